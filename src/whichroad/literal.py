"""The paper's method as printed, on a recorded drive: `model="paper"`.

It is kept so that anyone can see its figures beside ours; what is literal about it, and
what the text leaves open, stands in `core.paper` and `core.paper_drive`.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .core.belief import LAST_FIX, NO_EDGE, NOW, STARTED, Belief, H, K, X, Y, new_belief
from .core.epoch import CLOCK
from .core.output import V_S, new_output
from .core.paper import STEPPED, Literal, new_bench
from .core.paper_drive import run_paper
from .epochs import Timeline
from .errors import DriveError
from .geodesy.angles import heading_of, radians
from .localizer import Recorded
from .records import Array, StartPose
from .roadmap import RoadMap
from .settings import Settings, Vehicle

_CHUNK = 20_000  # epochs between two looks at the progress bar


def localize_literal(
    roads: RoadMap,
    timeline: Timeline,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    start: StartPose | None = None,
    poses: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Recorded:
    """Localize a recorded drive by the paper's method, taken literally.

    Args:
        roads: The map.
        timeline: The drive in epochs.
        vehicle: The car.
        settings: The noise of odometry, and the numbers named `paper_`.
        start: A known pose at the first epoch; else the first fix starts the filter.
        poses: Whether the poses of the alternatives are kept too, for pictures.
        progress: Told how many epochs are done, now and then.

    Returns:
        One output row per epoch, its pose that of the most probable hypothesis, and the
        most probable edges one after the other: nothing makes them join.

    Raises:
        DriveError: Nothing can start the filter.
    """
    vehicle, settings = vehicle or Vehicle(), settings or Settings()
    epochs = timeline.epochs
    n = len(epochs.time)
    if start is None and not epochs.has_fix.any():
        raise DriveError(
            "the drive has no usable GNSS fix; at least one, or a start pose, was expected; "
            "give start=(lat, lon, bearing)"
        )
    belief, bench, output = new_belief(), new_bench(), new_output(n, poses)
    if start is not None:
        _start_at(belief, roads, start, float(epochs.time[0]), timeline.mode)
    literal = Literal(*(float(getattr(settings, name)) for name in Literal._fields))
    lever = np.array([vehicle.antenna_forward, vehicle.antenna_left])
    for first in range(0, n, _CHUNK):
        last = min(first + _CHUNK, n)
        run_paper(
            belief, roads.arrays, bench, epochs, output, first, last, timeline.mode, lever,
            settings.parameters(), literal, settings.outage_after_s, settings.ambiguous_below,
        )  # fmt: skip
        if progress is not None:
            progress(last)
    return Recorded(output, *_edges_in_turn(epochs.time, output.edge, output.value[:, V_S]))


def _start_at(belief: Belief, roads: RoadMap, start: StartPose, time: float, mode: int) -> None:
    """Begin from a given pose of M, as the paper does; the first epoch looks for roads."""
    x, y = roads.plane.from_geodetic(np.array([start.lat_deg]), np.array([start.lon_deg]))
    turn = roads.plane.convergence(x, y)
    belief.mean[0, X], belief.mean[0, Y] = x[0], y[0]
    belief.mean[0, H] = heading_of(start.bearing_deg, float(turn[0]))
    belief.mean[0, K] = 6.0 if mode == CLOCK else 1.0
    belief.cov[0, X, X] = belief.cov[0, Y, Y] = start.sigma_m**2
    belief.cov[0, H, H] = radians(start.sigma_bearing_deg) ** 2
    belief.cov[0, K, K] = 64.0 if mode == CLOCK else 0.0
    belief.edge[0], belief.probability[0] = NO_EDGE, 1.0
    belief.size[0] = 1
    belief.clock[[NOW, STARTED, LAST_FIX, STEPPED]] = time, 1.0, -math.inf, -math.inf


def _edges_in_turn(
    time: Array, edge: NDArray[np.int32], s: Array
) -> tuple[NDArray[np.int32], Array, Array]:
    """The most probable edges, repeats joined, each with its first epoch's time and abscissa."""
    on = np.flatnonzero(edge >= 0)
    new = on[np.diff(edge[on], prepend=-1) != 0]
    return edge[new], time[new], s[new]
