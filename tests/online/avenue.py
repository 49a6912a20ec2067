"""An avenue with crossings, a drive along it, and its readings one by one."""

from collections.abc import Iterator

import numpy as np

from scenes import Town, Truth, columns, drive_along, gnss, network
from whichroad.epochs import build_timeline
from whichroad.geodesy.plane import Plane
from whichroad.observations import (
    Drive,
    Fixes,
    GeoFix,
    Observation,
    WheelCounts,
    WheelTicks,
)
from whichroad.online import Estimate, Localizer
from whichroad.recorded import localize_recorded
from whichroad.settings import Vehicle
from whichroad.tables.status import STATUS

FIELDS = Fixes.__slots__


PLANE = Plane(49.4, 8.7)


CAR = Vehicle(track_width=1.5, metres_per_tick_left=0.01, metres_per_tick_right=0.01)


def avenue() -> list[np.ndarray]:
    """A street of 100 m blocks along x, crossed at each corner by a street of 200 m."""
    ahead = [np.array([[x, 0.0], [x + 100.0, 0.0]]) for x in np.arange(0.0, 1500.0, 100.0)]
    across = [
        np.array([[x, 0.0], [x, side * 100.0]])
        for x in np.arange(100.0, 1500.0, 100.0)
        for side in (1.0, -1.0)
    ]
    return [*ahead, *across]


TOWN = Town(network(avenue(), curvature=PLANE.curvature), PLANE)


STRAIGHT = drive_along([[20.0, -1.75], [1400.0, -1.75]])


def wheels(truth: Truth) -> WheelCounts:
    half = 0.75 * (truth.heading - truth.heading[0])
    return WheelCounts(truth.time, 100.0 * (truth.s - half), 100.0 * (truth.s + half))


def fixes(truth: Truth, at: np.ndarray, delay: float = 0.0, sigma: float = 3.0) -> Fixes:
    """Fixes at epochs `at`, made and stamped `delay` seconds later, at constant speed."""
    rows = gnss(truth, sigma=sigma)[at]
    heading = truth.heading[at]
    x = rows[:, 0] + 10.0 * delay * np.cos(heading)
    y = rows[:, 1] + 10.0 * delay * np.sin(heading)
    n = len(at)
    course_sigma = np.full(n, np.inf)
    course_sigma[0] = 6.0
    return Fixes(
        truth.time[at] + delay, *PLANE.to_geodetic(x, y), np.full(n, 9.0), np.full(n, 2.0),
        np.full(n, 6.0), np.full(n, 10.0), np.full(n, np.inf), np.degrees(np.pi / 2 - heading),
        course_sigma, np.zeros(n, np.uint8),
    )  # fmt: skip


def ticks(log: WheelCounts) -> list[WheelTicks]:
    columns = (log.time.tolist(), log.left.tolist(), log.right.tolist())
    return [WheelTicks(*row) for row in zip(*columns, strict=True)]


def records(log: WheelCounts, gnss_log: Fixes) -> Iterator[Observation]:
    """All readings in time order, wheels first."""
    columns = [getattr(gnss_log, name).tolist() for name in FIELDS if name != "flags"]
    fixed = [GeoFix(*row) for row in zip(*columns, strict=True)]
    yield from sorted([*ticks(log), *fixed], key=lambda r: r.time)


def said(estimates: dict[float, Estimate]) -> np.ndarray:
    return np.array(
        [
            (e.pose.x, e.pose.y, e.pose.heading, e.cov[0, 0], e.cov[1, 1], e.p_road, e.p_off_road,
             e.abscissa)
            for e in estimates.values() if e.answered
        ]
    )  # fmt: skip


def both_ways(log: WheelCounts, gnss_log: Fixes) -> tuple[dict[float, Estimate], np.ndarray, list]:
    """On-line estimates by time, the recorded drive's values and its edges and status."""
    online = Localizer(TOWN, vehicle=CAR)
    estimates = {r.time: online.update(r) for r in records(log, gnss_log)}
    assert online.skipped == {}
    timeline = build_timeline(Drive("d", gnss_log, log), PLANE, CAR)
    output = localize_recorded(TOWN, timeline, vehicle=CAR).output
    assert len(timeline.epochs) == len(estimates)
    edges = [
        (int(e) if e >= 0 else None, STATUS[s])
        for e, s in zip(output.rows.edge, output.rows.status, strict=True)
    ]
    return estimates, columns(output, "x y heading xx yy p_edge p_off_road s"), edges


def town_fix(x: float, y: float, time: float, **more: float) -> GeoFix:
    lat, lon = PLANE.to_geodetic(x, y)
    return GeoFix(time, lat, lon, 9.0, 0.0, 9.0, **more)


def driven_to(k: int) -> Localizer:
    """A localizer that has seen the straight drive up to epoch k, a fix each second."""
    online = Localizer(TOWN, vehicle=CAR)
    course = {"bearing_deg": 90.0, "sigma_bearing_deg": 6.0}
    for i, reading in enumerate(ticks(wheels(STRAIGHT))[: k + 1]):
        online.update(reading)
        if i % 10 == 0:
            online.update(town_fix(STRAIGHT.x[i], STRAIGHT.y[i], reading.time, **course))
    return online


def seen(first: int = 0, last: int = 600) -> list[Observation]:
    """Wheels and a fix each second."""
    return list(records(wheels(STRAIGHT), fixes(STRAIGHT, np.arange(0, 600, 10))))[first:last]
