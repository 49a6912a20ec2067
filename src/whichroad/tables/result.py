"""A matched drive as tables: points, path, summary."""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pyarrow as pa
from numpy.typing import NDArray

from ..diagnosis.finding import Finding
from ..diagnosis.sensor_states import SensorTrack
from ..errors import SettingError
from ..lookback.path import Alternative, Route, best_routes
from ..wording import counted
from ..writers import write_table
from .schema import geo_frame

if TYPE_CHECKING:
    from ..lineage import Lineage
    from ..roadmap import RoadMap
    from .relative_places import Surroundings


class Result:
    """A matched drive (or several): tables of points and path, and a summary.

    What is given as a function is put together when it is first asked for.  A result can be
    pickled: its tables are then made.

    Args:
        points: Points, one row per epoch.
        path: Path, one row per traversed edge.
        summary: What happened, in numbers.
        hypotheses: Poses of the alternatives per epoch, when they were asked for.
        diagnosis: Sensors, settings, maps and drives that are wrong or do not fit.
        find_alternatives: Gives the parts of the route with competing routes; None: not smoothed.
        roads: The map, to be drawn below the answer; a pickled result is without it.
        find_lineage: Gives births and deaths of the hypotheses; None: of several drives.
        surroundings: Of each drive, where places were given.
        sensor_track: What was believed and learnt of the sensors, when `hypotheses` were asked for.
    """

    def __init__(
        self,
        points: pa.Table | Callable[[], pa.Table],
        path: pa.Table | Callable[[], pa.Table],
        summary: dict[str, Any] | Callable[[], dict[str, Any]],
        hypotheses: dict[str, NDArray[Any]] | None = None,
        diagnosis: tuple[Finding, ...] | Callable[[], tuple[Finding, ...]] = (),
        find_alternatives: Callable[[], list[Alternative]] | None = None,
        roads: "RoadMap | None" = None,
        find_lineage: "Callable[[], Lineage] | None" = None,
        surroundings: "Sequence[Surroundings]" = (),
        sensor_track: SensorTrack | None = None,
    ) -> None:
        self._find_alternatives, self._roads = find_alternatives, roads
        self._find_lineage = find_lineage
        self.surroundings, self.sensor_track = tuple(surroundings), sensor_track
        self._late: dict[str, Any] = {
            "points": points, "path": path, "summary": summary, "diagnosis": diagnosis
        }  # fmt: skip
        self.hypotheses = hypotheses

    def _made(self, name: str) -> Any:
        value = self._late[name]
        if callable(value):
            value = self._late[name] = value()
        return value

    def __getstate__(self) -> dict[str, Any]:
        for name in self._late:
            self._made(name)
        if self._find_alternatives is not None:
            _ = self._parts
        gone = {"_find_alternatives": None, "_roads": None, "_find_lineage": None}
        return self.__dict__ | gone | {"surroundings": ()}

    def __repr__(self) -> str:
        figures = self.summary
        name = (
            repr(figures["drive_id"])
            if "drive_id" in figures
            else counted(figures.get("drives", 0), "drive")
        )
        if failed := figures.get("failed"):
            name += f", {len(failed):,} failed"
        epochs, metres = figures.get("epochs", 0), figures.get("path_m", 0.0)
        return f"Result({name}, {counted(epochs, 'epoch')}, {metres / 1e3:.1f} km)"

    def _repr_html_(self) -> str:
        """What a notebook shows: the track on its roads, as a picture that needs no connection."""
        from .drawing import answer_html

        return answer_html(self.to_arrow(), self.path_arrow(), repr(self), self._roads)

    def plot(self, ax: Any = None, **style: Any) -> Any:
        """Draw path and points with matplotlib; points are coloured by `p_way`.

        On new axes the roads near the drive are drawn beneath, and a legend names all.

        Args:
            ax: Axes to draw on, such as those of `RoadMap.plot`; None: new ones.
            style: For the points, as `GeoDataFrame.plot` takes it, such as `column`, `cmap`,
                `legend`, `markersize`, `figsize`.

        Returns:
            The axes, longitude to the right and latitude up, degrees.
        """
        from .drawing import plot_answer

        return plot_answer(self.points, self.path, ax, style, self._roads)

    def explore(self, **style: Any) -> Any:
        """Path and points on a page that can be moved and enlarged, with all their columns.

        Args:
            style: For the points, as `GeoDataFrame.explore` takes it, such as `column`, `tiles`.

        Returns:
            A `folium.Map`, whose page loads scripts and tiles from the net.  The commands
            `whichroad report` and `replay` make pages that do not.

        Raises:
            SettingError: A package of the extra `explore` is not installed.
        """
        from .drawing import explore_answer

        return explore_answer(self.points, self.path, style)

    @property
    def summary(self) -> dict[str, Any]:
        """What happened, in numbers."""
        return cast(dict[str, Any], self._made("summary"))

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """What is wrong, or does not fit, by its name (docs/reference/findings.md)."""
        return cast(tuple[Finding, ...], self._made("diagnosis"))

    @cached_property
    def points(self) -> Any:
        """Points as a GeoDataFrame in EPSG:4326; the same one each time.

        Its columns are in docs/reference/columns.md.  What is added to it is kept here, and not in
        `to_arrow` or `write`, which give the table as it was matched.
        """
        return geo_frame(self.to_arrow())

    @cached_property
    def path(self) -> Any:
        """Path as a GeoDataFrame in EPSG:4326; the same one each time."""
        return geo_frame(self.path_arrow())

    def to_arrow(self) -> pa.Table:
        """Points as an Arrow table."""
        return self._made("points")

    def path_arrow(self) -> pa.Table:
        """Path as an Arrow table, geometry as WKB."""
        return self._made("path")

    @cached_property  # which a pickled result has, and not what finds them
    def _parts(self) -> list[Alternative]:
        if self._find_alternatives is None:
            raise SettingError('no lag, or several drives; one with lag="full" was expected')
        return self._find_alternatives()

    @property
    def alternatives(self) -> list[Alternative]:
        """Parts of the drive whose route is not sure, with competing routes; see `routes`."""
        return [part for part in self._parts if len(part.routes) > 1 and part.routes[1].p >= 0.001]

    @cached_property
    def lineage(self) -> "Lineage":
        """Births, deaths and reasons of all hypotheses, one row each; see docs/lineage.md.

        The drive goes through the filter again when it is first asked for.  A pickled result
        has it if it was asked for before.  With a lag, too, it tells the filter's hypotheses.

        Raises:
            SettingError: There are several drives, or the result was pickled without it.
        """
        if self._find_lineage is None:
            raise SettingError(
                "lineage: there are several drives, or the result was pickled before its lineage "
                "was asked for; a result of one drive was expected; match each drive by itself"
            )
        return self._find_lineage()

    def attribute(self, name: str) -> pa.Table:
        """Values of an attribute of the road, such as "maxspeed", each with its probability.

        The roads are those of `alternatives` of the points: six at most an epoch.  On the most
        probable edge the value is that at the place; on others, of their longest piece.

        Args:
            name: A column of the points with attributes; "maxspeed" is `speed_limit_kmh`.

        Returns:
            Columns `drive_id, time, value, p`; a row for each value of each epoch, the most
            probable first.  The null value has the rest: off the roads, or no value known.

        Raises:
            SettingError: The map has no such attribute, or the result was pickled.
        """
        if self._roads is None:
            raise SettingError(
                "attribute: this result has no map, as one out of a pickle; the result that "
                "match gave was expected; ask before it is pickled"
            )
        from .attribute import attribute_table

        return attribute_table(self.to_arrow(), self._roads, name)

    def ahead(self, within_m: float = 500.0) -> pa.Table:
        """The places that the vehicle will come past, at every epoch.

        P is that of driving past within the distance, if the vehicle drives on: at each junction
        ahead it is multiplied by the prior of the turn.  The distance is that along the road,
        given that it is passed.  Roads are those of `alternatives`: six at most an epoch.

        Args:
            within_m: How far ahead, 0 to 5000 m.

        Returns:
            Columns `drive_id, time, id, distance_m, sigma_m, p`; the nearest first.

        Raises:
            SettingError: The drive was matched without places, or the result was pickled.
        """
        return self._about(lambda drive: drive.ahead(within_m))

    def nearby(self, radius_m: float = 50.0) -> pa.Table:
        """The places within a radius of the vehicle, at every epoch.

        Args:
            radius_m: 0 to 5000 m.

        Returns:
            Columns as of `ahead`; P is that of being so near, in a straight line.

        Raises:
            SettingError: The drive was matched without places, or the result was pickled.
        """
        return self._about(lambda drive: drive.nearby(radius_m))

    def _about(self, ask: "Callable[[Surroundings], pa.Table]") -> pa.Table:
        if not self.surroundings:
            raise SettingError(
                "places: this result has none, or is out of a pickle; a drive that was matched "
                "with places=... was expected"
            )
        return pa.concat_tables([ask(drive) for drive in self.surroundings])

    def routes(self, k: int = 3) -> list[Route]:
        """The k most probable routes from the drive's start to its end, connected edges with P.

        Raises:
            SettingError: The drive was matched without a lag, or there are several drives.
        """
        return best_routes(self._parts, k)

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write the points; the suffix chooses the format.

        GeoParquet, GeoJSON, GeoPackage, CSV, GPX, Arrow, NMEA, MCAP, or a bag of ROS 1 or 2.

        Args:
            path: The file.
            force: Replace a file that exists.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.to_arrow(), path, force=force)

    def write_path(self, path: str | Path, *, force: bool = False) -> None:
        """Write the path likewise.

        Args:
            path: The file.
            force: Replace a file that exists.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.path_arrow(), path, force=force)
