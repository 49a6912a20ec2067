"""An odometer that is read as seldom as the places, as trackers tell it."""

from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest

from demands.test_trackers import M, road_map
from whichroad import Distance, GeoFix, Localizer, RoadMap, match

EVERY, SIGMA = 90.0, 4.0  # s, m
COLUMNS = ("time", "lat", "lon", "odometer_m")


@cache
def roads() -> RoadMap:
    """Eight squares in a row; each has a direct road and one around, which look alike in time."""
    lines = {"first": [(-900.0, 0.0), (0.0, 0.0)]}
    for k in range(8):
        x = 900.0 * k
        lines[f"direct {k}"] = [(x, 0.0), (x + 450.0, 0.0)]
        lines[f"around {k}"] = [(x, 0.0), (x, 90.0), (x + 450.0, 90.0), (x + 450.0, 0.0)]
        lines[f"on {k}"] = [(x + 450.0, 0.0), (x + 900.0, 0.0)]
    return road_map(lines)


def driven(seed: int, step: float = 10.0, scale: float = 1.01) -> tuple[dict[str, Any], list[str]]:
    """A drive that goes around half of the squares: a table of it, and the roads driven."""
    rng = np.random.default_rng(seed)
    around = rng.random(8) < 0.5
    places, names = [(-800.0, 0.0), (0.0, 0.0)], ["first"]
    for k in range(8):
        x = 900.0 * k
        places += [(x, 90.0), (x + 450.0, 90.0)] if around[k] else []
        places += [(x + 450.0, 0.0), (x + 900.0, 0.0)]
        names += [f"{'around' if around[k] else 'direct'} {k}", f"on {k}"]
    x, y = np.array(places).T
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    # fixes lie on the roads "on", one in each: where it is there tells nothing of the square
    at = [40.0, *(way[np.flatnonzero((x == 900.0 * (k + 1)) & (y == 0.0))[0]] - 225.0
                  for k in range(8))]  # fmt: skip
    s = np.array(at)
    noise = rng.normal(0.0, SIGMA, (2, len(s)))
    time = 1.6e9 + EVERY * np.arange(len(s))
    return {
        "time": time, "lat": (np.interp(s, way, y) + noise[0]) * M,
        "lon": (np.interp(s, way, x) + noise[1]) * M, "sigma_m": np.full(len(s), SIGMA),
        "odometer_m": np.floor(scale * s / step) * step + 54_300.0,
    }, names  # fmt: skip


def right(table: Any, names: list[str], lag: Any = "full") -> tuple[float, float]:
    """Share of the squares whose road is in the path, and P of that."""
    path = match(table, roads(), lag=lag).path
    squares = [name for name in names if name[:2] in ("di", "ar")][1:]
    found = path.set_index("source_id").p.groupby(level=0).max()
    return float(np.mean([n in found for n in squares])), float(found.reindex(squares).mean())


def pooled(change: Any, lag: Any = "full") -> tuple[float, float]:
    """The same over several drives, each changed before it is matched."""
    drives = [driven(seed) for seed in range(8)]
    both = np.array([right(change(dict(table)), names, lag) for table, names in drives])
    return tuple(both.mean(axis=0))


def without(table: dict[str, Any]) -> dict[str, Any]:
    """The same without the odometer."""
    return {name: values for name, values in table.items() if name != "odometer_m"}


@pytest.mark.parametrize("lag", [None, "full"])
def test_the_distance_between_two_places_tells_which_way_was_driven(lag: Any):
    share, p = pooled(lambda table: table, lag)
    assert share >= 0.98
    assert p >= 0.95
    assert pooled(without, lag)[0] < 0.6  # these ways look alike


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(lambda odometer: 0.0 * odometer, id="stands"),
        pytest.param(lambda odometer: odometer / 1000.0, id="kilometres"),
        pytest.param(lambda odometer: 4.7 * odometer, id="counts"),
    ],
)
def test_one_that_does_not_fit_the_places_is_named_and_not_used(wrong: Any):
    table, _ = driven(0)
    result = match({**table, "odometer_m": wrong(table["odometer_m"])}, roads(), lag="full")
    assert [finding.what for finding in result.diagnosis] == ["odometry: distance"]
    alone = match(without(table), roads(), lag="full")
    pd.testing.assert_frame_equal(result.points, alone.points)
    assert not match(table, roads()).diagnosis


def test_a_reading_that_is_wrong_and_one_that_is_set_back_cost_their_own_leg_alone():
    def spoilt(table: dict[str, Any]) -> dict[str, Any]:
        odometer = table["odometer_m"].copy()
        odometer[4:] += 400.0  # wheels have spun
        odometer[6:] -= 54_000.0
        return {**table, "odometer_m": odometer}

    assert pooled(spoilt)[0] >= 0.8


def test_kilometres_alone_say_little_and_do_no_harm():
    whole = pooled(lambda t: {**t, "odometer_m": np.floor(t["odometer_m"] / 1e3) * 1e3})
    assert whole == pytest.approx(pooled(without), abs=0.05)


def test_rows_without_a_place_keep_their_rows():
    table, _ = driven(1)
    more = {name: np.insert(values, 4, np.nan) for name, values in table.items()}
    more["time"][4] = table["time"][3] + 40.0
    more["odometer_m"][4] = table["odometer_m"][3] + 200.0
    assert len(match(pd.DataFrame(more), roads()).points) == len(table["time"]) + 1


def test_read_seldom_beside_fixes_of_each_second_it_spoils_nothing():
    """Between two readings a minute apart nobody drives evenly."""
    time = np.arange(400.0)
    speed = np.where(time % 80.0 < 40.0, 18.0, 2.0)
    s = np.cumsum(speed) - 700.0
    rng = np.random.default_rng(0)
    table = {
        "time": 1.6e9 + time, "lat": rng.normal(0.0, SIGMA, 400) * M,
        "lon": (s + rng.normal(0.0, SIGMA, 400)) * M, "sigma_m": np.full(400, SIGMA),
    }  # fmt: skip
    alone = match(table, roads()).points
    odometer = np.where(time % 60.0 == 0.0, s + 1000.0, np.nan)
    both = match({**table, "odometer_m": odometer}, roads()).points
    pd.testing.assert_frame_equal(both, alone)


@pytest.mark.parametrize("first", [True, False])
def test_on_line_it_is_used_whether_it_comes_before_the_fix_or_after(first: bool):
    """Read every 90 s, it was taken for motion.  The speed after a leg shows that it is not."""
    for seed in range(4):
        table, _ = driven(seed)
        localizer = Localizer(roads())
        speeds = []
        for time, lat, lon, odometer in zip(*map(table.get, COLUMNS), strict=True):
            read = Distance(time, odometer)
            fix = GeoFix(time=time, lat_deg=lat, lon_deg=lon, cov_ee=SIGMA**2, cov_nn=SIGMA**2)
            for one in (read, fix) if first else (fix, read):
                estimate = localizer.update(one)
            speeds.append(estimate.speed)
            localizer = Localizer.from_bytes(localizer.to_bytes(), roads())
        recorded = match(table, roads()).points.speed_mps
        np.testing.assert_allclose(speeds[3:], recorded[3:], atol=0.5)
        assert estimate.p_road > 0.9


@pytest.mark.parametrize("change", [1500.0, -400.0, 5000.0])
def test_a_reading_that_contradicts_its_leg_says_nothing_of_the_speed(change: float):
    table, _ = driven(0)
    odometer = table["odometer_m"].copy()
    odometer[4:] += change
    for lag in (None, "full"):
        speed = match({**table, "odometer_m": odometer}, roads(), lag=lag).points.speed_mps
        assert (np.abs(speed[3:] - 10.5) < 2.5).all()


@pytest.mark.parametrize("before", [5e-5, 1.0])
def test_readings_shortly_before_each_fix_are_those_of_the_fix(before: float):
    share = []
    for seed in range(4):
        table, names = driven(seed)
        read = pd.DataFrame(
            {"time": table["time"] - before, "odometer_m": table["odometer_m"] - 10.0 * before}
        )
        rows = pd.concat([pd.DataFrame(without(table)), read]).sort_values("time")
        share.append(right(rows.reset_index(drop=True), names)[0])
    assert np.mean(share) >= 0.9


def test_on_line_a_hole_of_an_odometer_without_fixes_is_no_rest():
    """It is read each second, and a tunnel has begun."""
    localizer = Localizer(road_map({"long": [(-500.0, 0.0), (9000.0, 0.0)]}))
    rng = np.random.default_rng(0)
    for t in np.arange(121.0):
        if not 95.0 < t < 106.0:
            estimate = localizer.update(Distance(1.6e9 + t, 20.0 * t))
        if t <= 80.0:
            lat, lon = rng.normal(0.0, SIGMA, 2) * M + np.array([0.0, 20.0 * t * M])
            localizer.update(
                GeoFix(time=1.6e9 + t, lat_deg=lat, lon_deg=lon, cov_ee=SIGMA**2, cov_nn=SIGMA**2)
            )
    assert abs(estimate.pose.lon / M - 2400.0) < 60.0
