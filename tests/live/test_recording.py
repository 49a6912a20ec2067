"""A recording is whole at every moment, goes on after a crash, and reads like any drive."""

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from whichroad import (
    Distance,
    Localizer,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    WriteError,
    match,
    read_drive,
)
from whichroad.evaluate.input_tables import read_table
from whichroad.live.checkpoint import Checkpoint
from whichroad.live.playback import RecordedObservations
from whichroad.live.recording import Appended, Recorder
from whichroad.live.vehicle_run import Fitted, VehicleRun
from whichroad.tables.schema import read_arrow


def record(folder, town, ride, observations, every=50):
    localizer = Localizer(town, vehicle=ride.vehicle)
    recorder = Recorder(folder, town, {})
    for number, one in enumerate(observations):
        recorder.observe(one)
        localizer.take(one)
        recorder.record_estimate(localizer)
        if number % every == 0:
            recorder.flush()
    recorder.close()
    return localizer


def test_a_recording_reads_as_the_drive_that_was(town, ride, observations, tmp_path):
    record(tmp_path / "rec", town, ride, observations[:800])
    (drive,) = read_drive(tmp_path / "rec", vehicle=ride.vehicle)
    assert drive.drive_id == "rec"
    end = observations[799].time
    for name in ("time", "lat_deg", "lon_deg", "cov_ee", "cov_en", "cov_nn"):
        theirs = getattr(ride.drive.fixes, name)[ride.drive.fixes.time <= end]
        assert getattr(drive.fixes, name) == pytest.approx(theirs, rel=1e-9)
    theirs = ride.drive.odometry
    assert drive.odometry.left == pytest.approx(theirs.left[theirs.time <= end])
    points = match(tmp_path / "rec", town, vehicle=ride.vehicle).to_arrow()
    assert points.num_rows == len(drive.odometry.time)


def test_the_points_of_a_recording_are_what_was_said(town, ride, observations, tmp_path):
    localizer = record(tmp_path / "rec", town, ride, observations[:500])
    table = read_table(tmp_path / "rec")
    assert table.num_rows == 500
    last, said = table.slice(499).to_pylist()[0], localizer.estimate()
    assert (last["lat"], last["lon"]) == pytest.approx((said.pose.lat, said.pose.lon))
    assert (last["edge_id"], last["status"]) == (said.edge, said.status)


@pytest.mark.parametrize("seed", range(10))
def test_a_torn_end_is_passed_over_and_cut_off(town, ride, observations, tmp_path, seed):
    folder = tmp_path / "rec"
    record(folder, town, ride, observations[:300])
    whole = {file: len(read_arrow(file.read_bytes())[0]) for file in folder.glob("*.arrow")}
    rng = np.random.default_rng(seed)
    for file in whole:
        data = file.read_bytes()
        file.write_bytes(data[: int(rng.integers(len(data) // 2, len(data)))])
    before = {file: read_arrow(file.read_bytes())[0].num_rows for file in whole}
    assert all(before[file] <= whole[file] for file in whole)
    (drive,) = read_drive(folder, vehicle=ride.vehicle)
    assert len(drive.fixes) == before[folder / "fixes.arrow"]
    record(folder, town, ride, observations[300:400])
    after = {file: read_arrow(file.read_bytes()) for file in whole}
    assert all(ended for _, ended in after.values())
    assert len(after[folder / "points.arrow"][0]) == before[folder / "points.arrow"] + 100


def test_a_file_torn_in_its_very_beginning_starts_anew(tmp_path):
    schema = pa.schema([("a", pa.float64())])
    data = schema.serialize().to_pybytes()
    for size in (0, 1, 8, len(data) - 1, len(data)):
        path = tmp_path / f"{size}.arrow"
        path.write_bytes(data[:size])
        stream = Appended(path, schema)
        stream.append(pa.table({"a": [1.0, 2.0]}))
        stream.close()
        assert read_arrow(path.read_bytes())[0]["a"].to_pylist() == [1.0, 2.0]


def test_another_table_is_not_appended_to(tmp_path):
    path = tmp_path / "a.arrow"
    Appended(path, pa.schema([("b", pa.int64())])).close()
    with pytest.raises(WriteError, match="another table"):
        Appended(path, pa.schema([("a", pa.float64())]))


def test_a_folder_that_is_no_recording_is_refused(tmp_path):
    with pytest.raises(whichroad.ReadError, match="a folder without"):
        read_drive(tmp_path)


def test_a_recording_without_wheels_reads_as_its_fixes(town, ride, observations, tmp_path):
    fixes = [one for one in observations[:800] if isinstance(one, whichroad.GeoFix)]
    record(tmp_path / "rec", town, ride, fixes)
    (drive,) = read_drive(tmp_path / "rec", vehicle=ride.vehicle)
    assert len(drive.fixes) == len(fixes)
    assert drive.odometry is None


@pytest.mark.parametrize("kind", [whichroad.SpeedYaw, whichroad.Distance])
def test_a_car_without_wheel_sensors_is_recorded_too(town, ride, tmp_path, kind):
    values = (10.0, 0.1) if kind is whichroad.SpeedYaw else (5.0,)
    record(tmp_path / "rec", town, ride, [kind(1.7e9 + 0.1 * k, *values) for k in range(20)])
    (drive,) = read_drive(tmp_path / "rec", vehicle=ride.vehicle)
    assert len(drive.odometry.time) == 20


@pytest.mark.parametrize("kind", [WheelTicks, WheelSpeed, SpeedYaw, Distance])
def test_a_recording_keeps_that_signs_are_those_of_a_gear(town, ride, tmp_path, kind):
    """Also where the gear is heard in mid-drive, and the recording goes on after a restart."""
    folder = tmp_path / "rec"
    few = 1 if kind is Distance else 2

    def reading(k, geared):
        return kind(1.7e9 + 0.1 * k, *[-0.05 * k] * few, geared)

    record(folder, town, ride, [reading(k, False) for k in range(20)])
    (drive,) = read_drive(folder, vehicle=ride.vehicle)
    assert not drive.geared
    record(folder, town, ride, [reading(k, k > 30) for k in range(20, 60)])
    for _ in range(2):
        (drive,) = read_drive(folder, vehicle=ride.vehicle)
        assert drive.geared
        played = RecordedObservations(drive)
        assert all(played[k].geared for k in range(len(played)))
        record(folder, town, ride, [reading(60, False)])  # a later start that hears no gear
    (folder / "recording.json").write_text("{")
    assert not read_drive(folder, vehicle=ride.vehicle)[0].geared


def test_an_odometer_and_a_gyro_are_recorded_each_at_its_own_times(town, ride, tmp_path):
    readings = [whichroad.YawRate(1.7e9 + 0.02 * k, 0.1) for k in range(51)]
    readings += [whichroad.Distance(1.7e9 + 0.1 * k, 0.5 * k) for k in range(11)]
    record(tmp_path / "rec", town, ride, sorted(readings, key=lambda one: one.time))
    (drive,) = read_drive(tmp_path / "rec", vehicle=ride.vehicle)
    assert drive.odometry.distance.distance == pytest.approx(0.5 * np.arange(11))
    assert drive.odometry.gyro.rate == pytest.approx(np.full(51, 0.1))


def test_a_recording_of_nothing_says_so(town, tmp_path):
    Recorder(tmp_path / "rec", town, {}).close()
    with pytest.raises(whichroad.ReadError, match="nothing was recorded"):
        read_drive(tmp_path / "rec")


def test_a_recording_holds_the_turns_of_a_gyro(town, tmp_path):
    gyro = [whichroad.YawRate(1.6e9 + 0.1 * k, 0.1) for k in range(20)]
    wheel = [whichroad.Distance(1.6e9 + 0.1 * k + 0.05, 2.0 * k) for k in range(20)]
    recorder = Recorder(tmp_path / "rec", town, {})
    for one in sorted(gyro + wheel, key=lambda o: o.time):
        recorder.observe(one)
    recorder.close()
    (drive,) = read_drive(tmp_path / "rec")
    assert drive.odometry.gyro.rate == pytest.approx(np.full(20, 0.1))
    assert drive.odometry.distance.distance == pytest.approx(2.0 * np.arange(20))


class Drives:
    """A service that is started again and again with the same options."""

    def __init__(self, town, folder):
        self.town, self.folder, self.said = town, folder, []

    def drive(self, observations):
        """Start, drive and end; returns the names of what is there."""
        fitted = Fitted(
            Localizer(self.town), record=self.folder / "rec", state=self.folder / "state"
        )
        run = VehicleRun(fitted, window=1.0, rate=10.0, report=self.said.append)
        run.resume()
        run.filter_loop.observe(observations)
        run.keep()
        return sorted(one.name for one in self.folder.iterdir() if one.is_dir())


def test_another_drive_gets_a_folder_of_its_own_and_a_resumed_one_goes_on(
    town, observations, tmp_path
):
    drives = Drives(town, tmp_path)
    assert drives.drive(observations[:200]) == ["rec"]
    assert drives.drive(observations[200:300]) == ["rec"]
    (tmp_path / "state").unlink()
    assert drives.drive(observations[:100]) == ["rec", "rec.2"]
    assert drives.said[-1] == f"{tmp_path / 'rec'}: holds an earlier drive; recording in " + str(
        tmp_path / "rec.2"
    )
    assert drives.drive(observations[100:150]) == ["rec", "rec.2"]
    (tmp_path / "state").unlink()
    assert drives.drive(observations[:10]) == ["rec", "rec.2", "rec.3"]
    rows = []
    for name in ("rec", "rec.2"):
        (drive,) = read_drive(tmp_path / name)
        rows.append(len(drive.fixes) + len(drive.odometry.time))
    assert rows == [300, 150]


def test_a_state_is_not_put_into_a_folder_that_is_not_there(town, tmp_path):
    with pytest.raises(WriteError, match=r"nowhere' does not exist; .*create it first"):
        Checkpoint(tmp_path / "nowhere" / "state", Localizer(town))
    assert list(tmp_path.iterdir()) == []
