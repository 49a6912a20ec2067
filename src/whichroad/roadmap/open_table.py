"""Opening a table of roads: files and tables of any kind to `sheet.Sheet`."""

import csv
import re
import warnings
from pathlib import Path
from typing import Any

from ..errors import MapError, SettingError, comes_with
from .graphs import is_graph, read_graphml, sheet_of_graph
from .sheet import Sheet, from_arrow, from_frame

_EDGES = "edges"  # the layer of OSMnx with the lines
_HEAD = 1 << 16  # bytes within which the line of names ends
SEPARATOR = re.compile(rb'(?:\xef\xbb\xbf)?"?sep=[^\r\n]+\r?\n', re.IGNORECASE)
"""The line `sep=;` by which files tell Excel what parts their cells."""


def open_sheet(table: Any) -> Sheet:
    """A table of roads, whatever it is.

    Args:
        table: GeoDataFrame, DataFrame or Arrow table with WKB or WKT, a graph of networkx, or a
            path to CSV with WKT, Parquet, GeoJSON, GraphML or anything else that geopandas reads.

    Raises:
        MapError: It cannot be read, or has no geometry.
    """
    if isinstance(table, (str, Path)):
        return _open_file(Path(table))
    if is_graph(table):
        return sheet_of_graph(table)
    if hasattr(table, "column_names"):
        return from_arrow(table, "table of edges")
    if hasattr(table, "columns") and hasattr(table, "reset_index"):
        return from_frame(table, "table of edges")
    raise MapError(
        f"table of edges: it is a {type(table).__name__}; a GeoDataFrame, an Arrow table, a graph "
        "or a path was expected; convert it"
    )


def _open_file(path: Path) -> Sheet:
    import pyarrow as pa
    from shapely.errors import ShapelyError

    if not path.is_file():
        raise MapError(f"{path}: the file does not exist; a table of roads was expected; check it")
    name = path.name.lower()
    try:
        if name.endswith((".csv", ".csv.gz", ".tsv")):
            return from_arrow(read_csv(path), str(path))
        if name.endswith((".parquet", ".geoparquet", ".pq")):
            import pyarrow.parquet

            return from_arrow(pyarrow.parquet.read_table(path), str(path))
        if name.endswith(".graphml"):
            return read_graphml(path)
        with comes_with("geo", f"{path}: this format"):
            import geopandas

        layer = _layer(path)
        with warnings.catch_warnings():
            # what could not be read has no geometry, and `lines` counts it
            warnings.simplefilter("ignore", RuntimeWarning)
            frame = geopandas.read_file(path, layer=layer)
        return from_frame(frame, str(path))
    except SettingError:
        raise
    except (pa.ArrowException, ShapelyError, OSError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise MapError(
            f"{path}: {reason}; a table of roads (CSV with WKT, GeoParquet, GeoJSON) was expected; "
            "check that it is one"
        ) from error


def _layer(path: Path) -> str | None:
    """The layer with the edges, of a file of several; None: it has one.

    Raises:
        MapError: Several hold lines, and none is called `edges`.
    """
    import geopandas

    layers = geopandas.list_layers(path)
    if len(layers) < 2:
        return None
    kinds = dict(zip(layers["name"], layers["geometry_type"].astype(str), strict=True))
    if _EDGES in kinds:
        return _EDGES
    lines = [name for name, kind in kinds.items() if "LineString" in kind or kind == "Unknown"]
    if len(lines) == 1:
        return str(lines[0])
    raise MapError(
        f"{path}: layers {', '.join(kinds)}, of which {len(lines)} may hold lines; one with the "
        f"roads, or one called {_EDGES}, was expected; give "
        "geopandas.read_file(path, layer=...) to RoadMap.from_edges"
    )


def read_csv(path: Path) -> Any:
    """A CSV file, compressed or not, as an Arrow table; words that are not UTF-8 are mended.

    Commas, semicolons, tabs or bars part its cells, as the line of names shows; before it may be
    a line `sep=;`.  Where commas do not part cells, numbers may have them for points.
    """
    import pyarrow as pa
    import pyarrow.csv

    with path.open("rb") as f:
        compressed = f.read(2) == b"\x1f\x8b"

    def opened() -> Any:
        return pa.CompressedInputStream(str(path), "gzip") if compressed else pa.OSFile(str(path))

    with opened() as source:
        head = source.read(_HEAD)
    said = SEPARATOR.match(head)
    delimiter = _delimiter(head[said.end() if said else 0 :], path.suffix == ".tsv")
    with opened() as source:
        table = pyarrow.csv.read_csv(
            source,
            read_options=pyarrow.csv.ReadOptions(
                block_size=1 << 24,  # a long road is a long line
                skip_rows=1 if said else 0,
            ),
            parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter, newlines_in_values=True),
        )
    for i, column in enumerate(table.columns):
        if pa.types.is_binary(column.type):  # one word of it is not UTF-8
            words = [c if c is None else c.decode(errors="replace") for c in column.to_pylist()]
            column = pa.chunked_array([pa.array(words)])
        if delimiter != "," and pa.types.is_string(column.type):
            column = _with_points(column)
        table = table.set_column(i, table.column_names[i], column)
    return table


def _delimiter(head: bytes, tabs: bool) -> str:
    """What parts the names into most; of equal ones a comma, or a tab in a file of tabs."""
    text = head.decode("utf-8-sig", "replace")
    line = next((line for line in text.splitlines() if line.strip()), "")
    order = ("\t", ",", ";", "|") if tabs else (",", ";", "\t", "|")
    return max(order, key=lambda one: len(next(csv.reader([line], delimiter=one), [])))


def _with_points(column: Any) -> Any:
    """A column of numbers with decimal commas as numbers; others stay."""
    import pyarrow as pa
    import pyarrow.compute as pc

    said = pc.if_else(pc.equal(pc.utf8_trim_whitespace(column), ""), None, column)
    alike = pc.match_substring_regex(said, r"^\s*[-+]?\d+(,\d+)?\s*$")
    if not pc.all(alike).as_py() or not pc.any(pc.match_substring(said, ",")).as_py():
        return column
    points = pc.replace_substring(pc.utf8_trim_whitespace(said), ",", ".")
    return points.cast(pa.float64())
