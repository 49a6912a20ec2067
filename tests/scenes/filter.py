"""The filter on a hand-made map: a whole drive, or one epoch at a time."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad._compile import Records
from whichroad.epochs import Timeline
from whichroad.filter.lookback.history import new_history
from whichroad.filter.state import WHEELS, Belief, Context, new_path, new_work
from whichroad.filter.step import run
from whichroad.filter.summary.estimate import Output, new_output
from whichroad.geodesy.plane import Plane
from whichroad.graph.network import Roads
from whichroad.lookback.smoothing import Lag
from whichroad.recorded import Recorded, localize_recorded
from whichroad.settings import Settings, Vehicle, parameters

from .beliefs import roomy_belief


class Town(NamedTuple):
    """What the localizer asks of a map."""

    arrays: Roads
    plane: Plane


def localize(
    roads: Roads, epochs: Records, *, mode: int = WHEELS, side: str = "right",
    settings: Settings | None = None, lag: object = None,
) -> Recorded:  # fmt: skip
    """Localize a whole drive in one call."""
    town = Town(roads, Plane(49.4, 8.7))
    vehicle = Vehicle(driving_side=side)
    return localize_recorded(
        town, Timeline(epochs, mode, 0), vehicle=vehicle, settings=settings, lag=Lag.of(lag)
    )


def steps(
    roads: Roads, epochs: Records, *, mode: int = WHEELS, settings: Settings | None = None
) -> Iterator[tuple[int, Belief, Output]]:
    """Localize epoch by epoch; the belief after each is shown, not copied."""
    n = len(epochs)
    par = parameters(settings or Settings(), Vehicle(), mode)
    ctx = Context(par, roads, new_work())
    belief, path, history = roomy_belief(), new_path(1 << 15), new_history(0)
    output = new_output(n, False)
    run_epochs = run.bind(belief, path, history, epochs, output, ctx, ..., ...)
    for k in range(n):
        run_epochs(k, k + 1)
        yield k, belief, output


_COV = ("xx", "xy", "xh", "yy", "yh", "hh")


def column(output: Output, name: str) -> NDArray[Any]:
    """A field of the estimates, or an element of their covariance ("xx", "xy", ...), (n,)."""
    if name in _COV:
        return np.asarray(output.rows.cov[:, _COV.index(name)])
    return np.asarray(output.rows[name])


def columns(output: Output, names: str) -> NDArray[np.float64]:
    """Several of these, named with spaces between, (n, k)."""
    return np.column_stack([column(output, name) for name in names.split()])
