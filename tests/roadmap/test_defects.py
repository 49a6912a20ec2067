"""Defects that were drawn are found where they are, and a sound map has none."""

import geopandas
import pyarrow as pa
import pyarrow.parquet
import pytest
import shapely
from typer.testing import CliRunner

from whichroad.cli import app
from whichroad.errors import MapError
from whichroad.roadmap import RoadMap
from whichroad.roadmap.defects import defects

NODES = {1: (0, 0), 2: (200, 0), 3: (200, 200), 4: (0, 200)}
RING = [(10, [1, 2], {}), (20, [2, 3], {}), (30, [3, 4], {}), (40, [4, 1], {})]
ONE_WAY = {"oneway": "yes"}


def kinds(roads):
    return [(row["kind"], int(row["source_id"])) for row in defects(roads).to_pylist()]


def test_a_sound_map_has_none(osm):
    assert kinds(osm(NODES, RING)) == []


@pytest.mark.parametrize(
    ("nodes", "ways", "found"),
    [
        ({5: (100, 0.6), 6: (100, 90)}, [(50, [5, 6], {})], [("dangling", 50), ("island", 50)]),
        ({5: (100, 1.6), 6: (100, 90)}, [(50, [5, 6], {})], [("island", 50)]),
        ({5: (100, 0.6), 6: (100, 90)}, [(50, [5, 6], {"layer": "1"})], [("island", 50)]),
        ({5: (-0.3, 0)}, [(50, [1, 5], {})], [("short", 50)]),
        ({5: (400, 0)}, [(50, [2, 5], ONE_WAY)], [("no exit", 50)]),
        ({5: (400, 0)}, [(50, [5, 2], ONE_WAY)], [("no entry", 50)]),
        ({5: (500, 0), 6: (500, 90)}, [(50, [5, 6], {})], [("island", 50)]),
        ({5: (-60, 0.2), 6: (260, 0.2)}, [(50, [5, 6], {})], [("overlap", 50), ("island", 50)]),
    ],
)
def test_a_defect_is_found_where_it_was_drawn(osm, nodes, ways, found):
    assert sorted(kinds(osm(NODES | nodes, RING + ways))) == sorted(found)


def test_a_defect_has_its_place(osm, degrees):
    roads = osm(NODES | {5: (500, 0), 6: (500, 90)}, [*RING, (50, [5, 6], {})])
    [row] = defects(roads).to_pylist()
    lon, lat = degrees(500, 45)
    assert (row["lon"], row["lat"]) == pytest.approx((lon, lat), abs=1e-6)
    assert row["detail"] == "90 m of roads"


def test_places_that_no_map_has_are_named():
    far = shapely.LineString([(0.0, 0.0), (0.0, 0.01)]), shapely.LineString([(11, 5), (11, 5.01)])
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(geometry=list(far), crs="EPSG:4326"))
    said = [row["detail"] for row in defects(roads).to_pylist() if row["kind"] == "place"]
    assert said == ["the map is 5.0 by 11.0 degrees", "some of it lies at 0, 0"]


def test_drives_that_broke_a_rule_stumbled_over_the_defect_there(osm):
    roads = osm(NODES | {5: (400, 0)}, [*RING, (50, [2, 5], ONE_WAY)])
    [row] = defects(roads).to_pylist()
    back = int(roads.arrays.edges.opposite[row["edge_id"]])
    path = pa.table({"edge_id": [back, row["edge_id"], back, 0],
                     "broken_rule": ["against_one_way", None, "gap", "u_turn"]})  # fmt: skip
    assert defects(roads, path)["stumbled"].to_pylist() == [2]
    with pytest.raises(MapError, match="broken_rule"):
        defects(roads, path.select(["edge_id"]))
    with pytest.raises(MapError, match="beyond"):
        defects(roads, path.set_column(0, "edge_id", pa.array([10_000] * 4)))


def test_the_command_prints_counts_and_writes_the_table(osm, tmp_path):
    roads = osm(NODES | {5: (400, 0)}, [*RING, (50, [2, 5], ONE_WAY)])
    roads.save(tmp_path / "a.map")
    path = pa.table({"edge_id": [0], "broken_rule": ["gap"]})
    pyarrow.parquet.write_table(path, tmp_path / "path.parquet")
    out = tmp_path / "defects.geojson"
    done = CliRunner().invoke(app, ["map", "check", str(tmp_path / "a.map"), "-o", str(out),
                                    "--path", str(tmp_path / "path.parquet")])  # fmt: skip
    assert done.exit_code == 0
    assert "1 it can be entered, but not left" in " ".join(done.output.split())
    assert geopandas.read_file(out)["kind"].tolist() == ["no exit"]
