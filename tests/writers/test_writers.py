import csv
import errno
import json
import sqlite3
from datetime import UTC, datetime
from types import SimpleNamespace

import geopandas
import gpxpy
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely

from whichroad import RoadMap
from whichroad.errors import WriteError
from whichroad.tables import schema
from whichroad.writers import SUFFIXES, check, replacing, write_table


def test_geoparquet_comes_back_through_geopandas(points, path, tmp_path):
    for name, table in (("points", points), ("path", path)):
        out = tmp_path / f"{name}.parquet"
        write_table(table, out)
        frame = geopandas.read_parquet(out)
        assert frame.crs == "EPSG:4326"
        expected = shapely.from_wkb(schema.geometry(table).to_pylist())
        assert [a == b for a, b in zip(frame.geometry, expected, strict=True)] == [True] * len(
            frame
        )


def test_geoparquet_keeps_every_column_and_type(points, path, tmp_path):
    write_table(points, tmp_path / "points.parquet")
    back = pq.read_table(tmp_path / "points.parquet")
    assert back.drop(["geometry"]).cast(schema.POINTS).equals(points)
    write_table(path, tmp_path / "path.parquet")
    assert pq.read_table(tmp_path / "path.parquet").cast(schema.PATH).equals(path)


def test_geoparquet_says_its_version_its_kind_and_its_box(points, tmp_path):
    write_table(points, tmp_path / "points.parquet")
    geo = json.loads(pq.read_schema(tmp_path / "points.parquet").metadata[b"geo"])
    column = geo["columns"][geo["primary_column"]]
    assert geo["version"] == "1.1.0"
    assert column["geometry_types"] == ["Point"]
    assert column["bbox"] == [8.68, 49.41, 8.69, 49.42]


def test_geoparquet_of_many_row_groups_is_whole(points, tmp_path, monkeypatch):
    monkeypatch.setattr("whichroad.writers.parquet.ROWS_AT_A_TIME", 2)
    write_table(points, tmp_path / "points.parquet")
    assert len(geopandas.read_parquet(tmp_path / "points.parquet")) == 3


def test_a_table_without_position_becomes_plain_parquet(tmp_path):
    table = pa.table({"p": [0.5]})
    write_table(table, tmp_path / "t.parquet")
    assert pq.read_table(tmp_path / "t.parquet").equals(table)


@pytest.mark.parametrize("suffix", [".arrow", ".feather"])
def test_arrow_comes_back_as_it_was(points, tmp_path, suffix):
    out = tmp_path / f"points{suffix}"
    write_table(points, out)
    assert pa.ipc.open_file(pa.OSFile(str(out))).read_all().equals(points)


@pytest.mark.parametrize("suffix", [".geojson", ".json"])
def test_geojson_has_lon_before_lat_and_null_for_absence(points, tmp_path, suffix):
    out = tmp_path / f"points{suffix}"
    write_table(points, out)
    features = json.loads(out.read_text("utf-8"))["features"]
    assert features[0]["geometry"] == {"type": "Point", "coordinates": [8.68, 49.41]}
    assert features[0]["properties"]["time"] == "1970-01-01T00:00:00.000000Z"
    assert features[0]["properties"]["alternatives"][1] == {"edge_id": 9, "p": 0.15}
    assert features[2]["geometry"] is None
    assert features[2]["properties"]["edge_id"] is None


def test_geojson_of_a_path_has_its_lines(path, tmp_path):
    write_table(path, tmp_path / "path.geojson")
    features = json.loads((tmp_path / "path.geojson").read_text("utf-8"))["features"]
    assert features[0]["geometry"]["coordinates"] == [[8.0, 49.0], [8.1, 49.1]]
    assert "geometry" not in features[0]["properties"]


def test_geojson_is_read_by_geopandas(path, tmp_path):
    write_table(path, tmp_path / "path.geojson")
    assert len(geopandas.read_file(tmp_path / "path.geojson")) == 2


def test_geojson_refuses_what_json_cannot_say(points, tmp_path):
    broken = points.set_column(4, "bearing_deg", pa.array([1.0, float("inf"), None]))
    with pytest.raises(WriteError, match="infinite"):
        write_table(broken, tmp_path / "points.geojson")
    assert list(tmp_path.iterdir()) == []


def test_a_geopackage_has_a_layer_of_points_or_of_the_path(points, path, tmp_path):
    for name, table, kind in (("points", points, "Point"), ("path", path, "LineString")):
        write_table(table, tmp_path / f"{name}.gpkg")
        assert geopandas.list_layers(tmp_path / f"{name}.gpkg").values.tolist() == [[name, kind]]
        read = geopandas.read_file(tmp_path / f"{name}.gpkg")
        assert read.crs.to_epsg() == 4326
        assert len(read) == table.num_rows
        assert set(table.column_names) <= set(read.columns)
    read = geopandas.read_file(
        tmp_path / "points.gpkg", columns=["alternatives", "time", "edge_id"]
    )
    assert read.geometry[0] == shapely.Point(8.68, 49.41)
    assert read.geometry[2] is None
    assert json.loads(read.alternatives[0]) == points["alternatives"][0].as_py()
    assert read.time[1].isoformat() == "1970-01-01T00:00:00.100000+00:00"
    with pytest.raises(WriteError, match="no positions"):
        write_table(pa.table({"p": [0.5]}), tmp_path / "t.gpkg")


def test_a_shapefile_is_refused_for_a_geopackage(tmp_path):
    with pytest.raises(WriteError, match=r"'\.shp' names no format.*write \.gpkg"):
        check(tmp_path / "points.shp")


def test_csv_has_iso_times_lists_as_json_and_empty_for_absence(points, tmp_path):
    write_table(points, tmp_path / "points.csv")
    with open(tmp_path / "points.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == schema.POINTS.names
    assert rows[1]["time"] == "1970-01-01T00:00:00.100000Z"
    assert json.loads(rows[0]["alternatives"]) == points["alternatives"].to_pylist()[0]
    assert json.loads(rows[1]["alternatives"]) == []
    assert rows[2]["alternatives"] == rows[2]["lat"] == ""
    assert float(rows[0]["lat"]) == 49.41


def test_csv_of_a_path_has_its_lines_as_wkt(path, tmp_path):
    write_table(path, tmp_path / "path.csv")
    with open(tmp_path / "path.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["geometry"] == "LINESTRING (8 49, 8.1 49.1)"
    assert rows[1]["broken_rule"] == "against one-way"


def test_csv_in_pieces_has_one_header(points, tmp_path, monkeypatch):
    write_table(points, tmp_path / "whole.csv")
    monkeypatch.setattr("whichroad.writers.csv.ROWS_AT_A_TIME", 1)
    write_table(points, tmp_path / "pieces.csv")
    assert (tmp_path / "whole.csv").read_bytes() == (tmp_path / "pieces.csv").read_bytes()


def test_csv_takes_any_other_list_too(tmp_path):
    write_table(pa.table({"words": [["a", 'b"'], None]}), tmp_path / "t.csv")
    with open(tmp_path / "t.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert json.loads(rows[0]["words"]) == ["a", 'b"']


def test_gpx_is_a_track_with_time_that_gpxpy_reads(points, tmp_path):
    write_table(points, tmp_path / "points.gpx")
    tracks = gpxpy.parse((tmp_path / "points.gpx").read_text("utf-8")).tracks
    assert [track.name for track in tracks] == ["a <b> & c"]
    first, second = tracks[0].segments[0].points
    assert (first.latitude, first.longitude) == (49.41, 8.68)
    assert second.time.astimezone(UTC) == datetime(1970, 1, 1, 0, 0, 0, 100_000, UTC)
    assert {e.tag.rpartition("}")[2]: e.text for e in first.extensions}["p_road"] == "0.8"


def test_gpx_of_a_path_is_a_segment_for_each_run_of_edges_with_times_at_their_ends(path, tmp_path):
    gap = path.slice(0, 1)  # begins elsewhere than where the others end
    write_table(pa.concat_tables([path, gap]), tmp_path / "path.gpx")
    (track,) = gpxpy.parse((tmp_path / "path.gpx").read_text("utf-8")).tracks
    assert [len(segment.points) for segment in track.segments] == [4, 2]
    seconds = [p.time and p.time.timestamp() for p in track.segments[0].points]
    assert seconds == [0.0, 1.5, None, 3.0]


def test_gpx_without_position_is_refused(tmp_path):
    with pytest.raises(WriteError, match="no position"):
        write_table(pa.table({"p": [0.5]}), tmp_path / "t.gpx")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_empty_table_is_a_readable_file(suffix, tmp_path):
    write_table(schema.POINTS.empty_table(), tmp_path / f"t{suffix}")
    write_table(schema.PATH.empty_table(), tmp_path / f"p{suffix}")
    assert all(file.stat().st_size > 0 for file in tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_existing_output_stays_unless_forced(points, suffix, tmp_path):
    out = tmp_path / f"points{suffix}"
    out.write_text("mine")
    with pytest.raises(WriteError, match="exists already"):
        write_table(points, out)
    assert out.read_text() == "mine"
    write_table(points, out, force=True)
    assert out.stat().st_size > 4


@pytest.mark.parametrize("name", ["points.shp", "points"])
def test_an_unknown_suffix_is_refused_with_those_known(points, name, tmp_path):
    with pytest.raises(WriteError, match=r"\.parquet, \.geojson, .*\.feather"):
        write_table(points, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_refused_by_name(points, tmp_path):
    with pytest.raises(WriteError, match="nowhere"):
        write_table(points, tmp_path / "nowhere" / "points.csv")
    with pytest.raises(WriteError, match="nowhere"):
        check(tmp_path / "nowhere" / "points.csv")


def test_what_breaks_halfway_leaves_nothing_and_the_old_file_as_it_was(tmp_path):
    out = tmp_path / "points.csv"
    out.write_text("old")

    def break_halfway() -> None:
        with replacing(out, force=True) as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        break_halfway()
    assert [file.name for file in tmp_path.iterdir()] == ["points.csv"]
    assert out.read_text() == "old"


def test_the_check_ahead_says_what_writing_would_say(tmp_path):
    (tmp_path / "t.csv").write_text("mine")
    check(tmp_path / "new.csv")
    check(tmp_path / "t.csv", force=True)
    with pytest.raises(WriteError, match="--force"):
        check(tmp_path / "t.csv")
    with pytest.raises(WriteError, match="suffix"):
        check(tmp_path / "t.xlsx")


def _full(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, "No space left on device")


def _sqlite_full(*_args, **_kwargs):
    raise sqlite3.OperationalError("database or disk is full")


def _gdal_full(*_args, **_kwargs):
    raise RuntimeError("cannot rollback - no transaction is active")


def test_a_full_disk_is_called_one(points, tmp_path, monkeypatch):
    said = r"x\..*: the disk is full; space .* expected; make space, or choose another disk$"
    monkeypatch.setattr("whichroad.writers.robots._write_messages", _sqlite_full)
    monkeypatch.setattr("pyogrio.write_arrow", _gdal_full)
    with pytest.raises(WriteError, match=r"GDAL cannot write it \(cannot rollback"):
        write_table(points, tmp_path / "x.gpkg")
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=4096))
    for suffix in (".gpkg", ".db3"):
        with pytest.raises(WriteError, match=said):
            write_table(points, tmp_path / f"x{suffix}")
    monkeypatch.setattr("os.replace", _full)
    with pytest.raises(WriteError, match=said):
        write_table(points, tmp_path / "x.csv")
    assert not list(tmp_path.iterdir())


def test_a_full_disk_of_a_compiled_map_is_called_one(tmp_path, monkeypatch):
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(
        geometry=[shapely.LineString([(8.7, 49.4), (8.71, 49.4)])], crs=4326
    ))  # fmt: skip
    monkeypatch.setattr("os.replace", _full)
    with pytest.raises(WriteError, match=r"x\.map: the disk is full; .*; make space"):
        roads.save(tmp_path / "x.map")
    assert not list(tmp_path.iterdir())
