"""Clocks that differ: how late fixes are against the odometry, or the odometry against fixes.

A reading is often stamped when it arrives.  At a steady speed a fix that is a second late looks
like an error along the road.  Where the vehicle changes its velocity, the fix lags behind by the
velocity times the delay, as no error of a receiver does.  A filter of four states beside the
mixture tells these apart: what fixes err anyway (two axes), the delay, and what only lasts while
the velocity changes, as receivers that smooth their fixes lag then.

Wheels that slip while they accelerate and brake feign late fixes, but not in turns.  A second
filter of the same states learns from turns alone: where the speed changes, the way is unsure.
"""

import math
from typing import NamedTuple

import numpy as np

from ..._compile import Record, Vector, kernel
from .delay_filter import (
    ANYWHERE,
    ASSUMED,
    DELAY,
    ESTIMATE,
    Delayed,
    begin,
    begin_at,
    free,
    stretch,
    update_delay,
)
from .delays_tried import (
    DELAYS_TRIED,
    TRIED,
    delay_of,
    fade,
    forget_tried,
    refuted_by,
    score,
)

PUNCTUAL, FIXES, ODOMETRY = range(3)  # what is late

_PRIOR = 2.0  # s, sigma of a delay
PLACES = 64  # that are kept,
_APART = 0.1  # s between them
PACE = 0.5  # s over which a velocity is taken,
CHANGE = 2.0  # s, and its change
SOONEST, _LATEST = 0.45, 6.0  # s between fixes that are compared
_BIAS_TIME = 80.0  # s for which errors of receivers last
_OF_WAY = 0.08  # of the way: error of the odometry
_OF_SLIP, _SLIPS = 1.0, 0.3  # the same where wheels may slip; m/s², from which on they do
_STANDS, _DRIFTS = 0.3, 2.0  # m, of a vehicle that stands; m²/s, its fixes may drift
_WHITE, _LEAST = 0.7, 0.5  # of the reported sigma, m: what is new in every fix
_FITS = 1.7  # usual chi-square an axis, up to which a delay explains the errors
LONGEST = 5.0  # s, of a delay
_RARE = 0.02  # P(clocks differ)
_COVERED, _SEEN = 0.008, 1.0  # P of that from which on levels cover late fixes, and sigma (s)
_WORTH = (0.15, 0.3)  # s, of late fixes and late odometry, from which on they are mended
_SURE, _CONFIRMED = 0.95, 8.0  # P of that from which on it is mended, and s for which it is so
_WHILE, _NEWS = 20.0, 10.0  # s between two events; what one tells of the delay, 1/s²
_EVENTS = 2  # that must have told of it
_IN_TURNS, _SEEN_IN_TURNS = 0.7, 2.0  # share of a delay that turns show, and sigmas of that
_REFUTED = 10.0  # nats by which steps between fixes tell against a delay that is forgotten then
_OTHERWISE = 0.08  # s, by which receivers that smooth their fixes look late

LATENCY = np.dtype(
    [
        # time, s; place, way and turn by odometry, m, m, m, rad; row (number % PLACES)
        ("places", "f8", (PLACES, 5)),
        ("kept", "i8"),  # of places
        ("here", "f8", (4,)),  # the same, now
        ("before", "f8"),  # turn until the last epoch, rad
        ("mended", "u1"),  # 1: late odometry was moved on; these are no more those of the windows
        ("heading", "f8", (2,)),  # of the vehicle as estimated, rad, and its variance
        ("antenna", "f8", (2,)),  # ahead and left of M, m
        ("rate", "f8"),  # metres for a metre of the odometer
        ("time", "f8"),  # of the last fix that was compared, s; minus infinity: none
        # the fix (plane), the antenna from M (m), and M by odometry then, m; two axes each
        ("last", "f8", (6,)),
        ("pace", "f8"),  # m/s, then
        ("error", "f8", (2,)),  # of fixes less the way by odometry since the start, m
        ("estimate", ESTIMATE),  # by all that changes the velocity,
        ("turns", ESTIMATE),  # and by its direction alone, as wheels that slip do not change that
        ("tried", DELAYS_TRIED),
        ("known", "f8"),  # 1/s², what is known of the delay, at the last event,
        ("event_at", "f8"),  # s, when that was,
        ("events", "i8"),  # and how often it was
        ("sure_at", "f8"),  # s, until which it was not sure
        ("late", "u1"),  # PUNCTUAL, FIXES or ODOMETRY
        ("found", "u1"),  # 1: with this fix it has changed
        # not mended: P(fixes are late), speed that puts the vehicle ahead (m/s), way until then (m)
        ("behind", "f8", (3,)),
        ("led", "f8"),  # turn by which it was moved on until the last epoch, rad
        ("lead", "f8", (2,)),  # by which late odometry was moved on, m and rad
    ],
    align=True,
)


class Frame(NamedTuple):
    """From the frame of the odometry to the plane, in true metres: its axis ahead, by its scale."""

    c: float
    s: float


@kernel
def clear_latency(latency: Record) -> None:
    """Begin: nothing was seen."""
    latency.time = -math.inf
    latency.heading[1] = math.inf
    latency.sure_at = math.inf
    latency.event_at = -math.inf
    latency.events = 0
    latency.known = 0.0
    latency.found = latency.late != PUNCTUAL
    latency.late = PUNCTUAL
    latency.behind[0] = 0.0
    latency.behind[1] = 0.0
    begin(latency.estimate)
    begin(latency.turns)
    forget_tried(latency.tried)


def found_delay(latency: Record) -> float:
    """How late fixes were found to be, s; negative: the odometry; 0: clocks agree."""
    return float(latency["estimate"]["state"][DELAY]) if latency["late"] != PUNCTUAL else 0.0


def assume_delay(latency: Record, delay: float) -> None:
    """Begin with what a delay was found to be, s."""
    for name in ("estimate", "turns"):
        latency[name]["state"][DELAY] = delay
        latency[name]["cov"][DELAY, DELAY] = ASSUMED**2
    latency["late"] = FIXES if delay > 0.0 else ODOMETRY


@kernel
def keep_place(latency: Record, now: Record, time: float) -> None:
    """Keep the place by odometry, from time to time.

    Args:
        latency: In place.
        now: Sums of the odometry, of `vetting.windows`.
        time: s.
    """
    here = latency.here
    if latency.mended == 0:
        latency.before = here[3]
        here[0] = now.ox
        here[1] = now.oy
        here[2] = now.arc
        here[3] = now.turn
    last = latency.places[(latency.kept - 1) % PLACES]
    if latency.kept > 0 and time - last[0] < _APART:
        return
    place = latency.places[latency.kept % PLACES]
    place[0] = time
    for i in range(4):
        place[1 + i] = here[i]
    latency.kept += 1


@kernel
def place_at(latency: Record, now: float, ago: float) -> tuple[float, float, float, float]:
    """Place, way and turn by odometry some seconds ago; before the oldest one, that."""
    oldest = max(latency.kept - PLACES, 0)
    j = latency.kept - 1
    while j > oldest and now - latency.places[j % PLACES][0] < ago:
        j -= 1
    a = latency.places[j % PLACES]
    since = now - a[0]
    if since <= ago or j == latency.kept - 1:
        return a[1], a[2], a[3], a[4]
    b = latency.places[(j + 1) % PLACES]
    share = (since - ago) / (b[0] - a[0])
    return (
        a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]),
        a[3] + share * (b[3] - a[3]), a[4] + share * (b[4] - a[4]),
    )  # fmt: skip


@kernel
def velocity(latency: Record, frame: Frame, now: float, ago: float) -> tuple[float, float]:
    """Velocity until some seconds ago, m/s."""
    px, py, _, _ = place_at(latency, now, ago)
    qx, qy, _, _ = place_at(latency, now, ago + PACE)
    x = (px - qx) / PACE
    y = (py - qy) / PACE
    return frame.c * x - frame.s * y, frame.s * x + frame.c * y


@kernel
def delayed(latency: Record, frame: Frame, time: float) -> Delayed:
    """Motion about the time that a fix held."""
    delay = min(max(latency.estimate.state[DELAY], 0.0), LONGEST)
    px, py, _, _ = place_at(latency, time, delay)
    x = latency.here[0] - px
    y = latency.here[1] - py
    vx, vy = velocity(latency, frame, time, delay)
    wx, wy = velocity(latency, frame, time, delay + CHANGE)
    return Delayed(
        delay, frame.c * x - frame.s * y, frame.s * x + frame.c * y, vx, vy,
        (vx - wx) / CHANGE, (vy - wy) / CHANGE,
    )  # fmt: skip


@kernel
def compare(latency: Record, epoch: Record, scale: float, frame: Frame, then: Delayed) -> None:
    """Compare a fix with the one before and with the way between them."""
    since = epoch.time - latency.time
    heading = latency.heading[0]
    c = math.cos(heading)
    s = math.sin(heading)
    x = c * latency.antenna[0] - s * latency.antenna[1]
    y = s * latency.antenna[0] + c * latency.antenna[1]
    last = latency.last
    _, _, before, _ = place_at(latency, epoch.time, PACE)
    pace = (latency.here[2] - before) / PACE
    if since < _LATEST:
        forward = latency.here[0] - last[4]
        left = latency.here[1] - last[5]
        along = frame.c * forward - frame.s * left
        across = frame.s * forward + frame.c * left
        dx = (epoch.fix[0] - last[0]) / scale - (x - last[2])
        dy = (epoch.fix[1] - last[1]) / scale - (y - last[3])
        latency.error[0] += dx - along
        latency.error[1] += dy - across
        variance = epoch.fix[2] * epoch.fix[3] * max(latency.estimate.misfit, 1.0)
        of_way = (_OF_WAY**2 + latency.heading[1]) * (forward * forward + left * left)
        freed = 2.0 * variance * since / _BIAS_TIME + of_way
        if forward * forward + left * left < _STANDS * _STANDS:
            freed += _DRIFTS * since
        white = max(_WHITE * math.sqrt(variance), _LEAST) ** 2
        _try_delays(latency, epoch.time, frame, (dx, dy), 2.0 * white + of_way)
        slips = _OF_SLIP * min(abs(pace - latency.pace) / (since * _SLIPS), 1.0)
        free(latency.estimate, freed)
        free(latency.turns, freed)
        stretch(latency.turns, slips * along, slips * across)
        if update_delay(latency.estimate, latency.error, then, white):
            latency.events = 0
        update_delay(latency.turns, latency.error, then, white)
    else:
        free(latency.estimate, ANYWHERE)
        free(latency.turns, ANYWHERE)
        _try_delays(latency, epoch.time, frame, (0.0, 0.0), math.inf)
    latency.time = epoch.time
    latency.pace = pace
    _keep_fix(latency, epoch.fix, x, y)


@kernel
def _keep_fix(latency: Record, fix: Vector, x: float, y: float) -> None:
    """Keep a fix, with the antenna from M (m) and M by odometry."""
    last = latency.last
    last[0] = fix[0]
    last[1] = fix[1]
    last[2] = x
    last[3] = y
    last[4] = latency.here[0]
    last[5] = latency.here[1]


@kernel
def _try_delays(
    latency: Record, time: float, frame: Frame, step: tuple[float, float], variance: float
) -> None:
    """Score each delay by the step between two fixes, m, of a variance on each axis, m²."""
    tried = latency.tried
    fade(tried, time - latency.time)
    for j in range(TRIED):
        x, y, _, _ = place_at(latency, time, delay_of(j))
        before = tried.place[j]
        forward, left = x - before[0], y - before[1]
        way = (frame.c * forward - frame.s * left, frame.s * forward + frame.c * left)
        score(tried, j, step, way, variance)
        before[0] = x
        before[1] = y


@kernel
def _count_events(latency: Record) -> None:
    """Count the times, some while apart, that the vehicle has changed its velocity."""
    known = 1.0 / latency.estimate.cov[DELAY, DELAY]
    since = latency.time - latency.event_at
    if since < _WHILE:
        latency.known = known
    elif known > latency.known + _NEWS:
        latency.known = known
        latency.events += 1
        latency.event_at = latency.time


@kernel
def _p_late(latency: Record) -> float:
    """P(clocks differ) by as much as is worth it."""
    delay = latency.estimate.state[DELAY]
    if abs(delay) < (_WORTH[0] if delay > 0.0 else _WORTH[1]):
        return 0.0
    variance = latency.estimate.cov[DELAY, DELAY] + _OTHERWISE**2
    odds = 0.5 * delay * delay / variance + math.log(_RARE * math.sqrt(variance) / _PRIOR)
    return float(1.0 / (1.0 + math.exp(-min(odds, 100.0))))


@kernel
def p_late(latency: Record) -> float:
    """P(fixes are late) by as much as is worth it, and wheels do not slip instead; 0: untold.

    Turns show a delay and no slip.  Both are as likely before, and sigmas of turns count twice.
    """
    variance = (2.0 * 2.0) * latency.turns.cov[DELAY, DELAY]
    shown = latency.turns.state[DELAY]
    off = shown - latency.estimate.state[DELAY]
    nats = 0.5 * (off * off - shown * shown) / variance
    p = _p_late(latency) / (1.0 + math.exp(min(nats, 100.0)))
    p *= math.exp(-max(refuted_by(latency.tried, latency.estimate.state[DELAY]), 0.0))
    seen = latency.estimate.cov[DELAY, DELAY] < _SEEN * _SEEN
    return float(p) if seen and p > _COVERED else 0.0


@kernel
def _shows_in_turns(latency: Record) -> bool:
    """Whether turns show a delay as well, as they do not where wheels slip.

    Wheels that slip run ahead while the vehicle becomes faster, and fall behind while it brakes,
    as if fixes were late.  They never look as if the odometry was.
    """
    delay = latency.estimate.state[DELAY]
    shown = latency.turns.state[DELAY]
    sigma = math.sqrt(latency.turns.cov[DELAY, DELAY])
    return bool(delay < 0.0 or shown > max(_IN_TURNS * delay, _SEEN_IN_TURNS * sigma))


@kernel
def decide(latency: Record) -> None:
    """What is late."""
    against = refuted_by(latency.tried, latency.estimate.state[DELAY])
    if against > _REFUTED:
        begin_at(latency.estimate, 0.0)
        begin_at(latency.turns, 0.0)
    delay = latency.estimate.state[DELAY]
    late = latency.late
    _count_events(latency)
    unsure = _p_late(latency) < _SURE
    if latency.estimate.misfit > _FITS or unsure or against > 0.0:
        latency.sure_at = latency.time
    if abs(delay) < 0.5 * _WORTH[0]:
        late = PUNCTUAL
    elif (
        latency.time - latency.sure_at > _CONFIRMED
        and latency.events >= _EVENTS
        and _shows_in_turns(latency)
    ):
        late = FIXES if delay > 0.0 else ODOMETRY
    latency.found = late != latency.late
    latency.late = late
