"""Memory of the service and its worker while many large or malicious bodies come at once."""

import contextlib
import io
import json
import os
import socket
import subprocess
import sys
import threading
import time

import numpy as np

from .. import Figure, Options
from .matching import KINDS, body_file
from .process import Feed, Receiver, Served, can_options
from .world import world

MOST = 16 * 1024 * 1024
_AT_ONCE = 60
_CROWD = "from benchmarks.live.bodies import crowd; import sys; crowd(*sys.argv[1:])"
_WAIT = 60.0  # s after which memory must be given back


def bodies(options: Options) -> list[Figure]:
    """Sixty posts at once of each kind, then silence."""
    with world(20_000.0) as here:
        receiver = Receiver()
        sources = ("--nmea", f"tcp://127.0.0.1:{receiver.port}", *can_options(here))
        with Served(*here.options(), *sources) as served:
            feed = Feed(here, receiver.send)
            served.answered()
            time.sleep(5.0)
            quiet = memory(served)
            watch = Watch(served)
            rows = []
            for name, (body, kind, hold) in malicious(here).items():
                watch.most = 0.0
                statuses = at_once(here, served, body, kind, hold)
                idle(served)
                rows.append((name, watch.most - quiet, statuses))
                options.say(f"{name}: +{rows[-1][1]:.0f} MB, {statuses}")
            time.sleep(_WAIT)
            after = memory(served) - quiet
            watch.stop()
            health = served.get("/health")
            feed.stop()
        receiver.close()
    figures = [Figure("resident memory, quiet", quiet, "", "MB")]
    figures += [Figure(f"{name}: peak", most, "<= 500", "MB", _AT_ONCE) for name, most, _ in rows]
    broken = sum(
        count for _, _, statuses in rows for status, count in statuses.items() if status >= 500
    )
    return [
        *figures,
        Figure("peak of all", max(most for _, most, _ in rows), "<= 500", "MB", len(rows)),
        Figure("more than quiet after 60 s", after, "<= 20", "MB"),
        Figure("answers 5xx", float(broken), "<= 0", "", _AT_ONCE * len(rows)),
        Figure("observations refused", float(sum(health["skipped"].values())), "<= 0"),
    ]


def malicious(here):
    """Name: body, content type, whether the last byte is held back for a while."""
    legal = {
        f"200,000 rows as {kind}": (body_file(here, kind, 200_000).read_bytes(), KINDS[kind], False)
        for kind in KINDS
    }
    arrow, text = KINDS["arrow"], KINDS["json"]
    zeros = np.zeros(20_000_000, np.int64)
    wide = np.zeros(100_000_000, np.int8)
    places = {"time": np.arange(2e5), "lat": np.full(200_000, 49.4), "lon": np.full(200_000, 2.8)}
    more = {f"c{i}": np.zeros(200_000) for i in range(30)}
    bombs = {
        "20 million rows, zstd": (stream({"time": zeros}), arrow, False),
        "100 million rows, zstd": (stream({"time": wide, "lat": wide, "lon": wide}), arrow, False),
        "33 columns of 200,000 rows, zstd": (stream({**places, **more}), arrow, False),
        "lists in JSON": (b"[" + b"[]," * (MOST // 3 - 2) + b"[]]", text, False),
        "objects in JSON": (b"[" + b'{"a":1},' * (MOST // 8 - 2) + b"{}]", text, False),
        "200,000 objects in JSON": (
            b"[" + b",".join(b'{"time":%d,"lat":49.4,"lon":2.8,"b":"%d"}' % (i, i)
                             for i in range(200_000)) + b"]", text, False),
        "words in JSON": (b'{"time":[' + b'"ab",' * 1_999_000 + b'"ab"]}', text, False),
        "wide characters in JSON": (
            b'{"time":["' + "\U0001f600".encode() * (MOST // 4 - 8) + b'"]}', text, False),
        "lines of CSV": (b"time,lat,lon\n" + b"1\n" * (MOST // 2 - 10), "text/csv", False),
        "one line of CSV": (b"time,lat,lon" + b"," * (MOST - 20), "text/csv", False),
        "tags of GPX": (b"<gpx>" + b"<a/>" * (MOST // 4 - 8), "application/gpx+xml", False),
        "attributes of GPX": (
            b"<gpx " + b" ".join(b'a%x=""' % i for i in range(1_500_000)) + b"/>",
            "application/gpx+xml", False),
        "sentences": (sentences(here), "text/plain", False),
        "16 MB, never ended": (b"time,lat,lon\n" + b"1,2,3\n" * (MOST // 6 - 10), "text/csv", True),
    }  # fmt: skip
    return {**bombs, **legal}


def stream(columns):
    """A compressed Arrow stream."""
    import pyarrow as pa

    table, sink = pa.table(columns), io.BytesIO()
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(sink, table.schema, options=options) as writer:
        writer.write_table(table)
    return sink.getvalue()


def sentences(here):
    """An NMEA log of 16 MB."""
    from .world import burst

    fixes, parts, size, number = here.drive.fixes, [], 0, 0
    while size < MOST - 1000:
        data = burst(fixes, number % len(fixes), 1.7e9 + 0.1 * number)
        parts.append(data)
        size += len(data)
        number += 1
    return b"".join(parts)


def at_once(here, served, body, kind, hold):
    """Statuses of sixty posts at the same time, by a process of its own."""
    path = here.folder / "body"
    path.write_bytes(body)
    done = subprocess.run(
        ["nice", "-n", "10", sys.executable, "-c", _CROWD, str(served.port), str(path), kind,
         "hold" if hold else ""],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return {int(status): count for status, count in json.loads(done.stdout).items()}


def crowd(port, path, kind, hold):
    """Post a file sixty times at once; print how often which status came."""
    with open(path, "rb") as file:
        body = file.read()
    statuses, lock, start = {}, threading.Lock(), threading.Barrier(_AT_ONCE)

    def work():
        start.wait()
        status = post(port, body, kind, bool(hold))
        with lock:
            statuses[status] = statuses.get(status, 0) + 1

    threads = [threading.Thread(target=work) for _ in range(_AT_ONCE)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(json.dumps(statuses))


def post(port, body, kind, hold):
    """Status of one post; 0: there was no answer."""
    head = (
        f"POST /match HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    ).encode()
    with socket.create_connection(("127.0.0.1", port), timeout=120) as one:
        with contextlib.suppress(OSError):  # refused before it was read: the answer is there
            one.sendall(head + (body[:-1] if hold else body))
        try:
            if hold:
                one.settimeout(5.0)
            first = one.recv(4096)
            while one.recv(1 << 16):
                pass
        except OSError:
            first = b"" if not hold else b"HTTP/1.1 000"
    return int(first[9:12] or 0)


def idle(served):
    """Wait until no worker runs."""
    end = time.monotonic() + 120.0
    while len(family(served.process.pid)) > 1 and time.monotonic() < end:
        time.sleep(0.05)


def family(pid):
    """A process and those that it has started."""
    try:
        with open(f"/proc/{pid}/task/{pid}/children") as file:
            return [pid, *map(int, file.read().split())]
    except OSError:
        return [pid]


def memory(served):
    """Resident memory of the service and its worker, MB; what they share counts twice."""
    pages = 0
    for pid in family(served.process.pid):
        try:
            with open(f"/proc/{pid}/statm") as file:
                pages += int(file.read().split()[1])
        except OSError:
            continue
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Watch:
    """The most memory, looked at every 5 ms."""

    def __init__(self, served):
        self.most = 0.0
        self._served, self._stop = served, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._stop.wait(0.005):
            self.most = max(self.most, memory(self._served))

    def stop(self):
        """No more."""
        self._stop.set()
        self._thread.join()
