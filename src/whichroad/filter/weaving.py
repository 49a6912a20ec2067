"""Fine fixes every metre or two: a vehicle that follows its road is seen to move by its heading.

Roads are drawn with corners, and vehicles drive arcs.  Between coarse or rare fixes the two are
alike.  Fine and frequent ones show every decimetre beside the line, and each of them would cost
the road something.  So the vehicle is taken to move by its heading, which comes back to its road's
within some metres (a Gauss-Markov process, integrated): as much for one second as for ten tenths.
"""

import math
from typing import NamedTuple

from .._compile import Matrix, Record, Vector, kernel
from ..graph.geometry import wrap
from ._simd import add_times
from .gnss.bias import is_fine
from .lookback.history import History, accumulate_noise
from .motion import Increment, Noise
from .state import DISTANCE, OFF_ROAD, WHEELS, Belief, H, K, N, X, Y

WOBBLE = 5.0  # m, over which a heading about the road's lasts
_LIGHT = 1e-3  # weight on roads below which headings are the usual ones
_YOUNG = 30.0  # s of fixes, before which they may be late beside an odometer
_OFTEN = 3.0  # m between fixes, up to which they show how a vehicle weaves


class Weave(NamedTuple):
    """What a heading about the road's does to a way along it."""

    ahead: float  # of the way, along the road, m
    aside: float  # to the left, m
    by_heading: tuple[float, float]  # derivatives of both by the heading, m
    by_rate: tuple[float, float]  # and by κ


@kernel
def is_seen_weaving(state: Record, metres: float) -> bool:
    """Whether fixes are so fine and frequent that a vehicle moves by its heading in this epoch.

    Args:
        state: Its usual interval of fixes counts, and the way since the last one.
        metres: Of the epoch.
    """
    if state.mode == WHEELS or state.knows_heading == 1 or not is_fine(state):
        return False
    if state.mode == DISTANCE and state.learnt_time < _YOUNG:
        return False
    usual = abs(state.speed) * state.fix_interval
    return bool(
        state.fix_interval > 0.0 and usual < _OFTEN and state.since_fix + metres < 2.0 * _OFTEN
    )


@kernel
def renew_about_road(belief: Belief, par: Record, odometer: float) -> None:
    """The variance of headings about roads is that of the last epoch, the usual one at least.

    What is left of it where several epochs make a step is the mean over the last metres.
    """
    state = belief.state[0]
    on = 0.0
    for i in range(state.count):
        on += belief.hyp[i].weight if belief.hyp[i].edge != OFF_ROAD else 0.0
    if state.weaves == 1 and on > _LIGHT:
        state.about_road[1] /= on
    state.about_road[0] = max(state.about_road[1], par.edge_heading_sigma**2)
    state.about_road[1] = 0.0
    new = 1.0 - math.exp(-2.0 * abs(odometer * state.speed) / WOBBLE)
    state.about_road[2] += new * (state.about_road[0] - state.about_road[2])


@kernel
def weave(mean: Vector, tangent: tuple[float, float], odometer: float) -> Weave:
    """The way of a vehicle by its heading, from its road's tangent.

    With a the angle between them, w = κ δ the way and φ = exp(-|w| / l), the heading comes back:

        ahead = w - b (1 - cos a),    aside = b sin a,    b = l (1 - φ) sign w
    """
    about = wrap(mean[H] - math.atan2(tangent[1], tangent[0]))
    sine, cosine = math.sin(about), math.cos(about)
    way = odometer * mean[K]
    kept = math.exp(-abs(way) / WOBBLE)
    b = math.copysign(WOBBLE * (1.0 - kept), way)
    by_rate = odometer * (1.0 - kept * (1.0 - cosine)), odometer * kept * sine
    return Weave(way - b * (1.0 - cosine), b * sine, (-b * sine, b * cosine), by_rate)


@kernel
def derivatives(
    way: Weave, tangent: tuple[float, float], odometer: float
) -> tuple[float, float, float, float]:
    """Derivatives of x and y by the heading, and by κ beside those of a way along the tangent."""
    tx, ty = tangent
    ahead, aside = way.by_heading
    x, y = ahead * tx - aside * ty, ahead * ty + aside * tx
    ahead, aside = way.by_rate[0] - odometer, way.by_rate[1]
    return x, y, ahead * tx - aside * ty, ahead * ty + aside * tx


@kernel
def turn_by_heading(
    hyp: Record, tangent: tuple[float, float], odometer: float, variance: float
) -> None:
    """The covariance of a hypothesis that moves by its heading, less what moves it by κ.

    Args:
        hyp: Not yet moved; in place.
        tangent: Of its road.
        odometer: δ.
        variance: σ², rad².
    """
    cov = hyp.cov
    way = weave(hyp.mu, tangent, odometer)
    x, y, u, v = derivatives(way, tangent, odometer)
    add_times(cov[X], x, cov[H])
    add_times(cov[X], u, cov[K])
    add_times(cov[Y], y, cov[H])
    add_times(cov[Y], v, cov[K])
    for i in range(K + 1, N):
        cov[i, X], cov[i, Y] = cov[X, i], cov[Y, i]
    cov[H, X], cov[H, Y] = cov[X, H], cov[Y, H]
    cov[K, X], cov[K, Y] = cov[X, K], cov[Y, K]
    for i in range(H):  # X and Y
        cov[i, X] += x * cov[i, H] + u * cov[i, K]
        cov[i, Y] += y * cov[i, H] + v * cov[i, K]
    add_weaving(cov, tangent, odometer * hyp.mu[K], variance)


@kernel
def add_weaving(cov: Matrix, tangent: tuple[float, float], way: float, variance: float) -> None:
    """Add the noise of a place by a heading that varies, with the heading's.

    The heading varies by σ² about the road's.  Over a way of w metres, with φ = exp(-w / l),

        across: σ² l² (2 w / l - 3 + 4 φ - φ²),    with the heading: σ² l (1 - φ)²
    """
    tx, ty = tangent
    kept, across = _across(way, variance)
    shared = math.copysign(variance * WOBBLE * (1.0 - kept) ** 2, way)
    cov[X, X] += across * ty * ty
    cov[Y, Y] += across * tx * tx
    cov[X, Y] -= across * tx * ty
    cov[Y, X] = cov[X, Y]
    cov[X, H] -= shared * ty
    cov[Y, H] += shared * tx
    cov[H, X] = cov[X, H]
    cov[H, Y] = cov[Y, H]


@kernel
def _across(way: float, variance: float) -> tuple[float, float]:
    """φ, and the variance across of `add_weaving`, m²."""
    metres = abs(way) / WOBBLE
    kept = math.exp(-metres)
    square = WOBBLE * WOBBLE * max(2.0 * metres - 3.0 + 4.0 * kept - kept * kept, 0.0)
    return kept, variance * square


@kernel
def as_on_roads(state: Record, noise: Noise, metres: float) -> Noise:
    """Process noise off the roads: headings vary there as on roads, so that neither is likelier."""
    if state.weaves == 0:
        return noise
    kept, across = _across(metres, state.about_road[0])
    heading = state.about_road[0] * (1.0 - kept * kept)
    return Noise(noise.along, noise.across + across, heading, noise.rate, 0.0, noise.cross)


@kernel(inline=True)
def note_motion_along(
    history: History, state: Record, odometer: float, noise: Noise, metres: float
) -> None:
    """Find out whether vehicles are seen to weave, and keep motion and noise for the smoother."""
    state.weaves = is_seen_weaving(state, metres)
    if len(history.steps) == 0:
        return
    history.since[0].drawn |= 2 if state.weaves == 1 else 1 - state.knows_heading
    move = Increment(odometer, 0.0, odometer, 0.0, odometer)
    accumulate_noise(history, move, as_on_roads(state, noise, metres))
