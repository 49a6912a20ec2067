"""A recorded drive through the filter: `model="default"`, smoothed or not, and `model="paper"`."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from .diagnosis.finding import Finding
from .diagnosis.findings import findings_of, is_scale
from .diagnosis.further_sensors import further_findings, readings_of
from .diagnosis.map_offset import MapError, map_error_of
from .diagnosis.off_roads import off_road_findings
from .diagnosis.sensor_states import SensorTrack, states_of
from .diagnosis.sensors import (
    column_findings,
    least_speed_findings,
    sensor_findings,
    takeover_findings,
    tick_findings,
)
from .diagnosis.snapped_places import snapped_findings
from .epochs import SPARSE, Timeline, is_interpolated
from .errors import DriveError
from .filter.lookback.history import is_full, new_history
from .filter.state import (
    CLOCK,
    NO_EDGE,
    WHEELS,
    Belief,
    Context,
    H,
    K,
    Path,
    X,
    Y,
    new_belief,
    new_path,
    new_work,
)
from .filter.step import run
from .filter.summary.estimate import Output, new_output
from .filter.vetting.latency import assume_delay
from .geodesy.angles import heading_of, radians
from .global_start import is_vague, search, start_at, start_of_coarse_fix
from .graph.network import copied
from .lookback.path import BestChains, Chain, heaviest_chain, tidied
from .lookback.smoothing import Lag, Past, entries_in_use, smooth
from .observations import StartPose
from .roadmap import RoadMap
from .sensors.whole_scale import whole_scales
from .settings import Settings, Vehicle, parameters
from .workspace import Workspace, entries_of, without_states

_CHUNK = 20_000  # epochs between two checks of the path tree and progress reports
_STATES = 1000  # moments of a drive at which the states of sensors are kept, where they are
_SPARE_ENTRIES = 4096  # free entries of the path tree, below which it is tidied


class Recorded(NamedTuple):
    """A recorded drive, localized."""

    output: Output
    chain: Chain  # edges of the most probable path, OFF_ROAD between
    diagnose: Callable[[], tuple[Finding, ...]] = tuple
    past: Past | None = None  # what it can be smoothed with, where that was asked for
    evidence: float = math.nan  # nats, log-likelihood of all observations
    sensors: Mapping[str, Mapping[str, int]] = {}
    track: SensorTrack | None = None  # of the sensors, where poses were asked for
    map_error: MapError | None = None  # as learnt
    withheld: tuple[Finding, ...] = ()  # sensors that are wrong, as far as `diagnosis` names them
    further: tuple[Finding, ...] = ()  # the same of further sensors
    off_roads: tuple[Finding, ...] = ()  # a drive that is not on the mapped roads

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Sensors, settings, maps and drives that are wrong or do not fit; found when asked for."""
        return (*self.off_roads, *self.diagnose())


def localize_recorded(
    roads: RoadMap,
    timeline: Timeline,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    start: StartPose | str | None = None,
    poses: bool = False,
    progress: Callable[[int], None] | None = None,
    lag: Lag | None = None,
) -> Recorded:
    """Localize a recorded drive.

    Args:
        roads: The map.
        timeline: The drive in epochs.
        vehicle: The car.
        settings: The model's numbers.
        start: A known pose at the first epoch, or "map": anywhere on it (also a pose with
            a sigma of more than 40 m or 45 degrees is searched for by wheels and map); else
            the first fix starts the filter.
        poses: Whether the poses of the alternatives are kept too, for pictures.
        progress: Called now and then with the number of epochs done.
        lag: By how much later knowledge epochs are answered; None: by what was known then.

    Returns:
        One estimate per epoch, and the most probable path.

    Raises:
        DriveError: Nothing can start the filter.
    """
    vehicle, settings = vehicle or Vehicle(), settings or Settings()
    epochs = timeline.epochs
    n = len(epochs)
    _check_start(timeline, start, 'or start="map" where both wheels were recorded')
    workspace = Workspace.taken()
    belief, path = workspace.belief(lag is not None), workspace.path()
    ctx = workspace.context(roads.arrays, settings, vehicle, timeline.mode, timeline.evidence)
    history, buffers = (new_history(0), None) if lag is None else workspace.smoothing()
    output = new_output(n, poses)
    done, path = begin(
        roads, timeline, belief, path, ctx, output, vehicle=vehicle, settings=settings,
        start=start, progress=progress,
    )  # fmt: skip
    chunk = min(_CHUNK, max(n // _STATES, 1)) if poses else _CHUNK
    track = SensorTrack([], []) if poses else None
    go_on = run.bind(belief, path, history, epochs, output, ctx, ..., ...)
    while done < n:
        target = min(done + chunk, n)
        done = go_on(done, target)
        moved = lag is not None and is_full(history)
        if moved:
            history = workspace.enlarged(history)
        elif done < target or len(path.entry) - path.size[0] < _SPARE_ENTRIES:
            path, moved = tidied(path, *entries_in_use(belief, history)), True
        if moved:
            go_on = run.bind(belief, path, history, epochs, output, ctx, ..., ...)
        if track is not None and done:
            track.time.append(float(epochs.time[done - 1]))
            track.states.append(states_of(belief, timeline.sensors, int(epochs.gyro[done - 1])))
        if progress is not None:
            progress(done)
    state = copied(belief.state).view(np.ndarray)  # of which a field is had at once
    vetting = state["vetting"].view(np.recarray)[0]
    if is_interpolated(epochs):  # a reader has said so
        vetting.repeats.seconds = 0.0
    heard = state["sensors"][0]
    further = further_findings(timeline.sensors, heard)
    counts = readings_of(timeline.sensors, heard)
    off = map_error_of(belief, settings, roads.plane)
    shifted = timeline.delay - timeline.late
    fit = partial(
        findings_of, epochs, output, timeline.mode, settings, vehicle, vetting, off, shifted
    )  # fmt: skip
    withheld = (
        *column_findings(timeline.wrong), *takeover_findings(timeline.takeover),
        *sensor_findings(vetting, shifted),
    )  # fmt: skip

    def diagnose() -> tuple[Finding, ...]:
        # settings are not judged by sensors that are wrong
        found = 0.0 if vehicle.least_speed else timeline.least_speed
        notes = (*tick_findings(timeline.tick), *least_speed_findings(found))
        judged = not withheld or is_scale(withheld)
        return (*further, *notes, *(fit() if judged else withheld))

    def off_roads(answered: Output) -> tuple[Finding, ...]:
        drive = epochs, answered.rows, [0, n], roads.arrays
        return (*off_road_findings(*drive).values(), *snapped_findings(*drive).values())

    heaviest, evidence = heaviest_chain(path, belief), float(state["log_evidence"][0])
    if lag is None or not history.count["steps"][0]:
        workspace.give_back()
        return Recorded(
            output,
            heaviest,
            diagnose,
            None,
            evidence,
            counts,
            track,
            off,
            withheld,
            further,
            off_roads(output),
        )
    past = Past(roads, history, path, epochs, output, lag)
    smoothed = smooth(past, ctx, buffers)  # first: the path is chosen by smoothed probabilities
    best = heaviest if is_sparse(timeline) else BestChains(history, path, roads.arrays).found()
    past = past._replace(history=without_states(history), path=entries_of(path))
    workspace.give_back()
    return Recorded(
        smoothed, best, diagnose, past, evidence, counts, track, off, withheld, further,
        off_roads(smoothed),
    )  # fmt: skip


def is_sparse(timeline: Timeline) -> bool:
    """Whether the heaviest path is chosen, as a whole: single epochs do not see between fixes."""
    return timeline.mode == CLOCK and timeline.interval > SPARSE


def localize_by_paper(
    roads: RoadMap,
    timeline: Timeline,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    start: StartPose | None = None,
    poses: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Recorded:
    """Localize a recorded drive by the paper's method (`filter.paper`).

    Args:
        roads: The map.
        timeline: The drive in epochs.
        vehicle: The car.
        settings: The noise of odometry, and the numbers named `paper_`.
        start: A known pose at the first epoch; else the first fix starts the filter.
        poses: Whether the poses of the alternatives are kept too, for pictures.
        progress: Called now and then with the number of epochs done.

    Returns:
        One estimate per epoch, its pose that of the most probable hypothesis, and the
        most probable edges one after the other: nothing makes them join.

    Raises:
        DriveError: Nothing can start the filter.
    """
    epochs = timeline.epochs
    n = len(epochs)
    _check_start(timeline, start, "")
    par = parameters(settings or Settings(), vehicle or Vehicle(), timeline.mode, paper=True)
    ctx = Context(par, roads.arrays, new_work(paper=True))
    belief, path, history = new_belief(), new_path(0), new_history(0)
    output = new_output(n, poses)
    begin_paper(belief, roads, timeline, start)
    for first in range(0, n, _CHUNK):
        last = min(first + _CHUNK, n)
        run(belief, path, history, epochs, output, ctx, first, last)
        if progress is not None:
            progress(last)
    rows = output.rows
    on = np.flatnonzero(rows.edge >= 0)
    new = on[np.diff(rows.edge[on], prepend=-1) != 0]
    chain = Chain(rows.edge[new], np.asarray(epochs.time[new]), rows.s[new])
    return Recorded(output, chain)


def begin(
    roads: RoadMap, timeline: Timeline, belief: Belief, path: Path, ctx: Context, output: Output, *,
    vehicle: Vehicle, settings: Settings, start: StartPose | str | None,
    progress: Callable[[int], None] | None = None,
) -> tuple[int, Path]:  # fmt: skip
    """Begin from a pose or by a search over the map, where no fix starts the filter.

    How late fixes are, and scales of an odometer that are others throughout, are known from the
    beginning.

    Args:
        roads: The map.
        timeline: The drive in epochs.
        belief: Empty; filled unless a fix will do it.
        path: An empty tree of edges entered.
        ctx: The drive's constants.
        output: Estimates of the epochs that a search answers are filled.
        vehicle: The car.
        settings: The model's numbers.
        start: As `localize_recorded` takes it.
        progress: Called now and then with the number of epochs done.

    Returns:
        The first epoch that is to be filtered, and the tree of edges entered.
    """
    if timeline.late > 0.0:
        assume_delay(belief.state[0].vetting.latency, timeline.late)
    belief.state[0].vetting.slow.least = timeline.least_speed
    if timeline.mode == WHEELS:
        vetting, scales = belief.state[0].vetting, whole_scales(timeline.epochs, roads.plane)
        vetting.wheel_size.scale.factor, vetting.turn_size.scale.factor = scales
    if start is None and (coarse := start_of_coarse_fix(roads, timeline)) is not None:
        try:
            return search(
                roads, timeline, belief, output, vehicle=vehicle, settings=settings, start=coarse,
                progress=progress,
            )  # fmt: skip
        except DriveError:  # no road is near, or they are too many: as any other fix
            return 0, path
    if is_vague(start, timeline.mode):
        return search(
            roads, timeline, belief, output, vehicle=vehicle, settings=settings,
            start=start if isinstance(start, StartPose) else None, progress=progress,
        )  # fmt: skip
    if isinstance(start, StartPose):
        start_at(belief, roads, path, ctx, start, float(timeline.epochs.time[0]), settings)
    return 0, path


def begin_paper(
    belief: Belief, roads: RoadMap, timeline: Timeline, start: StartPose | str | None
) -> None:
    """Begin from a given pose, where no fix starts the paper's filter."""
    if isinstance(start, StartPose):
        _paper_start(belief, roads, start, float(timeline.epochs.time[0]), timeline.mode)


def _check_start(timeline: Timeline, start: StartPose | str | None, more: str) -> None:
    """Refuse a drive that nothing can start."""
    if start is None and not timeline.epochs["has_fix"].any():
        raise DriveError(
            "the drive has no usable GNSS fix; at least one, or a start pose, was expected; "
            f"give start=(lat, lon, bearing){', ' if more else ''}{more}"
        )


def _paper_start(belief: Belief, roads: RoadMap, start: StartPose, time: float, mode: int) -> None:
    """Begin from a given pose of M, as the paper does; the first epoch searches for roads."""
    x, y = roads.plane.from_geodetic(np.array([start.lat_deg]), np.array([start.lon_deg]))
    turn = roads.plane.convergence(x, y)
    hyp, state = belief.hyp[0], belief.state[0]
    hyp.mu[X], hyp.mu[Y] = x[0], y[0]
    hyp.mu[H] = heading_of(start.bearing_deg, float(turn[0]))
    hyp.mu[K] = 6.0 if mode == CLOCK else 1.0
    hyp.cov[X, X] = hyp.cov[Y, Y] = start.sigma_m**2
    hyp.cov[H, H] = radians(start.sigma_bearing_deg) ** 2
    hyp.cov[K, K] = 64.0 if mode == CLOCK else 0.0
    hyp.edge, hyp.weight = NO_EDGE, 1.0
    state.count = 1
    state.time, state.started = time, 1
    state.last_fix = state.map_time = -math.inf
