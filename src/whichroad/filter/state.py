"""The filter's state as records: one hypothesis, what all hypotheses share, the path tree.

A record's field has a name, a type and a unit, here and nowhere else.  The state vector of a
hypothesis, in this order:

    X, Y     position of M, the middle of the rear axle, plane coordinates (paper, X_k)
    H        heading, rad, counter-clockwise from the plane's east (the paper's θ)
    K        metres per odometer metre; without odometry m/s, whose "odometer" counts seconds
    B        heading drift per odometer metre, rad/m
    D        offset from the road's centre line in the map's frame, m, right positive
    MX, MY   map-minus-world offset, m
    GX, GY   GNSS bias in units of the reported ellipse (zero mean, unit variance)
    U        driven beyond what was extrapolated while wheels are silent, m (`silent_wheels`)
    V        error of one further sensor that stays, rad or m (`evidence.observe`); else zero

X and Y are in plane units and everything else, covariance included, in true metres: a
displacement of v metres moves X, Y by k v, with k the plane's local scale.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from .._compile import Array, Matrix, Record, Records, Vector, entry, kernel
from ..graph.index import CANDIDATE
from ..graph.labels import Search, new_search
from ..graph.network import Roads, lane_sigma_of, records
from ._simd import N as N
from ._simd import copy_record
from .evidence.evidence_kinds import NO_EVIDENCE, SENSOR, SENSORS, Evidence
from .lookback.path_tree import Path as Path
from .lookback.path_tree import enter as enter
from .lookback.path_tree import new_path as new_path
from .records import DIRECTION, MAP_ERROR, RANKING, SEPARATION
from .records import EPOCH as EPOCH
from .records import Epochs as Epochs
from .records import new_epochs as new_epochs
from .sparse.driver import DRIVER, LEG, begin_leg
from .sparse.origin import ORIGIN, forget_origin
from .vetting.motion_sources import REPORTS, STILL, VETTING, clear
from .vetting.windows import CLOCK as CLOCK
from .vetting.windows import DISTANCE as DISTANCE
from .vetting.windows import WHEELS as WHEELS

X, Y, H, K, B, D, MX, MY, GX, GY, U, V = range(N)

OFF_ROAD = -1  # edge of the hypothesis that the vehicle is on no mapped road
NO_EDGE = -2

NOTHING, RECEIVER, MOTION = range(3)  # what a hypothesis blames for fixes that fitted nothing
WRONG, BIASED = 1, 2  # what a hypothesis that has driven on regardless of a fix takes it to be
# motion is predicted: not yet; anew by a fix; in the plane; along the road; not at all; by routes
WAIT, START, PLANE, ROAD, STAND, ROUTES = range(6)

BESIDE_SIGMA = 20.0  # m, off the roads: sigma of the offset from a road that runs beside
RARE, RARE_FLOOR, GRACE = 0.01, 1e-3, 60.0  # prior of a rare turn; its floors, for so many m
NO_BOUND = 1e9  # m, of a hypothesis that has passed nothing on

CAPACITY, KEPT = 160, 48  # hypotheses, children of one epoch included; that survive it

HYPOTHESIS = np.dtype(
    [
        ("mu", "f8", (N,)),  # mean of the state vector
        ("cov", "f8", (N, N)),
        ("log_weight", "f8"),
        ("weight", "f8"),  # exp(log_weight), set by `normalise`
        ("along", "f8"),  # abscissa on its edge, m
        ("along_sigma", "f8"),  # m
        ("lateral", "f8"),  # offset from the edge when last tracked, m, right positive
        ("tangent", "f8", (2,)),  # of the edge there
        ("odds", "f8", (2,)),  # of its weight over the risk: twice the logarithm, the root of that
        ("p_not_passed", "f8"),  # P(not past the edge's end, or the bound), when last evaluated
        ("bound", "f8"),  # abscissa from which on its Gaussian was passed on, m, or NO_BOUND
        ("travel_variance", "f8"),  # of the distance to the last sparse fix, m²; 0: it stood
        ("stood", "f8"),  # s that it has stood, by sparse fixes; off the roads: it is parked there
        ("beside", "f8", (4,)),  # off the roads: filter.beside; zero: it has just left one
        ("freed", "f8"),  # variance that the GNSS bias was given since the last stored step
        ("grace", "f8"),  # m to drive until the usual floors hold again, after a rare turn
        ("scratch", "f8", (8,)),  # of one observation; each module names its slots
        ("ground", "f8", (2, 3)),  # height (m), slope, sensor's error (m): filter.elevation
        ("sinks", "f8"),  # log-likelihood of the second of these over the first, nats
        ("amiss", "f8"),  # how much worse headings fit it than they fit the best one, nats, <= 0
        ("path_entry", "i8"),  # newest entry of the path tree
        ("edge", "i4"),  # directed edge, OFF_ROAD, NO_EDGE
        ("before", "i4"),  # edge from which it came over the start of its own, or NO_EDGE
        ("segment", "i4"),  # vertex at which the current segment starts
        ("corner", "i4"),  # edge along which it drove before it turns at its end, or NO_EDGE
        ("course", "i4"),  # off the roads: edge that it was last beside, NO_EDGE
        ("blames", "u1"),  # what it takes to be wrong: NOTHING, RECEIVER or MOTION
        ("backs", "u1"),  # 1: it backs up, and odometry without a sign counts up (no_sign)
        ("new_edge", "u1"),  # 1: the edge was entered in this epoch, its path entry is due
        ("ignores", "u1"),  # WRONG: it takes this epoch's fix to say nothing; BIASED: to be far off
        ("leg", LEG),  # what it drove to the last fix, where that was sparse
        ("origin", ORIGIN),  # where it was before a fix that it takes to be wrong
    ],
    align=True,
)

FILTER = np.dtype(
    [
        ("count", "i8"),  # hypotheses
        ("rows", "i8"),  # and, since the last estimate, their parts across nodes (node_shares)
        ("parents", "i8"),  # hypotheses of the history's last step; 0: nothing is stored
        ("mode", "i8"),  # what moves the vehicle now: WHEELS, DISTANCE or CLOCK
        ("known_rate", "f8", (2,)),  # κ of the odometer and its variance, when last used
        ("known_drift", "f8", (2,)),  # the same of b
        ("vetting", VETTING),  # which sensors are believed
        ("separation", SEPARATION),  # places by odometry alone (gnss.separation)
        ("direction", DIRECTION),  # whether odometry has a sign
        ("still", STILL),  # whether fixes alone show that the vehicle stands (filter.standstill)
        ("sensors", SENSOR, (SENSORS,)),  # further ones (filter.evidence)
        ("ranking", RANKING),  # of the edges, in the last estimate
        ("map", MAP_ERROR),  # as learnt (filter.map_error)
        ("driver", DRIVER),  # as learnt (filter.sparse.driver)
        ("started", "u1"),
        ("weaves", "u1"),  # 1: vehicles move by their headings (weaving)
        ("hindsight", "u1"),  # 1: of a smoothed step
        ("motion", "u1"),  # how this epoch's motion is predicted: WAIT ... ROUTES
        ("changed", "u1"),  # 1: weights or edges changed in this epoch
        ("observed", "u1"),  # 1: its fix was observed
        ("knows_heading", "u1"),  # 1: the heading is the vehicle's own, and not the road's
        ("about_road", "f8", (3,)),  # variance of headings about roads, rad²: now, next, mean
        ("course_time", "f8"),  # of the last course over ground, s
        ("heading_time", "f8"),  # of the last heading that a further sensor told, s
        ("forward_time", "f8"),  # of the last truncation to forward speeds, s
        ("time", "f8"),  # of the last epoch, s
        ("scale", "f8"),  # plane metres per true metre here
        ("log_evidence", "f8"),  # log-likelihood of all observations
        ("speed", "f8"),  # m/s over ground, negative in reverse
        ("turn_rate", "f8", (2,)),  # of the last epoch, and of the last moments, rad/s
        ("odometer_speed", "f8"),  # m/s by the odometer, low-pass filtered
        ("odometer_acceleration", "f8"),  # m/s²
        ("since_map", "f8"),  # m driven since the map was observed
        ("dragged", "f8", (2,)),  # by fixes since then, m, as no speed tells
        ("since_exit", "f8"),  # m driven since the off-road exchange
        ("since_fix", "f8"),  # m driven since the last fix
        ("unmeasured", "f8"),  # m extrapolated since the last fix or measured odometry
        ("moving", "f8"),  # s of motion since the last fix
        ("standing", "f8"),  # s of standing until now
        ("last_fix", "f8"),  # time of the last fix, s
        ("fix_interval", "f8"),  # usual interval of fixes, s
        ("reported", "f8", (2,)),  # least sigma of fixes since the start, and the last one's, m
        ("misfits", "f8"),  # fixes in a row that fit no hypothesis
        ("heard", "f8", (2,)),  # time of the last fix or measured odometry; usual interval, s
        ("elsewhere", "f8", (2,)),  # P(moved while nothing was heard), until a fix; how far, m
        ("map_time", "f8"),  # time of the last map observation, s (paper preset)
        ("on_road_at", "f8"),  # time of the last fix at which the roads had half of the weight, s
        ("restarted_at", "f8"),  # of the last start at a fix of a receiver alone, s
        ("gnss_factor", "f8"),  # on reported variances, as learnt; 0 before the first fix
        ("innovation_factor", "f8"),  # the same by innovations,
        ("windowed_factor", "f8"),  # by innovations that keep their sign,
        ("bias_factor", "f8"),  # and by the bias states
        ("road_energy", "f8", (2,)),  # what roads have told of the bias (filter.inflation)
        ("road_prior", "f8"),  # the factor believed before
        ("level_tail", "f8"),  # sigmas of levels over those of Gaussians; 0: not used yet
        ("reports", REPORTS),  # speeds and courses of the receiver, and their latency
        ("innovation_mean", "f8", (2,)),  # mean of the last normalised innovations, each axis
        ("second_mean", "f8", (2,)),  # the same of the last second, of fixes that come sooner
        ("unlearnt", "f8"),  # s of motion since the factors were last learnt
        ("factor_time", "f8"),  # time of the fix that the factors were last learnt from, s
        ("learnt_time", "f8"),  # s over which they have been learnt
        ("white_factor", "f8"),  # white variance over the reported one, as seen
        ("gnss_cov", "f8", (3,)),  # reported covariance, smoothed: xx, xy, yy, m²
        ("bias_cov", "f8", (3,)),  # covariance that scales the bias states, m²
        ("bias_root", "f8", (3,)),  # its symmetric root S, m
        ("fix_1", "f8", (4,)),  # x, y (plane), time, variance (m²) of the last fix
        ("fix_2", "f8", (4,)),  # and of the one before
        ("fix_across", "f8"),  # offset of the last sparse fix from the road, m,
        ("across_heading", "f8"),  # that road's heading, rad,
        ("across_time", "f8"),  # and the time, s
    ],
    align=True,
)

_SETTINGS = (
    "heading_noise", "turn_noise", "along_noise", "lateral_noise", "yaw_bias_noise",
    "acceleration_noise", "scale_sigma", "drift_sigma", "lane_sigma", "lane_length", "map_sigma",
    "map_length", "relative_sigma", "edge_heading_sigma", "node_radius", "node_sigma",
    "node_heading_sigma", "map_spacing", "gnss_white_ratio", "gnss_time", "gnss_gate",
    "gnss_adapt_time", "gnss_start", "gnss_inflation", "gnss_fault_time", "gnss_lost",
    "off_road_leave", "off_road_return", "off_road_cost", "off_road_start", "wrong_way",
    "u_turn_rate", "search_radius", "prune", "merge", "components", "lost_after", "protection_risk",
    "unknown", "outage_after", "ambiguous_below", "paper_stay", "paper_radius", "paper_width",
    "paper_heading_sigma", "paper_step",
)  # fmt: skip

PARAMETERS = np.dtype(
    [
        *((name, "f8") for name in _SETTINGS),  # SI; `settings.Settings` has units and reasons
        ("lever", "f8", (2,)),  # antenna ahead and left of M, m
        ("side", "f8"),  # 1 where one drives on the right, -1 on the left
        ("mode", "i8"),  # WHEELS, DISTANCE or CLOCK: the sensors there are
        ("paper", "u1"),  # 1: the paper's literal form (filter.paper)
    ],
    align=True,
)

SUCCESSOR = np.dtype(
    [
        ("edge", "i4"),
        ("parent", "i4"),  # successor it was reached from, -1: the origin itself
        ("offset", "f8"),  # abscissa of its start, from the origin's start, m
        ("prior", "f8"),  # product of turn priors
        ("weight", "f8"),  # the same, by the speed in each turn
        ("mass", "f8"),  # weight times Gaussian mass
        ("turn", "f8"),  # sum of turns, rad
    ],
    align=True,
)

CANDIDATES, SUCCESSORS = 128, 64  # edges near a fix; that a hypothesis may pass on to in a step


class Belief(NamedTuple):
    """The mixture of hypotheses and what all of them share; rows from `count` on are free."""

    hyp: Annotated[Records, Array(HYPOTHESIS, 1)]  # (C,)
    lineage: Matrix  # (C, KEPT or 0) share of its weight from each hypothesis of the last step
    state: Annotated[Records, Array(FILTER, 1)]  # (1,)


class Work(NamedTuple):
    """Buffers of the kernels, allocated once per thread."""

    row: Vector  # (N,) observation row
    gains: Matrix  # (2 C, N) P hᵀ of the two rows of a fix, of each hypothesis (gnss.position)
    reading: Epochs  # (1,) what is believed of an epoch
    successor: Annotated[Records, Array(SUCCESSOR, 1)]  # (SUCCESSORS,)
    near: Annotated[Records, Array(CANDIDATE, 1)]  # (CANDIDATES,)
    search: Search  # routes between sparse fixes
    merged: Annotated[Records, Array(HYPOTHESIS, 1)]  # (CANDIDATES, or 0 without the paper preset)
    evidence: Evidence  # what further sensors say


class Context(NamedTuple):
    """What is constant over a drive, and buffers."""

    par: Annotated[Records, Array(PARAMETERS, 1)]  # (1,)
    roads: Roads
    work: Work


def new_belief(lineage: bool = False, capacity: int = CAPACITY) -> Belief:
    """An empty belief; `lineage` where its history is stored (`filter.lookback.history`)."""
    hyp, state = records(capacity, HYPOTHESIS), records(1, FILTER)
    hyp.edge = hyp.before = hyp.corner = NO_EDGE
    hyp.along_sigma = hyp.p_not_passed = 1.0
    hyp.bound, hyp.path_entry = NO_BOUND, -1
    state.course_time = state.heading_time = -math.inf
    known = state[0].map
    known.factor = known.local = known.rate = known.prior = known.heading_factor = 1.0
    state[0].still.age = -1.0
    state[0].direction.doubted = state[0].separation.begun = -math.inf
    state[0].separation.departure.since = -math.inf
    state[0].separation.reckoned["begun"] = -math.inf
    clear(state[0].vetting)
    reports = state[0].reports
    reports.speed[1] = reports.course[1] = reports.place[2] = -math.inf
    return Belief(hyp, np.zeros((capacity, KEPT if lineage else 0)), state)


def new_parameters() -> Records:
    """Parameters, (1,), to be filled."""
    return records(1, PARAMETERS)


def new_work(paper: bool = False, evidence: Evidence = NO_EVIDENCE) -> Work:
    """Buffers for one thread, and what further sensors say."""
    held = records(CANDIDATES if paper else 0, HYPOTHESIS)
    return Work(
        np.zeros(N), np.zeros((2 * CAPACITY, N)), new_epochs(1), records(SUCCESSORS, SUCCESSOR),
        records(CANDIDATES, CANDIDATE), new_search(), held, evidence,
    )  # fmt: skip


@entry
def normalise(belief: Belief) -> None:
    """Make the weights sum to one: P(S_k | Y).

    The log of their sum is the log-likelihood of the observations since the last call;
    it adds to the log-evidence.
    """
    state = belief.state[0]
    top = -math.inf
    for i in range(state.count):
        top = max(top, belief.hyp[i].log_weight)
    total = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        hyp.weight = math.exp(hyp.log_weight - top)
        total += hyp.weight
    log_total = top + math.log(total)
    state.log_evidence += log_total
    for i in range(state.count):
        hyp = belief.hyp[i]
        hyp.log_weight -= log_total
        hyp.weight /= total


@kernel
def heaviest(belief: Belief) -> int:
    """The hypothesis of the largest log-weight."""
    top = 0
    for i in range(belief.state[0].count):
        if belief.hyp[i].log_weight > belief.hyp[top].log_weight:
            top = i
    return top


@kernel
def most_probable(belief: Belief) -> int:
    """The hypothesis of the largest weight, as of the last normalisation."""
    top = 0
    for i in range(belief.state[0].count):
        if belief.hyp[i].weight > belief.hyp[top].weight:
            top = i
    return top


@kernel
def rescale(hyp: Record, factor: float) -> None:
    """Multiply a hypothesis' weight."""
    hyp.log_weight += math.log(max(factor, 1e-300))
    hyp.weight *= factor


@kernel
def floor_of(hyp: Record, floor: float) -> float:
    """A floor of weight for a hypothesis: a thousandth of it after a rare turn.

    A rule that is broken is as rare as the hypotheses that are dropped.  Only what is observed
    behind the turn can speak for it.
    """
    return RARE_FLOOR * floor if hyp.grace > 0.0 else floor


@kernel
def move_row(belief: Belief, source: int, target: int) -> None:
    """Copy one hypothesis over another, with its lineage."""
    copy_record(belief.hyp[target], belief.hyp[source])
    for a in range(belief.state[0].parents):
        belief.lineage[target, a] = belief.lineage[source, a]


@kernel
def blank(hyp: Record, edge: int, segment: int) -> None:
    """Make a row a hypothesis on an edge that knows nothing: all zero, as certain as can be."""
    for a in range(N):
        hyp.mu[a] = 0.0
        for b in range(N):
            hyp.cov[a, b] = 0.0
    hyp.log_weight = hyp.weight = hyp.sinks = hyp.amiss = 0.0
    hyp.along = hyp.lateral = hyp.travel_variance = hyp.grace = hyp.stood = hyp.freed = 0.0
    hyp.along_sigma = hyp.p_not_passed = 1.0
    hyp.bound = NO_BOUND
    for k in range(2):
        hyp.tangent[k] = hyp.odds[k] = 0.0
        for a in range(3):
            hyp.ground[k, a] = 0.0
    hyp.blames, hyp.ignores, hyp.new_edge, hyp.backs = NOTHING, 0, 1, 0
    forget_origin(hyp.origin)
    begin_leg(hyp.leg)
    hyp.path_entry, hyp.before, hyp.corner = -1, NO_EDGE, NO_EDGE
    hyp.edge, hyp.segment = edge, segment
    forget_course(hyp)


@kernel
def forget_course(hyp: Record) -> None:
    """It was beside no road yet."""
    hyp.course = NO_EDGE
    for k in range(4):
        hyp.beside[k] = 0.0


@kernel
def spawn(belief: Belief, i: int, share: float, edge: int, segment: int) -> int:
    """Append a child of hypothesis i on an edge, with a share of its weight; returns its row.

    The caller has seen that the table is not full, and takes the share from i.
    """
    state = belief.state[0]
    child = int(state.count)
    move_row(belief, i, child)
    hyp = belief.hyp[child]
    rescale(hyp, share)
    if edge != hyp.edge:
        hyp.bound, hyp.before = NO_BOUND, NO_EDGE
    hyp.edge, hyp.segment = edge, segment
    hyp.new_edge = 1
    forget_course(hyp)
    if edge == OFF_ROAD:
        redraw(hyp, D, 0.0, BESIDE_SIGMA**2)
    state.count = child + 1
    return child


@kernel
def lane_mean(ctx: Context, edge: int) -> float:
    """Usual offset right of the centre line of an edge, m; 0 off the roads."""
    return 0.0 if edge < 0 else float(ctx.par[0].side * ctx.roads.edges[edge].lane)


@kernel
def lane_sigma(ctx: Context, edge: int) -> float:
    """Its sigma, m; off the roads that of the offset from a road beside."""
    if edge < 0:
        return BESIDE_SIGMA
    return lane_sigma_of(ctx.roads, edge, ctx.par[0].lane_sigma)


@kernel
def redraw(hyp: Record, state: int, mean: float, variance: float) -> None:
    """Give one state a new mean and variance, independent of all others."""
    for j in range(N):
        hyp.cov[state, j] = 0.0
        hyp.cov[j, state] = 0.0
    hyp.cov[state, state] = variance
    hyp.mu[state] = mean
