"""A small town as a file, and a fleet whose trips are known."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from whichroad.geodesy.plane import Plane

PLANE = Plane(49.4, 8.7)
BLOCK = 200.0  # m
SIDE = 6  # streets each way


def grid_map() -> whichroad.RoadMap:
    """Streets along and across."""
    import geopandas
    import shapely

    k = np.arange(SIDE) * BLOCK
    ends = [((a, b), (a + BLOCK, b)) for a in k[:-1] for b in k]
    ends += [((b, a), (b, a + BLOCK)) for a in k[:-1] for b in k]
    lines = []
    for line in ends:
        lat, lon = PLANE.to_geodetic(*np.array(line).T)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
    return whichroad.RoadMap.from_edges(
        geopandas.GeoDataFrame({"id": np.arange(len(lines))}, geometry=lines, crs="EPSG:4326")
    )


def trip(name: str | None, row: int, start: float = 1.6e9, seed: int = 0) -> pa.Table:
    """A drive along one of the streets, with a fix each second."""
    rng = np.random.default_rng(seed)
    x = np.arange(10.0, 950.0, 12.0)
    noise = rng.normal(0, 2, (2, len(x)))
    lat, lon = PLANE.to_geodetic(x + noise[0], (row % SIDE) * BLOCK + noise[1])
    names = pa.array([name] * len(x), pa.string())
    return pa.table({"trip_id": names, "time": start + np.arange(len(x)), "lat": lat, "lon": lon})


@pytest.fixture(scope="session")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled map."""
    path = tmp_path_factory.mktemp("town") / "town.map"
    grid_map().save(path)
    return path


@pytest.fixture(scope="session")
def table() -> pa.Table:
    """Forty trips, one behind the other, by name."""
    return pa.concat_tables([trip(f"car {i:02}", i, 1.6e9 + 50 * i, i) for i in range(40)])


@pytest.fixture(scope="session")
def shuffled(table: pa.Table) -> pa.Table:
    """The same rows in any order."""
    return table.take(np.random.default_rng(1).permutation(table.num_rows))
