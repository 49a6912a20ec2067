"""Own names of columns, tables without names, and missing files: what is seen, and what to do."""

import numpy as np
import pytest

import whichroad
from whichroad.errors import ReadError, SettingError
from whichroad.readers import read_drive

ROWS = "".join(f"2026-06-01T08:00:{k:02d}Z,{49.41 + 1e-4 * k:.4f},8.7\n" for k in range(9))


@pytest.mark.parametrize("head", ["ts,Latitude,Longitude", "a,b,c"])
def test_a_source_column_that_is_not_there_is_named(put, head):
    ts, lat, lon = head.split(",")
    file = put("own.csv", f"{head}\n{ROWS}")
    whole = {"time": ts, "lat": lat, "lon": lon}
    (drive,) = read_drive(file, columns=whole)
    assert len(drive.fixes) == 9
    for name in whole:
        wrong = whole | {name: f"{whole[name]}x"}
        said = rf"own.csv: no column '{whole[name]}x' for {name} .*did you mean {whole[name]}"
        with pytest.raises(ReadError, match=said):
            read_drive(file, columns=wrong)
    with pytest.raises(ReadError, match=r"'tmie' is not the name of a quantity; .*mean time "):
        read_drive(file, columns={"tmie": ts} | whole)


@pytest.mark.parametrize(
    ("head", "meant"),
    [
        ("GPS Timestamp,Pos. Lat,Pos. Lon", 'time="GPS Timestamp",lat="Pos. Lat",lon="Pos. Lon"'),
        ("Zeit,Breite,Länge", "time=Zeit,lat=Breite,lon=Länge"),
        ("Datum,Breite,Laenge", "time=Datum,lat=Breite,lon=Laenge"),
        ("time,Lattitude,Longitute", "lat=Lattitude,lon=Longitute"),
    ],
)
def test_columns_that_are_likely_meant_are_offered_as_the_option_takes_them(put, head, meant):
    file = put("own.csv", f"{head}\n{ROWS}")
    with pytest.raises(ReadError) as refused:
        read_drive(file)
    assert f"did you mean `whichroad match --columns {meant}` (columns=)?" in str(refused.value)
    own = dict(pair.split("=") for pair in meant.replace('"', "").split(","))
    assert len(read_drive(file, columns=own)[0].fixes) == 9


@pytest.mark.parametrize(
    "head", ["when,lat,lon", "Start Time,End Time,lat,lon", "time,lat_error,long_name,x"]
)
def test_columns_that_may_mean_something_else_are_not_offered(put, head):
    row = "2026-06-01T08:00:00Z" + ",1" * head.count(",")
    with pytest.raises(ReadError, match="rename the columns") as refused:
        read_drive(put("own.csv", f"{head}\n{row}\n"))
    assert "did you mean" not in str(refused.value)


def test_a_table_without_names_is_recognised_and_read_by_numbers(put):
    file = put("bare.csv", ROWS)
    said = r"bare.csv: the first line holds values \(2026-.*--columns time=1,lat=2,lon=3"
    with pytest.raises(ReadError, match=said):
        read_drive(file)
    (drive,) = read_drive(file, columns={"time": 1, "lat": 2, "lon": 3})
    assert np.allclose(drive.fixes.lat_deg, 49.41 + 1e-4 * np.arange(9))


def test_a_missing_file_names_those_of_similar_names(put, tmp_path):
    put("drive.nmea", "$GPZDA")
    with pytest.raises(ReadError, match=r"No such file.*did you mean .*drive.nmea\?"):
        read_drive(tmp_path / "drive.nmae")
    with pytest.raises(ReadError, match=r"No such file.*check the name; in .* are drive.nmea$"):
        read_drive(tmp_path / "xyz.csv")
    with pytest.raises(ReadError, match=r"there is no folder .*nowhere$"):
        read_drive(tmp_path / "nowhere" / "drive.nmea")


def test_a_can_log_goes_with_paths_only(put, tmp_path):
    (tmp_path / "street.csv").write_text('geometry\n"LINESTRING (8.7 49.40, 8.7 49.42)"\n')
    drives = read_drive(put("a.csv", "time,lat,lon\n" + ROWS))
    with pytest.raises(SettingError, match=r"can, dbc: given beside a list; paths of"):
        whichroad.match(drives, tmp_path / "street.csv", can="car.log")


def test_numbers_of_numpy_are_written_as_numbers(put):
    file = put("a.csv", "time,lat,lon\n" + ROWS)
    for raised, seen in (
        (lambda: whichroad.Settings(gnss_time=np.float64(-1.5)), "gnss_time is -1.5 s"),
        (lambda: whichroad.lookback.smoothing.Lag.of(np.float64(-9.0)), "lag is -9.0;"),
        (lambda: read_drive(file, columns={"time": np.int64(9)}), "no column 9 for time"),
    ):
        with pytest.raises(whichroad.WhichroadError) as error:
            raised()
        assert seen in str(error.value)
        assert "np." not in str(error.value)
    assert str(ReadError(f"{np.float32(8)!r}, {np.str_('x')!r}")) == "8.0, 'x'"


@pytest.mark.parametrize("beside", [0, 3, 9])
def test_speeds_mostly_in_rows_of_their_own_are_an_odometer_else_the_receivers(put, beside: int):
    """As where OBD was joined to fixes by time, and some times were the same."""
    rows = [
        f"2026-06-01T08:00:{k:02d}.0Z,{49.41 + 1e-4 * k:.4f},8.7,{'10' if k < beside else ''}\n"
        for k in range(9)
    ]
    rows += [f"2026-06-01T08:00:{k:02d}.5Z,,,10\n" for k in range(8)]
    (drive,) = read_drive(put("obd.csv", "time,lat,lon,speed_mps\n" + "".join(sorted(rows))))
    assert len(drive.fixes) == 9
    if beside == 9:
        assert drive.odometry is None
        assert drive.skipped == {"no position": 8}
        assert np.allclose(drive.fixes.speed, 10.0)
    else:
        assert drive.odometry.distance[-1] == pytest.approx(
            10.0 * (drive.odometry.time[-1] - drive.odometry.time[0])
        )
        assert np.isinf(drive.fixes.sigma_speed).all()  # reports none
        assert not drive.skipped
        assert any("rows without a position" in note for note in drive.notes)
