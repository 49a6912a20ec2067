"""Files as many tools write them: read as their owners mean, or refused with what to do.

Python packages write their own; the others' files are in the form that their makers document.
Each kind is written for two drives, one of them in the south-west.  Nothing may be wrong
without a word.
"""

import gzip
import io
import sys
import zipfile
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from whichroad.errors import ReadError
from whichroad.readers import drive_from_table, read_drive

from . import written_by_tools, written_shapes, written_texts  # noqa: F401  (they add kinds)
from .driving import town
from .written import READ, N, degrees, frame_of

PLACES = {"north-east": (49.4, 8.7), "south-west": (-33.45, -70.66)}
PLANES = {"north-east": 32632, "south-west": 32719}
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:movingpandas")


@pytest.fixture(params=PLACES)
def drive(request):
    """One drive: its table, its times in several forms, its plane."""
    lat, lon = PLACES[request.param]
    seed = list(PLACES).index(request.param)
    frame = town(seed, n=N, lat=lat, lon=lon).drop(columns="true_yaw")
    frame = frame.rename(columns={"true_speed": "v"}).round({"lat": 7, "lon": 7, "v": 3})
    moments = pd.to_datetime(np.round(frame.time), unit="s", utc=True)
    return SimpleNamespace(
        frame=frame, time=frame.time.to_numpy(), lat=frame.lat.to_numpy(), lon=frame.lon.to_numpy(),
        v=frame.v.to_numpy(), at=moments, iso=moments.dt.strftime("%Y-%m-%dT%H:%M:%SZ"),
        epsg=PLANES[request.param], east=request.param == "north-east",
        rows=list(frame.itertuples(index=False)),
    )  # fmt: skip


def read(thing, options):
    if hasattr(thing, "read"):
        with thing:
            return read_drive(thing, **options)
    if hasattr(thing, "suffix"):
        return read_drive(thing, **options)
    return drive_from_table(thing, **options)


@pytest.mark.parametrize("name", READ)
def test_what_a_tool_writes_is_read_as_its_owner_means_it(drive, tmp_path, name, sound):
    write, about = READ[name]
    made = write(drive, tmp_path)
    thing, options = made if isinstance(made, tuple) else (made, {})
    (got,) = read(thing, options)
    sound(got)
    n = len(got.fixes)
    assert n >= about.get("fewest", N)
    said = " ".join(got.notes)
    if about.get("ordered", True) or about.get("timed", True):
        assert got.fixes.lat_deg == pytest.approx(drive.lat[:n], abs=about.get("abs_deg", 1e-7))
        assert got.fixes.lon_deg == pytest.approx(drive.lon[:n], abs=about.get("abs_deg", 1e-7))
    if about.get("timed", True):
        start = drive.time[0] if about.get("relative") else 0.0
        tolerance = about.get("abs_time", 1e-3)
        assert got.fixes.time == pytest.approx(drive.time[:n] - start, abs=tolerance)
        assert "invented" not in said
    else:
        assert "no times in the file: they were invented" in said
    known = np.isfinite(got.fixes.sigma_speed)
    if about.get("speed"):
        assert known.all()
        assert got.fixes.speed == pytest.approx(drive.v, abs=about.get("abs_speed", 2e-3))
    else:
        assert not known.any()
    if "fewest" in about:
        assert "cut short" in said


# Files of no kind that is read, or that do not say enough

REFUSED = {
    "a spreadsheet": ("a.xlsx", lambda d: _xlsx(), "spreadsheet.*save it as CSV"),
    "UTF-16": ("a.csv", lambda d: _table(d).encode("utf-16"), "UTF-16.*save it in UTF-8"),
    "TCX": ("a.tcx", lambda d: b"<?xml version='1.0'?><TrainingCenterDatabase/>", "export GPX"),
    "a page of the web": ("a.html", lambda d: b"<!doctype html><html></html>", "export GPX"),
    "a picture": ("a.jpg", lambda d: b"\xff\xd8\xff\xe0" + bytes(100), "unknown format"),
    "an empty file": ("a.csv", lambda d: b"", "the file is empty"),
    "places and an unknown column": (
        "a.csv", lambda d: _table(d, "Zeitpunkt"), "no time.*--columns time=",
    ),
    "unknown columns": ("a.csv", lambda d: b"a,b\n1,2\n", "no known column.*--columns"),
    "dates of which the month is unknown": (
        "a.csv",
        lambda d: pd.DataFrame({"time": "03/04/2026 10:00:00", **degrees(d)}).to_csv(index=False),
        "which number is the month; ISO 8601",
    ),
    "coordinates of a plane": (
        "a.csv",
        lambda d: pd.DataFrame({"time": d.iso, "x": 5e5, "y": 5.4e6}).to_csv(index=False),
        "without a reference system.*--crs",
    ),
    "a candump": ("a.log", lambda d: b"(1780315200.000000) can0 3A0#0A001E00\n", "--dbc"),
    "a cut JSON": ("a.json", lambda d: b'[{"lat": 49.4, "lon"', "cut short.*columns time"),
    "JSON without places": ("a.json", lambda d: b'{"a": [1, 2]}', "columns time, lat, lon"),
    "a damaged gzip": ("a.csv.gz", lambda d: gzip.compress(b"time,lat,lon\n")[:20], "unpack it"),
    "GeoJSON of areas": (
        "a.geojson",
        lambda d: b'{"type":"FeatureCollection","features":[{"type":"Feature","properties":{},'
        b'"geometry":{"type":"Polygon","coordinates":[[[8,49],[9,49],[9,50],[8,49]]]}}]}',
        "without records of places",
    ),
}  # fmt: skip


def _table(d, time="time"):
    return pd.DataFrame({time: d.iso, **degrees(d)}).to_csv(index=False)


def _xlsx():
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("xl/workbook.xml", "<workbook/>")
    return packed.getvalue()


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_read_is_refused_with_what_to_do(drive, put, kind):
    name, content, said = REFUSED[kind]
    with pytest.raises(ReadError, match=f"(?s){said}") as caught:
        read_drive(put(name, content(drive)))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 900


def test_geoparquet_in_a_plane_without_its_system_is_refused_with_what_to_do(drive, tmp_path):
    frame = frame_of(drive).to_crs(drive.epsg).set_crs(None, allow_override=True)
    frame.to_parquet(tmp_path / "a.parquet")
    with pytest.raises(ReadError, match=r"without a reference system.*--crs"):
        read_drive(tmp_path / "a.parquet")
    (got,) = read_drive(tmp_path / "a.parquet", crs=drive.epsg)
    assert got.fixes.lat_deg == pytest.approx(drive.lat, abs=1e-7)


def test_many_trips_in_geoparquet_of_a_plane_are_where_they_were(drive, tmp_path):
    from whichroad.readers.many_trips import trip_batches

    frame = frame_of(drive).to_crs(drive.epsg).assign(trip_id=["a", "b"] * (N // 2))
    frame.to_parquet(tmp_path / "a.parquet")
    for batch in trip_batches(tmp_path / "a.parquet"):
        (got,) = drive_from_table(batch.table.slice(0, batch.first[1]))
        assert got.fixes.lat_deg == pytest.approx(drive.lat[::2], abs=1e-7)
        assert got.fixes.lon_deg == pytest.approx(drive.lon[::2], abs=1e-7)


def test_a_geopackage_of_several_layers_is_refused_with_what_to_do(drive, tmp_path):
    frame_of(drive).to_file(tmp_path / "a.gpkg", layer="one")
    frame_of(drive).to_file(tmp_path / "a.gpkg", layer="two")
    with pytest.raises(ReadError, match=r"one, two; .*a file of its own"):
        read_drive(tmp_path / "a.gpkg")


def test_standard_input_is_read(drive, monkeypatch):
    data = io.TextIOWrapper(io.BytesIO(_table(drive).encode()))
    monkeypatch.setattr(sys, "stdin", data)
    (got,) = read_drive("-")
    assert got.fixes.lat_deg == pytest.approx(drive.lat)


@pytest.mark.parametrize("by", ["folder", "pattern"])
def test_folders_and_patterns_are_all_their_files(drive, tmp_path, by):
    for k, rows in enumerate((slice(0, 40), slice(40, N))):
        part = pd.DataFrame({"time": drive.iso, **degrees(drive)})[rows]
        part.to_csv(tmp_path / f"{k}.csv", index=False)
    (tmp_path / "notes.md").write_text("my drives\n")
    (got,) = read_drive(tmp_path if by == "folder" else tmp_path / "*.csv")
    assert got.fixes.lat_deg == pytest.approx(drive.lat)
    assert any("0, 1: joined" in note for note in got.notes)
    assert any("not read: notes.md" in note for note in got.notes) == (by == "folder")
    with pytest.raises(ReadError, match="no file matches"):
        read_drive(tmp_path / "*.gpx")


def test_there_are_sixty_kinds_of_files():
    assert len(READ) + len(REFUSED) >= 60
