"""Files of other programs: what is read of them, and what is said of those that are not."""

import numpy as np
import pandas as pd
import pytest

from whichroad.errors import ReadError
from whichroad.readers import drive_from_table, read_drive

T0 = 1_780_315_200.0  # 2026-06-01 12:00 UTC


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("x.json", b'[{"time": 0, "name": "here"}]', "JSON .*columns time, lat, lon"),
        ("x.geojson", b'{"type": "FeatureCollection", "features": [], "x": 1}', "JSON"),
        ("x.kml", b"<kml><coordinates>8.65,49.48</coordinates></kml>", "no GPX; .*export GPX"),
        ("x.csv.gz", b"\x1f\x8b\x08rubbish", "unpack it"),
        ("x.xlsx", b"PK\x03\x04rubbish", "save it as CSV"),
        ("x.csv", "time,lat,lon\n0,49.4,8.7\n".encode("utf-16"), "save it in UTF-8"),
        ("x.bin", b"\x00\x01\x02", "unknown format"),
    ],
)
def test_what_is_not_read_is_told_what_it_is_and_what_to_do(put, name, content, said):
    with pytest.raises(ReadError, match=said):
        read_drive(put(name, content))


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_commas_are_decimal_where_they_do_not_part_columns(put, delimiter):
    rows = [["recorded_at", "lat", "lon", "speed_kmh"]]
    rows += [[f"{T0 + i:.0f}", f"49,4{i}", "8,7", "36,5" if i else ""] for i in range(3)]
    text = "".join(delimiter.join(row) + "\n" for row in rows)
    fixes = read_drive(put("x.csv", text.encode()))[0].fixes
    assert fixes.lat_deg.tolist() == [49.40, 49.41, 49.42]
    assert fixes.lon_deg.tolist() == [8.7] * 3
    assert fixes.speed[1:] == pytest.approx(36.5 / 3.6)


def test_commas_are_decimal_in_a_frame_too():
    frame = pd.DataFrame({"time": T0 + np.arange(3), "lat": ["49,41", "49,42", None]})
    frame["lon"], frame["hdop"] = ["8,7", "8,701", ""], "0,9"
    (drive,) = drive_from_table(frame)
    assert drive.fixes.lat_deg.tolist() == [49.41, 49.42]
    assert drive.fixes.lon_deg.tolist() == [8.7, 8.701]
    assert drive.fixes.cov_ee == pytest.approx((0.9 * 4.0) ** 2)


def test_commas_of_thousands_are_not_decimal():
    frame = pd.DataFrame({"time": T0 + np.arange(3), "lat": 49.4, "lon": 8.7})
    (drive,) = drive_from_table(frame.assign(odometer_m=["12,345", "12,355", "12,365"]))
    assert drive.odometry is None
    assert drive.skipped["unparsable number in odometer_m"] == 3


@pytest.mark.parametrize(
    ("lat", "lon", "what"),
    [
        ("49.4957N", "8.6577E", "write them so"),
        (4929.742, 839.461, "write them so"),
        (494957064, 86576808, "1e-7 degrees, give them by --columns lat_e7="),
        (49495706, 8657680, "1e-6 degrees, give them by --columns lat_e6="),
        (5482661.25, 475152.5, "metres in a plane, .*--crs"),
        (5482661, 475152, "metres in a plane, .*--crs"),
    ],
)
def test_places_that_are_no_degrees_are_shown(lat, lon, what):
    frame = pd.DataFrame({"time": T0 + np.arange(3), "lat": lat, "lon": lon})
    with pytest.raises(ReadError, match=f"for example '{lat}' and '{lon}'; .*{what}"):
        drive_from_table(frame)
    if not isinstance(lat, str):
        with pytest.raises(ReadError, match=what):
            drive_from_table(frame.assign(speed_mps=9.0))


def test_places_in_millionths_of_degrees_are_read_by_their_name():
    frame = pd.DataFrame({"time": T0 + np.arange(3), "lat_e6": 49495706, "lon_e6": 8657680})
    (drive,) = drive_from_table(frame)
    assert drive.fixes.lat_deg == pytest.approx([49.495706] * 3)
    assert drive.fixes.lon_deg == pytest.approx([8.65768] * 3)


def test_points_and_commas_in_one_column_are_not_guessed_at(put):
    text = f"time;lat;lon\n{T0};49.4;8.7\n{T0 + 1};49,4;8.7\n{T0 + 2};1.049,4;8.7\n"
    (drive,) = read_drive(put("x.csv", text.encode()))
    assert len(drive.fixes) == 1
    assert drive.skipped["unparsable number in lat"] == 2
