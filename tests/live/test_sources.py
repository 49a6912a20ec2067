"""Sources that cannot be opened say why, once; they are tried again, and end without a word."""

import asyncio
import contextlib
import gc
import itertools
import os
import signal
import socket
import subprocess
import time

import pytest

from live.service import Served, free_port, knock, on_air
from whichroad import Localizer, ReadError, SettingError, Vehicle
from whichroad.live import sources
from whichroad.live.addresses import can_address, nmea_address
from whichroad.live.decode import NmeaStream
from whichroad.live.health import Health
from whichroad.live.server import Plan, Run
from whichroad.live.sources import NmeaInput, read_tcp
from whichroad.live.vehicle_run import Fitted
from whichroad.readers import read_drive
from whichroad.simulate.drive_files import nmea_text


@pytest.mark.parametrize("text", ["tcp://127.0.0.1", "udp://", "listen://:70000", "tcp://[::1]"])
def test_an_address_without_a_port_is_told_to_lack_one(text):
    with pytest.raises(SettingError, match=r"without a port from 0 to 65535; .*add the port"):
        nmea_address(text)


def test_a_reason_is_told_once_until_it_changes_or_the_input_has_spoken():
    said = []
    health = Health("port", "gnss", said.append)
    for reason in ("No such device", "No such device", "Permission denied", "Permission denied"):
        health.lose(reason)
        assert health.message(0.0)["reason"] == reason
    health.open()
    assert health.message(0.0)["reason"] is None
    health.lose("Permission denied")
    assert len(said) == 2
    health.heard(1, 0.0)
    health.lose("Permission denied")
    assert len(said) == 3


def test_a_server_that_refuses_is_tried_again_and_named_once():
    said, writers, port = [], [], free_port()
    health = Health(f"tcp 127.0.0.1:{port}", "gnss", said.append)

    async def run():
        address = nmea_address(f"tcp://127.0.0.1:{port}")
        into = NmeaInput(health, NmeaStream(), lambda *_: None)
        task = asyncio.create_task(read_tcp(address, health, lambda: into))
        while health.link != "lost":
            await asyncio.sleep(0.01)
        server = await asyncio.start_server(lambda _, w: writers.append(w), "127.0.0.1", port)
        while health.link != "open":
            await asyncio.sleep(0.01)
        while not writers:
            await asyncio.sleep(0.01)
        task.cancel()
        writers[0].close()
        server.close()

    asyncio.run(asyncio.wait_for(run(), 60.0))
    assert said == [
        f"tcp 127.0.0.1:{port}: Connection refused; it is opened again as soon as that is possible"
    ]


@pytest.mark.slow
def test_devices_that_are_not_there_are_named_on_stderr_and_by_health(files, tmp_path):
    drive, port = files / "drive", free_port()
    sources = ("--nmea", "/dev/ttyNOPE", "--nmea", f"tcp://127.0.0.1:{port}", "--can", "nope0")
    more = ("--dbc", drive / "vehicle.dbc", "--vehicle", drive / "vehicle.toml")
    with Served("--map", files / "town.map", *sources, *more) as served:
        told = served.until(lambda said: all(s["reason"] for s in said["sensors"]), "/health")
        time.sleep(1.0)  # tries that say nothing
        _, said = served.stop()
    reasons = {one["name"]: one["reason"] for one in told["sensors"]}
    assert reasons["serial ttyNOPE"] == "No such file or directory"
    assert reasons[f"tcp 127.0.0.1:{port}"] == "Connection refused"
    assert reasons["socketcan nope0"] in ("No such device", os.strerror(97))
    for name, reason in reasons.items():
        assert said.count(f"{name}: {reason}; it is opened again") == 1


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_service_ends_in_order_while_receivers_are_connected(files, ride, tmp_path, end):
    port = free_port()
    options = ("--nmea", f"listen://127.0.0.1:{port}", "--state", tmp_path / "state")
    with Served("--map", files / "town.map", *options) as served:
        bursts = on_air(nmea_text(ride).encode(), int(time.time()) - 60)
        callers = [knock(port) for _ in range(3)]
        for caller in callers:
            caller.sendall(next(bursts))
        served.until(lambda said: said["fix"] is not None)
        begun = time.time()
        served.process.send_signal(end)
        _, said = served.process.communicate(timeout=120)
        for caller in callers:
            caller.close()
    assert served.process.returncode == 0
    assert said.splitlines() == ["there is no earlier state", "Ctrl-C stops the service"]
    assert (tmp_path / "state").stat().st_mtime > begun - 0.05


@pytest.mark.slow
def test_what_is_piped_in_is_heard_until_it_ends(files, ride):
    with Served("--map", files / "town.map", "--nmea", "-", stdin=subprocess.PIPE) as served:
        for burst in itertools.islice(on_air(nmea_text(ride).encode(), int(time.time()) - 60), 12):
            os.write(served.process.stdin.fileno(), burst)
            time.sleep(0.05)
        told = served.until(lambda said: said["sensors"][0]["count"] >= 11)
        assert told["sensors"][0]["name"] == "standard input"
        served.process.stdin.close()
        served.process.stdin = None
        ended = served.until(lambda said: said["sensors"][0]["state"] == "ended")
        assert ended["sensors"][0]["count"] == 12
        code, _ = served.stop()
    assert code == 0


@pytest.mark.slow
def test_a_service_of_once_ends_with_standard_input(files, ride, tmp_path):
    options = ("--map", files / "town.map", "--nmea", "-", "--once", "--record", tmp_path / "told")
    with Served(*options, stdin=subprocess.PIPE) as served:
        for burst in itertools.islice(on_air(nmea_text(ride).encode(), int(time.time()) - 60), 12):
            os.write(served.process.stdin.fileno(), burst)
            time.sleep(0.05)
        served.process.stdin.close()
        served.process.stdin = None
        _, said = served.process.communicate(timeout=60)
    assert served.process.returncode == 0
    assert said.splitlines() == ["Ctrl-C stops the service"]
    [drive] = read_drive([tmp_path / "told"])
    assert drive.fixes is not None
    assert len(drive.fixes) == 12


@pytest.mark.slow
def test_what_was_skipped_of_standard_input_is_told_at_its_end(files, ride):
    text = b"".join(itertools.islice(on_air(nmea_text(ride).encode(), int(time.time()) - 60), 12))
    garbled = text.replace(b"*", b"9*", 1) + b"rubbish\n" * 20
    options = ("--map", files / "town.map", "--nmea", "-", "--once")
    with Served(*options, stdin=subprocess.PIPE) as served:
        os.write(served.process.stdin.fileno(), garbled)
        served.process.stdin.close()
        served.process.stdin = None
        _, said = served.process.communicate(timeout=60)
    assert said.splitlines() == [
        "Ctrl-C stops the service",
        "skipped: wrong checksum: 1, stretch of bytes outside NMEA sentences: 1",
    ]


@pytest.mark.slow
def test_a_played_log_without_a_date_or_with_garbled_lines_is_told_so(files, ride, tmp_path):
    lines = nmea_text(ride).splitlines(keepends=True)
    played = [line for line in lines if line[3:6] not in ("RMC", "ZDA")][:60]
    garbled = next(k for k, line in enumerate(played) if line[3:6] == "GST" and k > 20)
    played[garbled] = played[garbled].replace("*", "9*")
    log = tmp_path / "log.nmea"
    log.write_text("".join(played))
    options = ("--map", files / "town.map", "--nmea", log, "--speed", "max", "--once")
    with Served(*options) as served:
        _, said = served.process.communicate(timeout=60)
    assert served.process.returncode == 0
    assert said.splitlines() == [
        "note: no date in the log (no RMC, no ZDA): days are counted from 1970-01-01",
        "Ctrl-C stops the service",
        "skipped: wrong checksum: 1",
    ]


@pytest.mark.slow
def test_a_port_that_another_has_is_named(files):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with Served("--map", files / "town.map", "--nmea", f"listen://127.0.0.1:{port}") as served:
            _, said = served.process.communicate(timeout=120)
            assert served.process.returncode == 1
    assert f"listen://127.0.0.1:{port} cannot be opened (Address already in use)" in said


@pytest.mark.parametrize("broken", ["port", "dbc"])
@pytest.mark.filterwarnings("error")
def test_what_cannot_be_begun_leaves_nothing_half_begun(town, tmp_path, broken):
    """Python warns of coroutines that were never awaited, behind the refusal."""
    dbc = tmp_path / "car.dbc"
    dbc.write_text('VERSION ""\nBU_: X\nBO_ 1 A: 8 X\n SG_ V : 0|8@1+ (1,0) [0|0] "km/h" X\n')
    car, bad = Vehicle(signals={"speed": "V"}), tmp_path / "bad.dbc"
    bad.write_text("BO_ x")
    can = [(can_address("virtual:none"), dbc if broken == "port" else bad)]
    with socket.create_server(("127.0.0.1", 0)) as other:
        nmea = [nmea_address(f"udp://127.0.0.1:{free_port()}")]
        fitted = Fitted(Localizer(town, vehicle=car), nmea=nmea, can=can)
        run = Run(Plan([fitted], port=other.getsockname()[1]))
        with pytest.raises((SettingError, ReadError), match=r"in use|not a CAN database"):
            asyncio.run(run.run())
    gc.collect()


def test_a_connection_that_died_unheard_is_dropped_and_its_sender_gets_in(files, ride, monkeypatch):
    """A cut cable ends no connection: nothing comes any more, and the sender connects again."""
    monkeypatch.setattr(sources, "_DEAD", 1.0)
    monkeypatch.setattr("whichroad.live.senders._HELD", 0.5)
    bursts = list(on_air(nmea_text(ride).encode(), 1_700_000_000))
    port, taken = free_port(), []
    health = Health("port", "gnss", lambda _: None)

    def make():
        return NmeaInput(health, NmeaStream(), lambda _, fixes, __: taken.extend(fixes))

    async def send(bursts, writer):
        for burst in bursts:
            writer.write(burst)
            await asyncio.sleep(0.1)

    async def run():
        task = asyncio.create_task(
            sources.listen_tcp(nmea_address(f"listen://127.0.0.1:{port}"), health, make)
        )
        await asyncio.sleep(0.1)
        dead = []
        for _ in range(3):  # each is cut, and comes again
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            before = len(taken)
            began = time.perf_counter()
            while len(taken) < before + 3:
                await send(bursts[:1], writer)
                del bursts[0]
                assert time.perf_counter() - began < 5.0
            dead.append((reader, writer))
        for reader, writer in dead:
            with contextlib.suppress(ConnectionResetError):
                assert await asyncio.wait_for(reader.read(), 5.0) == b""
            writer.close()
        running = [one for one in asyncio.all_tasks() if "serve" in repr(one.get_coro())]
        assert not running
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    asyncio.run(run())
