"""A virtual CAN bus: wheels and fixes into one filter, in the order of their times."""

import asyncio
import json
import socket
import threading
import time
from collections import Counter

import can
import pytest
from websockets.sync.client import connect

from live.service import free_port, on_air
from readers.truck import DBC
from whichroad import GeoFix, Localizer, Vehicle, read_vehicle
from whichroad.live.addresses import can_address, nmea_address
from whichroad.live.can_bus import BusWatch
from whichroad.live.decode import CanStream
from whichroad.live.health import Health
from whichroad.live.server import Plan, Run
from whichroad.live.vehicle_run import Fitted
from whichroad.readers.can_frames import EXTENDED, read_frames
from whichroad.simulate.drive_files import nmea_text


@pytest.fixture
def running():
    """Runs a service in a thread of this process; stops it in the end."""
    runs = []

    def begin(plan):
        ready = threading.Event()
        port = []

        def said(bound):
            port.append(bound)
            ready.set()

        plan.ready, plan.port = said, 0
        run = Run(plan)
        loop = asyncio.new_event_loop()
        thread = threading.Thread(target=lambda: loop.run_until_complete(run.run()))
        thread.start()
        runs.append((run, loop, thread))
        run.loop = loop
        assert ready.wait(20)
        return run, port[0]

    yield begin
    for run, loop, thread in runs:
        loop.call_soon_threadsafe(run.stop)
        thread.join(20)
        loop.close()


def frames_of(files, begin, until):
    """Frames of the recorded drive, the first at `begin`."""
    drive = files / "drive"
    stream = CanStream(drive / "vehicle.dbc", read_vehicle(drive / "vehicle.toml"))
    found = read_frames(drive / "can.log", stream.frames, Counter())
    rows = [
        (float(t), k, bytes(d[:n]))
        for k, f in found.items()
        for t, d, n in zip(f.time, f.data, f.length, strict=True)
    ]
    rows.sort()
    return [(t - rows[0][0] + begin, k, d) for t, k, d in rows if t - rows[0][0] < until]


def test_wheels_of_a_bus_and_fixes_of_a_socket_meet(files, town, ride, running):
    drive = files / "drive"
    channel, udp = "whichroad-test", free_port()
    fitted = Fitted(
        Localizer(town, vehicle=read_vehicle(drive / "vehicle.toml")),
        nmea=[nmea_address(f"udp://127.0.0.1:{udp}")],
        can=[(can_address(f"virtual:{channel}"), drive / "vehicle.dbc")],
    )
    run, _ = running(Plan([fitted]))
    begin = int(time.time()) - 40
    bursts = list(on_air(nmea_text(ride).encode(), begin))[:12]
    frames = frames_of(files, float(begin), 12.0)
    time.sleep(0.3)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as bus:
        for number, burst in enumerate(bursts):  # the fix comes after the wheels of its second
            for stamp, key, data in frames:
                if number <= stamp - begin < number + 1:
                    bus.send(
                        can.Message(timestamp=stamp, arbitration_id=key, data=data,
                                    is_extended_id=False)
                    )  # fmt: skip
            time.sleep(0.06)
            sender.sendto(burst, ("127.0.0.1", udp))
            time.sleep(0.06)
        sender.close()
        time.sleep(0.2)
    said = json.loads(run.filter_loop.published)
    kinds = {sensor["kind"]: sensor for sensor in said["sensors"]}
    assert kinds["gnss"]["count"] == 12
    assert kinds["wheels"]["count"] > 100
    assert said["answered"]
    assert run.filter_loop.buffer.rewinds >= 8
    assert run.filter_loop.buffer.skipped["late"] == 0
    assert run.filter_loop.localizer.skipped == {}


CAR = Vehicle(signals={"speed": "WheelSpeed", "yaw_rate": "YawRate", "reverse": "Gear"})


def speed(kmh):
    return b"\xff" + (256 * kmh).to_bytes(2, "little") + b"\xff" * 5


@pytest.fixture
def dbc(tmp_path):
    path = tmp_path / "truck.dbc"
    path.write_text(DBC)
    return path


def test_messages_of_a_bus_are_read_whoever_sends_them(town, dbc, running):
    """The .dbc has FE for senders; a filter of exact ids lets no frame in."""
    channel, said = "whichroad-j1939", []
    fitted = Fitted(Localizer(town, vehicle=CAR), can=[(can_address(f"virtual:{channel}"), dbc)])
    run, _ = running(Plan([fitted], report=said.append))
    time.sleep(0.3)
    turn = b"\xff" * 3 + round(3.92 * 8192).to_bytes(2, "little") + b"\xff" * 3
    with can.Bus(interface="virtual", channel=channel) as bus:
        for _ in range(8):
            for name, data in (
                (0x18F0090B, turn), (0x18FEF100, speed(36)), (0x18FEF121, speed(72)),
            ):  # fmt: skip
                bus.send(can.Message(arbitration_id=name, data=data, is_extended_id=True))
            time.sleep(0.1)
        time.sleep(0.5)
    health = run.filter_loop.health()
    assert health["sensors"][0]["count"] == 8
    [problem] = health["problems"]
    assert "CCVS1: read from source address 00" in problem
    assert "; 21 sends it too and is not read" in problem
    assert any("VDC2 is read from source address 0B" in line for line in said)


def test_a_unit_that_has_no_values_locks_nobody_out_of_a_bus(dbc):
    said, made = [], []
    signals = {"speed": "WheelSpeed"}
    health, stream = Health("can0", "wheels", said.append), CanStream(dbc, Vehicle(signals=signals))
    watch = BusWatch(health, stream)
    for k in range(20):
        stream.feed(0x18FEF100 | EXTENDED, 1.7e9 + 0.1 * k, b"\xff" * 8)
        watch.look(0.1 * k)
        made += stream.feed(0x18FEF121 | EXTENDED, 1.7e9 + 0.1 * k + 0.01, speed(36))
    assert len(made) == 20
    assert stream.skipped_why == {"signal not available": 1}
    made += stream.feed(0x18FEF1FE | EXTENDED, 1.7e9 + 3.0, speed(36))
    watch.look(3.0)
    assert len(made) == 21
    where = "can0: CCVS1 is read from source address"
    assert said == [
        f"{where} 00, as FE of the .dbc does not send PGN 65265",
        f"{where} 21, as FE of the .dbc does not send PGN 65265; 00 sends it without a value",
        "can0, CCVS1: the sender of the .dbc is heard now, and read",
    ]
    assert not health.troubles.messages()


def test_frames_that_do_not_come_are_problems_with_their_ids(dbc):
    said = []
    health, stream = Health("can0", "wheels", said.append), CanStream(dbc, CAR)
    watch = BusWatch(health, stream)
    watch.look(0.0)
    watch.look(20.0)
    assert not health.troubles.messages()  # the bus is not open
    health.open()
    for now in (20.0, 29.9):
        watch.look(now)
        assert not health.troubles.messages()
    watch.look(30.0)
    [problem] = health.troubles.messages()
    assert (
        "came for 10 s of CCVS1 (18FEF1FE, PGN 65265), Gears (320), VDC2 (18F009FE, PGN" in problem
    )
    stream.feed(0x18FEF100 | EXTENDED, 31.0, speed(36))
    watch.look(31.0)
    [problem] = health.troubles.messages()
    assert "CCVS1 (" not in problem  # but the others, without which nothing is said
    health.heard(1, 32.0)
    watch.look(32.0)
    assert not health.troubles.messages()
    told = [line for line in said if "no frame" in line]
    assert [line.split(" (")[0] for line in sorted(told)] == [
        "can0: no frame Gears", "can0: no frame VDC2",
    ]  # fmt: skip
    watch.look(45.0)
    assert len(health.troubles.messages()) == 1
    health.lose("gone")
    watch.look(46.0)
    health.open()
    watch.look(47.0)
    assert not health.troubles.messages()  # it is new


def test_who_asks_nothing_is_let_go_and_a_websocket_stays(town, observations, running, monkeypatch):
    monkeypatch.setattr("whichroad.live.web_server._REQUEST_TIME", 0.3)
    run, port = running(
        Plan([Fitted(Localizer(town), nmea=[nmea_address(f"udp://:{free_port()}")])])
    )
    health = run.filter_loop.sensor("test", "gnss")
    idle = socket.create_connection(("127.0.0.1", port), timeout=10)
    with connect(f"ws://127.0.0.1:{port}/ws") as listener:
        assert idle.recv(10) == b""
        time.sleep(0.5)
        fix = next(one for one in observations if isinstance(one, GeoFix))
        run.loop.call_soon_threadsafe(run.filter_loop.take, health, [fix], time.perf_counter())
        assert json.loads(listener.recv(timeout=60))["answered"]
    idle.close()
