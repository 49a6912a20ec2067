"""Wheels are silent, and a gyro goes on: the distance is unknown until they are heard again.

Counters go on counting meanwhile.  So the spare state U is what the vehicle has driven beyond
what was extrapolated since they fell silent.  Its noise is that of the position along the heading:

    p' = p + R(θ) (n, 0),    U' = U + n,    var n = V(t + Δt) − V(t)

with V the variance of the way of `motion.unseen_way`, of a speed that begins as it was.

When wheels are heard again, the distance that they tell less what was extrapolated observes U.  It
moves each hypothesis along the way that it came, and tells those apart that a turn of the gyro has
taken into different roads.  Where it fits none, the vehicle may be elsewhere (`gnss.silence`).
After a long silence one in ten is elsewhere, which nothing shows until the next fix.
"""

import math

from .._compile import Matrix, Record, kernel
from .gaussian import log_density, update_state
from .gnss.silence import FASTEST, may_be_lost, may_have_moved
from .lookback.history import History, accumulate_noise
from .motion import Increment, Noise, unseen_way
from .state import Belief, H, N, U, X, Y
from .vetting.windows import HEARD_AGAIN

_SURE, _SCALE = 1.0, 0.01  # m, sigma of a distance that wheels tell, and share of the excess
_BY_CHANCE = 1e-4  # 1/m, density of distances that mean nothing
_FITS = 10.0  # chi-square beyond which no hypothesis was moved as the wheels were
_LONG, _LOST = 30.0, 0.1  # s, from which on so many are lost by then, which nothing shows


@kernel
def roam(belief: Belief, history: History, epoch: Record, dt: float) -> None:
    """Add what the distance of an epoch may be off by, after it was extrapolated.

    Args:
        belief: In place.
        history: Its noise since the last step is added to.
        epoch: By a gyro alone; where wheels are heard again, with what they tell in its `arc`.
        dt: Its duration, s.
    """
    state = belief.state[0]
    silent = state.vetting.silent
    if silent <= dt:  # it begins
        _forget(belief)
    q = unseen_way(silent, dt)
    for i in range(state.count):
        hyp = belief.hyp[i]
        c, s = math.cos(hyp.mu[H]), math.sin(hyp.mu[H])
        cov = hyp.cov
        cov[X, X] += q * c * c
        cov[Y, Y] += q * s * s
        cov[U, U] += q
        _add_twice(cov, X, Y, q * c * s)
        _add_twice(cov, X, U, q * c)
        _add_twice(cov, Y, U, q * s)
    if len(history.steps) > 0:
        still = Increment(0.0, 0.0, 0.0, 0.0, 0.0)
        accumulate_noise(history, still, Noise(q, 0.0, 0.0, 0.0, 0.0, 0.0))
    if epoch.gyro == HEARD_AGAIN:
        _arrive(belief, epoch.arc)


@kernel
def _add_twice(cov: Matrix, i: int, j: int, value: float) -> None:
    """Add to a covariance and to its mirror image."""
    cov[i, j] += value
    cov[j, i] += value


@kernel
def _arrive(belief: Belief, excess: float) -> None:
    """Wheels are heard again: observe how far they went beyond what was extrapolated, m."""
    state = belief.state[0]
    silent = state.vetting.silent
    variance = _SURE * _SURE + (_SCALE * excess) ** 2
    best = math.inf
    for i in range(state.count):
        hyp = belief.hyp[i]
        nu = excess - hyp.mu[U]
        best = min(best, nu * nu / (hyp.cov[U, U] + variance))
    if best > _FITS:
        may_have_moved(state, excess, silent)
    elif silent > _LONG:
        may_be_lost(state, _LOST, FASTEST * silent)
    for i in range(state.count):
        hyp = belief.hyp[i]
        nu = excess - hyp.mu[U]
        s = update_state(hyp.mu, hyp.cov, U, nu, variance, state.scale)
        hyp.log_weight += math.log(math.exp(log_density(nu, s)) + _BY_CHANCE)
    _forget(belief)
    state.changed = 1
    state.observed = 1


@kernel
def _forget(belief: Belief) -> None:
    """U is zero again, with zero variance."""
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        hyp.mu[U] = 0.0
        for j in range(N):
            hyp.cov[U, j] = 0.0
            hyp.cov[j, U] = 0.0
