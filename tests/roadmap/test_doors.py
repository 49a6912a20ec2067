"""What is no map is refused by name, whatever it is."""

import pytest

from whichroad.errors import MapError
from whichroad.roadmap import RoadMap


@pytest.mark.parametrize("name", ["x.osm.pbf", "x.osm", "x.osm.gz", "x.osm.bz2", "x.txt", "x"])
@pytest.mark.parametrize("content", [b"", b"\0\1\2", b"id,from,to\n1,2,3\n", b"<osm><way"])
def test_a_file_that_is_no_map_is_refused_by_name(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MapError, match="x"):
        RoadMap.from_osm(path)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(MapError, match=r"nowhere\.osm"):
        RoadMap.from_osm(tmp_path / "nowhere.osm")


def test_a_map_without_streets_is_refused(osm):
    with pytest.raises(MapError, match="no drivable way"):
        osm({1: (0, 0), 2: (1, 1)}, [(10, [1, 2], {"highway": "footway"})])
    with pytest.raises(MapError, match="no street has a length"):
        osm({1: (0, 0), 2: (0, 0)}, [(10, [1, 2], {})])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("x.csv", b"id,from,to\n1,2,3\n"),
        ("x.csv", b""),
        ("x.csv", b"geometry\n\n"),
        ("x.csv", b"geometry\nPOINT (1 2)\n"),
        ("x.parquet", b"PAR1"),
        ("x.geojson", b'{"type": "FeatureCollection", "features": []}'),
        ("x.geojson", b"{"),
        ("x.gpkg", b"\0\1"),
    ],
)
def test_a_table_without_roads_is_refused_by_name(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MapError, match=r"x\."):
        RoadMap.from_edges(path)


def test_what_is_no_table_is_refused(tmp_path):
    with pytest.raises(MapError, match="int"):
        RoadMap.from_edges(5)
    with pytest.raises(MapError, match="no such file"):
        RoadMap.from_edges(tmp_path / "nowhere.csv")
