"""The lane offset where a road is left for another one."""

from ..._compile import Matrix, Vector, kernel
from ..slow_states import decay
from ..state import D, N, X, Y

_FORKS, _PARTS = 0.2, 0.3  # rad, turns up to which a road runs on, and from which it forks off


@kernel
def kept_lane(turn: float) -> float:
    """c, what is kept of the lane offset where a road is left with a turn (rad) for another one.

    1 up to 0.2 rad, 0 from 0.3 rad on, linear between.  Straight on the lane stays.  A road that
    forks off is drawn from the middle of the one that is left, and driven from its outer lane:
    its lanes are its own.
    """
    return min(max((_PARTS - abs(turn)) / (_PARTS - _FORKS), 0.0), 1.0)


@kernel
def change_lane(
    mean: Vector, cov: Matrix, turn: float, lanes: tuple[float, float, float],
    tangent: tuple[float, float], scale: float,
) -> None:  # fmt: skip
    """`redraw_lane`, by which the vehicle itself moves across its road.

    For vehicles that follow their road: their place across it is where the lane is, and not
    observed.  Else a change of lanes would count against the road that has it.

        d⁺ = d̄' + c (d − d̄) + e,    p⁺ = p + n (d⁺ − d),    n to the right

    Where the usual lane is another one, it takes some metres to get there: e ~ (d̄' − d̄)².

    Args:
        mean: State, (N,), in place.
        cov: Covariance, (N, N), in place.
        turn: rad.
        lanes: Usual lane offset before and after, m, and its sigma after.
        tangent: Of the road before.
        scale: Local scale of the plane.
    """
    old, new, sigma = lanes
    nx = tangent[1]
    ny = -tangent[0]
    kept = kept_lane(turn)
    before = mean[D]
    if kept < 1.0:
        share = kept - 1.0
        for j in range(N):
            cov[X, j] += share * nx * cov[D, j]
            cov[Y, j] += share * ny * cov[D, j]
        for j in range(N):
            cov[j, X] += share * nx * cov[j, D]
            cov[j, Y] += share * ny * cov[j, D]
    redraw_lane(mean, cov, turn, old, new, sigma)
    moves = (new - old) ** 2
    added = (1.0 - kept * kept) * sigma * sigma + moves
    cov[D, D] += moves
    cov[X, X] += added * nx * nx
    cov[Y, Y] += added * ny * ny
    cov[X, Y] += added * nx * ny
    cov[Y, X] = cov[X, Y]
    cov[X, D] += added * nx
    cov[Y, D] += added * ny
    cov[D, X] = cov[X, D]
    cov[D, Y] = cov[Y, D]
    mean[X] += scale * nx * (mean[D] - before)
    mean[Y] += scale * ny * (mean[D] - before)


@kernel
def redraw_lane(
    mean: Vector, cov: Matrix, turn: float, old: float, new: float, sigma: float
) -> None:
    """Redraw part of the lane offset when turning into another road.

    d⁺ = d̄' + c (d − d̄), variance + σ² (1 − c²), with c of `kept_lane`.
    """
    c = kept_lane(turn)
    mean[D] += new - old
    decay(mean, cov, D, new, c, sigma * sigma)
