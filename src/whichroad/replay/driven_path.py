"""The path of a drive beside its points: the line between distant fixes, and broken rules."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..observations import Array
from ..ragged import row_and_place
from ..tables.schema import seconds_of

if TYPE_CHECKING:
    from ..roadmap import RoadMap

FAR = 3.0  # s between points, from which on the route between them is drawn along the roads
AROUND = 2  # edges of the route before and behind one that are the same place, somewhat earlier
COLUMNS = ("drive_id", "edge_id", "enter_time", "exit_time", "enter_m", "exit_m", "broken_rule")


@dataclass(frozen=True, slots=True)
class Route:
    """The edges of a route in driving order, (r,) each."""

    edge: NDArray[np.int64]
    enter: Array  # s since 1970
    exit: Array
    enter_m: Array
    exit_m: Array
    broken: list[str | None]  # words of `tables.schema.PATH`

    @classmethod
    def of(cls, path: pa.Table, drive_id: str) -> "Route | None":
        """The route of one drive.

        Args:
            path: Rows with the columns of `tables.schema.PATH`, of any number of drives.
            drive_id: Of the drive.

        Returns:
            None where the table has no route of this drive.
        """
        if not set(COLUMNS) <= set(path.column_names):
            return None
        path = path.filter(pc.equal(path["drive_id"].cast(pa.string()), drive_id))
        if not path.num_rows:
            return None
        enter, leave = (seconds_of(path[name]) for name in COLUMNS[2:4])
        enter_m, exit_m = (path[name].to_numpy().astype(np.float64) for name in COLUMNS[4:6])
        edge = path["edge_id"].to_numpy().astype(np.int64)
        return cls(edge, enter, leave, enter_m, exit_m, path["broken_rule"].to_pylist())

    @property
    def length(self) -> float:
        """Of all its edges as far as they were driven, m."""
        return float(np.sum(self.exit_m - self.enter_m))

    def between(
        self, time: Array, edge: NDArray[np.int64], along: Array, roads: "RoadMap"
    ) -> dict[int, list[list[float]]]:
        """Where the route runs between points that are far apart in time.

        Args:
            time: (n,) of the points, s since 1970.
            edge: (n,) on which each was matched.
            along: (n,) m along it.
            roads: The map.

        Returns:
            By point: [lat, lon] of the vertices on the route to it from the point before.
        """
        after = np.flatnonzero(np.diff(time) >= FAR) + 1
        low = np.searchsorted(self.exit, time[after - 1], side="right")
        high = np.searchsorted(self.enter, time[after], side="left")
        count = np.maximum(high - low, 0)
        gap, place = row_and_place(count)
        row = low[gap] + place
        begin, end = self.enter_m[row].copy(), self.exit_m[row].copy()
        for at, where, cut in (
            (after - 1, row == low[gap], begin),
            (after, row == high[gap] - 1, end),
        ):
            own = where & (self.edge[row] == edge[at][gap])
            cut[own] = along[at][gap][own]
        x, y, first = roads.edge_lines(self.edge[row], begin, np.maximum(begin, end))
        lat, lon = roads.plane.to_geodetic(x, y)
        points = np.round(np.column_stack([lat, lon]), 6)
        lines: dict[int, list[list[float]]] = {}
        ends = np.concatenate([[0], np.cumsum(count)])
        for k, a, b in zip(after.tolist(), first[ends[:-1]], first[ends[1:]], strict=True):
            if b > a:
                line = points[a:b]
                new = np.append(True, (line[1:] != line[:-1]).any(axis=1))
                inner = line[new][1:-1]  # its ends are those of the points themselves
                if len(inner):
                    lines[k] = inner.tolist()
        return lines

    def near(self, time: float, edge: int) -> set[int]:
        """Edges of the route about a moment, where it drives along an edge then; else none.

        Args:
            time: s since 1970.
            edge: The most probable one.
        """
        at = int(np.searchsorted(self.exit, time))
        low, high = max(at - AROUND, 0), at + AROUND + 1
        here = np.flatnonzero(self.edge[low:high] == edge)
        if not len(here):
            return set()
        at = low + int(here[np.argmin(np.abs(here + low - at))])
        return set(self.edge[max(at - AROUND, 0) : at + AROUND + 1].tolist())
