"""How slow states age: lane offset and map error by distance, the GNSS error by time.

Each is a Gauss-Markov process, x⁺ = x̄ + φ (x − x̄) + w with w ~ (1 − φ²) σ².
"""

import math
from typing import NamedTuple

from .._compile import Matrix, Record, Vector, kernel
from ._simd import new_row, scale_by, set_times
from .state import GX, GY, MX, MY, D, N


@kernel
def decay(
    mean: Vector, cov: Matrix, state: int, target: float, keep: float, variance: float
) -> None:
    """One Gauss-Markov step of a slow state: x⁺ = x̄ + φ (x − x̄) + w, w ~ (1 − φ²) σ²."""
    mean[state] = target + keep * (mean[state] - target)
    row = cov[state]
    own = keep * keep * row[state]
    set_times(row, keep, row)
    row[state] = own + (1.0 - keep * keep) * variance
    for j in range(N):
        cov[j, state] = row[j]


class MapDecay(NamedTuple):
    """Decay factors φ of the map's slow states in a Gauss-Markov step."""

    lane: float
    map: float


@kernel
def map_decay(par: Record, rate: float, metres: float) -> MapDecay:
    """φ over a distance (m): exp(−distance / length); `rate` is that of the map's error."""
    return MapDecay(math.exp(-metres / par.lane_length), keep_map(par, rate, metres))


@kernel
def keep_map(par: Record, rate: float, metres: float) -> float:
    """What is kept of the map's error over a distance (m): exp(−rate distance / length).

    Its local part alone varies.  What is not known of its mean lasts, so the rate is the local
    part's share of the variance.
    """
    return math.exp(-rate * metres / par.map_length)


@kernel
def keep_lane(par: Record, kept: float, lane_sigma: float) -> float:
    """What is kept of the lane offset where its sigma is another, `kept` where it is usual.

    Between changes of lane vehicles vary alike on wide roads and narrow ones: the variance of an
    increment, 2 σ² / length a metre, is the same.  So the length grows with σ².
    """
    if lane_sigma == par.lane_sigma:
        return kept
    return float(kept ** ((par.lane_sigma / lane_sigma) ** 2))


@kernel
def decay_map(
    mean: Vector, cov: Matrix, par: Record, usual: Record, kept: MapDecay, lane: float,
    lane_sigma: float,
) -> None:  # fmt: skip
    """Gauss-Markov step of the lane offset and the map's error.

    Args:
        mean: State, (N,), in place.
        cov: Covariance, (N, N), in place.
        par: The parameters.
        usual: The map's error, as learnt.
        kept: φ of both.
        lane: Usual lane offset here, m.
        lane_sigma: Its sigma, m.
    """
    keep = new_row()
    for i in range(N):
        keep[i] = 1.0
    in_lane = keep_lane(par, kept.lane, lane_sigma)
    keep[D] = in_lane
    keep[MX] = kept.map
    keep[MY] = kept.map
    for i in range(N):
        scale_by(cov[i], keep[i], keep)
    mean[D] = lane + in_lane * (mean[D] - lane)
    mean[MX] = usual.whole[0] + kept.map * (mean[MX] - usual.whole[0])
    mean[MY] = usual.whole[1] + kept.map * (mean[MY] - usual.whole[1])
    drawn = (1.0 - kept.map * kept.map) * usual.factor * par.map_sigma * par.map_sigma
    cov[D, D] += (1.0 - in_lane * in_lane) * lane_sigma * lane_sigma
    cov[MX, MX] += drawn
    cov[MY, MY] += drawn


@kernel
def age_map(
    mean: Vector, cov: Matrix, par: Record, usual: Record, metres: float, lane: float,
    lane_sigma: float,
) -> None:  # fmt: skip
    """`decay_map` over a distance (m)."""
    decay_map(mean, cov, par, usual, map_decay(par, usual.rate, metres), lane, lane_sigma)


@kernel
def age_bias(mean: Vector, cov: Matrix, keep: float) -> None:
    """Gauss-Markov step of the GNSS bias: so much of it is kept."""
    kept = new_row()
    for i in range(N):
        kept[i] = 1.0
    kept[GX] = keep
    kept[GY] = keep
    for i in range(N):
        scale_by(cov[i], kept[i], kept)
    mean[GX] *= keep
    mean[GY] *= keep
    cov[GX, GX] += 1.0 - keep * keep
    cov[GY, GY] += 1.0 - keep * keep
