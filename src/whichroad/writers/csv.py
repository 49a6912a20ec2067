"""CSV with a header: ISO times, lines as WKT (lon before lat), lists as JSON, absence empty."""

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from ..tables.schema import with_iso_times

ROWS_AT_A_TIME = 1 << 17


def write(table: pa.Table, path: Path) -> None:
    """Write the table, column by column and not row by row."""
    with open(path, "wb") as sink:
        for start in range(0, max(table.num_rows, 1), ROWS_AT_A_TIME):
            options = pa.csv.WriteOptions(include_header=start == 0)
            part = _as_text(table.slice(start, ROWS_AT_A_TIME))
            pa.csv.write_csv(part, sink, write_options=options)


def _as_text(table: pa.Table) -> pa.Table:
    table = with_iso_times(table)
    for index, column in enumerate(table.schema):
        values = table.column(index)
        if column.name == "geometry":
            table = table.set_column(index, column.name, _wkt(values))
        elif pa.types.is_nested(column.type):
            table = table.set_column(index, column.name, as_json(values))
    return table


def _wkt(values: pa.ChunkedArray) -> pa.Array:
    import shapely

    shapes = shapely.from_wkb(values.to_numpy())
    return pa.array(shapely.to_wkt(shapes, rounding_precision=9), pa.string())


def as_json(values: pa.ChunkedArray) -> pa.Array:
    """Each value as JSON text; lists of records of numbers take no Python per row."""
    array = values.combine_chunks()
    if not _is_list_of_numbers(array.type):
        texts = (None if value is None else json.dumps(value) for value in array.to_pylist())
        return pa.array(texts, pa.string())
    records = array.flatten()
    parts: list[pa.Array | str] = []
    for index, field in enumerate(array.type.value_type):
        parts.append(f'{", " if index else "{"}"{field.name}": ')
        parts.append(pc.fill_null(records.field(index).cast(pa.string()), "null"))
    objects = pc.binary_join_element_wise(*parts, "}", "")
    joined = pc.binary_join(_lists_like(array, objects), ", ")
    return pc.binary_join_element_wise("[", joined, "]", "")


def _is_list_of_numbers(kind: pa.DataType) -> bool:
    if not (pa.types.is_list(kind) and pa.types.is_struct(kind.value_type)):
        return False
    return all(
        pa.types.is_integer(field.type) or pa.types.is_floating(field.type)
        for field in kind.value_type
    )


def _lists_like(array: pa.ListArray, objects: pa.Array) -> pa.Array:
    """Lists of texts of the same lengths, null where `array` is."""
    lengths = pc.fill_null(pc.list_value_length(array), 0)
    ends = pc.cumulative_sum(lengths).cast(pa.int32())
    offsets = pa.concat_arrays([pa.array([0], pa.int32()), ends])
    return pa.ListArray.from_arrays(offsets, objects, mask=pc.is_null(array))
