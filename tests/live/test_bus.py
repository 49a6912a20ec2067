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
from whichroad import GeoFix, Localizer, read_vehicle
from whichroad.live.addresses import can_address, nmea_address
from whichroad.live.decode import CanStream
from whichroad.live.server import Plan, Run
from whichroad.live.vehicle_run import Fitted
from whichroad.readers.can_frames import read_frames
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
