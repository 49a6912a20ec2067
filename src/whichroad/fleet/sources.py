"""Queries of all that is read: a query for the files of each kind, and all of them as one."""

import gzip
from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import WriteError, first_line
from ..readers.mixed_files import (
    Layout,
    MixedFiles,
    Whole,
    keys_of,
    there,
    whole_of,
    with_trip,
)
from ..readers.names import find
from ..readers.trip_files import are_mixed, joined_schema, schemas_of
from ..roadmap.open_table import SEPARATOR
from .inputs import Inputs, used_columns

LOCAL = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?"
ZONED = LOCAL + r"(Z|[+-]\d\d(:?\d\d)?)"
OTHER_FORM = "whichroad: a time of another form"  # an error of a query
_SAMPLE = 10_000  # rows of which the times are looked at
CSV = "union_by_name=true, auto_type_candidates=['BIGINT', 'DOUBLE', 'VARCHAR']"  # options
_HEADER = 1 << 16  # bytes, at most


def can_stay(inputs: Inputs, trip_id: str, own: Mapping[str, str | int]) -> bool:
    """Whether files whose rows are in order can be read where they are."""
    if not inputs.is_parquet:
        return False
    return not are_mixed(schemas_of(inputs.files["parquet"], "parquet")[0], own, trip_id)


class Source(NamedTuple):
    """A query, and the types of its columns."""

    query: str
    kinds: dict[str, str]


class Reader(NamedTuple):
    """How sources are read."""

    run: Any  # gives the answer to a query
    con: Any
    folder: Path  # of what is written meanwhile
    trip_id: str
    own: Mapping[str, str | int]  # own names of columns, and those that further sensors read
    crs: Any = None  # of geometries that name none
    as_text: bool = False  # times of CSV stay text

    def sources(self, inputs: Inputs) -> list[Source]:
        """One for each way in which files are read, and one for each query."""
        several = bool(inputs.queries) or len(inputs.files) > 1
        asked = [self._tables(paths, kind, several=several)
                 for kind, paths in inputs.files.items() if kind != "csv"]  # fmt: skip
        groups = _by_header(inputs.files.get("csv", ()))
        alone = not several and len(groups) == 1
        asked += [self._csv(paths, alone=alone) for paths in groups]
        asked += [f"SELECT * FROM ({query})" for query in inputs.queries]
        return [Source(query, self._kinds(query)) for query in asked]

    def _kinds(self, query: str) -> dict[str, str]:
        return {row[0]: str(row[1]) for row in self.run(f"DESCRIBE {query}").fetchall()}

    def _tables(self, paths: Sequence[Path], kind: str, *, several: bool) -> str:
        """The query of Parquet or Arrow files."""
        schemas = schemas_of(paths, kind)[0]
        schema = joined_schema(schemas.values())
        found = find(schema.names, there(self.own, schema.names))
        mixed = are_mixed(schemas, self.own, self.trip_id)
        geometry = "geometry" in found and not {"lat", "lon"} <= found.keys()
        below = [Path(path.anchor) for path in paths]
        borne = any(keys_of(path, root) for path, root in zip(paths, below, strict=True))
        if mixed or (geometry and (several or borne)):
            root = below[0] if kind == "parquet" else None
            files = MixedFiles(schemas, kind, self.own, self.trip_id, crs=self.crs, below=root)
            return f"SELECT * FROM read_parquet([{text(self._written(files, kind))}])"
        if kind == "parquet" and not geometry:
            return f"SELECT * FROM read_parquet([{_all(paths)}], union_by_name=true)"
        import pyarrow.dataset as ds

        data = ds.dataset([str(path) for path in paths], schema, format=kind)
        self.con.register(f"files_{kind}", data)
        return f"SELECT * FROM files_{kind}"

    def _written(self, files: MixedFiles, kind: str) -> Path:
        """The file to which the used columns of others are copied: DuckDB may read it again."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        names, path = files.schema.names, self.folder / f"alike-{kind}.parquet"
        own = there(self.own, names)
        columns = used_columns(names, self.trip_id, str(files.first), own).columns
        schema = pa.schema([files.schema.field(name) for name in columns])
        try:
            with pq.ParquetWriter(path, schema, compression="zstd") as file:
                for batch in files.to_batches(columns):
                    file.write_batch(batch)
        except OSError as error:
            raise WriteError(
                f"{path}: cannot be written ({first_line(error)}); a folder with space for all "
                "rows was expected; make space, or choose another by -o"
            ) from None
        return path

    def _csv(self, paths: Sequence[Path], *, alone: bool) -> str:
        """The query of CSV files: trips stay text, times are read where all are ISO 8601."""
        options = CSV
        kinds = self._kinds(f"SELECT * FROM read_csv([{_all(paths)}], {options})")
        own = self.own if alone else there(self.own, kinds)
        used = used_columns(kinds, self.trip_id, str(paths[0]), own)
        options += f", types={{{text(used.trip)}: 'VARCHAR'}}"
        rows = f"read_csv([{_all(paths)}], {options})"
        time = quoted(used.time)
        if kinds[used.time] == "VARCHAR" and not self.as_text:
            few = f"SELECT {time} AS t FROM {rows} LIMIT {_SAMPLE}"
            for form, kind in ((ZONED, "TIMESTAMPTZ"), (LOCAL, "TIMESTAMP")):
                test = f"SELECT bool_and(t IS NULL OR regexp_full_match(t, '{form}')) FROM ({few})"
                if self.run(test).fetchone()[0]:
                    moment = _moment(time, form, kind)
                    return f"SELECT * REPLACE ({moment} AS {time}) FROM {rows}"
        return f"SELECT * FROM {rows}"


def union_of(sources: Sequence[Source], trip_id: str, own: Mapping[str, str | int]) -> str:
    """The query of the rows of all sources, whose columns have the same names.

    Raises:
        ReadError: They cannot be read together.
    """
    own = with_trip(own, trip_id)
    layouts = [_layout(source, own) for source in sources]
    whole = whole_of(layouts, own)
    asked = [
        source.query if whole is None else _alike(source, layout, whole)
        for source, layout in zip(sources, layouts, strict=True)
    ]
    return " UNION ALL BY NAME ".join(asked)


def _layout(source: Source, own: Mapping[str, str | int]) -> Layout:
    names = list(source.kinds)
    found = find(names, there(own, names))
    times = _times(source.kinds[found["time"].name]) if "time" in found else ""
    return Layout("trips", found, times)


def _times(kind: str) -> str:
    """As `mixed_files.Layout.times`, of a type of DuckDB."""
    if kind.startswith("TIMESTAMP"):
        return "zoned" if kind.startswith("TIMESTAMPTZ") or "ZONE" in kind else "naive"
    numbers = kind.startswith(("DECIMAL", "DOUBLE", "FLOAT")) or "INT" in kind
    return "text" if kind == "VARCHAR" else "number" if numbers else kind


def _alike(source: Source, layout: Layout, whole: Whole) -> str:
    """The query of a source whose columns are as those of all."""
    cells: dict[str, str] = {}
    gone = set()
    for quantity, column in layout.found.items():
        if column.name in gone:
            continue
        gone.add(column.name)
        factor, cell = whole.factor(quantity, layout), quoted(column.name)
        if factor != 1.0:
            cell = f"CAST({cell} AS DOUBLE) * {factor!r}"
        if quantity == "time" and whole.as_text:
            cell = f"CAST({cell} AS VARCHAR)"
        cells[whole.found[quantity].name] = cell
    cells |= {name: quoted(name) for name in source.kinds if name not in gone | cells.keys()}
    columns = ", ".join(f"{cell} AS {quoted(name)}" for name, cell in cells.items())
    return f"SELECT {columns} FROM ({source.query})"


def _moment(time: str, form: str, kind: str) -> str:
    """Times of a form as moments; another form is an error of the query."""
    moment = f"IF(regexp_full_match({time}, '{form}'), TRY_CAST({time} AS {kind}), NULL)"
    other = f"CAST(error('{OTHER_FORM}') AS {kind})"
    return f"CASE WHEN {time} IS NULL OR {moment} IS NOT NULL THEN {moment} ELSE {other} END"


def _by_header(paths: Sequence[Path]) -> list[list[Path]]:
    """CSV files in their order, in groups of the same first line; without those that hold none."""
    heads = [_head(path) for path in paths]
    some = any(holds for _, holds in heads)
    both = zip(heads, paths, strict=True)
    kept = [(head, path) for (head, holds), path in both if holds or not some]
    return [[path for _, path in group] for _, group in groupby(kept, itemgetter(0))]


def _head(path: Path) -> tuple[bytes, bool]:
    """The line of names of a CSV file, and whether another one follows it."""
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
            first = file.readline(_HEADER)
            if SEPARATOR.match(first):
                first += file.readline(_HEADER)
            more = bool(file.readline(1))
        first.decode()
        return first.rstrip(), more
    except (OSError, EOFError, UnicodeDecodeError):  # DuckDB will say what is wrong with it
        return b"", True


def _all(paths: Sequence[Path]) -> str:
    return ", ".join(text(path) for path in paths)


def text(value: Any) -> str:
    """A value as SQL writes texts."""
    return "'" + str(value).replace("'", "''") + "'"


def quoted(name: str) -> str:
    """A column as SQL writes its name."""
    return '"' + name.replace('"', '""') + '"'
