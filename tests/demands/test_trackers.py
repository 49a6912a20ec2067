"""What trackers and phones send: rows seconds apart, coarse first fixes, service roads, queues."""

from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
from shapely.geometry import LineString

from whichroad import RoadMap, match

M = 1.0 / 111_320.0  # degrees of a metre, at the equator
BEGIN = pd.Timestamp("2026-06-01T08:00Z")

Line = list[tuple[float, float]]  # m, east and north


def road_map(lines: dict[str, Line], **columns: list[str]) -> RoadMap:
    """Roads by name."""
    shapes = [LineString([(x * M, y * M) for x, y in line]) for line in lines.values()]
    table = gpd.GeoDataFrame({"id": list(lines), **columns}, geometry=shapes, crs=4326)
    return RoadMap.from_edges(table)


def rows(x: Any, y: Any, every: float, sigma: Any, **columns: Any) -> pd.DataFrame:
    """A table of fixes at places, m."""
    time = BEGIN + pd.to_timedelta(every * np.arange(len(x)), unit="s")
    return pd.DataFrame(
        {"time": time, "lat": np.asarray(y) * M, "lon": np.asarray(x) * M, "sigma_m": sigma}
        | columns
    )


def off(points: pd.DataFrame, x: Any, y: Any) -> np.ndarray:
    """How far answers are from places, m."""
    return np.hypot(points.lon / M - x, points.lat / M - y).to_numpy()


@pytest.mark.parametrize("lag", [None, "full"])
def test_who_creeps_on_in_a_queue_between_two_rows_is_followed(lag: Any):
    roads = road_map({
        "west": [(-900.0, 0.0), (615.0, 0.0)], "east": [(615.0, 0.0), (1500.0, 0.0)],
        "side": [(615.0, -300.0), (615.0, 0.0)],
    })  # fmt: skip
    moves, queue, there = np.arange(-800.0, 590.0, 100.0), [590.0] * 3, [625.0] * 12
    x = np.concatenate([moves, queue, there, np.arange(700.0, 1100.0, 100.0)])
    speed = np.where((x > 580.0) & (x < 650.0), 0.0, 10.0)
    noise = np.random.default_rng(1).normal(0.0, 1.5, (2, len(x)))
    table = rows(x + noise[0], noise[1], 10.0, 2.0, speed_mps=speed)
    points = match(table, roads, lag=lag).points
    assert (off(points, x, 0.0) < points.protection_level_m).all()
    stands = (x == 625.0) & (np.arange(len(x)) > len(moves) + 4)
    assert (points.source_id[stands] == "east").all()


@pytest.mark.parametrize("every", [1.0, 3.0, 5.0])
@pytest.mark.parametrize("speeds", [False, True])
def test_a_coarse_first_fix_does_not_spoil_the_fine_ones_after_it(every: float, speeds: bool):
    at = np.arange(-1000.0, 1100.0, 100.0)
    across = {f"h{n}": [(x, y) for x in at] for n, y in enumerate(at)}
    roads = road_map(across | {f"v{n}": [(x, y) for y in at] for n, x in enumerate(at)})
    x = -900.0 + 8.0 * np.arange(0.0, 120.0, every)
    noise = np.random.default_rng(2).normal(0.0, 2.0, (2, len(x)))
    noise[:, 0] = 280.0, -280.0
    sigma = np.where(np.arange(len(x)) == 0, 400.0, 3.0)
    more = {"speed_mps": 8.0} if speeds else {}
    points = match(rows(x + noise[0], noise[1], every, sigma, **more), roads).points
    away = off(points, x, 0.0)
    assert (away < points.protection_level_m).all()
    assert away[len(x) // 2 :].max() < 15.0
    assert (points.source_id[len(x) // 2 :] == "h10").all()


@pytest.mark.parametrize("every", [5.0, 10.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_service_road_beside_a_large_one_is_chosen_once_and_not_anew_at_each_fix(
    every: float, seed: int
):
    ends = [300.0 * n for n in range(9)]
    lines = {f"large{n}": [(x, 0.0), (x + 300.0, 0.0)] for n, x in enumerate(ends[:-1])}
    lines |= {f"small{n}": [(x, -12.0), (x + 300.0, -12.0)] for n, x in enumerate(ends[:-1])}
    lines |= {f"link{n}": [(x, 0.0), (x, -12.0)] for n, x in enumerate(ends)}
    roads = road_map(lines, highway=["primary"] * 8 + ["service"] * 17)
    x = 30.0 + 9.0 * np.arange(0.0, 250.0, every)
    noise = np.random.default_rng(seed).normal(0.0, 2.0, (2, len(x)))
    table = rows(x + noise[0], noise[1] - 13.5, every, 2.1)
    points = match(table, roads, lag="full").points
    large = points.source_id.str.startswith("large").fillna(False)
    assert not (large & (points.p_road >= 0.9)).any()
    assert points.source_id.str.startswith("small").fillna(False).mean() > 0.5
