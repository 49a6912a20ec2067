"""What is kept of each source of motion while it is vetted, see `filter.vetting.vet`."""

import math

import numpy as np

from ..._compile import Record, kernel
from .drift_walk import WALK
from .latency import LATENCY, clear_latency
from .repeats import REPEATS
from .scales import forget_scale
from .slipping import SLIP
from .turn_size import TURN_SIZE
from .wheel_size import WHEEL_SIZE
from .windows import ANCHOR, WINDOWS

ARC, TURN, SPEED, COURSE = range(4)  # what is vetted
SOURCES = 4
NONE, TURNS, ANYTHING = range(3)  # what an epoch has refused anew

SAMPLE = np.dtype(
    [
        ("time", "f8"),  # since the last sample, s,
        ("amount", "f8"),  # and what was measured since
        ("rate", "f8"),  # of the last sample, 1/s
        ("change", "f8"),  # from the one before, 1/s
        ("jitter", "f8"),  # by how much such changes usually differ, 1/s
        ("lasted", "f8"),  # s, of the last sample
        ("count", "i8"),  # of samples without a pause, 2 at most
    ],
    align=True,
)

SPIN = np.dtype(  # wheels that may turn on the spot, see `vetting.spinning`
    [
        ("p", "f8"),  # P(they do)
        ("sigma", "f8"),  # of the way of the fixes, m
        ("since", ANCHOR),  # when they began to stand
        ("before", ANCHOR),  # the last one
        ("alone", "u1"),  # 1: positions are all that the receiver tells
        ("rests", "u1"),  # 1: if so, the odometer stood then
        ("apart", "f8"),  # m by which the odometer's place was the farther one since then, at most
        ("held", "f8"),  # m of that which tell nothing: the receiver has held a place for so far
        ("steps", "f8", (2,)),  # m of fixes from anchor to anchor: while it moves, and at rest
    ],
    align=True,
)

BELOW = 3  # EPOCH.odometry_valid: 0, of odometry that tells nothing below a speed
AHEAD = 4  # the same: not measured, but as the vehicle would go on

SLOW = np.dtype(  # such odometry, see `filter.creeping`
    [
        ("least", "f8"),  # m/s, the least speed that it tells
        ("seconds", "f8"),  # s for which it has read 0 below that; 0: it reads more
        ("speed", "f8"),  # m/s by the receiver since then, averaged,
        ("known_at", "f8"),  # and when it was heard last, s; 0: never
        ("way", "f8"),  # m that are likely in this epoch,
        ("variance", "f8"),  # of the way of this epoch, m²,
        ("turn", "f8"),  # and of its turn, rad²
        ("unreckoned", "f8"),  # m², of ways that copies of the belief have not taken yet
        ("coarse", "u1"),  # 1: it counts in coarse steps, so that its speed jumps
    ],
    align=True,
)

TURN_OFFSET = np.dtype(  # a gyro's error that grows with the pace, see `filter.gyro`
    [
        ("mends", "f8"),  # rad/m that are added to its turns,
        ("variance", "f8"),  # and what is not known of that
        ("p", "f8"),  # P(there is one)
        ("own", "f8", (2,)),  # if so: what is to be added, rad/m, and its variance
        ("pace", "f8"),  # m/s of the vehicle as it moves; 0: it never came to rest
        ("rests", "u1"),  # 1: it has come to rest
        ("moved", "f8"),  # m since then
        ("before", "f8", (2,)),  # b and its variance when it came to rest,
        ("left", "f8", (2,)),  # and what is left since of that when it had driven off
    ],
    align=True,
)

FACING = np.dtype(  # where a vehicle faces by fixes and the sign of odometry, `vetting.facing`
    [
        ("x", "f8"),  # plane, of the fix at which the way began,
        ("y", "f8"),
        ("arc", "f8"),  # m counted since, backwards negative,
        ("metres", "f8"),  # and without its sign
        ("last", "f8"),  # rad turned since,
        ("turn", "f8"),  # and since the end of the last such way that told it:
        ("faces", "f8"),  # rad, in the plane, then,
        ("sign", "f8"),  # and -1: it was driven backwards; 0: there was none
    ],
    align=True,
)

VETTING = np.dtype(
    [
        ("windows", WINDOWS),
        ("slow", SLOW),
        ("begun", "u1"),  # 1: an epoch was seen
        ("score", "f8", (SOURCES,)),  # s of disagreement less those of agreement, kept in bounds
        ("refused", "u1", (SOURCES,)),  # 1: not believed
        # m/s, the receiver's speed when it was last refused; negative: it has changed
        ("stuck", "f8"),
        # m/s, a receiver's speed that stays the same, of fixes meanwhile: least, and most; since, s
        ("same", "f8", (4,)),
        ("borne_out", "u1"),  # 1: courses have turned with the fixes, and are used
        ("turned", "u1"),  # 1: so has the odometry,
        ("tried", "u1"),  # and did so once, even if not now, or in many small turns
        ("steered", "u1"),  # what has measured the turns lately: BY_WHEELS or BY_GYRO
        ("untried", "u1"),  # 1: a fix fitted nothing in a first turn, or soon after a return
        ("returned_at", "f8"),  # s, when odometry was last believed again
        ("stood_at", "f8"),  # s, when odometry came to stand; infinite: it moves
        ("runs", "u1"),  # 1: fixes run on beside odometry that stands
        ("outrun", "f8"),  # s for which they do so beside odometry and speeds that stand
        ("backed", "f8"),  # m by which it counts backwards (vetting.facing),
        ("forth", "f8"),  # m that it has counted forwards,
        ("facing", FACING),
        ("reversed", "u1"),  # 1: and is taken the other way round,
        ("turnabouts", "u1"),  # 1: and for sure, at some time
        ("compared", "u1"),  # 1: its distance has agreed with the fixes
        ("unturned", "f8"),  # m driven before it ever measured a turn; negative: it has
        # of the last leg of sparse fixes: directions by fixes and odometry, rad; alike; length, m;
        ("leg", "f8", (4,)),
        ("leg_before", "f8", (4,)),  # and m by fixes, two axes, and by odometry; s
        ("bend", "f8"),  # rad by which it has turned in the last seconds
        ("exposed", "u1"),  # 1: odometry was found impossible soon after a misfit, until a fix
        ("elsewhere", "u1"),  # 1: turns were refused with this epoch, and its fix is far away
        ("agreed", "f8"),  # rad, a course that agreed with the fixes first; infinite: none did
        ("speed_sample", SAMPLE),  # at the odometer's distance, m
        ("turn_sample", SAMPLE),  # at its turns, rad
        ("pivoted", "f8"),  # rad it has turned tighter than a car steers, while its middle moved
        ("suspect_at", "f8"),  # when odometry last changed as cars seldom do, s
        ("misfit", "f8"),  # m to the last fix that fitted no hypothesis, and three of its sigmas
        ("forked_at", "f8"),  # when a fix last fitted nothing, s,
        ("undecided_at", "f8"),  # and when the first one of such fixes did
        ("moved", "u1"),  # 1: the position was loosened at this epoch's fix
        ("impossible_at", "f8"),  # when the odometry last was what no car can do, s
        ("rolled", "f8"),  # m it has measured since
        ("relapses", "i8"),  # times that it was impossible again, soon after it was believed
        ("silent", "f8"),  # s for which odometry was not measured,
        ("missed", "u1"),  # 1: for so long that a fix moved the vehicle on to time alone
        ("sound", "f8"),  # m/s by the odometer when last believed
        ("pace", "f8"),  # m/s of the vehicle by the other sources; negative: unknown
        ("seconds", "f8", (SOURCES + 1,)),  # s for which each was withheld, and what is impossible
        ("since", "f8", (SOURCES + 1,)),  # s, when that began first; infinite: never
        ("reported", "f8", (SOURCES,)),  # while it was: what it said, m or rad² (turns squared),
        ("seen", "f8", (SOURCES,)),  # and what the others did, m or rad² (both multiplied)
        ("offs", "f8", (2,)),  # courses less directions of fixes: sums of cosine and sine
        ("news", "u1"),  # with this epoch was refused: NONE, TURNS that had agreed, ANYTHING
        ("drift", "f8"),  # rad/m that the odometry's turns are short of, as learnt
        ("wavers", "u1"),  # 1: with this epoch turns may be wrong
        ("odd", "i8"),  # receiver's speeds in a row that do not follow from the last one
        ("track", "f8"),  # rad, direction of fixes that are as fast as the odometer,
        ("track_sigma", "f8"),  # and its error, rad; infinite: they are not
        ("diverged", "f8"),  # s for which the belief's heading has differed from it,
        ("agreed_turn", "f8"),  # and the sum of turns when it last did not, rad
        ("apart", "u1"),  # 1: fixes and motion disagree, and either may be wrong
        ("latency", LATENCY),
        ("wheel_size", WHEEL_SIZE),  # the odometer's scale,
        ("turn_size", TURN_SIZE),  # and that of its turns
        ("turn_offset", TURN_OFFSET),  # a gyro's
        ("walk", WALK),  # of the drift of wheels
        ("repeats", REPEATS),  # fixes that only repeat a place
        ("spin", SPIN),
        ("slip", SLIP),  # wheels that slide or spin in passing
    ],
    align=True,
)

REPORTS = np.dtype(
    [
        ("speed", "f8", (3,)),  # reported by the receiver, m/s, when, s, and its change, m/s²
        ("course", "f8", (3,)),  # rad, s, rad/s
        ("place", "f8", (4,)),  # of a fix about a second ago: x, y (plane), when, s, course, rad
        ("latency", "f8", (2,)),  # of courses, moments: s times rad²/s², and rad²/s²
    ],
    align=True,
)

STILL = np.dtype(
    [
        ("near", "f8", (2,)),  # fixes, low-pass filtered, plane
        ("far", "f8", (2,)),  # the same of these
        ("at", "f8", (2,)),  # where the vehicle came to stand
        ("time", "f8"),  # of the last fix, s
        ("age", "f8"),  # s of fixes that are in it; negative: none
        ("apart", "f8"),  # s of fixes in a row that are farther off than it can have driven
        ("beyond", "f8", (2,)),  # the first of these
        ("left", "f8"),  # m by which a fix shows that it has left, until it is moved by them
        ("stands", "u1"),  # 1: the fixes stay where they are
        ("at_rest", "u1"),  # 1: the vehicle rests, by speed or place of the last fix
    ],
    align=True,
)

_REST = 2.0  # s without anything impossible,
_ROLLED = 10.0  # and m, after which odometry is believed again; twice as many after a relapse
_MOST_RELAPSES = 8
_SOUND_WAY = 2000.0  # m, after which relapses are forgotten


@kernel
def clear(vetting: Record) -> None:
    """Begin: nothing was seen, and everything is believed."""
    clear_latency(vetting.latency)
    vetting.wheel_size.scale.rate_variance = math.inf
    vetting.wheel_size.scale.rate = 1.0
    vetting.wheel_size.before = 1.0
    forget_scale(vetting.wheel_size.scale)
    forget_scale(vetting.turn_size.scale)
    vetting.rolled = _ROLLED
    vetting.impossible_at = -math.inf
    vetting.pace = -1.0
    vetting.track_sigma = math.inf
    vetting.forked_at = -math.inf
    vetting.undecided_at = -math.inf
    vetting.speed_sample.jitter = 0.3
    vetting.turn_sample.jitter = 0.1
    vetting.suspect_at = -math.inf
    vetting.stood_at = math.inf
    vetting.since[:] = math.inf
    vetting.agreed = math.inf
    vetting.returned_at = -math.inf
    vetting.windows.jitter = 2.0
    vetting.slip.time = vetting.slip.since = vetting.slip.then[0] = -math.inf
    vetting.windows.jumped_at = -math.inf
    vetting.windows.left[2] = -math.inf
    vetting.windows.speed_time = -math.inf
    vetting.windows.now.odometry = 1


@kernel
def is_possible(vetting: Record) -> bool:
    """Whether the odometry has been what cars can do for long enough."""
    rested = vetting.windows.now.time - vetting.impossible_at >= _REST
    return bool(rested and vetting.rolled >= _ROLLED * (1 << vetting.relapses))


@kernel
def is_borne_out(vetting: Record) -> bool:
    """Whether courses were seen to turn with the motion, or fixes are too sparse to show it.

    A course that is always 0 fits where the vehicle drives north, too.
    """
    windows = vetting.windows
    alone = windows.count <= 1 and windows.jumped_at < windows.now.time
    return bool(vetting.borne_out == 1 or alone)


@kernel
def blame(vetting: Record, time: float) -> None:
    """Odometry did what no car can do."""
    if is_possible(vetting):
        again = vetting.rolled < _SOUND_WAY and vetting.impossible_at > -math.inf
        vetting.relapses = min(vetting.relapses + 1, _MOST_RELAPSES) if again else 0
    vetting.impossible_at = time
    vetting.rolled = 0.0
