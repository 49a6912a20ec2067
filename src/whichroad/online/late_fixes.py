"""Fixes that come after readings of odometry that are newer: moved on to now."""

import math
from typing import NamedTuple

import numpy as np

from ..filter.state import DISTANCE, WHEELS, H, K
from .epoch_filter import EpochFilter

_ACCELERATION = 1.5  # m/s², sigma of a speed's change that nobody has measured
_RADIUS, _ACROSS = 6.0, 3.0  # m, m/s²: the sharpest bend, and the most across the way in one


class Since(NamedTuple):
    """Motion of the antenna from a time on."""

    x: float  # plane m
    y: float
    turn: float  # rad
    sigma: float  # m, error of the place,
    turn_sigma: float = 0.0  # rad, of the turn,
    speed_sigma: float = 0.0  # m/s, and change of speed meanwhile


def motion_since(now: EpochFilter, time: float, course: tuple[float, float]) -> Since:
    """What the vehicle has moved by since a time that is past, as the odometry measured it.

    Where no turns are measured it is taken to have moved straight on, by its course then.

    Args:
        now: The filter, which has hypotheses.
        time: s, within the last seconds.
        course: Of the vehicle then, as a fix reports it, in the plane, and its sigma, rad.
    """
    hyp = now.belief.hyp[: now.count]
    top, state = hyp[int(np.argmax(hyp["weight"]))], now.belief.state[0]
    heading, scale = float(top["mu"][H]), float(state["scale"])
    sigma = math.sqrt(float(top["cov"][H, H]))
    if now.mode != WHEELS:
        return _unturned(now, time, (heading, sigma) if course[1] > math.pi else course)
    before, here = _reckoned(now, time), state["vetting"]["latency"]["here"]
    by, turn = heading - float(here[3]), float(here[3]) - before[2]
    c, s = float(top["mu"][K]) * math.cos(by), float(top["mu"][K]) * math.sin(by)
    dx, dy = float(here[0]) - before[0], float(here[1]) - before[1]
    error = math.hypot(sigma, math.sqrt(float(top["cov"][K, K]))) * math.hypot(dx, dy)
    ahead, left = (float(v) for v in now.ctx.par[0]["lever"])
    then = heading - turn
    swing = math.cos(heading) - math.cos(then), math.sin(heading) - math.sin(then)
    x = c * dx - s * dy + ahead * swing[0] - left * swing[1]
    y = s * dx + c * dy + ahead * swing[1] + left * swing[0]
    return Since(scale * x, scale * y, turn, error)


def _unturned(now: EpochFilter, time: float, heading: tuple[float, float]) -> Since:
    """The same straight on, with the error that this may have; heading and its sigma, rad."""
    hyp, state, late = now.belief.hyp[: now.count], now.belief.state[0], now.time - time
    top = hyp[int(np.argmax(hyp["weight"]))]
    faster = _ACCELERATION * late
    way, unsure = now.speed * late, 0.5 * faster * late
    measured = float(state["vetting"]["latency"]["here"][2]) - _reckoned(now, time)[3]
    if now.mode == DISTANCE and math.isfinite(measured):
        way = float(top["mu"][K]) * measured
        unsure = math.sqrt(float(top["cov"][K, K])) * abs(measured)
    bend = min(abs(way) / _RADIUS, _ACROSS * late * late / max(abs(way), _RADIUS))
    unsure = math.hypot(unsure, math.hypot(0.5 * bend, heading[1]) * way)
    way *= float(state["scale"])
    x, y = way * math.cos(heading[0]), way * math.sin(heading[0])
    return Since(x, y, 0.0, unsure, bend, faster)


def _reckoned(now: EpochFilter, time: float) -> tuple[float, float, float, float]:
    """Place (m), turn (rad) and way (m) by odometry at a time, in its own frame.

    Before the oldest place that is kept it is there; the way is NaN then.
    """
    latency = now.belief.state[0]["vetting"]["latency"]
    places, here, kept = latency["places"], latency["here"], int(latency["kept"])
    count = min(kept, len(places))
    order = np.arange(kept - count, kept) % len(places)
    times = np.append(places[order, 0], now.time)
    x, y, way, turn = (
        float(np.interp(time, times, np.append(places[order, column], here[column - 1])))
        for column in range(1, 5)
    )
    return x, y, turn, way if time >= times[0] else math.nan
