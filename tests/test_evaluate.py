"""Known errors give known scores."""

import itertools
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from scipy.spatial import cKDTree

from whichroad.cli.console import print_table
from whichroad.errors import DriveError, ReadError, SettingError
from whichroad.evaluate import (
    Evaluation,
    anees_band,
    calibration_error,
    compare,
    evaluate,
    evaluate_files,
    further_columns,
    pool,
    route_mismatch,
    score,
    score_files,
)
from whichroad.evaluate.score import COVERAGE, MEANINGS

LAT, LON = 49.41, 2.82
M_PER_DEG = 111_218.0  # of latitude there, within 1e-4
START = 1.78e9


def a_drive(n=1000, speed=10.0):
    """A drive due east at 10 Hz, over edges of 100 m."""
    time = START + 0.1 * np.arange(n)
    travelled = speed * 0.1 * np.arange(n)
    east = np.degrees(
        travelled / (6378137.0 / np.sqrt(1 - 6.69438e-3 * np.sin(np.radians(LAT)) ** 2))
    )
    truth = {
        "time": time,
        "lat": np.full(n, LAT),
        "lon": LON + east / np.cos(np.radians(LAT)),
        "bearing_deg": np.full(n, 90.0),
        "edge_id": (travelled // 100).astype(int),
        "abscissa_m": travelled % 100,
        "speed_mps": np.full(n, speed),
        "on_road": np.ones(n, bool),
        "travelled_m": travelled,
    }
    points = {
        k: truth[k].copy() for k in ("time", "lat", "lon", "bearing_deg", "edge_id", "abscissa_m")
    }
    points |= {
        "cov_ee_m2": np.full(n, 4.0),
        "cov_en_m2": np.zeros(n),
        "cov_nn_m2": np.full(n, 4.0),
        "sigma_bearing_deg": np.full(n, 2.0),
        "p_road": np.full(n, 0.9),
        "p_off_road": np.full(n, 0.02),
    }
    return points, truth


def test_a_perfect_answer_has_no_error():
    points, truth = a_drive()
    e = evaluate(points, truth)
    assert e.rmse_m == pytest.approx(0, abs=1e-6)
    assert e.heading_rmse_deg == pytest.approx(0, abs=1e-9)
    assert e.abscissa_rmse_m == pytest.approx(0, abs=1e-9)
    assert e.anees == pytest.approx(0, abs=1e-9)
    assert (e.right_edge, e.right_edge_strict, e.coverage) == (1.0, 1.0, (1.0,) * 4)
    assert e.brier == pytest.approx(0.01)
    assert e.calibration_error == pytest.approx(0.1)
    assert "map_rmse_m" not in e.figures()  # the tables do not have it
    assert (e.p_off_on_road, e.p_off_off_road, e.outage) == (pytest.approx(0.02), 0.0, None)


def test_a_shift_north_is_to_the_left_of_driving_east():
    points, truth = a_drive()
    points["lat"] = points["lat"] + 3.0 / M_PER_DEG
    e = compare(points, truth)
    assert e.cross == pytest.approx(-3.0, abs=1e-3)
    assert e.along == pytest.approx(0.0, abs=1e-3)
    figures = score(e)
    assert figures.rmse_m == pytest.approx(3.0, abs=1e-3)
    assert figures.cross_rmse_m == pytest.approx(3.0, abs=1e-3)
    assert figures.anees == pytest.approx(9.0 / 4.0 / 2.0, rel=1e-3)


def test_a_bearing_too_far_clockwise_is_a_heading_too_small_even_across_north():
    points, truth = a_drive()
    truth["bearing_deg"] = np.full(1000, 359.0)
    points["bearing_deg"] = np.full(1000, 1.0)
    assert np.degrees(compare(points, truth).heading) == pytest.approx(-2.0)


def test_an_honest_gaussian_is_honest():
    points, truth = a_drive(20_000)
    random = np.random.default_rng(1)
    cov = np.array([[9.0, 4.0], [4.0, 4.0]])
    east, north = np.linalg.cholesky(cov) @ random.normal(size=(2, 20_000))
    points["lat"] = points["lat"] + north / M_PER_DEG
    points["lon"] = points["lon"] + east / M_PER_DEG / np.cos(np.radians(LAT)) * (111_218 / 111_505)
    points["bearing_deg"] = points["bearing_deg"] + 2.0 * random.normal(size=20_000)
    for name, value in (("ee", 9.0), ("en", 4.0), ("nn", 4.0)):
        points[f"cov_{name}_m2"] = np.full(20_000, value)
    e = evaluate(points, truth)
    low, high = anees_band(20_000, 2, z=3.3)
    assert low < e.anees < high
    low, high = anees_band(20_000, 3, z=3.3)
    assert low < e.anees_pose < high
    for said, found in zip((0.5, 0.9, 0.95, 0.99), e.coverage, strict=True):
        assert found == pytest.approx(said, abs=3.3 * np.sqrt(said * (1 - said) / 20_000))
    assert e.heading_rmse_deg == pytest.approx(2.0, rel=0.02)


def test_an_edge_is_right_within_ten_metres_of_travel():
    points, truth = a_drive()
    # every change is announced 0.8 s, 8 m, too early
    points["edge_id"] = np.append(truth["edge_id"][8:], [truth["edge_id"][-1]] * 8)
    e = evaluate(points, truth)
    assert e.right_edge == 1.0
    assert e.right_edge_strict == pytest.approx(1.0 - 9 * 8 / 1000)
    # and 15 m too early: 5 m are wrong at each of nine changes
    points["edge_id"] = np.append(truth["edge_id"][15:], [truth["edge_id"][-1]] * 15)
    assert evaluate(points, truth).right_edge == pytest.approx(1.0 - 9 * 4.5 / 1000, abs=0.006)


def test_slack_counts_travel_and_not_time():
    points, truth = a_drive()
    for table in (points, truth):  # a minute of standing just before an edge ends
        for name, values in table.items():
            table[name] = np.concatenate([values[:99], np.repeat(values[98], 600), values[99:]])
        table["time"] = START + 0.1 * np.arange(1600)
    points["edge_id"] = np.where(points["edge_id"] == 0, 1, points["edge_id"])
    wrong = ~compare(points, truth).right
    assert wrong.sum() == pytest.approx(90, abs=2)


def test_off_road_is_right_off_the_roads_only():
    points, truth = a_drive()
    truth["on_road"][500:] = False
    points["edge_id"] = np.full(1000, np.nan)
    points["p_off_road"] = np.where(truth["on_road"], 0.1, 0.8)
    points["p_road"] = np.full(1000, np.nan)
    e = evaluate(points, truth)
    assert e.right_edge == pytest.approx(0.5, abs=0.011)
    assert (e.p_off_on_road, e.p_off_off_road) == (pytest.approx(0.1), pytest.approx(0.8))
    assert (e.brier, e.calibration_error) == (0.0, 0.0)  # no road was ever named


def test_outages_are_scored_by_themselves():
    points, truth = a_drive()
    points["lat"][200:300] += 5.0 / M_PER_DEG
    e = evaluate(points, truth, mask=[(START + 20.0 - 1e-6, START + 29.95)])
    assert e.outage is not None
    assert e.outage.epochs == 100
    assert e.outage.rmse_m == pytest.approx(5.0, abs=2e-3)
    assert e.rmse_m == pytest.approx(5.0 * np.sqrt(0.1), rel=1e-3)
    assert e.figures()["outage_rmse_m"] == e.outage.rmse_m
    truth["outage"] = (np.arange(1000) >= 200) & (np.arange(1000) < 300)
    assert evaluate(points, truth).outage == e.outage


def test_the_beginning_and_standstill_can_be_left_out():
    points, truth = a_drive()
    truth["speed_mps"][-100:] = 0.0
    assert evaluate(points, truth, skip_s=20.0, moving=True).epochs == 700


def test_truth_and_answer_need_not_have_the_same_times():
    points, truth = a_drive()
    sparse = {name: values[3::10] for name, values in points.items()}
    truth = {name: values[::2] for name, values in truth.items()}
    e = evaluate(sparse, truth)
    assert e.epochs == 100
    assert e.rmse_m == pytest.approx(0, abs=1e-4)
    assert e.abscissa_rmse_m == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("form", ["pandas", "arrow", "iso"])
def test_every_kind_of_table_scores_the_same(form):
    points, truth = a_drive()
    points["lat"] = points["lat"] + 2.0 / M_PER_DEG
    expected = evaluate(points, truth)
    stamps = pd.to_datetime(np.round(points["time"] * 1e6).astype(np.int64), unit="us", utc=True)
    frame = pd.DataFrame(points).assign(time=stamps)
    if form == "arrow":
        found = evaluate(pa.Table.from_pandas(frame), truth)
    elif form == "iso":
        found = evaluate(frame.assign(time=stamps.strftime("%Y-%m-%dT%H:%M:%S.%fZ")), truth)
    else:
        found = evaluate(frame, truth)
    assert found.figures() == pytest.approx(expected.figures())


def test_a_truth_of_places_alone_has_errors_and_says_nothing_of_edges():
    points, truth = a_drive()
    points["lat"] += 3.0 / M_PER_DEG
    places = {name: truth[name] for name in ("time", "lat", "lon")}
    got, whole = evaluate(points, places), evaluate(points, truth)
    assert got.cross_rmse_m == pytest.approx(whole.cross_rmse_m, abs=1e-6)
    assert got.heading_rmse_deg == pytest.approx(0.0, abs=0.01)
    told = set(whole.figures()) - set(got.figures())
    assert told == {
        "right_edge", "right_edge_strict", "abscissa_rmse_m", "brier", "calibration_error", "sure",
        "sure_wrong",
    }  # fmt: skip


COLUMNS = {  # of an answer, and the figures that each adds to time, lat and lon
    "bearing_deg": {"heading_rmse_deg"},
    "cov_ee_m2 cov_en_m2 cov_nn_m2": {"anees", *(f"inside_{q}" for q in ("50", "90", "95", "99"))},
    "sigma_bearing_deg": {"anees_pose"},  # with both before
    "edge_id": {"right_edge", "right_edge_strict"},
    "abscissa_m": {"abscissa_rmse_m"},
    "p_road": {"brier", "calibration_error", "sure", "sure_wrong"},
    "p_off_road": {"p_off_on_road", "p_off_off_road"},
}


def shaken():
    """A drive and an answer with errors of every kind."""
    points, truth = a_drive()
    random = np.random.default_rng(5)
    n = len(points["time"])
    points["lat"] += random.normal(0.0, 2.0, n) / M_PER_DEG
    points["bearing_deg"] += random.normal(0.0, 2.0, n)
    points["abscissa_m"] += random.normal(0.0, 1.0, n)
    points["edge_id"][::7] = 99
    points["p_road"] = random.uniform(0.3, 1.0, n)
    return points, truth


def test_an_answer_of_places_alone_has_errors_and_each_further_column_adds_its_figures():
    points, truth = shaken()
    whole = evaluate(points, truth).figures()
    given = {name: points[name] for name in ("time", "lat", "lon")}
    figures = evaluate(given, truth).figures()
    assert set(figures) == {
        "epochs", "rmse_m", "median_m", "p95_m", "along_rmse_m", "cross_rmse_m",
    }  # fmt: skip
    for columns, added in COLUMNS.items():
        assert set(further_columns(figures)) & set(columns.split())
        given |= {name: points[name] for name in columns.split()}
        more = evaluate(given, truth).figures()
        assert set(more) - set(figures) == added
        assert {name: whole[name] for name in more} == pytest.approx(more)
        figures = more
    assert figures == pytest.approx(whole)
    assert further_columns(figures) == {}


def test_a_round_sigma_is_a_covariance():
    points, truth = shaken()
    given = {name: points[name] for name in ("time", "lat", "lon")}
    round_ = evaluate(given | {"sigma_m": np.full(1000, 2.0)}, truth)
    assert round_.anees == pytest.approx(evaluate(points, truth).anees)


@pytest.mark.parametrize("kind", [str, float, lambda v: v])
def test_roads_of_the_source_are_compared_where_edges_are_not_known(kind):
    points, truth = shaken()
    ways = np.arange(100) * 1000 + 7  # way of an edge
    given = {name: points[name] for name in ("time", "lat", "lon", "p_road")}
    given["source_id"] = np.array([kind(int(v)) for v in ways[points["edge_id"]]], dtype=object)
    own = {name: truth[name] for name in truth if name != "edge_id"}
    own["source_id"] = ways[truth["edge_id"]]
    got, whole = evaluate(given, own), evaluate(points, truth)
    assert got.right_edge == whole.right_edge < 0.9
    assert got.brier == pytest.approx(whole.brier)
    nothing = evaluate(given, truth)  # the truth has edges, and the answer roads of the source
    assert np.isnan(nothing.right_edge)


def test_drives_of_an_answer_of_places_alone_are_pooled():
    points, truth = shaken()
    one = compare({name: points[name] for name in ("time", "lat", "lon")}, truth)
    assert score(pool([one, one])).figures() == pytest.approx(
        score(one).figures() | {"epochs": 2000}
    )


def test_the_course_of_a_truth_that_stands_is_the_last_one():
    points, truth = a_drive()
    places = {name: truth[name].copy() for name in ("time", "lat", "lon")}
    places["lon"][600:], places["lon"][:100] = places["lon"][600], places["lon"][100]
    assert evaluate(points, places).heading_rmse_deg == pytest.approx(0.0, abs=0.01)


def test_epochs_without_a_position_are_left_out():
    points, truth = a_drive()
    points["lat"][:100] = np.nan
    assert evaluate(points, truth).epochs == 900


def test_a_covariance_that_is_none_counts_as_the_cap():
    points, truth = a_drive()
    points["cov_ee_m2"][0] = 0.0
    assert evaluate(points, truth).anees == pytest.approx(1e4 / 1000 / 2)


def test_drives_are_pooled_by_their_epochs():
    points, truth = a_drive()
    one = compare(points, truth)
    assert score(pool([one, one])).figures() == pytest.approx(
        score(one).figures() | {"epochs": 2000}
    )


def test_the_calibration_error_of_an_honest_forecast_is_small():
    random = np.random.default_rng(2)
    p = random.random(20_000)
    honest = calibration_error(p, random.random(20_000) < p)
    assert honest < 11 * 0.5 / np.sqrt(20_000)  # eleven bins, each within its own standard error
    assert calibration_error(np.full(100, 0.9), np.arange(100) < 60) == pytest.approx(0.3)


def test_what_cannot_be_compared_is_refused():
    points, truth = a_drive()
    with pytest.raises(DriveError, match="are they of one drive"):
        evaluate(points | {"time": points["time"] + 1e6}, truth)
    with pytest.raises(ReadError, match="no column 'lat'"):
        evaluate({"time": points["time"]}, truth)
    with pytest.raises(ReadError, match=r"lat .*numbers were expected"):
        evaluate(points | {"lat": np.array(["north"] * 1000)}, truth)
    with pytest.raises(ReadError, match="ISO 8601"):
        evaluate(points | {"time": np.array(["noon"] * 1000)}, truth)
    with pytest.raises(DriveError, match="2 drives"):
        evaluate(points | {"drive_id": np.array(["a", "b"] * 500)}, truth)
    with pytest.raises(DriveError, match="no epoch is left"):
        evaluate(points, truth, skip_s=1e6)


def test_files_are_compared_by_their_suffix(tmp_path):
    points, truth = a_drive()
    pa.csv.write_csv(pa.table(points), tmp_path / "points.csv")
    pa.parquet.write_table(pa.table(truth), tmp_path / "truth.parquet")
    figures = evaluate_files(tmp_path / "points.csv", tmp_path / "truth.parquet")
    text = pd.read_csv(tmp_path / "points.csv").to_csv(index=False, sep=";", decimal=",")
    (tmp_path / "excel.csv").write_text(f"sep=;\n{text}")
    assert evaluate_files(tmp_path / "excel.csv", tmp_path / "truth.parquet") == figures
    assert figures["right_edge"] == 1.0
    assert figures["inside_95"] == 1.0
    with pytest.raises(ReadError, match="names no table"):
        evaluate_files(tmp_path / "points.gpx", tmp_path / "truth.parquet")
    (tmp_path / "bad.parquet").write_bytes(b"no")
    with pytest.raises(ReadError, match="a table of points was expected"):
        evaluate_files(tmp_path / "bad.parquet", tmp_path / "truth.parquet")


@pytest.fixture
def written(tmp_path):
    """An answer with names of its own, and the folder of its truth."""
    points, truth = shaken()
    table = pa.table({"ts": points["time"], **{n: v for n, v in points.items() if n != "time"}})
    pa.csv.write_csv(table, tmp_path / "mine.csv")
    pa.parquet.write_table(pa.table(truth), tmp_path / "truth.parquet")
    return tmp_path / "mine.csv", tmp_path, points, truth


def test_a_masked_minute_has_figures_of_its_own(written):
    answer, folder, points, truth = written
    scored = score_files(answer, folder, mask=[(20.0, 40.0)], columns={"time": "ts"})
    begin = points["time"][0]
    wanted = evaluate(points, truth, mask=[(begin + 20.0, begin + 40.0)]).figures()
    assert scored.figures == pytest.approx(wanted)
    assert scored.figures["outage_epochs"] == 201
    with pytest.raises(SettingError, match="no epoch of the result is between 5,000 and"):
        score_files(answer, folder, mask=[(5e3, 6e3)], columns={"time": "ts"})


def test_a_column_that_is_not_there_is_named(written):
    answer, folder, *_ = written
    with pytest.raises(ReadError, match=r"mine.csv: no column 'time'.*--columns time=COLUMN"):
        score_files(answer, folder)
    with pytest.raises(ReadError, match=r"no column 'tz' for time .*ts, "):
        score_files(answer, folder, columns={"time": "tz"})
    with pytest.raises(ReadError, match=r"'tmie' is no column .*did you mean time"):
        score_files(answer, folder, columns={"tmie": "ts"})
    with pytest.raises(ReadError, match=r"without points.arrow or points.parquet"):
        score_files(folder, folder)


def test_hints_name_the_table_that_lacks_a_column():
    points, truth = shaken()
    own = {name: truth[name] for name in truth if name not in ("edge_id", "abscissa_m")}
    figures = evaluate(points, own).figures()
    hints = further_columns(figures, set(points), set(own))
    assert hints == {"edge_id of the truth": "right_edge"}


def test_two_different_drives_are_not_compared_in_silence(written):
    answer, folder, points, truth = written
    away = truth | {"lat": truth["lat"] + 0.01}
    pa.parquet.write_table(pa.table(away), folder / "truth.parquet")
    [note] = score_files(answer, folder, columns={"time": "ts"}).notes
    assert "a result and a truth of one drive were expected" in note
    ends = np.concatenate([truth["time"][:50] - 86_400.0, truth["time"][-50:] + 86_400.0])
    around = {name: np.concatenate([v[:50], v[-50:]]) for name, v in truth.items()}
    with pytest.raises(DriveError, match="are they of one drive"):
        evaluate(points, around | {"time": ends})


LINE = np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 200.0]])


def test_the_same_route_cut_otherwise_has_no_mismatch():
    cut = [
        LINE[:2],
        np.array([[300.0, 0.0], [300.0, 77.7]]),
        np.array([[300.0, 77.7], [300.0, 200.0]]),
    ]
    found = route_mismatch([LINE], [LINE], cut)
    assert found == (0.0, 0.0, pytest.approx(500.0))
    assert found.fraction == 0.0


def test_missed_and_extra_lengths_are_counted_apart():
    answer = [np.array([[0.0, 0.0], [300.0, 0.0], [500.0, 0.0]])]
    missed, extra, driven = route_mismatch([LINE], [LINE], answer)
    assert missed == pytest.approx(200.0, abs=5.0)  # the corner is near enough for 3 m
    assert extra == pytest.approx(200.0, abs=5.0)
    assert driven == pytest.approx(500.0)


def test_the_opposite_direction_is_another_road():
    missed, extra, _ = route_mismatch([LINE], [LINE], [LINE[::-1]])
    assert (missed, extra) == (pytest.approx(500.0, abs=5), pytest.approx(500.0, abs=5))


def test_whole_first_and_last_edges_cost_nothing():
    part = np.array([[100.0, 0.0], [300.0, 0.0], [300.0, 50.0]])
    assert route_mismatch([part], [LINE], [LINE])[:2] == (0.0, 0.0)


def test_no_answer_misses_everything():
    assert route_mismatch([LINE], [LINE], [])[:2] == (pytest.approx(500.0), 0.0)
    assert route_mismatch([LINE], [LINE], [LINE[:1]])[:2] == (pytest.approx(500.0), 0.0)


def test_mismatch_agrees_with_a_search_over_all_samples():
    random = np.random.default_rng(3)
    lines = [np.cumsum(random.normal(0, 20, (30, 2)), axis=0) for _ in range(2)]
    moved = [lines[0] + random.normal(0, 2.5, (30, 2)), lines[1] + 40.0]

    def embed(parts):
        rows = []
        for p in parts:
            for a, b in itertools.pairwise(p):
                size = np.hypot(*(b - a))
                n = int(np.ceil(size))
                at = a + ((np.arange(n) + 0.5) / n)[:, None] * (b - a)
                way = np.tile(3.0 * (b - a) / size, (n, 1))  # 60 degrees: a chord of 3 m
                rows.append(np.column_stack([at, way, np.full(n, size / n)]))
        return np.concatenate(rows)

    a, b = embed(lines), embed(moved)
    apart = cKDTree(b[:, :4]).query(a[:, :4])[0]
    assert route_mismatch(lines, lines, moved).missed == pytest.approx(
        a[apart > 3 * np.sqrt(2), 4].sum()
    )


@pytest.mark.data
def test_mismatch_agrees_with_the_peers_scores(data_folder):
    peers = data_folder.parent / "bench" / "peers"
    if not (peers / "metrics.py").is_file():
        pytest.skip(f"the peers' scores are not here: {peers}")
    sys.path.insert(0, str(peers))
    try:
        import metrics
    finally:
        sys.path.remove(str(peers))
    random = np.random.default_rng(4)
    true = [np.cumsum(random.normal(0, 30, (60, 2)), axis=0)]
    found = [
        true[0] + random.normal(0, 2.0, (60, 2)),
        np.cumsum(random.normal(0, 30, (20, 2)), axis=0),
    ]
    assert route_mismatch(true, true, found) == pytest.approx(
        metrics.route_mismatch(true, true, found)
    )
    assert Path(metrics.__file__).parent == peers


def test_every_figure_has_a_meaning_and_no_meaning_is_left_over():
    names = {f.name for f in fields(Evaluation)} - {"coverage", "outage"}
    assert MEANINGS.keys() == names | {f"inside_{100 * c:g}" for c in COVERAGE}


def test_figures_are_printed_with_units_and_meanings(capsys):
    figures = {"rmse_m": 2.5, "outage_heading_rmse_deg": 1.0, "odd_words": 3}
    print_table("a against b", figures.items(), MEANINGS)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "a against b",
        "  rmse                 2.5 m      position error (RMS)",
        "  outage heading rmse  1 degrees  error of the bearing (RMS)",
        "  odd words            3",
    ]
