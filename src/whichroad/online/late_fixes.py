"""Fixes that come after readings of odometry that are newer: moved on to now."""

import math
from typing import NamedTuple

import numpy as np

from ..filter.state import WHEELS, H, K
from .epoch_filter import EpochFilter


class Since(NamedTuple):
    """Motion of the antenna from a time on."""

    x: float  # plane m
    y: float
    turn: float  # rad
    sigma: float  # m, error of the place


def motion_since(now: EpochFilter, time: float) -> Since:
    """What the vehicle has moved by since a time that is past, as the odometry measured it.

    Where no turns are measured it is taken to have kept its speed and heading.

    Args:
        now: The filter, which has hypotheses.
        time: s, within the last seconds.
    """
    hyp = now.belief.hyp[: now.count]
    top, state = hyp[int(np.argmax(hyp["weight"]))], now.belief.state[0]
    heading, scale = float(top["mu"][H]), float(state["scale"])
    sigma = math.sqrt(float(top["cov"][H, H]))
    if now.mode != WHEELS:
        way = scale * now.speed * (now.time - time)
        return Since(way * math.cos(heading), way * math.sin(heading), 0.0, 0.0)
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


def _reckoned(now: EpochFilter, time: float) -> tuple[float, float, float]:
    """Place (m) and turn (rad) by odometry at a time, in its own frame."""
    latency = now.belief.state[0]["vetting"]["latency"]
    places, here, kept = latency["places"], latency["here"], int(latency["kept"])
    count = min(kept, len(places))
    order = np.arange(kept - count, kept) % len(places)
    times = np.append(places[order, 0], now.time)
    x, y, turn = (
        float(np.interp(time, times, np.append(places[order, column], here[column - 1])))
        for column in (1, 2, 4)
    )
    return x, y, turn
