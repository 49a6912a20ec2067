"""Records: an epoch, what a drive shows of the error of the map, an epoch's ranked edges."""

from typing import Annotated

import numpy as np

from .._compile import Array, Record, Records
from ..graph.network import records
from ._simd import N

EPOCH = np.dtype(  # what the sensors said at one moment, and since the one before
    [
        ("time", "f8"),  # s
        # odometry, pre-integrated since the epoch before, in M's frame at that epoch
        ("arc", "f8"),  # odometer metres
        ("turn", "f8"),  # rad
        ("forward", "f8"),  # m
        ("left", "f8"),  # m
        ("unsure", "f8"),  # m², variance of the arc beyond that of odometry, of coarse steps
        # GNSS
        ("fix", "f8", (5,)),  # x, y (plane), sigma_major, sigma_minor (m), heading of major (rad)
        ("speed", "f8"),  # m/s
        ("speed_sigma", "f8"),  # inf: not reported
        ("course", "f8"),  # heading over ground, rad
        ("course_sigma", "f8"),  # inf: not reported
        ("odometer", "f8", (2,)),  # read at a sparse fix, m, 0: none; variance of the way to it, m²
        ("odometry_valid", "u1"),  # 1: measured; 2: until the next; 3: BELOW; 4: AHEAD; 0: not
        ("has_fix", "u1"),
        ("filled", "u1"),  # 1: the fix repeats an earlier one, as later ones prove
        ("gyro", "u1"),  # what measures the turn: BY_WHEELS ... of `vetting.windows`
        ("geared", "u1"),  # 1: a gear tells whether odometry is forwards or backwards
        ("evidence", "u1"),  # rows of `Work.evidence`, of further sensors
        ("first_evidence", "i4"),  # the first of them
    ],
    align=True,
)

Epoch = Annotated[Record, Array(EPOCH, 0)]

MAP_ERROR = np.dtype(  # what a drive has shown of the map's error, see `filter.map_error`
    [
        ("factor", "f8"),  # variance of the map's error about its mean, over map_sigma²
        ("local", "f8"),  # of it, what is not the uncertainty of that mean
        ("rate", "f8"),  # of `factor`, what is drawn anew over map_length
        ("prior", "f8"),  # of the hypotheses' own, before any road was seen
        ("whole", "f8", (2,)),  # mean of the map's error: how far the map is off as a whole, m
        ("energy", "f8", (2,)),  # what roads have told of its size: seen, and known
        ("information", "f8", (3,)),  # what they have told of its mean: xx, xy, yy, 1/m²,
        ("towards", "f8", (2,)),  # and that times the mean, 1/m
        ("moments", "f8", (3,)),  # over the way: lengths, and lengths times the error, m
        ("heading_factor", "f8"),  # on edge_heading_sigma²: lines of bad maps are turned for long
        ("heading_window", "f8", (3,)),  # innovations since it was learnt: m, sum, variance
        ("heading_energy", "f8", (2,)),  # what they have told of it: seen, and windows
        ("offset", "f8", (4,)),  # how far fixes are off from roads: lengths, square, and mean
    ],
    align=True,
)

COPIES = 2  # of the belief, that are moved by odometry alone

RECKONED = np.dtype(  # one of them, see `gnss.separation`
    [
        ("mu", "f8", (N,)),  # state by odometry alone since it was copied from the belief
        ("cov", "f8", (N, N)),
        ("begun", "f8"),  # s, when it was copied
        ("live", "u1"),
        ("p", "f8"),  # P(the belief and this differ by a fault)
        ("away", "f8", (2,)),  # from the heaviest hypothesis to it, m, axes of the plane
    ],
    align=True,
)

DEPARTURE = np.dtype(  # a fix that has left a vehicle whose odometer stands, see `gnss.departure`
    [
        ("p", "f8"),  # P(the vehicle is there)
        ("at", "f8", (2,)),  # its place by the fix, m, plane
        ("pace", "f8"),  # m/s, of the fixes
        ("time", "f8"),  # s, of the fix
        ("since", "f8"),  # s, when the vehicle came to rest,
        ("place", "f8", (2,)),  # its place then, m, plane
        ("offset", "f8", (2,)),  # by which a fix was expected beside it, m, plane
        ("variance", "f8"),  # of such a fix's place, m²
    ],
    align=True,
)

ROADS_LEFT = np.dtype(  # roads that were left while no fix came, see `filter.roads_left`
    [
        ("known", "u1"),  # 1: since the last fix the vehicle was on roads for sure
        ("doubted", "u1"),  # 1: the motion may be wrong
        ("odds", "f8"),  # log-odds that it is
        ("place", "f8", (2,)),  # where it was so last, m, plane
        ("metres", "f8"),  # driven since then
        ("seen", "f8"),  # m since the last fix, until now
    ],
    align=True,
)

UNMAPPED = np.dtype(  # fixes that lie beside the road, see `filter.unmapped`
    [
        ("p", "f8"),  # P(the vehicle is there, on a road that the map lacks)
        ("chi2", "f8"),  # squared distance across the road over its variance
        ("at", "f8", (2,)),  # their place, m, plane,
        ("sigma", "f8"),  # and its sigma as reported, m
        ("road", "f8", (2,)),  # the place on the road, where they err and the map does not
        ("haste", "f8", (2,)),  # how far speeds are too high for roads, and lately were, 0 to 1
        ("hasty", "f8"),  # P(the vehicle is on another road), as they are: filter.haste
        ("pace", "f8"),  # m/s, low-pass filtered,
        ("paced_at", "f8"),  # and the time of its last change, s
    ],
    align=True,
)

DOPPLER = np.dtype(  # fixes against the velocities reported with them: `gnss.doppler_scale`
    [
        ("error", "f8", (2,)),  # by which they have drifted, m
        ("place", "f8", (2,)),  # x, y (plane) of the last fix,
        ("velocity", "f8", (2,)),  # m/s, and
        ("time", "f8"),  # s
        ("lasted", "f8"),  # s, over which they were compared
        ("factor", "f8"),  # on reported variances,
        ("shown", "f8"),  # and its largest value of late
        ("until", "f8"),  # time up to which fixes are taken to lie far beside the road, s
    ],
    align=True,
)

DROPPED = np.dtype(  # ways between sparse fixes that nobody follows, see `sparse.dropped`
    [
        ("p", "f8"),  # P of them
        ("sigma", "f8"),  # of the fix, within which they lie, m
        ("time", "f8"),  # s, of that fix
    ],
    align=True,
)

GROSS = np.dtype(  # a receiver's error that may be a gross one, see `gnss.gross_error`
    [
        ("p", "f8"),  # P(the receiver is right, and the likeliest place is not); 0: they agree
        ("jump", "f8", (2,)),  # of the last fix that fitted nothing, m, axes of the plane
        ("time", "f8"),  # s, of that fix
        ("offered", "f8"),  # s, when a place at the fix was last offered
        ("error", "f8", (2,)),  # of the receiver, m, axes of the plane,
        ("sigma", "f8"),  # and its usual sigma, m
        ("astray", "f8"),  # P(fixes err, if they lead off the roads),
        ("aged", "f8"),  # and s, until when that has faded
    ],
    align=True,
)

DIRECTION = np.dtype(  # of odometry that may have no sign, see `hypotheses.no_sign`
    [
        ("has_sign", "u1"),  # 1: it has one, as it has counted down
        ("backing", "u1"),  # 1: some hypothesis may back up
        ("heard", "u1"),  # 1: the speed is known
        ("rests", "u1"),  # 1: the vehicle stands
        ("starts", "u1"),  # 1: the vehicle has started once
        ("speed", "f8"),  # m/s counted, low-pass filtered
        ("crept", "f8"),  # m counted without a pause
        ("paused", "f8"),  # s since it counted last
        ("back", "f8"),  # m counted down without a pause,
        ("downs", "i8"),  # and how often
        ("rested", "f8"),  # s it has stood since it drove
        ("metres", "f8"),  # m since the last start
        ("doubted", "f8"),  # time, s, until which it may have backed up
    ],
    align=True,
)

CARRIED = np.dtype(  # far fixes of a vehicle that stood without any, see `gnss.carried`
    [
        ("p", "f8"),  # P(the vehicle was carried there); 0: there are none
        ("since", "f8"),  # s, when the first of them came, and the last one
        ("time", "f8"),
        ("place", "f8", (2,)),  # m, plane,
        ("sigma", "f8"),  # and its sigma, m
    ],
    align=True,
)

SEPARATION = np.dtype(  # all of them, and how restless the receiver is
    [
        ("reckoned", RECKONED, (COPIES,)),
        ("departure", DEPARTURE),
        ("roads", ROADS_LEFT),
        ("unmapped", UNMAPPED),
        ("doppler", DOPPLER),
        ("dropped", DROPPED),
        ("gross", GROSS),
        ("carried", CARRIED),
        ("begun", "f8"),  # s, when the last one was copied
        ("sums", "f8", (4,)),  # of the odometry until now: x, y (m), turn (rad), arc (m)
        ("calm", "f8"),  # scale of the receiver's sigmas, in calm times; 0: not known
        ("restless", "f8"),  # by how much sigmas of the position may be too small
    ],
    align=True,
)

ALTERNATIVES = 6  # ranked edges

RANKING = np.dtype(  # ranked edges; they hold for as long as no weight changes
    [
        ("known", "u1"),  # 1: it is that of the weights as they are
        ("unknown", "f8"),  # P of what no hypothesis knows, by which it was made
        ("edge", "i4", (ALTERNATIVES,)),  # the most probable edges, in order
        ("p", "f4", (ALTERNATIVES,)),
        ("row", "i4", (ALTERNATIVES,)),  # the hypothesis of the largest weight on each
        ("chosen", "i4"),  # the edge that is told: the most probable one
        ("best", "i4"),  # the heaviest hypothesis on it, -1: none
        ("p_chosen", "f8"),  # of all hypotheses on it, where all of P is known
        ("facing", "f8"),  # P of its opposite direction
        ("chain", "i8"),  # ranked edges of its way, as bits; 0: it is alone
        ("p_chain", "f8"),  # of these
    ],
    align=True,
)

Epochs = Annotated[Records, Array(EPOCH, 1)]  # of a drive


def new_epochs(n: int) -> Epochs:
    """Empty epochs, (n,) EPOCH."""
    return records(n, EPOCH)
