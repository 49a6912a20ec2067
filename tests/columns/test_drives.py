"""Value oracles for the tables of many trips, from the input and the other tables."""

from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pytest

import whichroad
from columns.test_path import town
from laws.public import START, degrees, metres

NAMES = ["plain", "another", "twice", "far", "bridged", "odometer", "blank"]


def along(n: int, first: float = 10.0, step: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
    """Latitudes and longitudes along the first two streets, right lane, noise of 1 m."""
    rng = np.random.default_rng(n)
    x = first + step * np.arange(n)
    y = np.interp(x, [0.0, 110.0, 200.0, 300.0, 400.0], [0.0, 20.0, 0.0, -15.0, 0.0])
    lon, lat = degrees(x, y - 1.75 + rng.normal(0.0, 1.0, n))
    return lat, lon


def trip(name: str, n: int, time: np.ndarray, **columns: Any) -> pd.DataFrame:
    lat, lon = along(n)
    return pd.DataFrame({"drive_id": name, "time": time, "lat": lat, "lon": lon, **columns})


@cache
def trips() -> pd.DataFrame:
    """Seven trips, of which one has odd rows, one is far from the map and one has no position."""
    second = np.arange(30.0)
    plain = trip("plain", 30, START + second, sigma_m=2.0)
    another = trip("another", 22, START + 50.0 + second[:22], sigma_m=2.0)
    twice = trip("twice", 25, START + 100.0 + np.array([0, 1, 1, 2, *range(3, 24)]), sigma_m=2.0)
    far = trip("far", 20, START + second[:20], sigma_m=2.0).assign(lat=12.0)
    bridged = trip("bridged", 30, START + second + 7200.0 * (second > 14), sigma_m=2.0)
    lon, lat = degrees(np.linspace(410, 590, 15), np.linspace(203, 227, 15))
    bridged.loc[15:, ["lat", "lon"]] = np.column_stack([lat, lon])
    fixes = trip("odometer", 20, START + 2.0 + second[:20], sigma_m=2.0)
    half = 0.5 * np.arange(44)
    wheels = pd.DataFrame({"drive_id": "odometer", "time": START + half + 0.25,
                           "odometer_m": 10.0 * half})  # fmt: skip
    both = pd.concat([fixes, wheels]).sort_values("time", kind="stable")
    blank = trip("blank", 5, START + second[:5]).assign(lat=np.nan, lon=np.nan)
    return pd.concat([plain, another, twice, far, bridged, both, blank], ignore_index=True)


@cache
def tables() -> dict[str, pd.DataFrame]:
    many = whichroad.match_many(trips(), town())
    return {
        "points": many.points.to_pandas(), "path": many.path.to_pandas(),
        "drives": many.drives.to_pandas().set_index("drive_id"),
    }  # fmt: skip


def of(table: str, name: str) -> pd.DataFrame:
    rows = tables()[table]
    return rows[rows.drive_id == name]


ANSWERED = ["plain", "another", "twice", "bridged", "odometer"]
EACH = pytest.mark.parametrize("name", ANSWERED)


def drive(name: str) -> Any:
    return tables()["drives"].loc[name]


def test_each_trip_has_a_row_and_unanswered_trips_have_a_reason():
    rows = tables()["drives"]
    assert rows.index.tolist() == NAMES
    assert rows.answered.tolist() == [True, True, True, False, True, True, False]
    assert rows.reason[ANSWERED].isna().all()
    assert "km from the map" in rows.reason["far"]
    assert "neither fixes nor odometry" in rows.reason["blank"]
    for name in ("far", "blank"):
        assert len(of("points", name)) == 0
        assert len(of("path", name)) == 0
        assert drive(name)[["epochs", "fixes", "epochs_without_answer"]].tolist() == [0, 0, 0]
        assert drive(name)[["duration_s", "path_m", "mean_p_road"]].isna().all()


@EACH
def test_epochs_and_fixes_are_those_of_the_input(name: str):
    given = trips()[trips().drive_id == name]
    times = given.time.drop_duplicates()
    fixes = given[given.lat.notna()].time.drop_duplicates()
    row, points = drive(name), of("points", name)
    assert row.epochs == len(points) == len(times)
    assert row.fixes == len(fixes)
    assert row.fixes < row.epochs or name != "odometer"
    before = (times < fixes.min()).sum()
    assert row.epochs_without_answer == points.lat.isna().sum() == before
    assert row.duration_s == pytest.approx(times.max() - times.min())
    said = points.time.astype("datetime64[ns, UTC]").astype("int64") * 1e-9
    np.testing.assert_allclose(said, np.sort(times), atol=1e-5)


@EACH
def test_the_path_s_figures_are_sums_over_its_rows(name: str):
    row, path = drive(name), of("path", name)
    assert path.seq.tolist() == list(range(len(path)))
    assert row.edges == len(path)
    assert row.gaps == (path.broken_rule == "gap").sum()
    assert row.path_m == pytest.approx((path.exit_m - path.enter_m).sum())
    given = trips()[(trips().drive_id == name) & trips().lat.notna()]
    x, y = metres(given.lon, given.lat)
    step = np.hypot(np.diff(x), np.diff(y))
    assert row.path_m == pytest.approx(step[step < 100.0].sum(), rel=0.15)
    assert row.gaps == (1 if name == "bridged" else 0)


@EACH
def test_mean_probabilities_are_means_over_answered_epochs(name: str):
    row, points = drive(name), of("points", name).dropna(subset=["lat"])
    assert row.mean_p_road == pytest.approx(points.p_road.mean(), abs=1e-12)
    assert row.mean_p_off_road == pytest.approx(points.p_off_road.mean(), abs=1e-12)
    assert 0.0 < row.mean_p_off_road < 0.2 < row.mean_p_road


def test_skipped_rows_are_counted_for_their_own_trip():
    skipped = tables()["drives"].skipped
    assert sum(count for _, count in skipped["twice"]) == 1
    for name in ("plain", "another", "bridged", "odometer"):
        assert len(skipped[name]) == 0
        assert len(drive(name).notes) == 0


def test_trips_in_one_batch_keep_their_names():
    """Trips of fixes only are filtered in one call."""
    rows = [trip(name, n, START + np.arange(float(n))) for name, n in (("b", 9), ("a", 14))]
    many = whichroad.match_many(pd.concat(rows), town())
    told = many.drives.to_pylist()
    assert [(row["drive_id"], row["epochs"]) for row in told] == [("b", 9), ("a", 14)]
    for row in told:
        points = many.points.filter(pc.equal(many.points["drive_id"], row["drive_id"]))
        path = many.path.filter(pc.equal(many.path["drive_id"], row["drive_id"]))
        assert points.num_rows == row["fixes"] == row["epochs"]
        assert path.num_rows == row["edges"]
        assert path["seq"].to_pylist() == list(range(path.num_rows))
        assert row["mean_p_road"] == pytest.approx(np.mean(points["p_road"].to_pylist()))


def test_unused_columns_are_noted():
    mine = trips()[trips().drive_id == "plain"].assign(bearing_deg=90.0)
    row = whichroad.match_many(mine, town()).drives.to_pylist()[0]
    note = "bearings not used: without a speed it is unknown whether they are valid"
    assert row["notes"] == [note]


@EACH
def test_a_trip_of_many_has_the_tables_of_the_trip_alone(name: str):
    alone = whichroad.match(trips()[trips().drive_id == name], town())
    many = whichroad.match_many(trips(), town())
    for table, one in ((many.points, alone.to_arrow()), (many.path, alone.path_arrow())):
        mine = np.array(table["drive_id"].to_pylist()) == name
        assert table.filter(mine).equals(one)
    row = {k: v for k, v in alone.summary.items() if k in tables()["drives"].columns}
    row.pop("skipped")
    row.pop("notes")
    for figure, value in row.items():
        assert drive(name)[figure] == pytest.approx(value)
    assert dict(drive(name).skipped) == alone.summary["skipped"]
    assert list(drive(name).notes) == alone.summary["notes"]


@EACH
def test_the_summary_counts_status_and_hypotheses_over_the_points(name: str):
    alone = whichroad.match(
        trips()[trips().drive_id == name], town(), mask=[(10.0, 14.0)] if name == "plain" else []
    )
    points, told = alone.to_arrow().to_pandas(), alone.summary
    assert told["drive_id"] == name
    assert told["status"] == pytest.approx(points.status.value_counts(normalize=True).to_dict())
    # masked fixes are epochs, 10, 11, ... 14 s
    assert told["fixes_masked"] == (5 if name == "plain" else 0)
    known = points.dropna(subset=["lat"])
    off = [row.p_off_road > max([a["p"] for a in row.alternatives], default=0.0)
           for row in known.itertuples()]  # fmt: skip
    assert told["off_road_epochs"] == sum(off)
    assert told["mean_live_hypotheses"] >= known.alternatives.map(len).mean()
