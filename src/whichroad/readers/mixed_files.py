"""Files of trips that several tools wrote, read as if one had written all of them.

A column gets the name that it has in other files.  Where only some files name a zone, times become
text, which is read row by row.  Points become degrees, each by the reference system of its file.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import unquote

from ..errors import ReadError, first_line
from .geometries import places_of, system_of
from .names import Column, find, normal
from .tables_in_memory import flattened

if TYPE_CHECKING:
    import pyarrow as pa

Own = Mapping[str, str | int]
_NO_VALUE = "__HIVE_DEFAULT_PARTITION__"  # as folders bear an empty cell


class Layout(NamedTuple):
    """What is read of a table, and how it is written."""

    where: str  # the file, for errors
    found: dict[str, Column]  # by quantity
    times: str  # zoned, naive, text, number, or another type; empty: no time is there
    system: str = ""  # of the geometry, where that alone gives the places

    @property
    def is_geometry(self) -> bool:
        """Whether a geometry alone gives the places."""
        return "geometry" in self.found and not {"lat", "lon"} <= self.found.keys()


class Whole(NamedTuple):
    """How tables are written together."""

    found: dict[str, Column]  # by quantity, the names that all get
    as_text: bool  # times
    as_degrees: bool  # geometries

    def factor(self, quantity: str, layout: Layout) -> float:
        """By what numbers of one table are multiplied."""
        own, common = layout.found[quantity], self.found[quantity]
        if quantity == "time" and layout.times != "number":
            return 1.0
        return (own.factor or 1.0) / (common.factor or 1.0)


def there(own: Own, names: Iterable[str]) -> dict[str, str | int]:
    """Those own names whose columns this table has: others may have the rest."""
    known = {normal(name) for name in names}
    return {alias: column for alias, column in own.items() if normal(str(column)) in known}


def with_trip(own: Own, trip: str) -> Own:
    """Own names, and the column that names the trip, where the caller gave it."""
    return own if trip == "drive_id" else {"drive_id": trip, **own}


def layout_of(schema: "pa.Schema", own: Own, where: str) -> Layout:
    """The layout of a file whose columns are known."""
    found = find(schema.names, there(own, schema.names))
    times = _kind(schema.field(found["time"].place).type) if "time" in found else ""
    layout = Layout(where, found, times)
    if not layout.is_geometry:
        return layout
    field = schema.field(found["geometry"].place)
    return layout._replace(system=repr(system_of(schema.metadata or {}, field)))


def _kind(kind: "pa.DataType") -> str:
    """How a type holds times."""
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    if pa.types.is_timestamp(kind):
        return "naive" if kind.tz is None else "zoned"
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        return "number"
    return "" if pa.types.is_null(kind) else "text" if "string" in str(kind) else str(kind)


def whole_of(layouts: Sequence[Layout], own: Own) -> Whole | None:
    """How tables are written together; None: all are written alike.

    Raises:
        ReadError: The unit of a column is told by the names in some files, by nothing in others.
    """
    names: dict[str, set[str]] = {}
    for one in layouts:
        for quantity, column in one.found.items():
            names.setdefault(quantity, set()).add(column.name)
    kinds = {one.times for one in layouts} - {""}
    as_text = len(kinds) > 1 and not kinds.isdisjoint(("zoned", "naive"))
    geometries = {one.system for one in layouts if "geometry" in one.found or "lat" in one.found}
    as_degrees = len(geometries) > 1
    if not as_text and not as_degrees and all(len(some) < 2 for some in names.values()):
        return None
    every = [column.name for one in layouts for column in one.found.values()]
    if as_degrees:
        every += [name for name in ("lat", "lon") if name not in names]
    every = list(dict.fromkeys(every))
    whole = Whole(find(every, there(own, every)), as_text, as_degrees)
    for quantity, column in whole.found.items():
        known = [one for one in layouts if quantity in one.found]
        for one in known:
            has = one.found[quantity]
            counts = quantity == "time" and one.times == "number" and bool(column.factor)
            if has.bare != column.bare or (counts and not has.factor):
                other = next(o for o in known if o.found[quantity].name == column.name)
                raise ReadError(
                    f"{one.where}: its column {has.name!r} is {column.name!r} in {other.where}, "
                    "and only one of the names tells the unit; one name in all files was expected; "
                    "rename it, or match the files apart"
                )
    return whole


class MixedFiles:
    """Parquet or Arrow files as a dataset of one schema, as far as `batches_in` asks for it.

    Args:
        schemas: Of each file, without the values that its folders bear.
        kind: parquet or ipc.
        own: Own names of columns.
        trip: The column that names trips; "drive_id": the usual ones.
        crs: Of geometries that name none; None: degrees.
        below: Folders below this one may bear values; None: none.

    Raises:
        ReadError: The files cannot be read together.
    """

    def __init__(
        self, schemas: "Mapping[Path, pa.Schema]", kind: str, own: Own, trip: str,
        *, crs: Any = None, below: Path | None = None,
    ) -> None:  # fmt: skip
        from .trip_files import joined_schema

        self._own, self._kind, self._crs, self._below = with_trip(own, trip), kind, crs, below
        self._empty = {path: self._flat(path, one.empty_table()) for path, one in schemas.items()}
        layouts = [self._layout(path) for path in schemas]
        whole = whole_of(layouts, self._own)
        found = layouts[0].found if whole is None else whole.found
        geometries = any(one.is_geometry for one in layouts)
        self._whole = whole or Whole(found, False, geometries)
        self.schema = joined_schema(self._alike(path, t).schema for path, t in self._empty.items())
        self.scanner = None  # it is taken for a dataset
        self.first = next(iter(schemas))
        naive = any(one.times == "naive" for one in layouts)
        self.zoneless = self._whole.found["time"].name if naive else None  # of the column of times

    def _layout(self, path: Path) -> Layout:
        return layout_of(self._empty[path].schema, self._own, str(path))

    def _flat(self, path: Path, table: "pa.Table") -> "pa.Table":
        """A table of a file with the values that its folders bear."""
        import pyarrow as pa

        names = [*table.column_names, *table.flatten().column_names]
        table = flattened(table, there(self._own, names))
        for name, value in keys_of(path, self._below).items():
            if name not in table.column_names:
                cells = pa.repeat(pa.scalar(value, pa.string()), table.num_rows)
                table = table.append_column(name, cells)
        return table

    def _alike(self, path: Path, table: "pa.Table") -> "pa.Table":
        """A table of a file as all are written."""
        import pyarrow as pa

        layout, whole = self._layout(path), self._whole
        cells: dict[str, Any] = {}
        gone = set()
        if whole.as_degrees and "geometry" in layout.found:
            geometry = layout.found["geometry"]
            gone.add(geometry.name)
            if layout.is_geometry and geometry.name in table.column_names:
                at = geometry._replace(place=table.column_names.index(geometry.name))
                lon, lat = places_of(table, at, self._crs, str(path))
                names = [whole.found[q].name if q in whole.found else q for q in ("lat", "lon")]
                cells |= dict(zip(names, (pa.array(lat), pa.array(lon)), strict=True))
        for quantity, column in layout.found.items():
            if column.name not in gone and column.name in table.column_names:
                gone.add(column.name)
                values = table.column(column.name)
                if quantity == "time" and whole.as_text:
                    values = _text(values)
                factor = whole.factor(quantity, layout)
                cells[whole.found[quantity].name] = (
                    values if factor == 1.0
                    else pa.compute.multiply(values.cast(pa.float64()), factor)
                )  # fmt: skip
        others = [name for name in table.column_names if name not in gone | cells.keys()]
        cells |= {name: table.column(name) for name in others}
        return pa.table(cells)

    def to_batches(
        self, columns: Sequence[str] | None = None, batch_size: int = 1 << 15, **_: Any
    ) -> "Iterator[pa.RecordBatch]":
        """The rows of all files, one after the other.

        Raises:
            ReadError: A file cannot be read to its end.
        """
        import pyarrow as pa

        wanted = pa.schema([self.schema.field(name) for name in columns or self.schema.names])
        for path in self._empty:
            try:
                yield from self._batches(path, wanted, batch_size)
            except (pa.ArrowException, OSError) as error:
                raise ReadError(
                    f"{path}: cannot be read with the others ({first_line(error)}); columns of the "
                    "same kind as in the other files were expected; write it again"
                ) from None

    def _batches(self, path: Path, wanted: "pa.Schema", rows: int) -> "Iterator[pa.RecordBatch]":
        import pyarrow as pa
        import pyarrow.dataset as ds

        data, found = ds.dataset(path, format=self._kind), self._layout(path).found
        common = {c.name: self._whole.found[q].name for q, c in found.items() if q != "geometry"}
        need = [n for n in self._empty[path].column_names if common.get(n, n) in wanted.names]
        need += [c.name for q, c in found.items() if q == "geometry"]
        heads = {name if name in data.schema.names else name.partition(".")[0] for name in need}
        reads = [name for name in data.schema.names if name in heads]
        for batch in data.to_batches(columns=reads, batch_size=rows, batch_readahead=1):
            table = self._flat(path, pa.Table.from_batches([batch]))
            table = self._alike(path, table)
            cells = [
                table.column(field.name).cast(field.type) if field.name in table.column_names
                else pa.chunked_array([pa.nulls(table.num_rows, field.type)])
                for field in wanted
            ]  # fmt: skip
            yield from pa.Table.from_arrays(cells, schema=wanted).to_batches()


def _text(times: "pa.ChunkedArray") -> "pa.ChunkedArray":
    """Times as text: those of a zone in UTC, with its letter."""
    import pyarrow as pa

    kind = times.type
    if pa.types.is_dictionary(kind):
        times = times.cast(kind.value_type)
    if pa.types.is_timestamp(kind) and kind.tz is not None:
        times = times.cast(pa.timestamp(kind.unit, "UTC"))
    return times.cast(pa.string())


def keys_of(file: Path, below: Path | None) -> dict[str, str | None]:
    """The values that the folders of a file bear, below one folder."""
    if below is None or not file.is_relative_to(below):
        return {}
    pairs = [part.partition("=") for part in file.relative_to(below).parts[:-1] if "=" in part]
    return {unquote(k): None if v == _NO_VALUE else unquote(v) for k, _, v in pairs}
