"""Several vehicles in one service, and two senders on one port."""

import json
import socket
import time

import pytest
from typer import BadParameter
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from live.service import Served, free_port, on_air
from whichroad.cli.live_vehicles import Fittings, named, own_file
from whichroad.live.decode import NmeaStream
from whichroad.live.nmea_output import sentences
from whichroad.live.senders import OneSender
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
    assert port.takes("a", 8.3)


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
