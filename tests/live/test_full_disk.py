"""A disk that takes no more costs what would be kept on it, never the estimates."""

import os
import resource

import pyarrow as pa
import pytest

from live.service import Served, drive_files
from whichroad import Localizer, read_drive
from whichroad.live import recording
from whichroad.live.recording import Appended, Recorder
from whichroad.live.vehicle_run import Fitted, VehicleRun
from whichroad.tables.schema import read_arrow


@pytest.fixture
def disk(monkeypatch):
    """A disk with room for so many bytes more, in the recordings of this process."""
    room, write = {"bytes": 10**9}, os.write

    def limited(file, data):
        if not room["bytes"]:
            raise OSError(28, "No space left on device")
        done = write(file, bytes(data[: room["bytes"]]))
        room["bytes"] -= done
        return done

    monkeypatch.setattr(recording.os, "write", limited)
    return room


def test_a_batch_that_does_not_fit_is_left_out_whole_and_the_stream_goes_on(tmp_path, disk):
    stream = Appended(tmp_path / "a.arrow", pa.schema([("a", pa.float64())]))
    stream.append(pa.table({"a": [1.0]}))
    disk["bytes"] = 50
    with pytest.raises(OSError, match="No space left"):
        stream.append(pa.table({"a": [2.0]}))
    disk["bytes"] = 10**9
    stream.append(pa.table({"a": [3.0]}))
    stream.close()
    table, whole = read_arrow((tmp_path / "a.arrow").read_bytes())
    assert whole
    assert table["a"].to_pylist() == [1.0, 3.0]


def test_rows_that_are_not_recorded_are_counted(town, observations, tmp_path, disk):
    recorder = Recorder(tmp_path / "rec", town, {})
    for one in observations[:100]:
        recorder.observe(one)
    disk["bytes"] = 0
    with pytest.raises(OSError, match="No space left"):
        recorder.flush()
    assert recorder.lost == 100
    disk["bytes"] = 10**9
    for one in observations[100:300]:
        recorder.observe(one)
    recorder.close()
    (drive,) = read_drive(tmp_path / "rec")
    assert len(drive.fixes) + len(drive.odometry.time) == 200


def test_a_state_that_cannot_be_stored_is_told_once_and_stored_when_it_can(town, tmp_path):
    said, path = [], tmp_path / "state"
    fitted = Fitted(Localizer(town), state=path)
    run = VehicleRun(fitted, window=1.0, rate=10.0, report=said.append)
    part = tmp_path / "state.part"
    part.symlink_to("/dev/full")
    for _ in range(3):
        for job in run.jobs():
            job()
    assert [str(path) in line and "No space left" in line for line in said] == [True]
    health = run.filter_loop.health()
    assert (health["status"], len(health["problems"])) == ("degraded", 1)
    assert health["problems"][0] == "--state state: No space left on device"
    part.unlink()
    run.keep()
    assert len(said) == 2
    assert run.filter_loop.health()["problems"] == []
    assert path.stat().st_size > 0


@pytest.mark.slow
def test_a_service_whose_files_cannot_grow_goes_on_and_says_so(files, tmp_path):
    options = ("--map", files / "town.map", *drive_files(files / "drive"), "--speed", 2)
    with Served(*options, "--record", tmp_path / "rec", "--state", tmp_path / "state") as served:
        served.until(lambda said: said["answered"])
        pid = served.process.pid
        _, most = resource.prlimit(pid, resource.RLIMIT_FSIZE, (3000, resource.RLIM_INFINITY))
        told = served.until(lambda said: len(said["problems"]) == 2, "/health")
        assert told["status"] == "degraded"
        seq = served.get("/estimate")["seq"]
        served.until(lambda said: said["seq"] > seq + 10)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, most))
        served.until(lambda said: not said["problems"], "/health")
        last = served.get("/estimate")["epoch_s"]
        code, said = served.stop()
    assert code in (0, 130)
    assert "Traceback" not in said
    assert said.count("cannot be written (File too large)") == 2
    assert f"{tmp_path / 'rec'}: the recording goes on" in said
    (drive,) = read_drive(tmp_path / "rec")
    assert drive.odometry.time[-1] > last - 0.5
