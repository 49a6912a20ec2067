"""One fix in 50 is wrong by 20 to 200 m: what does it cost over the drive without that fix?"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from whichroad.evaluate import route_mismatch

from .. import Figure, Options, interval, share
from . import between, matched

SHARE = 0.02  # of the fixes
WRONG_M = (20.0, 200.0)
DRAWS = {1: 1, 5: 1, 10: 2, 30: 5, 60: 5}  # of the wrong fixes of a drive, by s between fixes


def spoiled(trace: Any, rng: Any) -> tuple[Any, Any] | None:
    """A trace with wrong fixes, and the same without these; None: all fixes are right."""
    n = len(trace.t)
    bad = rng.random(n) < SHARE
    bad[[0, -1]] = False
    if not bad.any():
        return None
    away = np.where(bad, rng.uniform(*WRONG_M, n), 0.0)
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    metre = 180.0 / (np.pi * 6_371_000.0)  # degrees
    lat = trace.lat + metre * away * np.sin(angle)
    lon = trace.lon + metre * away * np.cos(angle) / np.cos(np.radians(trace.lat))
    columns = {name: getattr(trace, name)[~bad] for name in ("t", "lat", "lon")}
    return replace(trace, lat=lat, lon=lon), replace(trace, **columns)


def mismatch(options: Options, m: matched.Matched) -> tuple[float, float]:
    """Metres wrong and metres driven."""
    truth = [line for line in between.true_lines(options, m) if len(line) > 1]
    answer = []
    for wkb in m.path_rows["geometry"].to_numpy(zero_copy_only=False):
        lon, lat = np.asarray(shapely.from_wkb(wkb).coords)[:, :2].T
        answer.append(np.column_stack(m.roads.plane.from_geodetic(lat, lon)))
    missed, extra, length = route_mismatch(truth, truth, answer)
    return missed + extra, length


def pairs(options: Options, traces: Iterator[Any], every: int) -> list[tuple[float, float, float]]:
    """Of each draw: metres wrong with and without the wrong fixes, and metres driven.

    A draw without a wrong fix is the drive as it is.
    """
    found = []
    for number, (name, roads, trace, truth) in enumerate(traces):

        def wrong(
            one: Any, name: str = name, roads: Any = roads, truth: Any = truth
        ) -> tuple[float, float]:
            return mismatch(options, matched.answer(name, roads, one, "full", truth))

        sound, length = wrong(trace)
        for draw in range(DRAWS[every]):
            two = spoiled(trace, np.random.default_rng([number, every, draw]))
            if two is None:
                found.append((sound, sound, length))
                continue
            bad, without = wrong(two[0])[0], wrong(two[1])[0]
            found.append((bad, without, length))
            if bad > without + 300.0:
                options.say(f"  {name}, draw {draw}: {without:.0f} to {bad:.0f} m wrong")
    return found


def measure(options: Options) -> list[Figure]:
    """Real tracks and Heidelberg at each rate."""
    sources: dict[str, Callable[..., Iterator[Any]]] = {
        "real": matched.real_traces, "Heidelberg": matched.city_traces,
    }  # fmt: skip
    figures = []
    for name, traces in sources.items():
        if name not in options.more.get("classes", "real,Heidelberg").split(","):
            continue
        for every in matched.intervals(options):
            rows = np.array(pairs(options, traces(options, every), every))
            more = np.column_stack([rows[:, 0] - rows[:, 1], rows[:, 2]])
            title = f"wrong fixes, {name} {every} s"
            ends, without = interval(share, more), share(rows[:, [1, 2]])
            figures += [
                Figure(f"{title}: mismatch more", share(more), "<= 0.1", "%", len(rows), ends),
                Figure(f"{title}: mismatch without them", without, "", "%", len(rows)),
            ]
    return figures
