"""Which sensors are believed: each is held against all others, and against what cars can do.

A reading that no car can make is not believed at once.  A source of motion that disagrees with
the others for some seconds is not believed until it agrees again; where two stand against each
other, the one that physics, persistence and a third source speak for is kept.  What is not
believed is withheld from the filter, which then moves the vehicle by what is left: by distance
alone, or by time.
"""

import math

from ..._compile import Record, kernel
from .agreement import NEVER, differ, weigh_courses, weigh_distances, weigh_turns
from .clocks import heed_clocks, mend_odometry
from .latency import clear_latency, keep_place
from .motion_sources import (
    AHEAD,
    ANYTHING,
    ARC,
    COURSE,
    NONE,
    SOURCES,
    SPEED,
    TURN,
    TURNS,
    is_possible,
)
from .plausibility import check_odometry, is_odd
from .slipping import count_slip, weigh_slip
from .sparse_fixes import leg_of, weigh_leg
from .spinning import begin_stand, weigh_spin
from .turn_size import watch_turns
from .wheel_size import watch_size
from .windows import (
    ANCHORS,
    BY_GYRO,
    CLOCK,
    DISTANCE,
    PAUSE,
    UNTURNED,
    WHEELS,
    Seen,
    add_fix,
    advance,
    between,
    course_between,
    far_enough,
    needed,
)

_WINDOW = 4.0  # s, of what does not move
_SILENT = 1.5  # s of silence, from which on a fix tells the motion better than that before it
_OUTRUN = 60.0  # s for which fixes run away from a vehicle that stands by two sources
_CHANGED = 1.0  # m/s
_REFUSED, _BELIEVED = 3.0, -3.0  # scores from which on a source is not believed, and again is


@kernel
def mode_of(vetting: Record, sensors: int) -> int:
    """What moves the vehicle: of the sensors there are (WHEELS, DISTANCE, CLOCK) those believed."""
    if (
        sensors == CLOCK
        or vetting.missed == 1
        or vetting.refused[ARC] == 1
        or not is_possible(vetting)
    ):
        return CLOCK
    silent = vetting.steered == BY_GYRO and vetting.unturned > NEVER  # and may not be a gyro
    if sensors == WHEELS and (vetting.refused[TURN] == 1 or silent):
        return DISTANCE
    return sensors


@kernel
def vet(vetting: Record, epoch: Record, dt: float, sensors: int, scale: float) -> None:
    """Take an epoch, and decide which sources of motion are believed.

    Args:
        vetting: In place.
        epoch: What the sensors measured.
        dt: Since the epoch before, s.
        sensors: What there is: WHEELS, DISTANCE or CLOCK.
        scale: Plane metres per true metre.
    """
    windows = vetting.windows
    _forget(vetting)
    if sensors != CLOCK:
        _take_odometry(vetting, epoch, dt, sensors)
        keep_place(vetting.latency, windows.now, epoch.time)
    if epoch.has_fix and sensors != CLOCK:
        weigh_slip(vetting, epoch, _rolls(vetting) and vetting.refused[SPEED] == 0)
    count_slip(vetting, epoch.time)
    if not epoch.has_fix:
        return
    sound = _compare_clocks(vetting, epoch, sensors, scale)
    odd = is_odd(vetting, epoch)
    leg = leg_of(windows, epoch, scale)
    kept = _keep(vetting, epoch, scale, not odd)
    watch_size(vetting.wheel_size, epoch, windows, scale, sound)
    if not kept:
        return
    anew = vetting.wheel_size.sudden or vetting.wheel_size.scale.found
    watch_turns(vetting.turn_size, windows, scale, sound, anew, vetting.steered == BY_GYRO)
    if leg.seconds > 0.0:
        seen = weigh_leg(vetting, leg, sensors)
        _decide(vetting)
        _record(vetting, seen, windows.now.time, leg.seconds)
        return
    vetting.leg[3] = vetting.leg_before[3] = 0.0
    last = windows.count - 1
    first = far_enough(windows, last, scale, _WINDOW)
    if first >= 0:
        since = windows.anchors[last % ANCHORS].time - windows.anchors[(last - 1) % ANCHORS].time
        seen = between(windows, first, last, scale)
        _weigh(vetting, seen, first, scale, sensors, since)
        weigh_spin(vetting, last, scale, sensors)
        _decide(vetting)
        _record(vetting, seen, windows.now.time, since)
    else:
        weigh_spin(vetting, last, scale, sensors)
        _decide(vetting)


@kernel
def _weigh(
    vetting: Record, seen: Seen, first: int, scale: float, sensors: int, since: float
) -> None:
    """Compare the sources of motion from an anchor to the newest one."""
    windows = vetting.windows
    last = windows.count - 1
    steered = sensors == WHEELS and seen.odometry and vetting.refused[TURN] == 0
    vetting.bend = seen.turn
    _set_track(vetting, seen)
    courses = course_between(windows, first, last)
    turn = weigh_courses(vetting, courses, seen, steered, since)
    if sensors == WHEELS and seen.odometry:
        weigh_turns(vetting, courses, seen, last, scale, since)
        turn = seen.turn if vetting.refused[TURN] == 0 else turn
    weigh_distances(vetting, sensors, seen, turn, since)


@kernel
def _keep(vetting: Record, epoch: Record, scale: float, speed: bool) -> bool:
    """`add_fix`; after a pause a stand begins anew."""
    windows = vetting.windows
    paused = epoch.time - vetting.spin.before.time > PAUSE
    kept = add_fix(windows, epoch, scale, speed)
    if paused:
        begin_stand(vetting.spin, windows.anchors[0])
    return bool(kept)


@kernel
def _rolls(vetting: Record) -> bool:
    """Whether the odometer's way is believed."""
    believed = vetting.missed == 0 and vetting.refused[ARC] == 0
    return bool(is_possible(vetting) and believed)


@kernel
def _compare_clocks(vetting: Record, epoch: Record, sensors: int, scale: float) -> bool:
    """Learn how late a fix is; returns whether distance and turn until it may be right."""
    if sensors == CLOCK:
        vetting.latency.behind[0] = 0.0
        return False
    sound = _rolls(vetting) and vetting.slip.by == 0.0
    sound = sound and (sensors == DISTANCE or vetting.refused[TURN] == 0)
    heed_clocks(vetting.latency, epoch, scale, sound)
    return bool(sound and sensors == WHEELS and vetting.windows.now.odometry == 1)


@kernel
def _take_odometry(vetting: Record, epoch: Record, dt: float, sensors: int) -> None:
    """Sum up what odometry has measured, and hold it against what cars can do."""
    measured = epoch.odometry_valid != 0 and epoch.odometry_valid != AHEAD
    vetting.silent = 0.0 if measured else vetting.silent + dt
    if measured:
        vetting.missed = 0
    elif epoch.has_fix and vetting.silent > _SILENT:
        vetting.missed = 1
    if measured and dt > 0.0:
        check_odometry(vetting, epoch, dt, sensors)
    if dt > 0.0:
        mend_odometry(vetting.latency, epoch)
    advance(vetting.windows, epoch, dt, measured and epoch.gyro != UNTURNED)
    if not measured:
        _pause(vetting.speed_sample)
        _pause(vetting.turn_sample)


@kernel
def _forget(vetting: Record) -> None:
    """Forget what only held for the epoch before."""
    vetting.news = NONE
    vetting.elsewhere = 0
    vetting.wavers = 0
    vetting.runs = 0
    vetting.track_sigma = math.inf


@kernel
def _set_track(vetting: Record, seen: Seen) -> None:
    """The direction of the fixes, where they are as fast as the odometer."""
    if not seen.odometry or seen.fixes < needed(seen.sigma):
        return
    if differ(seen.fixes, seen.odometer, seen.sigma) <= 0:
        vetting.track = seen.heading + 0.5 * seen.turn
        vetting.track_sigma = 2.0 * seen.sigma / seen.fixes + 0.5 * abs(seen.turn)


@kernel
def _pause(sample: Record) -> None:
    """Begin a sample anew."""
    sample.count = 0
    sample.time = 0.0
    sample.amount = 0.0


@kernel
def _decide(vetting: Record) -> None:
    """Stop believing, or believe again; a receiver's speed not before it has changed."""
    if abs(vetting.windows.speed - vetting.stuck) > _CHANGED:
        vetting.stuck = -1.0
    for source in range(SOURCES):
        if vetting.score[source] >= _REFUSED:
            if vetting.refused[source] == 0:
                agreed = source == TURN and vetting.turned == 1 and vetting.news == NONE
                vetting.news = TURNS if agreed else ANYTHING
                if source == SPEED:
                    vetting.stuck = vetting.windows.speed
            vetting.refused[source] = 1
        elif vetting.score[source] <= _BELIEVED and (source != SPEED or vetting.stuck < 0.0):
            vetting.refused[source] = 0
    if vetting.refused[TURN] == 1:
        vetting.turned = 0
        clear_latency(vetting.latency)
    if vetting.refused[COURSE] == 1:
        vetting.borne_out = 0
        vetting.agreed = math.inf


@kernel
def refuse_standing(vetting: Record) -> None:
    """Stop believing odometry and speeds that stand, as fixes have run away for a minute."""
    if vetting.outrun < _OUTRUN:
        return
    vetting.outrun = 0.0
    vetting.news = ANYTHING
    vetting.stuck = vetting.windows.speed
    for source in (ARC, SPEED):
        vetting.score[source] = _REFUSED
        vetting.refused[source] = 1


@kernel
def _record(vetting: Record, seen: Seen, now: float, since: float) -> None:
    """Sum up what was withheld and how it differed, by which it is named."""
    for source in range(SOURCES + 1):
        wrong = vetting.refused[source] == 1 if source < SOURCES else not is_possible(vetting)
        if wrong:
            vetting.seconds[source] += since
            if vetting.since[source] == math.inf:
                vetting.since[source] = now
    if vetting.refused[ARC] == 1:
        vetting.reported[ARC] += seen.odometer
        vetting.seen[ARC] += seen.fixes
    if vetting.refused[SPEED] == 1:
        vetting.reported[SPEED] += seen.receiver
        vetting.seen[SPEED] += seen.fixes
