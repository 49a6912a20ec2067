"""The service as a process, its feeds, and those who listen."""

import http.client
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time

from .. import Skipped
from .world import FRAME, World, burst, payload

_LATE = 3  # hundredths of a second that a receiver takes
CHANNEL = "239.74.163.2"
_CODE = "from whichroad.cli import main; main()"
_FIX = re.compile(rb'"fix":\{"epoch_s":([0-9.]+)')


def ahead():
    """The command that lets a process go before others, if that is permitted."""
    chrt = ("chrt", "-f", "10")
    try:
        done = subprocess.run([*chrt, "true"], capture_output=True)
    except OSError:
        return ()
    return chrt if done.returncode == 0 else ()


class Served:
    """`whichroad live` as a user starts it."""

    def __init__(self, *arguments, out=False, first=()):
        command = [*first, sys.executable, "-c", _CODE, "live", "--port", "0", "--no-page"]
        self.process = subprocess.Popen(
            [*command, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        line = self.process.stdout.readline()
        if not line.startswith("http://"):
            raise RuntimeError(self.process.stderr.read())
        self.port = int(line.rsplit(":", 1)[1].strip("/\n"))
        self.out = int(self.process.stdout.readline().rsplit(":", 1)[1]) if out else 0

    def get(self, path):
        """JSON of an address, or None while there is none."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            client.request("GET", path)
            answer = client.getresponse()
            return json.loads(answer.read()) if answer.status == 200 else None
        finally:
            client.close()

    def answered(self, seconds=30.0):
        """Wait for the first estimate."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            said = self.get("/estimate")
            if said and said["answered"]:
                return said
            time.sleep(0.05)
        raise RuntimeError("the service has no estimate")

    def memory(self):
        """Resident memory, MB."""
        with open(f"/proc/{self.process.pid}/status") as file:
            line = next(line for line in file if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024.0

    def cpu(self):
        """Processor time used, s."""
        with open(f"/proc/{self.process.pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def kill(self):
        """End it by force; returns what it had said on its standard error."""
        self.process.kill()
        return self.process.communicate()[1]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


class Feed:
    """Sends the world's fixes and wheels in real time.

    Args:
        world: Whose drive it is.
        send: Takes the bytes of a burst.

    Attributes:
        sent: When the burst of each fix was sent, by its epoch in 1/100 s.
    """

    def __init__(self, world: World, send):
        self.sent = {}
        self._world, self._send = world, send
        self._bus = bus()
        self._stop = threading.Event()
        self._begin = round(time.time() + 0.2, 1)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        log, fixes = self._world.drive.odometry, self._world.drive.fixes
        for row in range(len(log.time)):
            if not self._until(self._begin + 0.01 * row):
                break
            self._turn(payload(log, row))
            number, tenth = divmod(row - _LATE, 10)
            if tenth == 0 and 0 <= number < len(fixes):
                when = self._begin + 0.1 * number
                self._say(burst(fixes, number, when), round(100.0 * when))
        self._bus.shutdown()

    def _say(self, data, epoch):
        self.sent[epoch] = time.perf_counter()
        try:
            self._send(data)
        except OSError:
            self.sent.pop(epoch, None)

    def _turn(self, data):
        import can

        self._bus.send(can.Message(arbitration_id=FRAME, data=data, is_extended_id=False))

    def _until(self, when):
        wait = when - time.time()
        return not (self._stop.wait(wait) if wait > 0 else self._stop.is_set())

    def stop(self):
        """No more."""
        self._stop.set()
        self._thread.join()


def bus():
    """A CAN bus between processes."""
    try:
        import can

        return can.Bus(interface="udp_multicast", channel=CHANNEL)
    except Exception as error:
        raise Skipped(f"no CAN bus between processes ({error}); pip install msgpack") from None


def can_options(world: World):
    """Options that name the bus."""
    return ("--can", f"udp_multicast:{CHANNEL}", "--dbc", world.folder / "car.dbc")


class Receiver:
    """A TCP server that serves sentences to whoever connects last."""

    def __init__(self):
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._peer = None
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                peer, _ = self._server.accept()
            except OSError:
                return
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._peer = peer

    def send(self, data):
        """To the peer, if there is one."""
        if self._peer is None:
            raise OSError("nobody is there")
        self._peer.sendall(data)

    def close(self):
        """Stop."""
        self._server.close()
        if self._peer is not None:
            self._peer.close()


def shake(port, buffer=0):
    """A socket on which WebSocket frames come."""
    one = socket.socket()
    if buffer:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
    one.connect(("127.0.0.1", port))
    one.sendall(
        b"GET /ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    return one


class Listener:
    """Frames of one WebSocket; notes when each fix was first spoken of."""

    def __init__(self, port):
        self.socket = shake(port)
        self.heard = {}  # epoch in 1/100 s: when
        self._rest = b""
        self._open = False

    def read(self):
        """Take what is there; False: the end."""
        data = self.socket.recv(1 << 16)
        now = time.perf_counter()
        rest = self._rest + data
        if not self._open:
            head, end, rest = rest.partition(b"\r\n\r\n")
            self._open = bool(end)
            rest = rest if end else head
        while self._open and len(rest) > 4:
            begin = 4 if rest[1] == 126 else 2
            end = begin + (int.from_bytes(rest[2:4]) if rest[1] == 126 else rest[1])
            if len(rest) < end:
                break
            if rest[0] == 0x89:  # a ping is answered; a mask of zeros changes nothing
                payload = rest[begin:end]
                self.socket.sendall(bytes((0x8A, 0x80 | len(payload))) + bytes(4) + payload)
            elif match := _FIX.search(rest, begin, end):
                self.heard.setdefault(round(100.0 * float(match[1])), now)
            rest = rest[end:]
        self._rest = rest
        return bool(data)


_LISTEN = "from benchmarks.live.process import listen; import sys; listen(*sys.argv[1:])"


class Listening:
    """A listener in a process of its own, for so many seconds."""

    def __init__(self, port, seconds, first=()):
        command = [*first, sys.executable, "-c", _LISTEN, str(port), str(seconds)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._process.stdout.readline()

    def heard(self):
        """When each fix was first spoken of, by its epoch; waits until the seconds are over."""
        out, _ = self._process.communicate()
        return {int(epoch): at for epoch, at in json.loads(out).items()}


def listen(port, seconds):
    """Listen, and print what was heard when."""
    listener, end = Listener(int(port)), time.monotonic() + float(seconds)
    print("here", flush=True)
    while time.monotonic() < end and listener.read():
        pass
    print(json.dumps(listener.heard))


def latencies(sent, heard, skip=10):
    """Seconds from sending to hearing, sorted; without the first bursts, when all is learnt."""
    epochs = sorted(sent)[skip:]
    return sorted(heard[epoch] - sent[epoch] for epoch in epochs if epoch in heard)


def quantile(values, q):
    """Of sorted values; None of none."""
    return values[min(int(q * len(values)), len(values) - 1)] if values else None
