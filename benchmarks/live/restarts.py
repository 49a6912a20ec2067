"""kill -9 and restart, again and again: the time of what is published, on every output."""

import heapq
import http.client
import itertools
import json
import random
import socket
import threading
import time

from websockets.sync.client import connect

from whichroad.evaluate.input_tables import read_table
from whichroad.readers.nmea import NmeaParser

from .. import Figure, Options
from .process import Receiver, Served, bus, can_options
from .world import FRAME, burst, payload, world

_JITTER = 0.3  # s, longest delay of an observation


def restarts(options: Options) -> list[Figure]:
    """Half of the kills with 10 Hz GNSS and wheels, half with two receivers at 1 Hz alone."""
    times = int(options.more.get("drives", 10))
    figures: list[Figure] = []
    for name, wheels, every in (
        ("10 Hz and wheels", True, 1),
        ("two receivers of 1 Hz", False, 10),
    ):
        figures += killed(options, name, (times + 1) // 2, wheels, every)
    return figures


def killed(options, name, times, wheels, every):
    """Figures of one set of sensors."""
    rng = random.Random(times + every)
    with world(30_000.0) as here:
        receivers = [Receiver(), Receiver()]
        sources = [x for r in receivers for x in ("--nmea", f"tcp://127.0.0.1:{r.port}")]
        sources += can_options(here) if wheels else ()
        keep = ("--record", here.folder / "rec", "--state", here.folder / "state")
        feed = Late(here, receivers, wheels, every)
        outputs = Outputs(feed)
        for number in range(times + 1):
            served = Served(
                *here.options(), *sources, *keep, "--nmea-out", "tcp://127.0.0.1:0", out=True
            )
            outputs.follow(served)
            served.answered()
            time.sleep(rng.uniform(0.7, 3.0) + 0.1 * every)
            served.kill()
            outputs.join()
            options.say(f"{name}, kill {number}: {len(outputs.heard['websocket'])} messages")
        feed.stop()
        for receiver in receivers:
            receiver.close()
        recorded = [
            (when.timestamp(), when.timestamp(), 0.0)
            for when in read_table(here.folder / "rec")["time"].to_pylist()
        ]
    figures = []
    for output, rows in {**outputs.heard, "recording": recorded}.items():
        backwards = sum(b[0] < a[0] - 1e-6 for a, b in itertools.pairwise(rows))
        figures.append(
            Figure(f"{name}: {output}, times that go back", float(backwards), "<= 0", "", len(rows))
        )
        if output == "recording":
            continue
        future = max(epoch - clock for epoch, clock, _ in rows)
        beyond = max(epoch - newest for epoch, _, newest in rows)
        figures += [
            Figure(f"{name}: {output}, ahead of the clock, worst", future, "<= 0", "s", len(rows)),
            Figure(f"{name}: {output}, ahead of the newest observation, worst", beyond,
                   "<= 1.31" if every > 1 else "<= 0.5", "s", len(rows)),
        ]  # fmt: skip
    forgets = sum(b[0] < a[0] - 1e-6 for a, b in itertools.pairwise(outputs.heard["websocket"]))
    flagged = 100.0 * outputs.dead / max(outputs.messages, 1)
    return [
        *figures,
        Figure(f"{name}: the page forgets its track", float(forgets), "<= 0", "", times),
        Figure(f"{name}: messages called dead reckoning", flagged, "", "%", outputs.messages),
        Figure(f"{name}: kills", float(times), "", "", times),
    ]


class Late:
    """Fixes of two receivers, each delayed on its own, so that they come in another order."""

    def __init__(self, here, receivers, wheels, every):
        self.newest = 0.0  # time of the newest observation that was sent
        self._world, self._receivers, self._every = here, receivers, every
        self._bus = bus() if wheels else None
        self._stop = threading.Event()
        self._begin = round(time.time() + 0.2, 1)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        log, fixes = self._world.drive.odometry, self._world.drive.fixes
        rng, coming = random.Random(7), []
        for number in range(0, len(fixes), self._every):
            for side in range(2):
                when = self._begin + 0.1 * number
                heapq.heappush(coming, (when + rng.uniform(0.0, _JITTER), number, side, when))
        row = 0
        while coming and not self._stop.is_set():
            due = self._begin + 0.01 * row if self._bus is not None else float("inf")
            at = min(due, coming[0][0])
            if (wait := at - time.time()) > 0 and self._stop.wait(wait):
                break
            if at == due:
                if row < len(log.time):
                    self._turn(payload(log, row))
                row += 1
                continue
            _, number, side, when = heapq.heappop(coming)
            self.newest = max(self.newest, when)
            try:
                self._receivers[side].send(burst(fixes, number, when))
            except OSError:
                continue
        if self._bus is not None:
            self._bus.shutdown()

    def _turn(self, data):
        import can

        self.newest = max(self.newest, time.time())
        self._bus.send(can.Message(arbitration_id=FRAME, data=data, is_extended_id=False))

    def stop(self):
        """No more."""
        self._stop.set()
        self._thread.join()


class Outputs:
    """Time of the estimate, of the clock and of the newest observation, for every message."""

    def __init__(self, feed):
        self.heard = {"websocket": [], "estimate": [], "NMEA": []}
        self.dead = self.messages = 0
        self._feed, self._threads = feed, []

    def follow(self, served):
        """Listen to a service until it is killed."""
        works = (self._websocket, self._poll, self._nmea)
        self._threads = [threading.Thread(target=work, args=(served,)) for work in works]
        for thread in self._threads:
            thread.start()

    def join(self):
        """Wait until all have heard the end."""
        for thread in self._threads:
            thread.join()

    def _note(self, output, epoch):
        self.heard[output].append((epoch, time.time(), self._feed.newest))

    def _websocket(self, served):
        try:
            with connect(f"ws://127.0.0.1:{served.port}/ws") as one:
                while True:
                    said = json.loads(one.recv(timeout=30))
                    self._note("websocket", said["epoch_s"])
                    self.messages += 1
                    self.dead += said["dead_reckoning"]
        except Exception:
            return

    def _poll(self, served):
        while True:
            try:
                said = served.get("/estimate")
            except (OSError, http.client.HTTPException):
                return
            if said:
                self._note("estimate", said["epoch_s"])
            time.sleep(0.05)

    def _nmea(self, served):
        parser = NmeaParser(today=time.time())
        try:
            with socket.create_connection(("127.0.0.1", served.out), timeout=30) as one:
                while data := one.recv(65536):
                    for fix in parser.feed(data):
                        self._note("NMEA", fix.time)
        except OSError:
            return
