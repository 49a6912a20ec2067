"""Inflation of reported covariances where nothing but roads vouches for a receiver.

Without wheels and without Doppler speed a slow error moves the vehicle as driving does, and no
fix shows it.  An odometer without turns shows none across the road.  So the errors of a receiver
alone are taken to be larger than reported at first.  Only roads make the factor smaller.  Nothing
makes it larger than at first: else a wrong road would explain itself by a bad receiver.
"""

import math

from ..._compile import Record, Vector, kernel
from ..state import CLOCK, GX, GY, OFF_ROAD, WHEELS, Belief
from .doppler_scale import largest_factor

COARSE = 40.0  # m, sigma of a fix about which the roads of a town are too many to follow them all
NEVER = 1e9  # s, adaptation times beyond this mean: never
FILTERED = 0.3  # m/s; a speed whose sigma is not smaller may come out of a filter
_SPEED_INTERVAL = 2.5  # s, up to which speeds tell what was driven in between
_ALONE_TIME = 30.0  # s, for which errors last at most, where nothing shows it
_PRIOR = 0.3  # weight of the factor believed before, in times for which errors last
_FREEDOM = 16.0  # degrees of freedom of what is believed of the factor before,
_FREEDOM_WHEELS = 8.0  # and beside wheels, which soon know more
_UNTRUE, _FAR_FROM_TRUE = 1.5, 1.9  # of the scale, between which it falls to
_FREEDOM_UNTRUE = 6.0  # where errors differ from place to place,
_SHOWN = 0.1  # errors that roads have shown, below which they have shown nothing
_REFLECTS = 0.5  # m, of receivers that report more than this
_ONE_MORE = 3.0  # s beside wheels, in which another degree of freedom is learnt
_REMEMBERED = 900.0  # s of motion, for which roads are remembered: streets change
_WILD = 7.0  # squared error of a receiver alone over its scale: 3 % are larger
_REFLECTED = 20.0  # m, up to which a reported sigma may be a multiple too small
_LARGEST = 15.0  # m, and
_MOST = 400.0  # beside wheels, of the factor
_PAUSE = 5.0  # s between two starts at its fixes
_REACQUIRED = 3.0  # s, and
_UNUSUAL = 3.0  # times the usual interval, of a silence
_LIGHT = 0.01  # weight below which a hypothesis says nothing


@kernel
def _is_unlearnt(state: Record) -> bool:
    """Whether the factor is what is believed at first: neither roads nor fixes have shown it."""
    seen = max(state.innovation_factor, state.windowed_factor, state.bias_factor)
    return bool(state.gnss_factor > 1.001 * seen and state.road_energy[1] < _SHOWN)


@kernel
def tail_of(state: Record, par: Record) -> float:
    """How many times wider a level is, as the factor was learnt from few independent errors.

    The errors of a receiver whose variance was learnt with ν degrees of freedom are Student's:

        P(error > r) = (1 + r² / ν σ²)^(-ν/2)

    with ν = 8 + t/3 after t seconds beside wheels.  Without them it is 16 + twice the number of
    errors that roads have shown: Doppler shows no slow ones.  It is 6 where errors are about
    twice as large as reported: among reflections they differ from one street to the next.  A
    solution by carrier phase has none of metres.
    """
    if par.gnss_adapt_time >= NEVER:
        return 1.0
    freedom = _FREEDOM + 2.0 * state.road_energy[1]
    if state.mode == WHEELS:
        freedom = _FREEDOM_WHEELS + state.learnt_time / _ONE_MORE
    elif state.reported[1] >= _REFLECTS and not _is_unlearnt(state):
        share = (math.sqrt(state.gnss_factor) - _UNTRUE) / (_FAR_FROM_TRUE - _UNTRUE)
        freedom += min(max(share, 0.0), 1.0) * (_FREEDOM_UNTRUE - freedom)
    usual = -2.0 * math.log(par.protection_risk)
    return float(math.sqrt(freedom * (math.exp(usual / freedom) - 1.0) / usual))


@kernel
def is_vouched(state: Record, epoch: Record) -> bool:
    """Whether motion in the plane is measured without positions: wheels, or Doppler.

    A speed every some seconds says little of what was driven in between.
    """
    usual = state.heard[1] if state.mode == CLOCK else state.fix_interval
    doppler = epoch.speed_sigma < 1.0 and usual < _SPEED_INTERVAL
    return bool(state.mode == WHEELS or doppler)


@kernel
def inflation_of(par: Record, fix: Vector) -> float:
    """The factor on the reported variance of a receiver that nothing vouches for, at first.

    What it does not report is of some metres: reflections.  A coarse fix is that already.
    """
    reported = 0.5 * (fix[2] ** 2 + fix[3] ** 2)
    return float(1.0 + (par.gnss_inflation**2 - 1.0) * min(_REFLECTED**2 / reported, 1.0))


@kernel
def most_factor(state: Record, par: Record, fix: Vector) -> float:
    """The largest factor on reported variances that is learnt.

    Without wheels a wrong road would explain itself by a bad receiver.  So the receiver errs
    by w times what it reports, or by 15 m, whichever is more, but not by more than that.  Where
    its fixes lie far beside the road it errs by w, or by what `doppler_scale` bears out.
    """
    if state.mode == WHEELS:
        return _MOST
    reported = 0.5 * (fix[2] ** 2 + fix[3] ** 2)
    largest = min(_LARGEST**2 / reported, largest_factor(state))
    return float(min(max(inflation_of(par, fix), largest), _MOST))


@kernel
def was_silent(state: Record, par: Record, since: float) -> bool:
    """Whether a receiver without wheels was silent for so long that it may have lost satellites.

    One that is taken at its word has not.

    Args:
        state: With the usual interval of fixes before.
        par: Settings.
        since: s since the last one.
    """
    usual = state.fix_interval
    unusual = usual > 0.0 and since > max(_REACQUIRED, _UNUSUAL * usual)
    return bool(_may_inflate(state, par) and unusual)


@kernel
def _may_inflate(state: Record, par: Record) -> bool:
    """Whether the settings ask for it, and no turns are measured."""
    asked = par.gnss_adapt_time < NEVER and par.gnss_inflation > 1.0
    return bool(asked and state.mode != WHEELS)


@kernel
def is_inflated(state: Record, par: Record, epoch: Record) -> bool:
    """Whether the receiver may err more than it reports, and nothing but roads can show it."""
    return bool(_may_inflate(state, par) and not is_vouched(state, epoch))


@kernel
def may_reflect(state: Record, par: Record, epoch: Record) -> bool:
    """Whether no odometry is beside the receiver, or one that shows no error across the road."""
    return bool(_may_inflate(state, par) and (state.mode == CLOCK or not is_vouched(state, epoch)))


@kernel
def is_alone(state: Record, par: Record, epoch: Record) -> bool:
    """The same, or its speeds may come out of a filter, so that nothing measured is beside it."""
    filtered = epoch.speed_sigma >= FILTERED
    return bool(_may_inflate(state, par) and (filtered or not is_vouched(state, epoch)))


@kernel(inline=True)
def is_unlikely(belief: Belief, time: float) -> bool:
    """Whether the error of a receiver is larger than it is in 97 % of the time; once in 5 s.

    Its error follows a wrong road wherever that leads.
    """
    state = belief.state[0]
    if time < state.restarted_at + _PAUSE:
        return False
    energy = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        energy += hyp.weight * (hyp.mu[GX] ** 2 + hyp.mu[GY] ** 2)
    if energy < _WILD:
        return False
    state.restarted_at = time
    return True


@kernel
def bias_time(state: Record, par: Record, epoch: Record) -> float:
    """How long the receiver's error lasts, s; less where nothing vouches for it."""
    if is_inflated(state, par, epoch):
        return float(min(par.gnss_time, _ALONE_TIME))
    return float(par.gnss_time)


@kernel(inline=True)
def learn_by_roads(belief: Belief, par: Record, moving: float) -> float:
    """The factor on reported variances, by the bias that roads show.

        num += λ² t/T ½ Σ E|γ|²        den += t/T ½ Σ (2 − tr P_γ)
        λ²   = (a w² + num) / (a + den), at most w² and at least 1

    with γ the bias, P_γ its covariance, T the time for which it lasts, and w² what is believed
    before any road has shown it.

    Args:
        belief: Before it is conditioned on the fix.
        par: The parameters.
        moving: t, seconds of motion since the last fix.
    """
    state = belief.state[0]
    energy = 0.0
    known = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < _LIGHT or hyp.edge == OFF_ROAD:
            continue
        energy += hyp.weight * (hyp.mu[GX] ** 2 + hyp.mu[GY] ** 2)
        known += hyp.weight * max(2.0 - hyp.cov[GX, GX] - hyp.cov[GY, GY], 0.0)
    kept = math.exp(-moving / _REMEMBERED)
    share = 0.5 * moving / min(par.gnss_time, _ALONE_TIME)
    state.road_energy[0] = kept * state.road_energy[0] + share * state.gnss_factor * energy
    state.road_energy[1] = kept * state.road_energy[1] + share * known
    widest = state.road_prior if state.road_prior > 0.0 else par.gnss_inflation**2
    factor = (_PRIOR * widest + state.road_energy[0]) / (_PRIOR + state.road_energy[1])
    return float(max(min(factor, widest), 1.0))
