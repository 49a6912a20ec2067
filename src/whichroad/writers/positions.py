"""The columns of points that formats of robots and receivers take, rows with a position alone."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from ..errors import WriteError
from ..observations import Array
from ..tables.schema import TIME

_NUMBERS = ("lat", "lon", "bearing_deg", "speed_mps", "cov_ee_m2", "cov_en_m2", "cov_nn_m2",
            "sigma_bearing_deg")  # fmt: skip


class Positions(NamedTuple):
    """Points of one drive, (n,) each; NaN where a column lacks a value."""

    drive_id: str
    time: Array  # s since 1970 UTC
    lat: Array
    lon: Array
    bearing_deg: Array
    speed: Array  # m/s
    cov_ee: Array  # m²
    cov_en: Array
    cov_nn: Array
    sigma_bearing_deg: Array
    status: list[str | None]


def positions(table: pa.Table, path: Path) -> Iterator[Positions]:
    """The drives of a table of points.

    Args:
        table: As `tables.schema.POINTS`.
        path: The output, for errors.

    Raises:
        WriteError: It has no times or no positions.
    """
    if not {"time", "lat", "lon"} <= set(table.column_names):
        raise WriteError(
            f"{path}: the table has no positions with times; points, with columns time, lat and "
            "lon, were expected; write the path as .geojson or .parquet"
        )
    n = table.num_rows
    blank = pa.nulls(n, pa.string())
    names = table["drive_id"] if "drive_id" in table.column_names else blank
    status = table["status"] if "status" in table.column_names else blank
    micros = table["time"].cast(TIME).cast(pa.int64()).to_numpy().astype(np.float64)
    columns = [_floats(table, name) for name in _NUMBERS]
    there = np.isfinite(columns[0]) & np.isfinite(columns[1])
    drives = np.array([str(name or "drive") for name in names.to_pylist()], dtype=object)
    states = np.array(status.to_pylist(), dtype=object)
    for drive in dict.fromkeys(drives.tolist()):
        mine = there & (drives == drive)
        if mine.any():
            lat, lon, bearing, speed, ee, en, nn, sigma = (column[mine] for column in columns)
            time, said = 1e-6 * micros[mine], states[mine].tolist()
            yield Positions(str(drive), time, lat, lon, bearing, speed, ee, en, nn, sigma, said)


def _floats(table: pa.Table, name: str) -> Array:
    if name not in table.column_names:
        return np.full(table.num_rows, np.nan)
    column: Any = table[name].cast(pa.float64()).combine_chunks()
    values: Array = column.to_numpy(zero_copy_only=False)
    return values
