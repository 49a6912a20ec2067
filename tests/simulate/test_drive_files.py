"""What is written is what was simulated, read by other people's programs."""

import can
import cantools
import numpy as np
import pyarrow.parquet as pq
import pytest
from pynmeagps import NMEAReader

from whichroad.errors import WriteError
from whichroad.readers import read_vehicle
from whichroad.simulate import START, simulate_drive, write_demo, write_drive


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    paths, roads = write_demo(folder)
    return {path.name: path for path in paths}, roads


@pytest.fixture(scope="module")
def written(hand_made, tmp_path_factory):
    drive = simulate_drive(hand_made, seed=4, length_m=4000.0, scenario="outage")
    folder = tmp_path_factory.mktemp("drive")
    return drive, {path.name: path for path in write_drive(drive, hand_made, folder)}


@pytest.fixture(scope="module")
def sentences(written):
    # validate=1: checksums; quitonerror=2: any error is raised
    with written[1]["drive.nmea"].open("rb") as stream:
        return [m for _, m in NMEAReader(stream, validate=1, quitonerror=2)]


def of(sentences, kind):
    return [m for m in sentences if m.msgID == kind]


def test_every_second_has_a_burst_and_outages_say_so(written, sentences):
    drive, _ = written
    gga = of(sentences, "GGA")
    assert len(gga) == len(drive.fix_truth.time)
    assert [m.quality == 0 for m in gga] == list(~drive.seen_fix)
    assert {m.status for m in of(sentences, "RMC")} == {"A", "V"}
    assert len(of(sentences, "GST")) == len(of(sentences, "VTG")) == drive.seen_fix.sum()


def test_positions_in_nmea_are_the_fixes(written, sentences):
    fixes = written[0].drive.fixes
    gga = [m for m in of(sentences, "GGA") if m.quality]
    # written to a millionth of a minute: 2 mm; pynmeagps rounds to 1e-8 degrees
    assert np.abs([m.lat for m in gga] - fixes.lat_deg).max() < 1e-6 / 60
    assert np.abs([m.lon for m in gga] - fixes.lon_deg).max() < 1e-6 / 60


def test_times_in_nmea_are_utc(written, sentences):
    fixes = written[0].drive.fixes
    assert np.datetime64("2026-06-01T08:00:00").astype("datetime64[s]").astype(int) == START
    seconds = [
        m.time.hour * 3600 + m.time.minute * 60 + m.time.second for m in of(sentences, "GST")
    ]
    assert np.abs(np.array(seconds) - (fixes.time - START + 8 * 3600)).max() < 1e-6
    assert {str(m.date) for m in of(sentences, "RMC")} == {"2026-06-01"}
    assert {(m.day, m.month, m.year) for m in of(sentences, "ZDA")} == {(1, 6, 2026)}


def test_the_ellipse_and_the_sigmas_of_gst_are_one_covariance(written, sentences):
    fixes = written[0].drive.fixes
    for k, m in enumerate(of(sentences, "GST")):
        a, b, f = m.stdMajor, m.stdMinor, np.radians(m.orient)
        sin, cos = np.sin(f), np.cos(f)
        # two digits of about 3 m: half of 0.01 m, squared values to 2 * 3 * 0.01
        assert m.stdLat**2 == pytest.approx(fixes.cov_nn[k], abs=0.06)
        assert m.stdLong**2 == pytest.approx(fixes.cov_ee[k], abs=0.06)
        assert a**2 * sin**2 + b**2 * cos**2 == pytest.approx(fixes.cov_ee[k], abs=0.12)
        assert a**2 * cos**2 + b**2 * sin**2 == pytest.approx(fixes.cov_nn[k], abs=0.12)
        assert (a**2 - b**2) * sin * cos == pytest.approx(fixes.cov_en[k], abs=0.12)


def test_speed_and_course_are_written_where_there_is_one(written, sentences):
    fixes = written[0].drive.fixes
    rmc = [m for m in of(sentences, "RMC") if m.status == "A"]
    assert np.abs(np.array([m.spd for m in rmc]) * 1852 / 3600 - fixes.speed).max() < 1e-3
    for m, bearing, sigma in zip(rmc, fixes.bearing_deg, fixes.sigma_bearing_deg, strict=True):
        assert (m.cog == "") == (not np.isfinite(sigma))
        if m.cog != "":
            assert abs((m.cog - bearing + 180) % 360 - 180) < 0.006


@pytest.fixture(scope="module")
def frames(written):
    paths = written[1]
    base = cantools.database.load_file(paths["vehicle.dbc"])
    found = {}
    with can.LogReader(str(paths["can.log"])) as log:
        for message in log:
            signals = base.decode_message(message.arbitration_id, message.data)
            for name, value in signals.items():
                found.setdefault(name, []).append((message.timestamp, value))
    return found


def test_the_bus_carries_the_counts(written, frames):
    counts = written[0].drive.odometry
    for name, column in (
        ("WheelTicksRearLeft", counts.left),
        ("WheelTicksRearRight", counts.right),
    ):
        time, value = map(np.array, zip(*frames[name], strict=True))
        assert np.abs(time - counts.time).max() < 1e-5
        assert (value == column % 65536).all()
        steps = np.diff(value) % 65536
        assert steps.sum() == column[-1] - column[0]


def test_the_bus_carries_the_wheels_speeds(written, frames):
    drive = written[0]
    speed = np.array([v for _, v in frames["WheelSpeedRearLeft"]]) / 3.6
    counts = drive.drive.odometry
    rolled = 0.0404 * (counts.left[100:] - counts.left[:-100])
    summed = np.concatenate([[0.0], np.cumsum(0.05 * (speed[1:] + speed[:-1]))])
    # ten seconds: each end rounded by a count of 40 mm, and kinks between readings
    assert np.abs((summed[100:] - summed[:-100]) - rolled).max() < 0.2
    assert {str(v) for _, v in frames["Gear"]} == {"N", "D"}


def test_the_vehicle_file_is_the_vehicle(written):
    drive, paths = written
    read = read_vehicle(paths["vehicle.toml"])
    for name in (
        "track_width",
        "metres_per_tick_left",
        "metres_per_tick_right",
        "antenna_forward",
        "antenna_left",
        "driving_side",
    ):
        assert getattr(read, name) == getattr(drive.vehicle, name)
    assert read.counter_bits == 16
    base = cantools.database.load_file(paths["vehicle.dbc"])
    names = {s.name for m in base.messages for s in m.signals}
    assert {v for k, v in read.signals.items() if k != "reverse_value"} <= names


def test_the_truth_table_is_the_truth(written, hand_made):
    drive, paths = written
    table = pq.read_table(paths["truth.parquet"]).to_pandas()
    t = drive.truth
    assert len(table) == len(t)
    assert str(table.time[0]) == "2026-06-01 08:00:00+00:00"
    x, y = hand_made.plane.from_geodetic(table.lat.to_numpy(), table.lon.to_numpy())
    assert np.hypot(x - t.x, y - t.y).max() < 1e-6
    heading = hand_made.plane.heading(table.bearing_deg.to_numpy(), x, y)
    assert np.abs(np.angle(np.exp(1j * (heading - t.heading)))).max() < 1e-9
    assert (table.edge_id == t.edge).all()
    assert table.on_road.all()
    inside = (t.time >= drive.outages[0][0]) & (t.time <= drive.outages[0][1])
    assert (table.outage == inside).all()


def test_the_demo_leaves_everything_that_is_needed(demo):
    paths, roads = demo
    assert list(paths) == [
        "map.osm",
        "drive.nmea",
        "can.log",
        "vehicle.dbc",
        "vehicle.toml",
        "truth.parquet",
    ]
    edges = pq.read_table(paths["truth.parquet"])["edge_id"].to_numpy()
    assert edges.max() < len(roads)


def test_files_that_exist_are_kept_unless_forced(written, hand_made):
    drive, paths = written
    folder = paths["drive.nmea"].parent
    before = paths["drive.nmea"].read_bytes()
    with pytest.raises(WriteError, match="exists already"):
        write_drive(drive, hand_made, folder)
    write_drive(drive, hand_made, folder, force=True)
    assert paths["drive.nmea"].read_bytes() == before


def test_a_folder_that_cannot_be_made_is_said(written, hand_made, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(WriteError, match="cannot be made"):
        write_drive(written[0], hand_made, tmp_path / "file" / "folder")
