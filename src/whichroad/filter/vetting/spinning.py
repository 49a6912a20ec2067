"""Wheels that turn on the spot, as in snow or on a brake tester: all else stands.

The seconds in which a moving vehicle is compared tell little of a slow one.  So a stand by the
fixes is compared from its beginning on.  Where the receiver's own speed stands as well, a way by
the odometer is wrong.  But a receiver may hold its place, and report no speed, while the vehicle
creeps: fixes must differ from the odometer, too, before it is withheld.  Until then the level
covers both places.

Where positions are all that the receiver tells, the odometer must have stood as well when the
stand began.  Receivers hold the place of a vehicle that drives; and wheels of one do not spin.
Places are compared, not ways: who drives in a circle comes back.
"""

import math

from ..._compile import Record, kernel
from .._simd import copy_record
from .agreement import count, differ, moved
from .motion_sources import ARC, SPEED
from .windows import ANCHORS, CLOCK, COARSE, WHEELS, sigma_between

_LONGEST = 60.0  # s, after which a stand without a doubt is compared anew
_APART = 2.5  # sigmas, and a share of the way,
_OF_WAY = 0.2  # by which fixes differ from the odometer
_BY_BOTH = 0.5  # share of the fixes' way that the receiver's speed tells as well, at least
_P = 0.5  # P(the odometer is wrong), as long as only the receiver speaks against it
_PRIOR, _SOFT = 8.0, 1.5  # nats for it where positions alone do; times their variance
_LEAST_P = 1e-3  # of that
_FADES = 10.0  # s, of a doubt that is left when the fixes move on
_HOLDS = 20.0  # m for which receivers may hold the place of a stop
_AGAIN = 1.5  # times as far as it has held one before
_RESTS = 1.0  # m/s by an odometer that stands, or nearly
_QUIET = 0.3  # share of its steps at rest, below which a receiver holds a place
_OF_STEPS = 0.2  # of a step, in what is usual


@kernel
def begin_stand(spin: Record, anchor: Record) -> None:
    """Begin a stand at the first anchor after a pause, over which the receiver's way is not known.

    Args:
        spin: `motion_sources.VETTING`'s, in place.
        anchor: Of `windows`.
    """
    copy_record(spin.since, anchor)
    copy_record(spin.before, anchor)
    spin.p = 0.0
    spin.rests = 0


@kernel
def weigh_spin(vetting: Record, last: int, scale: float, sensors: int) -> None:
    """Count seconds in which only the odometer moves.

    Args:
        vetting: In place.
        last: The newest anchor.
        scale: Plane metres per true metre.
        sensors: What there is.
    """
    spin = vetting.spin
    windows = vetting.windows
    a = spin.since
    b = windows.anchors[last % ANCHORS]
    sigma = sigma_between(windows, a, b)
    since = b.time - spin.before.time
    alone = b.speeds == 0 or vetting.refused[SPEED] == 1
    measured = sensors != CLOCK and b.odometry == 1 and b.time > a.time
    if not measured or sigma > COARSE or alone != spin.alone:
        begin_stand(spin, b)
        spin.alone = alone
    elif alone and sensors == WHEELS:
        _weigh_places(vetting, b, scale, sigma, since)
    elif not alone:
        _weigh_speeds(vetting, b, scale, sigma, since)
    copy_record(spin.before, b)


@kernel
def _weigh_speeds(vetting: Record, b: Record, scale: float, sigma: float, since: float) -> None:
    """The same where the receiver tells its speed.

    Args:
        vetting: In place.
        b: The newest anchor.
        scale: Plane metres per true metre.
        sigma: Of the way of the fixes since the stand began, m.
        since: s since anchors were compared last.
    """
    spin = vetting.spin
    a = spin.since
    fixes = math.hypot(b.x - a.x, b.y - a.y) / scale
    doubted = spin.p > 0.0
    spin.p = 0.0
    odometer = abs(b.arc - a.arc)
    receiver = b.path - a.path
    precise = 0.3 * math.sqrt(b.time - a.time) + 0.5
    agree = differ(fixes, receiver, sigma) < 0
    if (agree or doubted) and differ(odometer, receiver, precise) > 0:
        spin.p = _P
        spin.sigma = sigma
        if agree and abs(odometer - fixes) > _APART * sigma + _OF_WAY * max(odometer, fixes):
            count(vetting, ARC, since)
    doubted = doubted or spin.p > 0.0
    left = fixes >= moved(sigma) and (not doubted or receiver > _BY_BOTH * fixes)  # else it jumped
    if left or (not doubted and b.time - a.time > _LONGEST):
        copy_record(spin.since, b)


@kernel
def _weigh_places(vetting: Record, b: Record, scale: float, sigma: float, since: float) -> None:
    """The same where positions are all that the receiver tells; see `_weigh_speeds`.

        P(spins) = 1 / (1 + exp(8 - d² / (3 sigma²)))

    with d what the places by odometry are farther apart than those of the fixes.
    """
    spin = vetting.spin
    a, before = spin.since, spin.before
    rests = abs(b.arc - before.arc) < _RESTS * since
    step = math.hypot(b.x - before.x, b.y - before.y) / scale
    kind = 1 if rests else 0
    spin.steps[kind] += _OF_STEPS * (step - spin.steps[kind])
    fixes = math.hypot(b.x - a.x, b.y - a.y) / scale
    odometer = math.hypot(b.ox - a.ox, b.oy - a.oy)
    apart = odometer - fixes
    slack = _APART * sigma + _OF_WAY * odometer
    left = fixes >= moved(sigma)
    p = spin.p * math.exp(-since / _FADES)
    if left and abs(apart) < slack:
        p = 0.0
        if spin.apart > slack:  # the receiver has held the place
            spin.held = max(spin.held, _AGAIN * spin.apart)
    spin.apart = max(spin.apart, apart)
    if spin.rests == 1 and not left and apart > 0.0 and spin.steps[0] > _QUIET * spin.steps[1]:
        odds = min(0.5 * apart * apart / (_SOFT * sigma * sigma), 2.0 * _PRIOR)
        p = max(p, 1.0 / (1.0 + math.exp(_PRIOR - odds)))
        if apart > max(slack, _HOLDS, spin.held) and fixes < _APART * sigma:
            count(vetting, ARC, since)
    spin.p = p if p > _LEAST_P and vetting.refused[ARC] == 0 else 0.0
    spin.sigma = sigma
    late = spin.p == 0.0 and b.time - a.time > _LONGEST
    if left or late or (rests and spin.rests == 0):
        copy_record(spin.since, b)
        spin.rests = kind
        spin.apart = 0.0
