"""Several vehicles in one service, and two senders on one port."""

import asyncio
import json
import socket
import time

import pytest
from typer import BadParameter
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from live.service import Served, free_port, on_air
from whichroad import Localizer
from whichroad.cli.live_vehicles import Fittings, named, own_file
from whichroad.live.addresses import Address
from whichroad.live.decode import NmeaStream
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.nmea_output import sentences
from whichroad.live.senders import OneSender
from whichroad.live.sources import NmeaInput, listen_tcp
from whichroad.live.troubles import Troubles
from whichroad.simulate.drive_files import nmea_text
from whichroad.writers.nmea_text import sealed


@pytest.fixture(scope="module")
def bursts(ride):
    return list(on_air(nmea_text(ride).encode(), int(time.time()) - 90))


def send(port, bursts):
    """A sender of its own; it must be closed."""
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for burst in bursts:
        sender.sendto(burst, ("127.0.0.1", port))
        time.sleep(0.04)
    return sender


@pytest.mark.slow
def test_each_vehicle_has_its_own_filter_and_its_own_page_of_everything(files, bursts, tmp_path):
    ports = {"van": free_port(), "bus_2": free_port()}
    sources = [
        x for name, port in ports.items() for x in ("--nmea", f"{name}=udp://127.0.0.1:{port}")
    ]
    more = ("--record", tmp_path / "drives", "--nmea-out", "bus_2=tcp://127.0.0.1:0")
    with Served("--map", files / "town.map", *sources, *more) as served:
        assert served.nmea_port() > 0
        senders = [send(ports["van"], bursts[:12]), send(ports["bus_2"], bursts[40:52])]
        said = {
            name: served.until(lambda one: one["fix"] is not None, f"/estimate?vehicle={name}")
            for name in ports
        }
        assert {name: one["vehicle"] for name, one in said.items()} == {n: n for n in ports}
        assert said["van"]["fix"]["epoch_s"] + 20 < said["bus_2"]["fix"]["epoch_s"]
        rows = served.get("/vehicles")
        assert [(row["vehicle"], row["answered"]) for row in rows] == [
            ("van", True),
            ("bus_2", True),
        ]
        assert served.get("/estimate")["vehicle"] == "van"  # the first, where none is asked for
        served.ask("POST", "/control?vehicle=bus_2", json.dumps({"action": "mask"}))
        assert served.get("/estimate?vehicle=bus_2")["gnss_masked"]
        assert not served.get("/estimate?vehicle=van")["gnss_masked"]
        with connect(f"ws://127.0.0.1:{served.port}/ws?vehicle=bus_2") as listener:
            assert json.loads(listener.recv(timeout=60))["vehicle"] == "bus_2"
        with pytest.raises(InvalidStatus, match="404"):
            connect(f"ws://127.0.0.1:{served.port}/ws?vehicle=car")
        assert served.ask("GET", "/history?vehicle=car")[0] == 404
        assert {s["name"] for s in served.get("/health?vehicle=van")["sensors"]} == {
            f"udp 127.0.0.1:{ports['van']}"
        }
        for sender in senders:
            sender.close()
        served.stop()
    for name in ports:
        assert (tmp_path / "drives" / name / "fixes.arrow").stat().st_size > 0


@pytest.mark.slow
def test_a_second_sender_on_a_port_is_refused_and_counted(files, bursts):
    port = free_port()
    with Served("--map", files / "town.map", "--nmea", f"udp://127.0.0.1:{port}") as served:
        first = send(port, bursts[:10])
        served.until(lambda one: one["fix"] is not None)
        second = send(port, bursts[50:56])  # the same roads, a minute later
        said = served.until(lambda one: one["sensors"][0]["refused"] >= 5)
        assert said["fix"]["epoch_s"] < served.get("/estimate")["fix"]["epoch_s"] + 30
        assert said["sensors"][0]["count"] <= 10
        first.close()
        second.close()


def test_the_first_who_gives_a_fix_holds_the_port_until_it_is_silent():
    port = OneSender()
    assert port.takes("a", 0.0)
    assert not port.takes("b", 1.0)
    assert port.takes("a", 2.0)
    assert not port.takes("b", 7.9)  # fixes come every two seconds: three of them are waited for
    assert port.takes("b", 8.1)
    assert not port.takes("a", 8.2)
    port.leaves("b")
    assert not port.takes("a", 8.3)  # b may connect again at once
    assert port.takes("c", 8.4)  # as it does here
    port.leaves("c")
    assert not port.takes("a", 11.3)
    assert port.takes("a", 11.5)


def at_once(port, sender, beside, seconds, begin=0.0):
    """Two senders at 5 Hz; which of the second's fixes are taken."""
    taken = []
    for k in range(int(5 * seconds)):
        port.takes(sender, begin + 0.2 * k)
        taken.append(port.takes(beside, begin + 0.2 * k + 0.05))
    return taken


def test_who_connects_again_finds_its_port_free_of_the_other_sender():
    port = OneSender()
    assert not any(at_once(port, "a", "b", 2.0))
    assert not port.hears("b", 2.0)
    port.leaves("a")
    assert not port.takes("b", 2.05)
    assert not port.hears("b", 2.05)
    assert not any(at_once(port, "a again", "b", 100.0, 2.1))
    port.leaves("a again")
    assert port.hears("b", 106.0)
    assert port.takes("b", 106.0)  # a is not back


def test_another_sender_and_refused_fixes_are_told_once_and_forgotten():
    said = []
    troubles = Troubles(said.append)
    port = OneSender("udp :2000", troubles)
    at_once(port, "10.0.0.1:7", "10.0.0.2:9", 4.0)
    assert not troubles.messages()  # as while a connection breaks
    at_once(port, "10.0.0.1:7", "10.0.0.2:9", 100.0, 4.0)
    [message] = troubles.messages()
    assert message == (
        "udp :2000, a second sender: fixes of others are refused, as those of 10.0.0.1:7 are taken"
    )
    assert len(said) == 1
    assert "(those of 10.0.0.2:9); give each vehicle a port" in said[0]
    assert port.takes("10.0.0.2:9", 120.0)
    assert (
        "another sender: fixes are those of 10.0.0.2:9 now; 10.0.0.1:7 had been silent for 16."
        in (said[1])
    )
    assert len(troubles.messages()) == 2
    for k in range(500):
        port.takes("10.0.0.2:9", 121.0 + 0.2 * k)
    assert not troubles.messages()
    assert len(said) == 4


def test_a_receiver_that_connects_again_is_told_nothing():
    said = []
    port = OneSender("listen :2000", Troubles(said.append))
    for k in range(100):
        assert port.takes(f"10.0.0.1:{k}", float(k))
        port.leaves(f"10.0.0.1:{k}")
    assert port.takes("10.0.0.2:1", 100.0)
    assert len(said) == 1


def test_a_receiver_that_connects_again_keeps_its_port_and_health_tells_of_the_other(
    town, bursts, monkeypatch
):
    """Beside a second one, whose fixes come at once after the connection is closed."""
    monkeypatch.setattr("whichroad.live.senders._LONG", 0.3)
    loop, number, taken = FilterLoop(Localizer(town)), free_port(), []
    health = loop.sensor(f"listen :{number}", "gnss")

    def make():
        return NmeaInput(health, NmeaStream(), lambda _, some, __: taken.extend(some))

    async def connect():
        return (await asyncio.open_connection("127.0.0.1", number))[1]

    async def say(*writers):
        for writer, burst in writers:
            writer.write(burst)
        await asyncio.sleep(0.06)

    async def both():
        server = asyncio.create_task(
            listen_tcp(Address("listen", "127.0.0.1", number), health, make)
        )
        await asyncio.sleep(0.1)
        first, second = await connect(), await connect()
        for k in range(4):
            await say((first, bursts[k]))
            await say((second, bursts[40 + k]))
        first.close()
        for k in range(4, 8):
            await say((second, bursts[40 + k]))
        first = await connect()
        for k in range(8, 14):
            await say((first, bursts[k]))
            await say((second, bursts[40 + k]))
        for writer in (first, second):
            writer.close()
            await writer.wait_closed()
        server.cancel()
        await asyncio.gather(server, return_exceptions=True)

    asyncio.run(both())
    assert len(taken) == 10
    assert taken[-1].time - taken[0].time == pytest.approx(13.0)
    assert health.refused == 14
    [problem] = loop.health()["problems"]
    assert f"listen :{number}, a second sender: fixes of others are refused" in problem


def test_an_option_names_its_vehicle_or_is_for_all():
    given = Fittings(
        named(["van=udp://:2000", "bus=listen://:2001"]), named(["van=can0"]), named(["car.dbc"]),
        named(["bus=bus.toml", "van=van.toml"]), named(["van=tcp://:3000"]),
        named(["van=van.jsonl"]),
    )  # fmt: skip
    assert given.names == ["van", "bus"]
    assert given.one("dbc", "van") == given.one("dbc", "bus") == "car.dbc"
    assert given.one("vehicle", "bus") == "bus.toml"
    assert given.one("readings", "van") == "van.jsonl"
    assert own_file(None, "van") is None


@pytest.mark.parametrize(
    "texts",
    [
        (["udp://:1", "van=udp://:2"], [], []),
        (["van=udp://:1"], ["bus=tcp://:2"], []),
        (["van=udp://:1", "bus=udp://:2"], ["tcp://:3"], []),
        (["van=udp://:1"], [], ["bus=bus.jsonl"]),
        (["van=udp://:1", "bus=udp://:2"], [], ["both.jsonl"]),
    ],
)
def test_a_vehicle_without_a_name_or_without_an_input_is_told(texts):
    nmea, out, readings = map(named, texts)
    with pytest.raises(BadParameter, match=r"NAME|name of a vehicle"):
        _ = Fittings(nmea, {}, {}, {}, out, readings).names


def test_standard_input_is_of_one_input():
    with pytest.raises(BadParameter, match="standard input"):
        _ = Fittings(named(["-"]), {}, {}, {}, {}, named(["-"])).names
    assert Fittings(named(["van=-"]), {}, {}, {}, {}, {}).names == ["van"]


def test_satellites_hdop_and_height_go_from_the_receiver_to_gga():
    stream = NmeaStream()
    good = sealed("GPGGA,080000.00,4924.5,N,00242.1,E,1,09,0.85,123.4,M,47.2,M,,")
    for letter in good + b"$GPGGA,080001.00,,,,,1,99,9.9,9,M,9,M,,*00\r\n":
        stream.feed(bytes([letter]))
    said = stream.receiver
    assert (said.satellites, said.hdop, said.altitude, said.geoid) == (9, 0.85, 123.4, 47.2)
    fix = {"age_s": 0.2, "masked": False, "satellites": 9, "hdop": 0.85, "altitude_m": 123.4}
    fix["geoid_m"] = 47.2
    message = {
        "epoch_s": 1.78e9, "status": "on_road", "dead_reckoning": False, "fix": fix,
        "pose": {"lat": 49.0, "lon": 2.0, "bearing_deg": 10.0, "speed_mps": 3.0},
        "ellipse": {"major_m": 3.0, "minor_m": 2.0, "bearing_deg": 20.0},
    }  # fmt: skip
    fields = sentences(message).decode().splitlines()[0].split(",")
    assert fields[6:13] == ["1", "09", "0.85", "123.4", "M", "47.2", "M"]
    message["fix"]["age_s"] = 60.0
    fields = sentences({**message, "status": "outage"}).decode().splitlines()[0].split(",")
    assert fields[6:13] == ["6", "", "", "123.4", "M", "47.2", "M"]


def test_a_pvt_of_ubx_gives_satellites_and_height():
    payload = bytearray(92)
    payload[23] = 11
    payload[32:40] = (170_600).to_bytes(4, "little") + (123_400).to_bytes(4, "little")
    body = b"\x01\x07\x5c\x00" + bytes(payload)
    first = second = 0
    for letter in body:
        first = (first + letter) & 255
        second = (second + first) & 255
    stream = NmeaStream()
    stream.feed(b"\xb5\x62" + body + bytes((first, second)))
    said = stream.receiver
    assert (said.satellites, said.hdop, said.altitude) == (11, None, 123.4)
    assert said.geoid == pytest.approx(47.2)
