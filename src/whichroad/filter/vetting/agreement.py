"""Distances and turns by each source of motion beside each other: who disagrees with the others."""

import math
from typing import NamedTuple

from ..._compile import Record, kernel
from ...graph.geometry import wrap
from .motion_sources import ARC, COURSE, SPEED, TURN, is_possible
from .windows import (
    CLOCK,
    COARSE,
    WHEELS,
    Courses,
    Seen,
    between,
    far_enough,
    needed,
    turn_of_places,
)

_LONGEST = 15.0  # s
_TURNED, _OPPOSITE = 2.0, 0.4  # rad², and share of it: turns that agreed before go the other way
_TRIED, _ALIKE_SUMS = (
    0.3,
    0.6,
)  # the same of turns that agree in sum; and, as they never did, disagree
_LONGER = 2.0  # times as long as legs must be, of the longer pair of them
_ABOUT = 2.2  # rad, beyond which two turns have no sign: the vehicle drives back, or has turned
_DIFFERS = 0.4  # rad, and two sigmas, from which on turns differ
_MOST_DRIFT = 0.2  # rad/m: a wheel by a third larger
_MOST, _LEAST = 6.0, -3.0  # of a score
_BENT = 2.0  # rad of a bend within which its chord tells its way
_AT_ONCE = 2.0  # s that one comparison tells of a receiver's speed or course at most
_TURNS_ALONG = 0.1  # rad, by which courses that agree must turn before they are used
_ALIKE = 0.3  # rad, within which two turns are alike
_STOPPED = 10.0  # s after an impossible stop, within which fixes may confirm it
_STANDS = 0.1  # m/s by the odometer
NEVER = 50.0  # m, after which odometry that never turned does not measure turns
_DISPUTED = 30.0  # s after a misfit, for which fixes that had run away before say nothing
_FASTER = 1.0  # m/s by which fixes become faster than a speed that stays the same may be
_RUNS = 2.0  # m/s of fixes, that no standing receiver feigns for long


@kernel
def differ(a: float, b: float, sigma: float) -> int:
    """Whether two distances agree (−1), or do not (1), or nothing can be said (0)."""
    larger = max(a, b)
    apart = abs(a - b)
    if apart > 4.0 * sigma + 0.2 * larger:
        return 1
    if apart < 2.0 * sigma + 0.12 * larger:
        return -1
    return 0


@kernel
def moved(sigma: float) -> float:
    """Way (m) of fixes of an error from which on they have moved."""
    return 5.0 * sigma + 2.0


@kernel
def count(vetting: Record, source: int, seconds: float) -> None:
    """Count seconds of disagreement, or, negative, of agreement.

    A fix that is off disagrees on the way there and on the way back, however long these take.
    """
    if source >= SPEED:  # or COURSE
        seconds = min(seconds, _AT_ONCE)
    vetting.score[source] = min(max(vetting.score[source] + seconds, _LEAST), _MOST)


@kernel
def _blame_one(vetting: Record, by_odometer: int, by_speed: int, since: float) -> None:
    """Odometer and receiver's speed differ: the one that differs from the fixes as well loses.

    Args:
        vetting: In place.
        by_odometer: Whether fixes and odometer differ.
        by_speed: Whether fixes and the receiver's speed do.
        since: s since they were compared last.
    """
    if by_odometer > 0 and by_speed <= 0:
        count(vetting, ARC, since)
    elif by_speed > 0 and by_odometer <= 0:
        count(vetting, SPEED, since)
    elif by_odometer > 0:
        count(vetting, ARC, 0.5 * since)
        count(vetting, SPEED, 0.5 * since)


@kernel
def _is_disputed(vetting: Record, stands: bool, now: float, seconds: float) -> bool:
    """Whether fixes fitted nothing before the odometry came to stand, and still do not."""
    if not stands:
        vetting.stood_at = math.inf
    elif vetting.stood_at == math.inf:
        vetting.stood_at = now - seconds
    return bool(vetting.undecided_at < vetting.stood_at and now - vetting.forked_at < _DISPUTED)


class Compared(NamedTuple):
    """Distances between two anchors; whether two of them differ is as of `differ`."""

    by_odometer: int  # fixes and odometer
    by_speed: int  # fixes and the receiver's speed
    both: int  # odometer and the receiver's speed
    fixes: float  # m
    odometer: float  # m
    seconds: float


@kernel
def weigh_distances(
    vetting: Record, sensors: int, seen: Seen, turn: float, since: float
) -> None:  # fmt: skip
    """Distance by fixes, odometer and receiver's speed: who disagrees with the others."""
    now = vetting.windows.now.time
    bent = min(abs(turn), _BENT)
    longer = 1.0 + bent * bent / 24.0 + bent**4 / 1000.0  # way over chord, on an arc
    fixes = seen.fixes * longer
    odometer = seen.odometer * longer if sensors == WHEELS else seen.odometer
    reported = seen.speeds
    rolls = sensors != CLOCK and seen.odometry
    precise = 0.3 * math.sqrt(seen.seconds) + 0.5
    vetting.pace = -1.0
    if seen.sigma > COARSE:
        return
    if reported and vetting.refused[SPEED] == 0:
        vetting.pace = seen.receiver / seen.seconds
    elif seen.fixes > 3.0 * seen.sigma:
        vetting.pace = fixes / seen.seconds
    others = max(odometer if rolls else 0.0, seen.receiver if reported else 0.0)
    if max(fixes, others) < moved(seen.sigma):
        # it stands by all of them; and did so from a sudden stop on
        if rolls and now - vetting.impossible_at < _STOPPED:
            vetting.rolled = math.inf
        return
    if reported:
        _weigh_same(vetting, seen, fixes)
    by_odometer = differ(fixes, odometer, seen.sigma) if rolls else 0
    by_speed = differ(fixes, seen.receiver, seen.sigma) if reported else 0
    both = differ(odometer, seen.receiver, precise) if rolls and reported else 0
    if abs(turn) > _BENT:  # a chord says little of the way
        by_speed = 0
        if sensors == WHEELS:
            both = 0
        else:
            by_odometer = 0
    if sensors == WHEELS and by_odometer != 0:
        way = differ(fixes, abs(seen.arc), seen.sigma)
        if (by_odometer > 0 and way <= 0) or (by_odometer < 0 and way > 0):
            by_odometer = 0  # turns that are wrong make the chord differ, or agree by chance
    compared = Compared(by_odometer, by_speed, both, fixes, odometer, seen.seconds)
    _count_distances(vetting, compared, rolls, reported and vetting.refused[SPEED] == 0, since)


@kernel
def _count_distances(
    vetting: Record, compared: Compared, rolls: bool, vouches: bool, since: float
) -> None:
    """Count distances for or against odometer and receiver's speed.

    What is not believed vouches for nothing else: a speed that is always 0 agrees with counters
    that stand, while the fixes move.  Odometry that has never agreed with the fixes is in another
    unit.

    Args:
        vetting: In place.
        compared: What was compared.
        rolls: Whether odometry was measured.
        vouches: Whether the receiver's speed was, and is believed.
        since: s since they were compared last.
    """
    now = vetting.windows.now.time
    by_odometer, by_speed, both = compared.by_odometer, compared.by_speed, compared.both
    sound = rolls and vetting.refused[ARC] == 0 and is_possible(vetting)
    if by_odometer > 0 and by_speed > 0 and both < 0 and vouches and sound:
        vetting.windows.jumped_at = now  # the positions differ from both others, which agree
    stands = rolls and compared.odometer < _STANDS * compared.seconds
    runs = stands and by_odometer > 0 and compared.fixes > _RUNS * compared.seconds
    disputed = _is_disputed(vetting, stands, now, compared.seconds)
    vetting.runs = runs and not disputed
    if not stands:
        vetting.outrun = 0.0
    elif runs and both < 0 and vouches:
        vetting.outrun += since
    if rolls and vouches and both > 0:
        _blame_one(vetting, by_odometer, by_speed, since)
    elif by_speed > 0 and (not sound or (both > 0 and by_odometer <= 0)):
        count(vetting, SPEED, since)
    never = vetting.compared == 0 and by_odometer > 0 and by_speed <= 0
    if (vetting.runs == 1 or never) and not vouches:
        count(vetting, ARC, since)
    if by_odometer < 0 or (both < 0 and vouches):
        count(vetting, ARC, -since)
    if by_odometer < 0 and vetting.score[ARC] <= _LEAST:  # once may be chance, in a bend
        vetting.compared = 1
    if by_speed < 0 or (both < 0 and sound and by_odometer <= 0):
        count(vetting, SPEED, -since)


@kernel
def _weigh_same(vetting: Record, seen: Seen, fixes: float) -> None:
    """A receiver's speed that is the same to the digit, while its fixes become faster or slower.

    One that stands may be right, and its fixes be pulled away.
    """
    same = vetting.same
    if vetting.windows.speed != same[0]:
        same[0] = vetting.windows.speed
        same[1], same[2] = math.inf, -math.inf
        same[3] = vetting.windows.now.time
    if same[0] < _RUNS or vetting.windows.now.time - same[3] < seen.seconds:
        return
    unsure = 2.0 * seen.sigma / seen.seconds
    same[1] = min(same[1], fixes / seen.seconds + unsure)
    same[2] = max(same[2], fixes / seen.seconds - unsure)
    if same[2] - same[1] > _FASTER:
        vetting.score[SPEED] = _MOST


@kernel
def _bear_out(vetting: Record, course: float) -> None:
    """A course that agrees has turned since the first one that did."""
    if vetting.agreed == math.inf:
        vetting.agreed = course
    elif abs(wrap(course - vetting.agreed)) > _TURNS_ALONG:
        vetting.borne_out = 1


@kernel
def weigh_courses(
    vetting: Record, courses: Courses, seen: Seen, steered: bool, since: float
) -> float:
    """Courses against the direction of the fixes; returns the turn by those believed, rad.

    Where a course that has agreed for long suddenly does not, but turns as the odometry does,
    it is the positions that have jumped.

    Args:
        vetting: In place.
        courses: Between two anchors.
        seen: Motion between the two.
        steered: Whether the odometry's turns are measured, and believed.
        since: s since they were compared last.
    """
    if not courses.reported:
        return 0.0
    course, turn = courses.mean, courses.turn
    wide = 3.0 * seen.sigma / max(seen.fixes, 1e-3)
    if seen.fixes >= needed(seen.sigma) and abs(turn) < 1.5:
        off = abs(wrap(seen.heading - course))
        alike = steered and abs(wrap(turn - seen.turn)) < _ALIKE
        if off > 0.6 + wide and alike and vetting.score[COURSE] <= _LEAST:
            vetting.windows.jumped_at = vetting.windows.now.time
        elif off > 0.6 + wide:
            vetting.offs[0] += math.cos(seen.heading - course)
            vetting.offs[1] += math.sin(seen.heading - course)
            vetting.reported[COURSE] += 1.0
            vetting.seen[COURSE] += abs(wrap(turn))
            count(vetting, COURSE, since if off < 1.2 else 2.0 * since)
        elif off < 0.3 + 0.5 * wide:
            count(vetting, COURSE, -since)
            _bear_out(vetting, course)
    return turn if vetting.refused[COURSE] == 0 else 0.0


class Turned(NamedTuple):
    """A turn by odometry beside that of others."""

    reckoned: float  # rad, by odometry
    others: float  # rad
    arc: float  # m over which it was driven
    unsure: float  # rad; negative: nothing can be said


@kernel
def _turn_by_fixes(windows: Record, last: int, scale: float, times: float) -> Turned:
    """The turn between two legs that end at an anchor, so many times as long as they must be."""
    middle = far_enough(windows, last, scale, _LONGEST, times)
    earlier = far_enough(windows, middle, scale, _LONGEST, times) if middle >= 0 else -1
    if earlier < 0:
        return Turned(0.0, 0.0, 0.0, -1.0)
    before = between(windows, earlier, middle, scale)
    seen = between(windows, middle, last, scale)
    narrow = min(before.fixes, seen.fixes)
    least = max(before.sigma, seen.sigma)
    same = differ(before.fixes, before.odometer, least) <= 0
    same = same and differ(seen.fixes, seen.odometer, least) <= 0
    odometry = before.odometry and seen.odometry
    if narrow < times * needed(least) or not odometry or not same:
        return Turned(0.0, 0.0, 0.0, -1.0)
    others, reckoned = turn_of_places(windows, earlier, middle, last)
    return Turned(reckoned, others, 0.5 * (before.arc + seen.arc), 2.0 * least / narrow)


@kernel
def weigh_turns(
    vetting: Record, courses: Courses, seen: Seen, last: int, scale: float, since: float
) -> None:
    """Turns by odometry against those of fixes, or of courses where they are reported."""
    windows = vetting.windows
    if courses.reported and vetting.refused[COURSE] == 0 and seen.fixes >= needed(seen.sigma):
        weigh_turn(vetting, Turned(seen.turn, wrap(courses.turn), seen.arc, 0.1), since)
        return
    short = _turn_by_fixes(windows, last, scale, 1.0)
    long = _turn_by_fixes(windows, last, scale, _LONGER)
    if long.unsure > 0.0 and (
        short.unsure < 0.0 or _significance(vetting, long) > _significance(vetting, short)
    ):
        weigh_turn(vetting, long, since)
    elif short.unsure > 0.0:
        weigh_turn(vetting, short, since)


@kernel
def _off(vetting: Record, turned: Turned) -> float:
    """Turn by others less that by odometry, less the drift that is known, rad."""
    return float(wrap(turned.others - turned.reckoned - vetting.drift * turned.arc))


@kernel
def _significance(vetting: Record, turned: Turned) -> float:
    """By how many times the least that counts two turns differ."""
    return abs(_off(vetting, turned)) / (_DIFFERS + 2.0 * turned.unsure)


@kernel
def weigh_turn(vetting: Record, turned: Turned, since: float) -> None:
    """Count one comparison for or against the odometry's turns."""
    turn, arc, unsure = turned.reckoned, turned.arc, turned.unsure
    if abs(turn) > _ABOUT and abs(turned.others) > _ABOUT:
        return
    vetting.reported[TURN] += turn * turn
    vetting.seen[TURN] += turn * turned.others
    squares = vetting.reported[TURN]
    if squares > _TRIED and vetting.seen[TURN] > _ALIKE_SUMS * squares:
        vetting.tried = 1
    least, share = (_TURNED, _OPPOSITE) if vetting.tried == 1 else (_TRIED, _ALIKE_SUMS)
    if squares > least and vetting.seen[TURN] < -share * squares:
        vetting.score[TURN] = _MOST  # all turns together go the other way
        vetting.wavers = 1
    off = abs(_off(vetting, turned))
    if vetting.unturned > NEVER and off > _ALIKE + unsure:
        vetting.score[TURN] = _MOST  # no sensor measures no turn at all
        vetting.wavers = 1
    if off > _DIFFERS + 2.0 * unsure and abs(arc) > 1.0:
        vetting.wavers = 1
    if off > 1.0 + 3.0 * unsure:
        count(vetting, TURN, 3.0 * since)
    elif off > 0.5 + 2.0 * unsure:
        count(vetting, TURN, since)
    elif off < 0.25 + unsure and abs(turn) > 0.4 + unsure:
        count(vetting, TURN, -2.0 * since)
        vetting.turned = 1
        vetting.tried = 1
        vetting.untried = 0
    if vetting.refused[TURN] == 1 and abs(arc) > 1.0:  # it may be that one wheel is larger
        vetting.drift += min(0.1 * since, 0.5) * (_off(vetting, turned) / arc)
        vetting.drift = min(max(vetting.drift, -_MOST_DRIFT), _MOST_DRIFT)
