"""Which delay fits the steps from fix to fix: some delays are tried beside the one that is learnt.

The filter of `vetting.delay_filter` is linear about its delay.  Where that is wrong by as much as
a brake takes, it learns from the wrong seconds, and is sure of a delay that is none.  Here each of
some delays is fixed, and scored by the steps:

    score += −½ |Δ fix − (place(t − d) − place(t' − d))|² / s²,    forgotten in 100 s

between two fixes at t' and t.  At a steady velocity all score alike.
"""

import math

import numpy as np

from ..._compile import Record, kernel

TRIED = 8  # delays,
_APART = 0.5  # s between them, from 0 on
_REMEMBERED = 100.0  # s
_MOST = 12.5  # nats that a step takes at most

DELAYS_TRIED = np.dtype(
    [
        ("place", "f8", (TRIED, 2)),  # by odometry at the last fix less the delay, m
        ("score", "f8", (TRIED,)),  # nats
    ],
    align=True,
)


@kernel
def forget_tried(tried: Record) -> None:
    """Begin: no delay fits better than another one."""
    for j in range(TRIED):
        tried.score[j] = 0.0


@kernel
def delay_of(j: int) -> float:
    """The delay that is tried, s."""
    return _APART * j


@kernel
def fade(tried: Record, since: float) -> None:
    """Forget, as time goes on."""
    for j in range(TRIED):
        tried.score[j] *= math.exp(-since / _REMEMBERED)


@kernel
def score(
    tried: Record, j: int, step: tuple[float, float], way: tuple[float, float], variance: float
) -> None:
    """Score a delay by a step between fixes, m, and the way by odometry that it would be of.

    The variance is that of each axis, m².
    """
    dx, dy = step[0] - way[0], step[1] - way[1]
    tried.score[j] -= min(0.5 * (dx * dx + dy * dy) / variance, _MOST)


@kernel
def refuted_by(tried: Record, delay: float) -> float:
    """Nats by which no delay fits the steps better than this one does, or one half a second off.

    A delay below half a second is not told from none: minus infinity.
    """
    if delay < _APART:
        return -math.inf
    j = int(min(max(delay / _APART, 0.0), TRIED - 1.0))
    return float(tried.score[0] - max(tried.score[j], tried.score[min(j + 1, TRIED - 1)]))
