"""The trips of a chunk on several maps: each on the map that holds it, the tables as one."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..errors import SettingError, WhichroadError
from ..observations import Array
from ..readers import drive_from_table
from ..readers.checks import is_place
from ..readers.dates import Writing
from ..readers.many_trips import TripBatch
from ..readers.names import find
from ..readers.reading import Reading
from ..readers.splitting import degrees_of, in_time_order
from ..roadmap import RoadMaps, Share
from ..sensors import Sensor
from ..tables.provenance import with_map
from ..tables.schema import MAP
from .trips import Job, Tables, joined, noted


class _Part(NamedTuple):
    """A trip, or a part of one, for one map."""

    name: str
    table: pa.Table
    map: int
    note: str | None
    trip: int  # of the chunk


class MapsJob(NamedTuple):
    """What all trips share, where each takes one of several maps."""

    maps: RoadMaps
    job: Job  # on any of them
    is_split: bool = False  # trips are parts already, called `name/1`, `name/2`, ...

    @property
    def identity(self) -> dict[str, Any]:
        """What results name as their map."""
        return self.maps.identity

    @property
    def written(self) -> Writing:
        """As of `Job`."""
        return self.job.written

    def with_more(self, sensors: Sequence[Sensor], places: Any) -> "MapsJob":
        """The job with further sensors, as `Job.with_more`; places belong to one map.

        Raises:
            SettingError: A sensor is none, or places are given.
        """
        if places is not None:
            raise SettingError(
                f"places are read for one map, and {self.maps.origin} has {len(self.maps):,}; "
                "pass the path of one map"
            )
        return self._replace(job=self.job.with_more(sensors, None))

    @property
    def reading(self) -> Reading:
        """As of `Job`."""
        return self.job.reading

    def own_columns(self) -> dict[str, str | int]:
        """As `Job.own_columns`."""
        return self.job.own_columns()

    def tables(self, chunk: TripBatch) -> Tables:
        """The tables of the trips of a chunk, with a column that names the map of each row."""
        parts = list(self._parts(chunk))
        made = []
        for k in sorted({part.map for part in parts}):
            own = [part for part in parts if part.map == k]
            name = self.maps.names[k]
            tables = self.job._replace(roads=self.maps[name]).tables(_batch(own, chunk))
            notes = {row: [part.note] for row, part in enumerate(own) if part.note}
            drives = noted(tables.drives, notes)
            made.append(Tables(*(_named(t, name) for t in (tables.points, tables.path, drives))))
        tables = made[0] if len(made) == 1 else _in_order(made, [part.name for part in parts])
        return Tables(*(with_map(table, self.identity) for table in tables))

    def _parts(self, chunk: TripBatch) -> Iterator[_Part]:
        """Each trip with its map; those that no map holds whole in parts."""
        found = find(chunk.table.column_names, self.job.columns)
        lat, lon = (degrees_of(chunk.table, found.get(name)) for name in ("lat", "lon"))
        place = is_place(lat, lon)
        count = np.add.reduceat(place, chunk.first[:-1], dtype=np.int64)
        some = np.flatnonzero(count)
        shares: dict[int, list[Share]] = {}
        if len(some):
            first = np.cumsum([0, *count[some]])
            each = self.maps.shares(lat[place], lon[place], first)
            shares = dict(zip(some.tolist(), each, strict=True))
        for trip, (low, high) in enumerate(pairwise(chunk.first)):
            rows, name = chunk.table.slice(low, high - low), chunk.names[trip]
            own = shares.get(trip)
            if own is not None and len(own) == 1:
                yield _Part(name, rows, own[0].map, None, trip)
            else:  # to be cut, or by other columns
                yield from self._at_borders(name, rows, trip)

    def _at_borders(self, name: str, rows: pa.Table, trip: int) -> Iterator[_Part]:
        """The parts of a trip, or all of it where it cannot be read."""
        rows, time = in_time_order(rows, self.job.columns, self.written)
        at, lat, lon = self._fixes(rows, time)
        if not len(at):
            yield _Part(name, rows, 0, None, trip)
            return
        (shares,) = self.maps.shares(lat, lon, np.array([0, len(at)]))
        bounds = [0, *np.searchsorted(time, at[[s.low for s in shares[1:]]]), len(rows)]
        for k, (share, (low, high)) in enumerate(zip(shares, pairwise(bounds), strict=True), 1):
            if len(shares) == 1:
                yield _Part(name, rows, share.map, None, trip)
                continue
            note = (
                f"no map of {self.maps.origin} holds the whole trip: this is part {k} of "
                f"{len(shares)}, on {self.maps.names[share.map]}"
            )
            part = f"{name}{'.' if self.is_split else '/'}{k}"
            yield _Part(part, rows.slice(low, high - low), share.map, note, trip)

    def _fixes(self, rows: pa.Table, time: Array) -> tuple[Array, Array, Array]:
        """Times and places of the fixes of a trip whose rows are in the order of time."""
        found = find(rows.column_names, self.job.columns)
        if {"lat", "lon"} <= found.keys():
            lat, lon = (degrees_of(rows, found[name]) for name in ("lat", "lon"))
            good = is_place(lat, lon) & np.isfinite(time)
            return time[good], lat[good], lon[good]
        try:
            fixes = drive_from_table(
                rows,
                vehicle=self.job.vehicle,
                settings=self.job.settings,
                crs=self.job.crs,
                columns=self.job.columns,
                tz=self.job.tz,
                dates=self.job.dates,
            )[0].fixes
        except WhichroadError:  # matching the trip will say why
            fixes = None
        if fixes is None:
            nothing = np.empty(0)
            return nothing, nothing, nothing
        return fixes.time, fixes.lat_deg, fixes.lon_deg


def _batch(parts: Sequence[_Part], chunk: TripBatch) -> TripBatch:
    """The parts of one map as a chunk of their own."""
    standing = {
        row: chunk.standing[part.trip]
        for row, part in enumerate(parts)
        if part.trip in chunk.standing and (row == 0 or parts[row - 1].trip != part.trip)
    }
    again = tuple(row for row, part in enumerate(parts) if part.trip in chunk.again)
    first = np.cumsum([0, *(len(part.table) for part in parts)]).tolist()
    table = pa.concat_tables([part.table for part in parts])
    return TripBatch(table, [part.name for part in parts], first, again, standing, chunk.units)


def _named(table: pa.Table, name: str) -> pa.Table:
    return table.append_column(MAP, pa.repeat(pa.scalar(name), len(table)))


def _in_order(made: Sequence[Tables], names: Sequence[str]) -> Tables:
    """The tables of several maps as one, in the order in which trips begin."""
    order = pa.array(dict.fromkeys(names))
    tables = []
    for table in joined(made):
        place: NDArray[np.int64] = pc.index_in(table["drive_id"], order).to_numpy()
        tables.append(table.take(np.argsort(place, kind="stable")))
    return Tables(*tables)
