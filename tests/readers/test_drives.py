"""The front door: formats told apart, files of one drive put on one clock; GPX and RTKLIB."""

import gpxpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import ReadError
from whichroad.observations import Odometer, WheelCounts, WheelSpeeds
from whichroad.readers import read_drive
from whichroad.readers.formats import format_of
from whichroad.settings import Vehicle

T0 = 1_780_315_200.0  # 2026-06-01 12:00 UTC
POS = """% program   : rtkpost
% ref pos   : none
%  {clock}                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)\
   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio
"""
TAIL = "100.0   5   8   2.0   3.0   5.0  -1.5  0.0  0.0  0.00  0.0"


def fixes(n=5, t0=T0):
    """A table of fixes, a second apart."""
    return "time,lat,lon\n" + "".join(f"{t0 + k},49.4,8.7{k}\n" for k in range(n))


def wheels(n=50, t0=T0):
    """A table of wheel speeds, ten a second."""
    rows = "".join(f"{t0 + 0.1 * k},10,10\n" for k in range(n))
    return "time,wheel_rl_mps,wheel_rr_mps\n" + rows


def gpx(
    points="", head='<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">'
):
    """A file with one track."""
    return f"<?xml version='1.0'?>{head}<trk><name>a</name><trkseg>{points}</trkseg></trk></gpx>"


def point(k, inner=""):
    """A point of a track, k seconds after noon."""
    return f'<trkpt lat="49.4" lon="8.7{k}"><time>2026-06-01T12:00:0{k}Z</time>{inner}</trkpt>'


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a", "time,lat,lon\n1,2,3\n", "table"),
        ("a.txt", "time;lat;lon\n", "table"),
        ("a.log", "# comment\n$GNGGA,,,,,,*00\n", "nmea"),
        ("a.log", "(1690000000.1) can0 123#00\n", "can"),
        ("a.log", " (1690000000.1)  can0  123   [1]  00\n", "can"),
        ("a.csv", "timestamp,arbitration_id,extended,remote,error,dlc,data\n", "can"),
        ("a.xml", "<?xml version='1.0'?><gpx version='1.1'>", "gpx"),
        ("a.out", "% program\n%  GPST   latitude(deg)\n", "pos"),
        ("a.dat", "PAR1....", "table"),
        ("A.NMEA", "whatever", "nmea"),
        ("a.blf", "whatever", "can"),
    ],
)
def test_a_format_is_known_by_suffix_or_by_content(put, name, content, kind):
    assert format_of(put(name, content)) == kind


@pytest.mark.parametrize("content", [b"\x7fELF\x01\x02\x03", b"hello world", b"{}", b"\x89PNG\r\n"])
def test_an_unknown_format_says_what_was_expected(put, content):
    with pytest.raises(ReadError, match=r"a\.bin: .*NMEA 0183, a drive table"):
        read_drive(put("a.bin", content))


def test_what_cannot_be_opened_is_refused(tmp_path):
    for path in (tmp_path / "nowhere.csv", tmp_path, "a\0b"):
        with pytest.raises(ReadError, match="cannot be read"):
            read_drive(path)
    with pytest.raises(ReadError, match="no file was given"):
        read_drive([])


def test_files_of_one_drive_are_one_drive(put, sound):
    (drive,) = read_drive([put("gnss.csv", fixes()), put("wheels.csv", wheels())])
    sound(drive)
    assert drive.drive_id == "gnss"
    assert len(drive.sources) == 2
    assert len(drive.fixes) == 5
    assert isinstance(drive.odometry, WheelSpeeds)


def test_parts_of_a_log_are_joined_in_order_of_time(put, sound):
    late, early = put("b.csv", fixes(5, T0 + 4)), put("a.csv", fixes(5))
    (drive,) = read_drive([late, early])
    sound(drive)
    assert drive.fixes.time == pytest.approx(T0 + np.arange(9))
    assert drive.skipped == {"repeated time": 1}


def test_the_better_odometry_is_used_and_the_other_noted(put):
    counts = "time,wheel_rl_ticks,wheel_rr_ticks\n" + "".join(
        f"{T0 + 0.1 * k},{20 * k},{20 * k}\n" for k in range(50)
    )
    (drive,) = read_drive([put("speeds.csv", wheels()), put("counts.csv", counts)])
    assert isinstance(drive.odometry, WheelCounts)
    assert any("WheelSpeeds left out" in note for note in drive.notes)


@pytest.mark.parametrize("name", ["odometry", "wheels.csv"])
def test_clock_offsets_are_added_by_role_or_by_file(put, name):
    car = Vehicle(clock_offset={name: -7200.0})
    files = [put("gnss.csv", fixes()), put("wheels.csv", wheels(t0=T0 + 7200))]
    (drive,) = read_drive(files, vehicle=car)
    assert drive.odometry.time[0] == pytest.approx(T0)
    assert drive.fixes.time[0] == pytest.approx(T0)


def test_files_that_share_no_time_are_refused(put):
    files = [put("gnss.csv", fixes()), put("wheels.csv", wheels(t0=T0 + 7200))]
    with pytest.raises(ReadError, match=r"do not overlap in time.*\[clock\]"):
        read_drive(files)


def test_drives_of_two_files_meet_by_their_ids(put):
    def table(head, row):
        return head + "".join(f"{T0 + k},{row},{'ab'[k % 2]}\n" for k in range(10))

    files = [
        put("gnss.csv", table("time,lat,lon,drive_id\n", "49.4,8.7")),
        put("odo.csv", table("time,odometer_m,drive_id\n", "5")),
    ]
    drives = read_drive(files)
    assert [drive.drive_id for drive in drives] == ["a", "b"]
    assert all(isinstance(drive.odometry, Odometer) for drive in drives)
    other = put("other.csv", table("time,odometer_m,drive_id\n", "5").replace(",a\n", ",c\n"))
    assert len(read_drive([files[0], other])) == 3
    strange = put("s.csv", "time,odometer_m,drive_id\n1,2,x\n2,3,y\n")
    with pytest.raises(ReadError, match="share no drive_id"):
        read_drive([files[0], strange])


def test_gpx_is_read_as_gpxpy_reads_it(put, sound):
    content = gpx("".join(point(k, f"<hdop>{k + 1}</hdop>") for k in range(6)))
    (drive,) = read_drive(put("a.gpx", content))
    sound(drive)
    points = gpxpy.parse(content).tracks[0].segments[0].points
    assert drive.fixes.lat_deg.tolist() == [p.latitude for p in points]
    assert drive.fixes.lon_deg.tolist() == [p.longitude for p in points]
    assert drive.fixes.time.tolist() == [p.time.timestamp() for p in points]
    assert np.diff(np.sqrt(drive.fixes.cov_ee)) == pytest.approx(4.0)


def test_gpx_points_without_place_or_time_are_counted(put, sound):
    bad = '<trkpt lat="x" lon="8"><time>2026-06-01T12:00:09Z</time></trkpt><trkpt lat="1" lon="2"/>'
    (drive,) = read_drive(put("a.gpx", gpx(point(0) + bad + point(2))))
    sound(drive)
    assert len(drive.fixes) == 2
    assert drive.skipped == {"unparsable point": 1, "no time": 1}


def test_each_track_of_a_gpx_is_a_drive(put):
    content = gpx(point(0) + point(1))
    track = content[content.index("<trk>") : content.index("</gpx>")]
    drives = read_drive(put("a.gpx", content.replace(track, track + track)))
    assert [drive.drive_id for drive in drives] == ["a/a", "a/a-2"]


@pytest.mark.parametrize(
    "content", [gpx(), gpx(point(0))[:-30], "<gpx>", "<kml></kml>", "", "\0", "time,lat\n"]
)
def test_what_is_no_gpx_is_refused_by_name(put, content):
    with pytest.raises(ReadError, match=r"a\.gpx"):
        read_drive(put("a.gpx", content))


@pytest.mark.parametrize(
    ("clock", "begin", "shift"),
    [
        ("UTC", "2026/06/01 12:00:0{k}.000", 0),
        ("GPST", "2026/06/01 12:00:0{k}.000", -18),
        ("JST", "2026/06/01 21:00:0{k}.000", 0),
        ("GPST", "2421 13000{k}.000", 0),
    ],
)
def test_rtklib_solutions_have_a_covariance_and_become_utc(put, sound, clock, begin, shift):
    lines = (f"{begin.format(k=k)}   49.4000000{k}    8.700000000   {TAIL}\n" for k in range(4))
    (drive,) = read_drive(put("a.pos", POS.format(clock=clock) + "".join(lines)))
    sound(drive)
    if begin.startswith("2026"):
        assert drive.fixes.time == pytest.approx(T0 + shift + np.arange(4))
    else:
        gps = np.datetime64("1980-01-06") + np.timedelta64(2421 * 7 * 86_400 + 130_000 - 18, "s")
        assert drive.fixes.time[0] == gps.astype("datetime64[s]").astype(int)
    # sdne is a signed square root
    row = np.column_stack([drive.fixes.cov_ee, drive.fixes.cov_en, drive.fixes.cov_nn])
    assert row.tolist() == [[9.0, -2.25, 4.0]] * 4


def test_cut_lines_of_a_solution_are_counted(put, sound):
    line = f"2026/06/01 12:00:00.000   49.4    8.7   {TAIL}\n"
    content = POS.format(clock="UTC") + line + "2026/06/01 12:00\n" + line.replace("49.4", "x")
    (drive,) = read_drive(put("a.pos", content))
    sound(drive)
    assert len(drive.fixes) == 1
    assert drive.skipped == {"line cut short": 1, "unparsable number": 1}


@pytest.mark.parametrize("content", [POS.format(clock="UTC"), "% hello\n1 2 3\n", "\0", "1 2 3\n"])
def test_what_is_no_solution_is_refused_by_name(put, content):
    with pytest.raises(ReadError, match=r"a\.pos"):
        read_drive(put("a.pos", content))


@pytest.mark.data
def test_real_solutions_and_bus_trips_are_read(data_folder, sound):
    for path in sorted((data_folder / "nagoya").glob("**/*.pos"))[:2]:
        (drive,) = read_drive(path)
        sound(drive)
        assert len(drive.fixes) > 100


@given(st.binary(max_size=300), st.sampled_from(["", ".csv", ".nmea", ".gpx", ".pos", ".parquet"]))
def test_any_bytes_under_any_name_give_records_or_a_read_error(tmp_path_factory, content, suffix):
    from .conftest import check_records

    path = tmp_path_factory.mktemp("any") / f"x{suffix}"
    path.write_bytes(content)
    try:
        drives = read_drive(path)
    except ReadError:
        return
    for drive in drives:
        check_records(drive)
