"""A matched drive as tables: points, path, summary."""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, cast

import pyarrow as pa
from numpy.typing import NDArray

from .._compile import Records
from ..diagnosis.findings import Finding
from ..errors import SettingError
from ..filter.estimate import Output
from ..path import Alternative, Route, best_routes
from ..traversals import Traversals
from ..writers import write_table
from .schema import geo_frame


class Answered(NamedTuple):
    """What the tables of a drive are made of."""

    epochs: Records  # (n,) filter.state.EPOCH
    output: Output
    driven: Callable[[], Traversals]


class Result:
    """A matched drive (or several): tables of points and path, and a summary.

    What is given as a function is put together when it is first asked for.

    Args:
        points: Points, one row per epoch.
        path: Path, one row per traversed edge.
        summary: What happened, in numbers.
        hypotheses: Poses of the alternatives per epoch, when they were asked for.
        diagnosis: Settings that do not fit the data.
        answered: Of one drive: what its tables are made of.
        find_alternatives: Gives the parts of the route with competing routes; None: not smoothed.
    """

    def __init__(
        self,
        points: pa.Table | Callable[[], pa.Table],
        path: pa.Table | Callable[[], pa.Table],
        summary: dict[str, Any] | Callable[[], dict[str, Any]],
        hypotheses: dict[str, NDArray[Any]] | None = None,
        diagnosis: tuple[Finding, ...] | Callable[[], tuple[Finding, ...]] = (),
        answered: Answered | None = None,
        find_alternatives: Callable[[], list[Alternative]] | None = None,
    ) -> None:
        self.answered, self._find_alternatives = answered, find_alternatives
        self._late: dict[str, Any] = {
            "points": points, "path": path, "summary": summary, "diagnosis": diagnosis
        }  # fmt: skip
        self.hypotheses = hypotheses

    def _made(self, name: str) -> Any:
        value = self._late[name]
        if callable(value):
            value = self._late[name] = value()
        return value

    def __repr__(self) -> str:
        figures = self.summary
        name = (
            repr(figures["drive_id"])
            if "drive_id" in figures
            else f"{figures.get('drives', 0)} drives"
        )
        epochs, metres = figures.get("epochs", 0), figures.get("path_m", 0.0)
        return f"Result({name}, {epochs:,} epochs, {metres / 1e3:.1f} km)"

    @property
    def summary(self) -> dict[str, Any]:
        """What happened, in numbers."""
        return cast(dict[str, Any], self._made("summary"))

    @property
    def diagnosis(self) -> tuple[Finding, ...]:
        """Settings that do not fit the data."""
        return cast(tuple[Finding, ...], self._made("diagnosis"))

    @property
    def points(self) -> Any:
        """Points as a GeoDataFrame in EPSG:4326."""
        return geo_frame(self.to_arrow())

    @property
    def path(self) -> Any:
        """Path as a GeoDataFrame in EPSG:4326."""
        return geo_frame(self.path_arrow())

    def to_arrow(self) -> pa.Table:
        """Points as an Arrow table."""
        return self._made("points")

    def path_arrow(self) -> pa.Table:
        """Path as an Arrow table, geometry as WKB."""
        return self._made("path")

    @cached_property
    def _parts(self) -> list[Alternative]:
        if self._find_alternatives is None:
            raise SettingError('no lag, or several drives; one with lag="full" was expected')
        return self._find_alternatives()

    @property
    def alternatives(self) -> list[Alternative]:
        """Parts of the drive whose route is not sure, with competing routes; see `routes`."""
        return [part for part in self._parts if len(part.routes) > 1 and part.routes[1].p >= 0.001]

    def routes(self, k: int = 3) -> list[Route]:
        """The k most probable routes from the drive's start to its end, connected edges with P.

        Raises:
            SettingError: The drive was matched without a lag, or there are several drives.
        """
        return best_routes(self._parts, k)

    def write(self, path: str | Path, *, force: bool = False) -> None:
        """Write the points; the suffix chooses GeoParquet, GeoJSON, CSV or GPX.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.to_arrow(), path, force=force)

    def write_path(self, path: str | Path, *, force: bool = False) -> None:
        """Write the path likewise.

        Raises:
            WriteError: The file exists and `force` is not set, or the suffix is unknown.
        """
        write_table(self.path_arrow(), path, force=force)
