"""The places about a recorded drive, epoch by epoch."""

from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from .._compile import Records
from ..filter.places.point_objects import STANCE
from ..filter.state import OFF_ROAD
from ..geodesy.angles import radians
from ..graph.network import records
from ..live.place_messages import PlaceMessages
from ..observations import Array
from ..places import AHEAD_M, NEARBY_M, Places
from ..tables.relative_places import Surroundings, stances_of

if TYPE_CHECKING:
    from ..live.message_types import PlaceMessage


class PlacesAbout:
    """Asks for the places ahead and nearby.

    Args:
        places: The places.
        live: (n,) whether there is an answer at each epoch.
        on_roads: (n, k) STANCE of the roads that it may be on,
        poses: (n, j) and of where it may be.
    """

    def __init__(self, places: Places, live: Array, on_roads: Records, poses: Records) -> None:
        self._places, self._live = places, live
        self._on_roads, self._poses = on_roads, poses
        self._messages = PlaceMessages(places)

    @classmethod
    def of_drive(cls, drive: Surroundings) -> "PlacesAbout":
        """Of a matched drive and its places."""
        stances = stances_of(drive.output, drive.places)
        return cls(drive.places, drive.output.rows.live, stances, stances)

    @classmethod
    def of_points(cls, points: pa.Table, places: Places) -> "PlacesAbout":
        """Of a table of points, which says of the most probable road alone where on it.

        So places ahead are those of this road, with its P; near ones are by the pose as a whole.

        Args:
            points: (n,) as `match` writes them.
            places: On the map that they were matched to.
        """
        on_roads = _stances_of_points(points, places)
        poses = on_roads.copy()
        poses.edge, poses.p = OFF_ROAD, 1.0
        return cls(places, np.isfinite(on_roads.x[:, 0]), on_roads, poses)

    def ahead(self, k: int) -> "list[PlaceMessage]":
        """Those within 500 m along the road at epoch k, the nearest first."""
        if not self._live[k]:
            return []
        return self._messages.of(self._places.ahead(self._on_roads[k].tobytes(), AHEAD_M))

    def nearby(self, k: int) -> "list[PlaceMessage]":
        """Those within 50 m in a straight line at epoch k."""
        if not self._live[k]:
            return []
        return self._messages.of(self._places.nearby(self._poses[k].tobytes(), NEARBY_M))


def _stances_of_points(points: pa.Table, places: Places) -> Records:
    """The best road of each point, (n, 1) STANCE."""
    names = ("lat", "lon", "bearing_deg", "cov_ee_m2", "cov_en_m2", "cov_nn_m2", "map_lat",
             "map_lon", "abscissa_m", "p_road")  # fmt: skip
    c = {name: points[name].to_numpy().astype(np.float64) for name in names}
    one = records(points.num_rows, STANCE).reshape(-1, 1)
    plane = places.roads.plane
    x, y = plane.from_geodetic(c["lat"], c["lon"])
    map_x, map_y = plane.from_geodetic(c["map_lat"], c["map_lon"])
    drawn = np.isfinite(map_x)
    turn = plane.convergence(x, y)
    cos, sin = np.cos(turn), np.sin(turn)
    ee, en, nn = (c[name] for name in names[3:6])
    one.x[:, 0], one.y[:, 0] = x, y
    one.map_x[:, 0], one.map_y[:, 0] = np.where(drawn, map_x, x), np.where(drawn, map_y, y)
    one.xx[:, 0] = cos * cos * ee - 2.0 * cos * sin * en + sin * sin * nn
    one.xy[:, 0] = cos * sin * (ee - nn) + (cos * cos - sin * sin) * en
    one.yy[:, 0] = sin * sin * ee + 2.0 * cos * sin * en + cos * cos * nn
    one.map_xx, one.map_xy, one.map_yy = one.xx, one.xy, one.yy
    bearing = radians(c["bearing_deg"])
    east, north = np.sin(bearing), np.cos(bearing)
    along = east * east * ee + 2.0 * east * north * en + north * north * nn
    on = points["edge_id"].is_valid().to_numpy() & np.isfinite(c["abscissa_m"])
    one.edge[:, 0] = np.where(on, points["edge_id"].fill_null(0).to_numpy(), OFF_ROAD)
    one.s[:, 0], one.sigma[:, 0] = np.nan_to_num(c["abscissa_m"]), np.sqrt(np.nan_to_num(along))
    one.p[:, 0] = np.where(on, np.nan_to_num(c["p_road"]), 0.0)
    return one
