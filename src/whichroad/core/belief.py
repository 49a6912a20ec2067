"""The belief: a mixture of hypotheses, one row each, and what its state means.

The state of a hypothesis, in this order and nowhere else:

    X, Y     position of M, the middle of the rear axle, plane coordinates (paper, X_k)
    H        heading, rad, counter-clockwise from the plane's east (the paper's θ)
    K        metres per odometer metre; without odometry the "odometer" counts seconds
             and K is the speed in m/s
    B        heading drift per odometer metre, rad/m
    D        offset from the road's centre line in the map's frame, m, right positive
    MX, MY   map-minus-world offset, m
    GX, GY   GNSS error in units of the reported ellipse (zero mean, unit variance)

X and Y are in plane units and everything else, covariance included, in true metres:
a displacement of v metres moves X, Y by k v, with k the plane's local scale.
"""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Cube, Ints, Ints32, Matrix, Vector, entry

N = 10
X, Y, H, K, B, D, MX, MY, GX, GY = range(N)

OFF_ROAD = -1  # edge of the hypothesis that the vehicle is on no mapped road
NO_EDGE = -2

# clock
NOW, TRAVELLED, MOVING, LAST_FIX, MISFITS, STARTED, SINCE_FIX, SPEED, STOOD = range(9)
GNSS_XX, GNSS_XY, GNSS_YY = 9, 10, 11  # smoothed covariance that receivers report, m²
TURN_RATE = 12  # rad/s
SINCE_LEFT = 13  # m travelled since off-road hypotheses were last born
GNSS_SCALE = 14  # factor on reported GNSS variances, learnt; 0 before the first fix
QUICK_SCALE, SLOW_SCALE = 15, 16  # what it is learnt from: innovations, the slow error,
WANDER_SCALE = 25  # and innovations that stay on one side
WANDER = 26  # and 27: mean of the last innovations over their sigmas, for each axis
USED_XX, USED_XY, USED_YY = 17, 18, 19  # covariance that scales γ, m²
LEARNT = 21  # s over which it has been learnt
SCALED_AT = 20  # time of the fix that the scale was last learnt from
ODOMETER_SPEED = 22  # m/s by the odometer, smoothed over a moment
PULL = 23  # m/s², its change
EVIDENCE = 24  # log-likelihood of all that was observed
WHITE = 28  # variance of what changes from fix to fix, over the reported one, as seen
BEFORE = 29  # and 30, 31: x, y, time of the last fix; 32 to 34: of the one before it
ORIGINS = 35  # hypotheses of the epoch last remembered; 0: nothing is remembered
ON_ROAD_AT = 36  # time of the last fix at which the roads had half of the probability
ACROSS = 37  # and 38, 39: offset from the road (m), its heading, time of the last sparse fix
CLOCKS = 40

CAPACITY = 160  # hypotheses, children of one epoch included
KEPT = 48  # hypotheses that survive an epoch


class Belief(NamedTuple):
    """All hypotheses; rows from `size[0]` on are scratch space.

    Shapes: C = CAPACITY, N states.
    """

    mean: Matrix  # (C, N)
    cov: Cube  # (C, N, N)
    log_weight: Vector  # (C,)
    probability: Vector  # (C,) exp(log_weight), set by `observe.normalise`
    edge: Ints32  # (C,) directed edge, OFF_ROAD
    segment: Ints32  # (C,) vertex at which the current segment starts
    abscissa: Vector  # (C,) m
    spread: Vector  # (C,) standard deviation of the abscissa, m
    stay: Vector  # (C,) probability of not being past the edge's end, when last looked at
    drove: Vector  # (C,) variance of what it drove to a fix far from the last one, m²; 0: it stood
    node: Ints  # (C,) newest node of the route tree
    fresh: Bytes  # (C,) 1: the edge was entered in this epoch, the route node is not made yet
    size: Ints  # (1,)
    clock: Vector  # see the names above
    scratch: Matrix  # (6, C)
    share: Matrix  # (C, KEPT or 0) of each hypothesis, what it owes to those last remembered


class Route(NamedTuple):
    """Tree of edges entered: follow `parent` back to get a hypothesis' route."""

    edge: Ints32
    parent: Ints
    time: Vector  # when the edge was entered, s
    abscissa: Vector  # where, m
    size: Ints  # (1,)


def new_belief(remembered: bool = False) -> Belief:
    """An empty belief; `remembered` where its past is kept (`core.memory`)."""
    c = CAPACITY
    return Belief(
        np.zeros((c, N)),
        np.zeros((c, N, N)),
        np.zeros(c),
        np.zeros(c),
        np.full(c, NO_EDGE, np.int32),
        np.zeros(c, np.int32),
        np.zeros(c),
        np.ones(c),
        np.ones(c),
        np.zeros(c),
        np.full(c, -1, np.int64),
        np.zeros(c, np.uint8),
        np.zeros(1, np.int64),
        np.zeros(CLOCKS),
        np.zeros((6, c)),
        np.zeros((c, KEPT if remembered else 0)),
    )


def new_route(capacity: int) -> Route:
    """An empty route tree."""
    return Route(
        np.full(capacity, NO_EDGE, np.int32),
        np.full(capacity, -1, np.int64),
        np.zeros(capacity),
        np.zeros(capacity),
        np.zeros(1, np.int64),
    )


@entry
def normalise(belief: Belief) -> float:
    """Make the weights sum to one; returns the log of what they summed to.

    That log is what the observations since the last call were worth: it adds to the
    evidence that the clock keeps.
    """
    n = belief.size[0]
    top = -math.inf
    for i in range(n):
        top = max(top, belief.log_weight[i])
    total = 0.0
    for i in range(n):
        belief.probability[i] = math.exp(belief.log_weight[i] - top)
        total += belief.probability[i]
    log_total = top + math.log(total)
    belief.clock[EVIDENCE] += log_total
    for i in range(n):
        belief.log_weight[i] -= log_total
        belief.probability[i] /= total
    return log_total
