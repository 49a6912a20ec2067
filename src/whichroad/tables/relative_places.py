"""Point objects relative to the vehicle at every epoch of a drive."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from .._compile import Records
from ..filter.places.point_objects import STANCE
from ..filter.summary.estimate import Output
from ..graph.network import records
from ..places import Places, RelativePlace
from .schema import TIME, times

Ask = Callable[[bytes], list[RelativePlace]]


class Surroundings(NamedTuple):
    """A matched drive and the places about it."""

    drive_id: str
    epochs: Records  # (n,) EPOCH
    output: Output  # with the poses of the alternatives
    places: Places

    def ahead(self, within: float) -> pa.Table:
        """The places ahead at every epoch; see `Result.ahead`."""
        return self._table(lambda stances: self.places.ahead(stances, within))

    def nearby(self, radius: float) -> pa.Table:
        """The places within a radius at every epoch; see `Result.nearby`."""
        return self._table(lambda stances: self.places.nearby(stances, radius))

    def _table(self, ask: Ask) -> pa.Table:
        stances = stances_of(self.output, self.places)
        rows: list[int] = []
        found: list[RelativePlace] = []
        for k, live in enumerate(self.output.rows.live.tolist()):
            if live:
                there = ask(stances[k].tobytes())
                rows += [k] * len(there)
                found += there
        kinds = relative_schema(self.places)
        time = np.asarray(self.epochs.time[rows], np.float64)
        return pa.table({
            "drive_id": [self.drive_id] * len(rows),
            "time": times(time),
            "id": [one.id for one in found],
            "distance_m": [one.distance_m for one in found],
            "sigma_m": [one.sigma_m for one in found],
            "p": [one.p for one in found],
        }, kinds)  # fmt: skip


def relative_schema(places: Places | None) -> pa.Schema:
    """The columns of tables of places; ids are text or whole numbers, as those of the places."""
    ids = pa.string() if places is None else pa.array(places.ids).type
    return pa.schema(
        [
            ("drive_id", pa.string()),
            ("time", TIME),
            ("id", ids),
            ("distance_m", pa.float64()),
            ("sigma_m", pa.float64()),
            ("p", pa.float64()),
        ]
    )


def stances_of(output: Output, places: Places) -> Records:
    """The alternatives of every epoch as places see them, (n, ALTERNATIVES) STANCE.

    Args:
        output: With the poses of the alternatives.
        places: Whose map it is.
    """
    pose, rows = output.alt_pose, output.rows
    scale = places.roads.plane.scale(rows.x, rows.y)[:, None]
    stances = records(pose.shape[0] * pose.shape[1], STANCE).reshape(pose.shape[:2])
    stances.p, stances.edge = rows.alt_p, rows.alt_edge
    stances.x, stances.y = pose[..., 0], pose[..., 1]
    stances.xx, stances.xy, stances.yy = pose[..., 3], pose[..., 4], pose[..., 5]
    stances.s, stances.sigma = pose[..., 6], pose[..., 7]
    stances.map_x = pose[..., 0] + scale * pose[..., 8]
    stances.map_y = pose[..., 1] + scale * pose[..., 9]
    stances.map_xx, stances.map_xy, stances.map_yy = pose[..., 10], pose[..., 11], pose[..., 12]
    return stances
