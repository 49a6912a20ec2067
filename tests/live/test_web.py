"""One web server and one access control for `live` and `replay`, so the same answers."""

import json
import re
import socket
import subprocess
import sys
import threading
import time

import httpx
import pytest
from typer.testing import CliRunner
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from live.service import CODE, Served, drive_files
from whichroad.cli import app
from whichroad.live import web_server
from whichroad.live.access import is_local
from whichroad.live.filter_loop import FilterLoop
from whichroad.online import Localizer

pytestmark = pytest.mark.slow


class Replayed:
    """`whichroad replay` as a user starts it."""

    def __init__(self, *arguments):
        command = [sys.executable, "-c", CODE, "replay", "--port", "0", "--no-browser"]
        self.process = subprocess.Popen(
            [*command, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        line = self.process.stdout.readline()
        found = re.match(r"http://.*:(\d+)/ ", line)
        assert found, self.process.stderr.read()
        self.port = int(found[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()


def arguments(files, command):
    folder = files / "drive"
    shared = ("--map", files / "town.map", "--vehicle", folder / "vehicle.toml")
    shared += ("--can", folder / "can.log", "--dbc", folder / "vehicle.dbc")
    return (
        (folder / "drive.nmea", *shared)
        if command == "replay"
        else (*drive_files(folder), *shared[:2])
    )


def started(files, command, *more):
    """The service of a command; `live` is there when it has an estimate."""
    if command == "replay":
        return Replayed(*arguments(files, command), *more)
    return Served(*arguments(files, command), *more)


@pytest.fixture(scope="module", params=["live", "replay"])
def address(request, files):
    with started(files, request.param) as one:
        end = time.monotonic() + 120.0
        url = f"http://127.0.0.1:{one.port}"
        while raw(one.port, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")[:4] != b"HTTP":
            assert time.monotonic() < end
        yield url


def raw(port, data, end=False):
    """What comes back for some bytes, until the connection is closed or silent."""
    with socket.create_connection(("127.0.0.1", port), timeout=5) as one:
        one.sendall(data)
        if end:
            time.sleep(0.05)
            one.shutdown(socket.SHUT_WR)
        said = b""
        try:
            while data := one.recv(65536):
                said += data
                head, found, body = said.partition(b"\r\n\r\n")
                length = re.search(rb"content-length: (\d+)", head)
                if found and length and len(body) >= int(length[1]):
                    break
        except TimeoutError:
            pass
        return said


def refusal(said):
    """Status and sentence of an answer."""
    head, _, body = said.partition(b"\r\n\r\n")
    assert b"access-control-allow-origin" not in head.lower()
    return int(head[9:12]), json.loads(body)["error"]


@pytest.mark.parametrize(
    ("header", "status", "sentence"),
    [
        (b"Host: [", 400, "the Host header is malformed"),
        (b"Host: [::1", 400, "the Host header is malformed"),
        (b"Host: ::1]:80", 400, "the Host header is malformed"),
        (b"Host: localhost:99999999", 400, "the Host header is malformed"),
        (b"Host: localhost:x", 400, "the Host header is malformed"),
        (b"Host: local host", 400, "the Host header is malformed"),
        (b"Host: user@localhost", 400, "the Host header is malformed"),
        (b"Host: local/host", 400, "the Host header is malformed"),
        (b"Host: \xff\xfe", 400, "the Host header is malformed"),
        (b"Host: evil.example", 403, "this host is not served"),
        (b"Host: 127.0.0.1.evil.example", 403, "this host is not served"),
        (b"Host: [::2]", 403, "this host is not served"),
        (b"Host:", 403, "this host is not served"),
        (b"Host: localhost\r\nOrigin: http://[", 400, "the Origin header is malformed"),
        (b"Host: localhost\r\nOrigin: http://[::1", 400, "the Origin header is malformed"),
        (b"Host: localhost\r\nOrigin: localhost", 400, "the Origin header is malformed"),
        (b"Host: localhost\r\nOrigin: http://a b", 400, "the Origin header is malformed"),
        (b"Host: localhost\r\nOrigin: http://localhost/x", 400, "the Origin header is malformed"),
        (b"Host: localhost\r\nOrigin:", 400, "the Origin header is malformed"),
        (b"Host: localhost\r\nOrigin: null", 403, "other origins are not served"),
        (b"Host: localhost\r\nOrigin: http://evil.example", 403, "other origins are not served"),
        (b"Host: localhost:1\r\nOrigin: http://localhost:2", 403, "other origins are not served"),
    ],
)
def test_a_foreign_or_malformed_host_or_origin_is_a_4xx(address, header, status, sentence):
    port = int(address.rsplit(":", 1)[1])
    for path in (b"/", b"/ws", b"/nothing"):
        said = raw(port, b"GET " + path + b" HTTP/1.1\r\n" + header + b"\r\n\r\n")
        assert refusal(said) == (status, sentence)


@pytest.mark.parametrize("header", [
    b"Host: localhost", b"Host: LOCALHOST:80", b"Host: 127.0.0.1:8080", b"Host: [::1]:80",
    b"Host: localhost.", b"Host: localhost:1\r\nOrigin: http://LocalHost:1",
])  # fmt: skip
def test_this_machine_by_any_of_its_names_is_served(address, header):
    port = int(address.rsplit(":", 1)[1])
    said = raw(port, b"GET /nothing HTTP/1.1\r\n" + header + b"\r\n\r\n")
    assert said.startswith(b"HTTP/1.1 404 ")


@pytest.mark.parametrize(
    "value",
    [10**19, -(10**30), 10**400, 1e308, "9" * 5000, {"a": 10**19}, [10**19]],
    ids=range(7),
)
def test_a_number_beyond_64_bits_is_a_4xx(address, value):
    for action in ("seek", "speed", "step", 10**19):
        body = json.dumps({"action": action, "value": value})
        answer = httpx.post(f"{address}/control", content=body)
        stepped = action == "step" and "live" not in answer.text and answer.status_code == 200
        assert answer.status_code in (400, 409) or stepped  # a replay's step has no value
    assert httpx.get(f"{address}/nothing").status_code == 404


@pytest.mark.parametrize(
    "path",
    ["/roads/a/{n}/1/1.mvt", "/roads/edges?ids={n}", "/static/{n}", "/roads/a/1/{n}/{n}.mvt"],
)
@pytest.mark.parametrize("digits", [20, 400, 5000])
def test_a_large_number_in_an_address_is_a_4xx(address, path, digits):
    answer = httpx.get(address + path.format(n="9" * digits))
    assert 400 <= answer.status_code < 500
    assert "error" in answer.json()


@pytest.mark.parametrize("length", [b"99999999999", b"9" * 18, b"9" * 19, b"9" * 5000, b"-1", b"x"])
def test_a_length_that_is_none_or_too_large_is_a_4xx(address, length):
    port = int(address.rsplit(":", 1)[1])
    head = b"POST /control HTTP/1.1\r\nHost: localhost\r\nContent-Length: " + length + b"\r\n\r\n"
    status, sentence = refusal(raw(port, head))
    assert status in (400, 413)
    assert len(sentence) < 100


@pytest.mark.parametrize("chunked", [False, True])
def test_a_body_that_is_cut_short_is_a_400(address, chunked):
    port = int(address.rsplit(":", 1)[1])
    length = b"Transfer-Encoding: chunked" if chunked else b"Content-Length: 1000"
    start = b"100\r\n{" if chunked else b"{"
    head = b"POST /control HTTP/1.1\r\nHost: localhost\r\n" + length + b"\r\n\r\n"
    said = raw(port, head + start, end=True)
    assert refusal(said) == (400, "the body ended before it was complete")


@pytest.mark.parametrize("data", [b"\x00\x01\x02\r\n\r\n", b"GET\r\n\r\n", b"x" * 40_000])
def test_what_is_no_request_is_a_400(address, data):
    port = int(address.rsplit(":", 1)[1])
    assert refusal(raw(port, data)) == (400, "Invalid HTTP request received.")


def test_a_body_where_none_is_taken_is_a_400(address):
    answer = httpx.request("GET", f"{address}/nothing", content=b"x" * 100)
    assert (answer.status_code, "error" in answer.json()) == (400, True)


def test_a_large_body_that_is_refused_does_not_hide_the_answer(address):
    for _ in range(5):
        answer = httpx.post(f"{address}/control", content=b"x" * 3_000_000)
        assert (answer.status_code, answer.json()) == (
            413, {"error": "at most 16384 bytes are taken here"}
        )  # fmt: skip


@pytest.mark.parametrize("command", ["live", "replay"])
def test_a_token_is_asked_of_everybody(files, command):
    with started(files, command, "--token", "s3cret") as one:
        url = f"http://127.0.0.1:{one.port}"
        for path in ("/", "/nothing", "/control"):
            assert httpx.get(url + path).status_code == 401
            assert httpx.get(f"{url}{path}?token=wrong").status_code == 401
        bearer = httpx.get(f"{url}/nothing", headers={"Authorization": "Bearer s3cret"})
        assert bearer.status_code == 404
        answer = httpx.get(f"{url}/nothing?token=s3cret")
        assert answer.status_code == 404
        cookie = answer.headers["set-cookie"].partition(";")[0]
        assert httpx.get(f"{url}/nothing", headers={"Cookie": cookie}).status_code == 404
        with pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{one.port}/ws")
        with connect(f"ws://127.0.0.1:{one.port}/ws?token=s3cret") as listener:
            assert json.loads(listener.recv(timeout=60))["version"] == 1


@pytest.mark.parametrize("command", ["live", "replay"])
@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "example.org"])
def test_other_machines_are_not_let_in_without_a_token(files, command, host):
    given = [command, "--host", host, *arguments(files, command)]
    done = CliRunner().invoke(app, [*map(str, given)])
    assert done.exit_code == 2
    assert "a --token was expected" in re.sub(r"[\s│]+", " ", done.stderr)


def test_with_a_token_a_replay_listens_for_other_machines(files):
    with started(files, "replay", "--token", "s3cret", "--host", "0.0.0.0") as one:
        url = f"http://127.0.0.1:{one.port}/nothing"
        assert httpx.get(url).status_code == 401
        headers = {"Authorization": "Bearer s3cret", "Host": "car.example"}
        assert httpx.get(url, headers=headers).status_code == 404


def test_names_and_addresses_of_this_machine_are_local():
    for host in ("localhost", "127.0.0.1", "127.1.2.3", "::1"):
        assert is_local(host)
    for host in (
        "",
        "0.0.0.0",
        "::",
        "10.0.0.1",
        "localhost.example",
        "example.org",
        "127.0.0.256",
    ):
        assert not is_local(host)


def test_an_answer_does_not_wait_until_its_head_is_acknowledged():
    with (
        web_server.listen("127.0.0.1", 0) as door,
        socket.create_connection(door.getsockname()),
        door.accept()[0] as accepted,
    ):
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


@pytest.fixture(params=["live", "replay"])
def hasty(request, town, ride, monkeypatch):
    """The port of an application whose timeouts are short."""
    monkeypatch.setattr(web_server, "_REQUEST_TIME", 0.3)
    monkeypatch.setattr(web_server, "_PATIENCE", 0.3)
    server = web_server.web_server(
        app_of(request.param, town, ride), lifespan=request.param == "replay"
    )
    listener = web_server.listen("127.0.0.1", 0)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield listener.getsockname()[1]
    server.should_exit = True
    thread.join(20)
    listener.close()


def app_of(command, town, ride):
    """The application of a command."""
    if command == "live":
        from whichroad.live.app import Service, application
        from whichroad.live.broadcaster import Broadcaster

        return application(Service(FilterLoop(Localizer(town)), Broadcaster()))
    from whichroad.replay.open_replay import Remaking
    from whichroad.replay.player import Player
    from whichroad.replay.replay_server import replay_app

    return replay_app(Player(Remaking(ride.drive, town, ride.vehicle)([]), paused=True), town)


def until_closed(one):
    """What comes until the other end closes the connection."""
    one.settimeout(20)
    said = b""
    try:
        while data := one.recv(65536):
            said += data
    except ConnectionResetError:
        pass
    return said


def test_who_asks_nothing_or_only_half_is_let_go(hasty):
    """Also after a first request that was whole."""
    whole = b"GET /nothing HTTP/1.1\r\nHost: localhost\r\n\r\n"
    for data, answered in ((b"", 0), (b"GET / HTTP/1.1\r\nHost: loc", 0)):
        with socket.create_connection(("127.0.0.1", hasty)) as one:
            one.sendall(data)
            assert until_closed(one).count(b"HTTP/1.1 ") == answered
    with socket.create_connection(("127.0.0.1", hasty)) as one:
        one.sendall(whole.replace(b"/nothing", b"/static/none") + b"GET / HTTP/1.1\r\nHost: loc")
        assert until_closed(one).count(b"HTTP/1.1 ") == 1


def test_a_websocket_that_answers_no_ping_is_let_go_and_one_that_does_stays(hasty):
    with connect(f"ws://127.0.0.1:{hasty}/ws", ping_interval=None) as alive:
        with socket.create_connection(("127.0.0.1", hasty)) as silent:
            silent.sendall(
                b"GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
                b"Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                b"Sec-WebSocket-Version: 13\r\n\r\n"
            )
            assert until_closed(silent).startswith(b"HTTP/1.1 101 ")
        alive.ping().wait(10)
        alive.send("still here")
        try:
            alive.recv(timeout=0.1)
        except TimeoutError:
            pass
        except ConnectionClosed as closed:
            raise AssertionError from closed
