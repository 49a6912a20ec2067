"""Drives for the laws: random ways through maps, and what is said of them at every epoch."""

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from hypothesis import Phase, settings
from numpy.typing import ArrayLike, NDArray

from scenes import Truth, columns, drive_along, epochs_of, gnss, steps
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, OFF_ROAD, WHEELS
from whichroad.filter.summary.estimate import Output
from whichroad.graph.network import Roads
from whichroad.settings import Settings

Array = NDArray[np.float64]

# A whole drive is one example: few, the same ones in every run.  No seed is simpler than another,
# so that there is nothing to shrink.
law = settings(
    max_examples=20, derandomize=True, deadline=None, phases=(Phase.explicit, Phase.generate)
)

# Sigmas taken at the receiver's word; else every difference is also one in the scale learnt.
AS_REPORTED = Settings(gnss_adapt_time=1e10)
LEARNT = Settings()


class Said(NamedTuple):
    """What the filter says at n epochs."""

    p: Array  # (n, groups) probability of each group of edges
    off: Array  # (n,) of being off the roads
    output: Output  # (n,) estimates

    @property
    def place(self) -> Array:
        """Position and its covariance: x, y, xx, xy, yy, (n, 5)."""
        return columns(self.output, "x y xx xy yy")

    @property
    def sigma(self) -> Array:
        """Root of the sum of both position variances, m, (n,)."""
        return np.sqrt(columns(self.output, "xx yy").sum(axis=1))


def said(
    roads: Roads, epochs: Records, groups: Sequence[Collection[int]] = (), *,
    mode: int = WHEELS, settings: Settings | None = None,
) -> Said:  # fmt: skip
    """Drive, and add up what each group of edges has at every epoch.

    Args:
        roads: The map.
        epochs: The drive, n epochs.
        groups: Edges that are one road.
        mode: What moves the vehicle.
        settings: The model's numbers.
    """
    size = len(roads.edges) + 1  # the last column: off the roads
    member = np.zeros((size, len(groups) + 1))
    for g, edges in enumerate(groups):
        member[list(edges), g] = 1.0
    member[OFF_ROAD, -1] = 1.0
    at, weights = [], []
    for k, belief, output in steps(roads, epochs, mode=mode, settings=settings):  # noqa: B007
        if k == 0:  # views of the belief: it is the same one in every epoch
            hyp, count = belief.hyp.view(np.ndarray), belief.state.view(np.ndarray)["count"]
            edge, weight = hyp["edge"], hyp["weight"]
        at.append(edge[: count[0]] % size + size * k)
        weights.append(weight[: count[0]].copy())
    found = np.concatenate(at), np.concatenate(weights)
    p = np.bincount(*found, size * len(epochs)).reshape(-1, size) @ member
    return Said(p[:, :-1], p[:, -1], output)


def sensed(truth: Truth, fix: Array, at: ArrayLike, mode: int, *, course: float = 0.1) -> Records:
    """Epochs as a car of that mode has them: without odometry only those with a fix.

    Args:
        truth: The drive.
        fix: (n, 5) fixes, of which those `at` are used.
        at: Epochs with a fix.
        mode: WHEELS, DISTANCE or CLOCK.
        course: Sigma of the first fix's course, rad; without odometry all report their speed.
    """
    rows = np.asarray(at)
    epochs = epochs_of(truth, fix, rows, course=course)
    if mode != CLOCK:
        return epochs
    epochs.speed, epochs.speed_sigma = np.gradient(truth.s, truth.time), 0.3
    return epochs[rows]


def between_parallels(seed: int, gap: float, *, length: float = 700.0, offset: float | None = None):
    """A drive on the right lane of the first of two parallel roads, or elsewhere between.

    Args:
        seed: Of the receiver and the place.
        gap: Between the roads, m.
        length: Driven, m.
        offset: Left of the first road's centre line, m; None: anywhere from lane to lane.
    """
    rng = np.random.default_rng(seed)
    y = rng.uniform(-1.75, gap - 1.75) if offset is None else offset
    x = rng.uniform(300.0, 600.0)
    truth = drive_along([[x, y], [x + length, y]])
    return truth, gnss(truth, sigma=rng.uniform(2.0, 6.0), seed=seed)


def way_through(seed: int, blocks: int, columns: int = 5, rows: int = 5, spacing: float = 120.0):
    """Corners of a random way through `scenes.grid_town`, never straight back, (n, 2)."""
    rng = np.random.default_rng(seed)
    at = (int(rng.integers(columns)), int(rng.integers(rows)))
    way, before = [at], None
    for _ in range(blocks):
        i, j = at
        ways = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        ways = [w for w in ways if 0 <= w[0] < columns and 0 <= w[1] < rows and w != before]
        before, at = at, ways[int(rng.integers(len(ways)))]
        way.append(at)
    return np.array(
        [(i * spacing + 10.0 * math.sin(j), j * spacing + 8.0 * math.cos(i)) for i, j in way]
    )
