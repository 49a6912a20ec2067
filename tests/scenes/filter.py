"""The filter on a hand-made map: a whole drive, or one epoch at a time."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from whichroad.core.belief import Belief, new_route
from whichroad.core.drive import run
from whichroad.core.epoch import WHEELS, Epochs
from whichroad.core.memory import new_memory
from whichroad.core.network import Roads
from whichroad.core.output import (
    Output,
    new_output,
)
from whichroad.core.switching import new_work
from whichroad.epochs import Timeline
from whichroad.geodesy.plane import Plane
from whichroad.localizer import Recorded, localize_recorded
from whichroad.settings import Settings, Vehicle
from whichroad.smoother import Lag

from .beliefs import roomy_belief


class Town(NamedTuple):
    """What the localizer asks of a map."""

    arrays: Roads
    plane: Plane


def localize(
    roads: Roads, epochs: Epochs, *, mode: int = WHEELS, side: str = "right",
    settings: Settings | None = None, lag: object = None,
) -> Recorded:  # fmt: skip
    """Localize a whole drive in one call."""
    town = Town(roads, Plane(49.4, 8.7))
    vehicle = Vehicle(driving_side=side)
    return localize_recorded(
        town, Timeline(epochs, mode, 0), vehicle=vehicle, settings=settings, lag=Lag.of(lag)
    )


def steps(
    roads: Roads, epochs: Epochs, *, mode: int = WHEELS, settings: Settings | None = None
) -> Iterator[tuple[int, Belief, Output]]:
    """Localize epoch by epoch; the belief after each is shown, not copied."""
    settings = settings or Settings()
    par = settings.parameters()
    n = len(epochs.time)
    belief, route, work, output = (
        roomy_belief(),
        new_route(1 << 15),
        new_work(),
        new_output(n, False),
    )
    for k in range(n):
        run(
            belief, roads, route, work, epochs, output, k, k + 1, mode, 1.0, np.zeros(2), par,
            settings.outage_after_s, settings.ambiguous_below, False, new_memory(0),
        )  # fmt: skip
        yield k, belief, output
