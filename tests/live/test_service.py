"""The service as a process: real sockets, a virtual bus, a pty; sensors come, stop and return."""

import json
import os
import socket
import threading
import time
import tty
from itertools import pairwise

import pytest

from live.service import Served, drive_files, free_port, knock, on_air
from whichroad.readers.nmea import NmeaParser
from whichroad.simulate.drive_files import nmea_text

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log(ride):
    return nmea_text(ride).encode()


@pytest.fixture(scope="module")
def town_map(files):
    return ("--map", files / "town.map")


@pytest.fixture(scope="module")
def replayed(files, town_map):
    """A service that plays the drive at ten times its speed, in a loop long enough."""
    with Served(*town_map, *drive_files(files / "drive"), "--speed", 10) as served:
        served.until(lambda said: said["answered"])
        yield served


def feed(bursts, send, stop, every=0.1):
    for burst in bursts:
        if stop.is_set():
            return
        try:
            send(burst)
        except OSError:  # the test closed its end
            return
        time.sleep(every)


@pytest.fixture
def airing():
    """Runs feeds in the background until the test is over."""
    stop, threads = threading.Event(), []

    def begin(bursts, send, every=0.1):
        thread = threading.Thread(target=feed, args=(bursts, send, stop, every))
        threads.append(thread)
        thread.start()

    yield begin
    stop.set()
    for thread in threads:
        thread.join()


# Played files


def test_all_doors_tell_the_same_estimate(replayed):
    with replayed.listen() as socket_:
        said = [json.loads(socket_.recv(timeout=60)) for _ in range(20)]
    assert [b["seq"] - a["seq"] for a, b in pairwise(said)][1:] == [1] * 18
    assert said[-1]["play"]["position_s"] > said[0]["play"]["position_s"]
    assert replayed.get("/estimate").keys() == said[0].keys()
    status, body = replayed.ask("GET", "/metrics")
    assert status == 200
    assert b"whichroad_latency_seconds_bucket" in body
    assert replayed.get("/health")["sensors"][0]["name"] == "recording"


def test_events_are_sent_to_who_asks(replayed):
    with socket.create_connection(("127.0.0.1", replayed.port), timeout=10) as client:
        client.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        seen = b""
        while seen.count(b"event: estimate") < 5:
            seen += client.recv(65536)
    head, _, body = seen.partition(b"\r\n\r\n")
    assert b"text/event-stream" in head
    first = body[body.index(b"data: ") + 6 :].split(b"\n")[0]
    assert json.loads(first)["type"] == "estimate"


def test_masked_fixes_make_the_ellipse_grow(replayed):
    assert replayed.control("seek", 30)[0] == 200
    assert replayed.control("unmask")[1]["gnss_masked"] is False
    before = replayed.until(lambda said: said["play"]["position_s"] > 32)
    assert replayed.control("mask")[1]["gnss_masked"] is True
    after = replayed.until(
        lambda said: (
            said["fix"]["masked"]
            and said["status"] == "outage"
            and said["protection_m"] > 1.5 * before["protection_m"]
        )
    )
    assert after["fix"]["believed"] is None
    assert after["reckoning"]["travelled_m"] > 0
    assert replayed.control("unmask")[0] == 200


def test_a_recording_is_paused_stepped_and_sought(replayed):
    replayed.control("pause")
    position = replayed.get("/estimate")["play"]["position_s"]
    time.sleep(0.3)
    assert replayed.get("/estimate")["play"]["position_s"] == position
    replayed.control("seek", 60)
    replayed.until(lambda said: said["play"]["position_s"] == pytest.approx(60, abs=0.2))
    replayed.control("step", 1.0)
    replayed.until(lambda said: said["play"]["position_s"] == pytest.approx(61, abs=0.2))
    replayed.control("seek", 20)
    back = replayed.until(lambda said: said["play"]["position_s"] == pytest.approx(20, abs=0.2))
    assert back["answered"]
    assert replayed.control("speed", 20)[1]["play"]["speed"] == 20
    replayed.control("resume")
    replayed.until(lambda said: said["play"]["position_s"] > 25)
    replayed.control("pause")  # the last test with it: others take minutes on busy processors


# Sensors


def test_fixes_over_tcp_become_sentences(town_map, log, airing):
    port = free_port()
    server = socket.create_server(("127.0.0.1", port))
    sources = ("--nmea", f"tcp://127.0.0.1:{port}", "--nmea-out", "tcp://127.0.0.1:0")
    with Served(*town_map, *sources) as served:
        out = socket.create_connection(("127.0.0.1", served.nmea_port()), timeout=20)
        peer, _ = server.accept()
        airing(on_air(log, int(time.time()) - 20), peer.sendall)
        parser, fixes = NmeaParser(), []
        while len(fixes) < 10:
            data = out.recv(65536)
            assert data
            fixes += parser.feed(data)
        said = served.get("/estimate")
        assert said["sensors"][0]["state"] == "ok"
        assert said["latency_ms"]["p50"] is not None
        assert fixes[-1].lat_deg == pytest.approx(said["pose"]["lat"], abs=0.01)
        assert not parser.skipped
        out.close()
        peer.close()
    server.close()


def test_a_lost_connection_is_dead_reckoning_until_it_is_back(town_map, log, airing):
    port = free_port()
    server = socket.create_server(("127.0.0.1", port))
    with Served(*town_map, "--nmea", f"tcp://127.0.0.1:{port}") as served:
        peer, _ = server.accept()
        bursts = on_air(log, int(time.time()) - 60)
        for _ in range(25):
            peer.sendall(next(bursts))
            time.sleep(0.05)
        served.until(lambda said: said["answered"])
        peer.close()
        lost = served.until(lambda said: said["dead_reckoning"] and not said["sensors"][0]["ok"])
        later = served.until(lambda said: said["epoch_s"] > lost["epoch_s"] + 0.5)
        assert later["ellipse"]["major_m"] > lost["ellipse"]["major_m"]
        peer, _ = server.accept()
        airing(bursts, peer.sendall)
        back = served.until(lambda said: not said["dead_reckoning"])
        assert back["sensors"][0]["ok"]
        peer.close()
    server.close()


def test_a_serial_port_is_taken_up_again(town_map, log, airing, tmp_path):
    name = tmp_path / "ttyGNSS"

    def plug():
        main, side = os.openpty()
        tty.setraw(side)
        name.symlink_to(os.ttyname(side))
        return main, side

    main, side = plug()
    with Served(*town_map, "--nmea", f"serial:/dev/../{name}@115200") as served:
        bursts = on_air(log, int(time.time()) - 60)
        for _ in range(20):
            os.write(main, next(bursts))
            time.sleep(0.05)
        said = served.until(lambda said: said["answered"])
        assert said["sensors"][0]["name"] == "serial ttyGNSS"
        os.close(main)
        os.close(side)
        name.unlink()
        served.until(lambda said: said["sensors"][0]["state"] == "lost")
        main, side = plug()
        airing(bursts, lambda burst: os.write(main, burst))
        served.until(lambda said: said["sensors"][0]["ok"] and not said["dead_reckoning"])
    os.close(side)


def test_datagrams_and_callers_are_heard(town_map, log, airing):
    udp, tcp = free_port(), free_port()
    sources = ("--nmea", f"udp://127.0.0.1:{udp}", "--nmea", f"listen://127.0.0.1:{tcp}")
    with Served(*town_map, *sources, "--clock", "arrival") as served:
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        airing(on_air(log, 1.7e9), lambda b: sender.sendto(b, ("127.0.0.1", udp)))
        caller = knock(tcp)
        airing(on_air(log, 1.7e9), caller.sendall)
        said = served.until(lambda said: all(s["ok"] for s in said["sensors"]) and said["answered"])
        assert said["epoch_s"] == pytest.approx(time.time(), abs=5.0)
    sender.close()
    caller.close()


def test_a_crowd_of_rubbish_does_not_keep_the_receiver_out(town_map, log, airing):
    port = free_port()
    with Served(*town_map, "--nmea", f"listen://127.0.0.1:{port}") as served:
        crowd = [knock(port) for _ in range(40)]
        for one in crowd:
            one.sendall(os.urandom(2000))
        caller = knock(port)
        airing(on_air(log, int(time.time()) - 60), caller.sendall)
        served.until(lambda said: said["answered"])
        crowd += [knock(port) for _ in range(40)]
        seq = served.get("/estimate")["fix"]["epoch_s"]
        served.until(lambda said: said["fix"]["epoch_s"] > seq + 5)
        for one in [*crowd, caller]:
            one.close()
