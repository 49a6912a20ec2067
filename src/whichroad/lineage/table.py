"""The lives of a drive's hypotheses as a table, and P of each over time."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..epochs import Timeline
from ..observations import Array, StartPose
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from ..tables.schema import TIME, times
from ..wording import counted
from ..writers import write_table
from .lives import COUNTS, WHY, Hypothesis, lives_of

LINEAGE = pa.schema(
    [
        ("drive_id", pa.string()),
        ("id", pa.int64()),
        ("parent_id", pa.int64()),
        ("edge_id", pa.int64()),
        ("source_id", pa.string()),
        ("name", pa.string()),
        ("born", TIME),
        ("birth", pa.string()),
        ("died", TIME),
        ("reason", pa.string()),
        ("into_id", pa.int64()),
        ("p_born", pa.float64()),
        ("p_most", pa.float64()),
        ("p_last", pa.float64()),
        ("driven_m", pa.float64()),
    ]
)
"""One row per hypothesis, in the order of births."""

WEIGHTS = pa.schema(
    [("time", TIME), ("id", pa.int64()), ("p", pa.float64()), ("components", pa.int64())]
)
"""One row per hypothesis and epoch of its life."""


class Lineage:
    """Births, deaths and reasons of the hypotheses of one drive; can be pickled.

    Args:
        drive_id: The drive's name.
        hypotheses: In the order of births.
        time: (n,) of the epochs, s since 1970.
        driven: (n,) distance until each, m.
    """

    def __init__(
        self, drive_id: str, hypotheses: list[Hypothesis], time: Array, driven: Array
    ) -> None:
        self.drive_id, self._hypotheses, self._time = drive_id, hypotheses, time
        self._driven = driven

    def __len__(self) -> int:
        return len(self._hypotheses)

    def __repr__(self) -> str:
        return f"Lineage({self.drive_id!r}, {counted(len(self), 'hypothesis', 'hypotheses')})"

    def _repr_html_(self) -> str:
        return str(self.to_pandas()._repr_html_())

    def to_arrow(self) -> pa.Table:
        """One row per hypothesis; the columns are in docs/lineage.md."""
        hypotheses = self._hypotheses
        ended = np.array([h.why != "alive" for h in hypotheses], bool)
        created = np.array([h.created for h in hypotheses], np.int64)
        last = np.array([h.last for h in hypotheses], np.int64)
        gone = np.minimum(last + 1, len(self._time) - 1)
        columns = {
            "drive_id": [self.drive_id] * len(hypotheses),
            "id": [h.number for h in hypotheses],
            "parent_id": [_known(h.parent) for h in hypotheses],
            "edge_id": [_known(h.edge) for h in hypotheses],
            "source_id": [h.source for h in hypotheses],
            "name": [h.street for h in hypotheses],
            "born": times(self._time[created]),
            "birth": [h.birth for h in hypotheses],
            "died": pa.array(times(self._time[gone]).cast(pa.int64()).to_numpy(), mask=~ended),
            "reason": [_reason(h) for h in hypotheses],
            "into_id": [_known(h.into) for h in hypotheses],
            "p_born": [h.p[0] for h in hypotheses],
            "p_most": [max(h.p) for h in hypotheses],
            "p_last": [h.p[-1] for h in hypotheses],
            "driven_m": self._driven[last] - self._driven[created],
        }
        columns["died"] = columns["died"].cast(TIME)
        return pa.table(columns, LINEAGE)

    def to_pandas(self) -> Any:
        """The same as a DataFrame."""
        return self.to_arrow().to_pandas()

    def weights_arrow(self) -> pa.Table:
        """P of every hypothesis in every epoch of its life: `time, id, p, components`.

        Within an epoch P of the hypotheses on roads sums to 1 - `p_off_road` of the points,
        and P of one edge is what `alternatives` says of it, unless the points are smoothed.
        Without wheels these share P of a hypothesis that lies across a node between both sides.
        `components` are the Gaussians of the hypothesis.
        """
        alive = [len(h.p) for h in self._hypotheses]
        number = np.repeat(np.arange(len(alive)), alive)
        epoch = np.concatenate(
            [np.zeros(0, np.int64), *(np.arange(h.created, h.last + 1) for h in self._hypotheses)]
        )
        p = np.concatenate([np.zeros(0), *(np.asarray(h.p) for h in self._hypotheses)])
        count = [c for h in self._hypotheses for c in h.components]
        order = np.argsort(epoch, kind="stable")
        columns = {
            "time": times(self._time[epoch[order]]),
            "id": number[order],
            "p": p[order],
            "components": np.array(count, np.int64)[order],
        }
        return pa.table(columns, WEIGHTS)

    def weights(self) -> Any:
        """The same as a DataFrame."""
        return self.weights_arrow().to_pandas()

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write the table of hypotheses; the suffix chooses the format: Parquet, CSV, Arrow.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.to_arrow(), path, force=force)

    def plot(
        self,
        ax: Any = None,
        *,
        window: tuple[float, float] | None = None,
        least: float = COUNTS,
    ) -> Any:
        """Draw a lane for every edge over time, coloured by P, with births and deaths.

        Args:
            ax: Axes to draw on; None: new ones.
            window: What is drawn, seconds since the drive's start; None: all of it.
            least: Edges that never have as much P are left out.

        Returns:
            The axes, seconds since the drive's start to the right.
        """
        from .lanes import Stretch, plot_lanes

        since = self._time - self._time[0]
        return plot_lanes(
            ax, Stretch(since, self._hypotheses, window or (0.0, float(since[-1])), least)
        )


def lineage_of(
    drive_id: str, roads: RoadMap, timeline: Timeline, *, vehicle: Vehicle, settings: Settings,
    start: StartPose | str | None = None, model: str = "default",
) -> Lineage:  # fmt: skip
    """The lineage of a drive; see `lives.lives_of` for what it takes."""
    return Lineage(
        drive_id,
        *lives_of(
            roads, timeline, vehicle=vehicle, settings=settings, start=start, model=model
        ),
    )  # fmt: skip


def _known(number: int) -> int | None:
    return number if number >= 0 else None


def _reason(h: Hypothesis) -> str:
    """Why it has ended, with the number of the one that goes on."""
    if h.why == "merged":
        return f"merged into {h.into}, on the same edge" if h.edge >= 0 else f"merged into {h.into}"
    return WHY[h.why]
