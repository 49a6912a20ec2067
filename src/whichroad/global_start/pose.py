"""A start from a given pose, or roughly from a coarse fix."""

import math

import numpy as np

from ..epochs import Timeline
from ..filter.hypotheses.births import Start, cold_start
from ..filter.hypotheses.reduction import reduce
from ..filter.state import CLOCK, GX, GY, WHEELS, Belief, Context, Path, normalise
from ..geodesy.angles import heading_of, radians
from ..graph.network import plane_scale
from ..observations import StartPose
from ..roadmap import RoadMap
from ..settings import Settings
from .steps import have_fine_fix

_BLIND_SPEED, _BLIND_SPEED_SIGMA = 6.0, 8.0  # m/s, at a start without odometry
_WHITE = 0.01  # white sigma of a pose over the one given
_MISTAKEN = 0.02  # probability that the bearing of a given pose is any other one


def start_of_coarse_fix(roads: RoadMap, timeline: Timeline) -> StartPose | None:
    """Where to search for a vehicle whose drive begins with coarse fixes; None: it need not be.

    A town has more roads about such a fix than the ordinary belief holds.
    """
    epochs = timeline.epochs
    if timeline.mode != WHEELS or not epochs.has_fix.any():
        return None
    first = int(np.argmax(epochs.has_fix))
    if have_fine_fix(epochs[first : first + 1])[0]:
        return None
    x, y, sigma = (float(value) for value in epochs.fix[first, :3])
    sigma = math.hypot(sigma, float(np.abs(epochs.arc[: first + 1]).sum()))
    lat, lon = roads.plane.to_geodetic(x, y)
    return StartPose(lat, lon, 0.0, sigma, 180.0)


def initial_state(belief: Belief, time: float, settings: Settings) -> None:
    """What all hypotheses share, at a start before any fix.

    Args:
        belief: Its state is set.
        time: s.
        settings: For the sigma of fixes that report none.
    """
    state = belief.state
    state.time = time
    state.factor_time = time
    state.last_fix = -math.inf
    state.started = 1
    state.knows_heading = 1
    state.gnss_cov[0, [0, 2]] = settings.default_sigma_m**2
    for factor in ("gnss_factor", "innovation_factor", "windowed_factor", "bias_factor"):
        state[factor] = 1.0


def start_at(
    belief: Belief, roads: RoadMap, path: Path, ctx: Context, start: StartPose, time: float,
    settings: Settings,
) -> None:  # fmt: skip
    """Begin from a given pose of M, before any fix.

    Its bearing may be mistaken: with a small probability the vehicle points along any road near,
    in either direction, or anywhere off the roads.

    Args:
        belief: The filter's, empty.
        roads: The map.
        path: The tree of edges entered.
        ctx: The drive's constants.
        start: The pose.
        time: s.
        settings: The model's numbers.
    """
    mode = int(ctx.par.mode[0])
    belief.state.mode = WHEELS  # a pose includes the heading: merged as with wheels
    x, y = roads.plane.from_geodetic(np.array([start.lat_deg]), np.array([start.lon_deg]))
    turn = roads.plane.convergence(x, y)
    known = Start(
        bias=1.0,
        white=_WHITE,
        heading=heading_of(start.bearing_deg, float(turn[0])),
        heading_sigma=radians(start.sigma_bearing_deg),
        rate=_BLIND_SPEED if mode == CLOCK else 1.0,
        rate_sigma=_BLIND_SPEED_SIGMA if mode == CLOCK else float(ctx.par.scale_sigma[0]),
        drift=0.0,
        drift_sigma=float(ctx.par.drift_sigma[0]) if mode == WHEELS else 0.0,
        at_antenna=False,
    )
    fix = np.array([x[0], y[0], start.sigma_m, start.sigma_m, 0.0])
    belief.state.scale = plane_scale(ctx.roads, float(x[0]), float(y[0]))
    cold_start(belief, path, ctx, fix, known, 1.0)
    normalise(belief)
    cold_start(belief, path, ctx, fix, known._replace(heading_sigma=math.inf), _MISTAKEN)
    n = int(belief.state[0].count)
    cov = belief.hyp["cov"]
    for state in (GX, GY):  # the pose owes nothing to the GNSS bias of later fixes
        cov[:n, state, :] = 0.0
        cov[:n, :, state] = 0.0
        cov[:n, state, state] = 1.0
    normalise(belief)
    reduce(belief, path, ctx)
    belief.state.mode = mode
    initial_state(belief, time, settings)
