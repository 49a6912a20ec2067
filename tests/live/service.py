"""A real service in a process of its own, and the feeds of a simulated vehicle."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from websockets.sync.client import connect

from whichroad import Settings, read_vehicle
from whichroad.live import trace_worker
from whichroad.live.trace_options import TraceOptions

# A process beside the filter gives way to all others.  Beside busy processors, as those of tests
# are, it waits for minutes: here it does not, but where that itself is tested.
KEEPS_PACE = "import whichroad.live.background as b; b.give_way = lambda **_: None; "
# python-can imports asammdf where it is installed, which takes longer than all else; services read
# no MF4, and their extra does not bring it.
CODE = "import sys; sys.modules['asammdf'] = None; from whichroad.cli import main; main()"
_URGENT = f"from whichroad.live import traces as t; t._WORKER = {KEEPS_PACE!r} + t._WORKER; {CODE}"


def _in_the_foreground():
    """Ctrl-C reaches a process also where the tests are a job that a script runs beside others."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


class Served:
    """`whichroad live` as a user starts it, but for the priority of its other processes."""

    def __init__(self, *arguments, gives_way=False, stdin=None):
        code = CODE if gives_way else _URGENT
        command = [sys.executable, "-c", code, "live", "--port", "0", "--no-page"]
        self.process = subprocess.Popen(
            [*command, *map(str, arguments)], stdin=stdin, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
            preexec_fn=_in_the_foreground,
        )  # fmt: skip
        self.lines = []
        line = self._line()
        self.port = int(line.rsplit(":", 1)[1].strip("/\n"))

    def _line(self):
        line = self.process.stdout.readline()
        assert line.startswith("http://"), self.process.stderr.read()
        return line

    def nmea_port(self):
        """The port of the sentences that go out."""
        return int(self.process.stdout.readline().rsplit(":", 1)[1])

    def ask(self, method, path, body=None, headers=None, host="127.0.0.1"):
        """Status and body of one request."""
        client = http.client.HTTPConnection(
            host, self.port, timeout=100
        )  # a trace waits for every other process
        try:
            client.request(method, path, body, headers or {})
            answer = client.getresponse()
            return answer.status, answer.read()
        finally:
            client.close()

    def get(self, path):
        """JSON of an address."""
        status, body = self.ask("GET", path)
        assert status == 200, body
        return json.loads(body)

    def control(self, action, value=None):
        """Press a button."""
        status, body = self.ask("POST", "/control", json.dumps({"action": action, "value": value}))
        return status, json.loads(body)

    def listen(self, **more):
        """A WebSocket."""
        return connect(f"ws://127.0.0.1:{self.port}/ws", **more)

    def until(self, holds, path="/estimate", seconds=120.0):
        """The first answer of an address for which something holds."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            status, body = self.ask("GET", path)
            if status == 200 and holds(said := json.loads(body)):
                return said
            time.sleep(0.05)
        raise AssertionError(f"it did not happen: {body[:2000]!r}")

    def kill(self):
        """As the operating system would."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self):
        """As a user does; returns the exit code and what was said."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            _, said = self.process.communicate(timeout=120)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode, said

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


def refusal_of(body, suffix, files, folder):
    """How the process that matches refuses a posted trace, asked in this one: it starts slowly."""
    car = read_vehicle(files / "drive" / "vehicle.toml")
    asked = trace_worker.request(suffix, TraceOptions(), files / "town.map", car, Settings())
    (folder / trace_worker.REQUEST).write_text(asked, encoding="utf-8")
    (folder / trace_worker.BODY).write_bytes(body)
    with pytest.raises(trace_worker.Refused) as refused:
        _check_and_match(folder)
    return refused.value


def _check_and_match(folder):
    trace_worker.check_body(folder)
    trace_worker.match_trace(folder)


def free_port():
    """A port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def knock(port):
    """A connection, as soon as there is somebody."""
    for _ in range(100):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            time.sleep(0.05)
    raise AssertionError("nobody listens")


def drive_files(folder: Path):
    """Options that name the files of a simulated drive."""
    return (
        "--nmea", folder / "drive.nmea", "--can", folder / "can.log",
        "--dbc", folder / "vehicle.dbc", "--vehicle", folder / "vehicle.toml",
    )  # fmt: skip


def on_air(log: bytes, begin: float):
    """The bursts of an NMEA log, shifted so that the first is of `begin` (whole seconds)."""
    bursts, burst = [], []
    for line in log.splitlines():
        burst.append(line.decode())
        if line[3:6] == b"ZDA":
            bursts.append(burst)
            burst = []
    for number, lines in enumerate(bursts):
        moment = time.gmtime(begin + number)
        clock, date = time.strftime("%H%M%S.00", moment), time.strftime("%d%m%y", moment)
        dated = time.strftime("%d,%m,%Y", moment)
        yield b"".join(_again(line, clock, date, dated) for line in lines)


def _again(line, clock, date, dated):
    """A sentence with another time."""
    fields = line[1 : line.index("*")].split(",")
    kind = fields[0][2:]
    if kind != "VTG":
        fields[1] = clock
    if kind == "RMC":
        fields[9] = date
    if kind == "ZDA":
        fields[2:5] = dated.split(",")
    body = ",".join(fields)
    total = 0
    for letter in body.encode():
        total ^= letter
    return f"${body}*{total:02X}\r\n".encode()
