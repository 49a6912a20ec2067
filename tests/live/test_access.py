"""Rubbish gets a 4xx, strangers stay outside, slow clients are dropped, and the service lives."""

import asyncio
import json
import os
import re
import socket
import time

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from live.service import Served, drive_files, refusal_of
from whichroad.live import traces
from whichroad.live.app import Service, application
from whichroad.live.broadcaster import Broadcaster
from whichroad.live.filter_loop import FilterLoop
from whichroad.online import Localizer

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def served(files):
    options = ("--map", files / "town.map", *drive_files(files / "drive"))
    with Served(*options, "--laps", 50) as one:
        one.until(lambda said: said["answered"])
        yield one


@pytest.mark.parametrize(
    ("method", "path", "body", "status"),
    [
        ("GET", "/nothing", None, 404),
        ("GET", "/../../etc/passwd", None, 404),
        ("GET", "/control", None, 405),
        ("POST", "/estimate", "", 405),
        ("POST", "/control", "", 400),
        ("POST", "/control", "[]", 400),
        ("POST", "/control", '{"action": "fly"}', 400),
        ("POST", "/control", '{"action": {"a": 1}}', 400),
        ("POST", "/control", '{"action": "seek"}', 400),
        ("POST", "/control", '{"action": "seek", "value": NaN}', 400),
        ("POST", "/control", '{"action": "seek", "value": true}', 400),
        ("POST", "/control", '{"action": "speed", "value": 1e9}', 400),
        ("POST", "/control", '{"action": "step", "value": "far"}', 400),
        ("POST", "/control", "[" * 10_000, 400),
        ("POST", "/control", "x" * 20_000, 413),
        ("POST", "/match", "no content type", 415),
    ],
)
def test_rubbish_is_a_4xx_that_tells_nothing(served, method, path, body, status):
    got, said = served.ask(method, path, body)
    assert got == status
    assert "error" in json.loads(said)
    for secret in (b"Traceback", b'File "', b".py", os.getcwd().encode()):
        assert secret not in said


NO_TRACES = [  # formats, bodies, and the status of the refusal
    ("application/json", b"{", 400),
    ("text/plain", os.urandom(5000), 422),
    ("application/json", b"[1, 2]", 400),
    ("application/json", b'{"time": [1], "lat": ["a"], "lon": [2]}', 422),
    ("text/csv", b"a,b\n1,2\n", 422),
    ("text/csv", b"time,lat,lon\n0,49.4,8.7\n1,89,8.7\n", 422),
    ("application/gpx+xml", b"<gpx>", 422),
    ("application/vnd.apache.arrow.stream", os.urandom(300), 422),
]


@pytest.mark.parametrize(
    ("kind", "body", "status"), [*NO_TRACES[:2], ("text/html", b"<p>", 415)], ids=range(3)
)
def test_a_trace_that_is_none_is_a_4xx_without_paths(served, kind, body, status):
    got, said = served.ask("POST", "/match", body, {"content-type": kind})
    assert (got, "error" in json.loads(said)) == (status, True)
    assert b"/tmp" not in said
    assert b".py" not in said


@pytest.mark.parametrize(("kind", "body", "status"), NO_TRACES, ids=range(len(NO_TRACES)))
def test_what_is_said_of_any_trace_that_is_none_has_no_paths(files, tmp_path, kind, body, status):
    """As the process that matches says it, but in this one."""
    refused = refusal_of(body, traces._KINDS[kind], files, tmp_path)
    assert refused.status == status
    assert refused.why
    assert not re.search(r"/tmp|\.py", refused.why)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 403),
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Content-Length": "99999999999"}, 413),
    ],
)
def test_strangers_stay_outside(served, headers, status):
    got, said = served.ask("POST", "/control", '{"action": "mask"}', headers)
    assert got == status
    assert "access-control-allow-origin" not in str(said).lower()
    assert served.get("/estimate")["gnss_masked"] is False


def test_a_websocket_of_another_origin_is_refused(served):
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{served.port}/ws", origin="https://evil.example")
    assert refused.value.response.status_code == 403


def test_a_large_or_talkative_websocket_is_closed_or_slowed(served):
    def shout():
        with connect(f"ws://127.0.0.1:{served.port}/ws") as socket_:
            socket_.send("x" * 10_000)
            for _ in range(1000):
                socket_.recv(timeout=60)

    with pytest.raises(ConnectionClosed):
        shout()
    assert served.get("/health")["answered"]


def test_half_open_and_random_connections_do_no_harm(served):
    idle = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(50)]
    for number, one in enumerate(idle):
        if number % 3 == 1:
            one.sendall(b"GET /health HTTP/1.1\r\nHost: local")
        if number % 3 == 2:
            one.sendall(os.urandom(4000))
    before = served.get("/estimate")["seq"]
    served.until(lambda said: said["seq"] > before + 10)
    for one in idle:
        one.close()


def test_who_does_not_read_is_dropped_and_delays_nobody(served):
    served.control("speed", 10)
    stalled = socket.socket()
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stalled.connect(("127.0.0.1", served.port))
    stalled.sendall(
        b"GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    listeners = served.get("/health")["listeners"]
    served.control("seek", 0)
    served.control("resume")
    with served.listen() as other:
        end = time.monotonic() + 120
        while served.get("/health")["listeners"] > listeners and time.monotonic() < end:
            other.recv(timeout=60)
    gone = served.until(lambda said: said["listeners"] < listeners, "/health")
    assert gone["answered"]
    served.control("speed", 1)
    stalled.close()


def test_too_many_requests_are_refused(town):
    """By the application itself: over sockets a busy machine may ask too slowly."""
    app = application(Service(FilterLoop(Localizer(town)), Broadcaster()))
    scope = {
        "type": "http", "http_version": "1.1", "method": "GET", "scheme": "http",
        "path": "/health", "raw_path": b"/health", "root_path": "", "query_string": b"",
        "headers": [(b"host", b"localhost")], "client": ("127.0.0.1", 1), "server": ("::1", 80),
    }  # fmt: skip
    statuses = set()

    async def receive():
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message):
        statuses.add(message.get("status"))

    async def ask():
        for _ in range(700):
            await app(dict(scope), receive, send)

    asyncio.run(ask())
    assert statuses - {None} == {200, 429}
