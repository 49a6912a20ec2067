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

PUNCTUAL, FIXES, ODOMETRY = range(3)  # what is late

_STATES = 4
DELAY, _SMOOTHING = 2, 3  # states beside the two axes
_PRIOR = (2.0, 2.0)  # s, s²: sigmas of these
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
_AT_FIRST, _NEW = 2.0, 1.0 / 16.0  # usual chi-square an axis; share of a new one
_GATE = 25.0  # chi-square of two axes, from which on the error of fixes has jumped
_ANYWHERE, _OTHER_DELAY = 1e4, 0.3  # m² of its place then; s by which the delay may differ
_ASSUMED = 0.5  # s, sigma of a delay that was found before
LONGEST = 5.0  # s, of a delay
_RARE = 0.02  # P(clocks differ)
_COVERED, _SEEN = 0.008, 1.0  # P of that from which on levels cover late fixes, and sigma (s)
_WORTH = (0.15, 0.3)  # s, of late fixes and late odometry, from which on they are mended
_SURE, _CONFIRMED = 0.95, 8.0  # P of that from which on it is mended, and s for which it is so
_WHILE, _NEWS = 20.0, 10.0  # s between two events; what one tells of the delay, 1/s²
_EVENTS = 2  # that must have told of it
_IN_TURNS, _SEEN_IN_TURNS = 0.7, 2.0  # share of a delay that turns show, and sigmas of that
_OTHERWISE = 0.08  # s, by which receivers that smooth their fixes look late

ESTIMATE = np.dtype(
    [
        ("state", "f8", (_STATES,)),
        ("cov", "f8", (_STATES, _STATES)),
        ("row", "f8", (2, _STATES)),  # buffers of one observation, for both axes
        ("gain", "f8", (2, _STATES)),
        ("misfit", "f8"),  # usual chi-square an axis
    ],
    align=True,
)

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


class Delayed(NamedTuple):
    """Motion of the vehicle about the time that a fix held, plane, true metres."""

    delay: float  # s, for which this is
    dx: float  # way since then, m
    dy: float
    vx: float  # velocity then, m/s
    vy: float
    ax: float  # its change in the seconds before, m/s²
    ay: float


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
    _begin(latency.estimate)
    _begin(latency.turns)


@kernel
def _begin(estimate: Record) -> None:
    estimate.misfit = _AT_FIRST
    for i in range(_STATES):
        estimate.state[i] = 0.0
        for j in range(_STATES):
            estimate.cov[i, j] = 0.0
    for i in range(2):
        estimate.cov[i, i] = _ANYWHERE
        estimate.cov[DELAY + i, DELAY + i] = _PRIOR[i] ** 2


def found_delay(latency: Record) -> float:
    """How late fixes were found to be, s; negative: the odometry; 0: clocks agree."""
    return float(latency["estimate"]["state"][DELAY]) if latency["late"] != PUNCTUAL else 0.0


def assume_delay(latency: Record, delay: float) -> None:
    """Begin with what a delay was found to be, s."""
    for name in ("estimate", "turns"):
        latency[name]["state"][DELAY] = delay
        latency[name]["cov"][DELAY, DELAY] = _ASSUMED**2
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
        latency.error[0] += (epoch.fix[0] - last[0]) / scale - (x - last[2]) - along
        latency.error[1] += (epoch.fix[1] - last[1]) / scale - (y - last[3]) - across
        variance = epoch.fix[2] * epoch.fix[3] * max(latency.estimate.misfit, 1.0)
        of_way = (_OF_WAY**2 + latency.heading[1]) * (forward * forward + left * left)
        freed = 2.0 * variance * since / _BIAS_TIME + of_way
        if forward * forward + left * left < _STANDS * _STANDS:
            freed += _DRIFTS * since
        white = max(_WHITE * math.sqrt(variance), _LEAST) ** 2
        slips = _OF_SLIP * min(abs(pace - latency.pace) / (since * _SLIPS), 1.0)
        _free(latency.estimate, freed)
        _free(latency.turns, freed)
        _stretch(latency.turns, slips * along, slips * across)
        if _update(latency.estimate, latency.error, then, white):
            latency.events = 0
        _update(latency.turns, latency.error, then, white)
    else:
        _free(latency.estimate, _ANYWHERE)
        _free(latency.turns, _ANYWHERE)
    latency.time = epoch.time
    latency.pace = pace
    last[0] = epoch.fix[0]
    last[1] = epoch.fix[1]
    last[2] = x
    last[3] = y
    last[4] = latency.here[0]
    last[5] = latency.here[1]


@kernel
def _free(estimate: Record, variance: float) -> None:
    """Let the error of fixes change."""
    estimate.cov[0, 0] += variance
    estimate.cov[1, 1] += variance


@kernel
def _stretch(estimate: Record, x: float, y: float) -> None:
    """Let the error of fixes change along a way, by so much (m, one sigma)."""
    estimate.cov[0, 0] += x * x
    estimate.cov[0, 1] += x * y
    estimate.cov[1, 0] += x * y
    estimate.cov[1, 1] += y * y


@kernel
def _observe(estimate: Record, error: Vector, then: Delayed, axis: int) -> float:
    """Innovation of one axis; sets its row, and the gain times its variance."""
    row = estimate.row[axis]
    row[0] = 1.0 - axis
    row[1] = axis
    row[DELAY] = -then.vx if axis == 0 else -then.vy
    row[_SMOOTHING] = -then.ax if axis == 0 else -then.ay
    off = error[axis] + (then.dx if axis == 0 else then.dy) + row[DELAY] * then.delay
    for i in range(_STATES):
        estimate.gain[axis, i] = 0.0
        for j in range(_STATES):
            estimate.gain[axis, i] += estimate.cov[i, j] * row[j]
        off -= row[i] * estimate.state[i]
    return float(off)


@kernel
def _update(estimate: Record, error: Vector, then: Delayed, white: float) -> bool:
    """Kalman update by a fix; one that fits nothing says that its error has jumped: true."""
    x = _observe(estimate, error, then, 0)
    y = _observe(estimate, error, then, 1)
    gain = estimate.gain
    xx = yy = white
    xy = 0.0
    for i in range(_STATES):
        xx += gain[0, i] * estimate.row[0, i]
        xy += gain[0, i] * estimate.row[1, i]
        yy += gain[1, i] * estimate.row[1, i]
    det = xx * yy - xy * xy
    chi2 = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / det
    estimate.misfit += _NEW * (0.5 * min(chi2, _GATE) - estimate.misfit)
    if chi2 > _GATE:  # or the delay is another one
        _free(estimate, _ANYWHERE)
        estimate.cov[DELAY, DELAY] += _OTHER_DELAY**2
        return True
    for i in range(_STATES):
        by_x = (yy * gain[0, i] - xy * gain[1, i]) / det
        by_y = (xx * gain[1, i] - xy * gain[0, i]) / det
        estimate.state[i] += by_x * x + by_y * y
        for j in range(_STATES):
            estimate.cov[i, j] -= by_x * gain[0, j] + by_y * gain[1, j]
    return False


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
    odds = 0.5 * delay * delay / variance + math.log(_RARE * math.sqrt(variance) / _PRIOR[0])
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
    delay = latency.estimate.state[DELAY]
    late = latency.late
    _count_events(latency)
    if latency.estimate.misfit > _FITS or _p_late(latency) < _SURE:
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
