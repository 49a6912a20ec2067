from itertools import pairwise

import numpy as np
import pyarrow as pa
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from whichroad.tables import schema

degrees = st.one_of(st.none(), st.floats(-180, 180))


@given(st.lists(st.tuples(degrees, degrees), max_size=20))
def test_points_become_the_wkb_that_shapely_reads(pairs):
    lon = pa.array([pair[0] for pair in pairs], pa.float64())
    lat = pa.array([pair[1] for pair in pairs], pa.float64())
    wkb = schema.point_wkb(lon, lat)
    wkb.validate(full=True)
    for value, pair in zip(wkb.to_pylist(), pairs, strict=True):
        if None in pair:
            assert value is None
        else:
            point = shapely.from_wkb(value)
            assert (point.x, point.y) == pair


def test_a_slice_of_a_column_gives_its_own_points():
    lon, lat = pa.array([1.0, 2.0, 3.0]), pa.array([4.0, 5.0, 6.0])
    whole = schema.point_wkb(lon, lat).to_pylist()
    assert schema.point_wkb(lon.slice(1), lat.slice(1)).to_pylist() == whole[1:]


def test_lines_keep_their_vertices_in_order():
    lon, lat = np.array([8.0, 8.1, 9.0, 9.1, 9.2]), np.array([49.0, 49.1, 50.0, 50.1, 50.2])
    lines = shapely.from_wkb(schema.line_wkb(lon, lat, np.array([0, 2, 5])).to_pylist())
    assert [list(line.coords) for line in lines] == [
        [(8.0, 49.0), (8.1, 49.1)],
        [(9.0, 50.0), (9.1, 50.1), (9.2, 50.2)],
    ]


def test_no_lines_are_an_empty_column():
    none = np.array([])
    assert len(schema.line_wkb(none, none, np.array([0]))) == 0


def test_seconds_become_microseconds_without_drift():
    stamps = schema.times(np.array([0.0, 1.7e9 + 0.1]))
    assert stamps.cast(pa.int64()).to_pylist() == [0, 1_700_000_000_100_000]


def test_the_frame_of_points_is_in_wgs_84_and_absent_positions_are_none(points):
    frame = schema.geo_frame(points)
    assert frame.crs == "EPSG:4326"
    assert frame.geometry[0].coords[0] == pytest.approx((8.68, 49.41))
    assert frame.geometry[2] is None
    assert list(frame.columns)[:-1] == schema.POINTS.names


def test_a_table_without_position_has_no_geometry():
    assert schema.geometry(pa.table({"p": [1.0]})) is None


def test_thinning_keeps_the_first_row_of_each_cell_of_each_drive():
    seconds = np.array([10.0, 10.4, 10.9, 11.0, 12.5, 90.3, 91.2, 91.4])
    table = pa.table({"drive_id": ["a"] * 5 + ["b"] * 3, "time": schema.times(seconds)})
    kept = schema.thinned(table, 1.0)["time"].cast(pa.int64()).to_numpy() / 1e6
    assert kept.tolist() == [10.0, 11.0, 12.5, 90.3, 91.4]


def test_thinning_nothing_gives_nothing():
    empty = schema.POINTS.empty_table()
    assert schema.thinned(empty, 1.0).num_rows == 0


@given(st.lists(st.integers(2, 7), max_size=6), st.integers(0, 99))
def test_lines_are_the_bytes_that_shapely_writes(counts: list[int], seed: int):
    lon, lat = np.random.default_rng(seed).uniform(-90.0, 90.0, (2, sum(counts)))
    first = np.cumsum([0, *counts])
    lines = [shapely.LineString(np.column_stack([lon[a:b], lat[a:b]])) for a, b in pairwise(first)]
    assert schema.line_wkb(lon, lat, first).to_pylist() == [shapely.to_wkb(x) for x in lines]
