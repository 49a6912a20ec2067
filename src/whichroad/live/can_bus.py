"""A CAN bus, frame by frame; what is needed and does not come on it is told."""

import threading
import time
from collections.abc import Callable
from typing import Any

from ..readers.can_frames import EXTENDED, key
from ..readers.j1939 import Told, mask_of
from .addresses import Address
from .decode import CanStream
from .health import Health
from .sources import FIRST, Deliver, in_thread, reason_of

_ABSENT = 10.0  # s without a frame that is needed, after which that is told


async def read_can(address: Address, health: Health, stream: CanStream, deliver: Deliver) -> None:
    """Read a CAN bus in a thread of its own, for ever."""
    import can

    wanted = filters_of(stream)
    watch = BusWatch(health, stream)

    def work(stop: threading.Event, pass_on: Callable[[Any, float], None]) -> None:
        wait = FIRST
        while not stop.is_set():
            try:
                with can.Bus(
                    interface=address.interface, channel=address.place, can_filters=wanted
                ) as bus:
                    wait = FIRST
                    health.open()
                    while not stop.is_set():
                        if (frame := bus.recv(0.2)) is not None:
                            pass_on(frame, time.perf_counter())
            except (can.CanError, OSError, ValueError) as error:
                health.lose(reason_of(error))
            stop.wait(wait)
            wait = min(2.0 * wait, 1.0)

    def take(frame: Any, arrival: float) -> None:
        if frame.is_error_frame or frame.is_remote_frame:
            return
        name = key(frame.arbitration_id, frame.is_extended_id)
        readings = stream.feed(name, frame.timestamp, bytes(frame.data))
        health.open()
        health.skipped_why = stream.skipped_why
        if readings:
            deliver(health, readings, arrival)

    await in_thread(work, take, watch.look)


def filters_of(stream: CanStream) -> list[dict[str, Any]]:
    """Filters of python-can for the frames that a stream needs: of J1939 those of any sender."""
    return [
        {
            "can_id": one.frame & ~EXTENDED,
            "can_mask": mask_of(one.frame) if one.j1939 else 0x1FFFFFFF,
            "extended": bool(one.frame & EXTENDED),
        }
        for one in {signal.frame: signal for signal in stream.signals}.values()
    ]


class BusWatch:
    """Tells which frames that are needed do not come, and who sends those of J1939.

    Args:
        health: Of the bus.
        stream: Its decoder.
    """

    def __init__(self, health: Health, stream: CanStream) -> None:
        self._health, self._stream = health, stream
        self._frames = {signal.frame: signal for signal in stream.signals}
        self._last: dict[int, float] = {}  # frame -> s, when it came last
        self._since: float | None = None  # s, from which on the bus is open
        self._said: set[str] = set()  # lines that are told once
        self._news = 0
        self._told: dict[str, Told] = {}  # message -> its sender, where not that of the .dbc

    def look(self, now: float | None = None) -> None:
        """Look at what has come; to be called now and then.

        Args:
            now: s on the clock of `time.perf_counter`.
        """
        now = time.perf_counter() if now is None else now
        came, self._stream.came = self._stream.came, set()
        self._last.update(dict.fromkeys(came, now))
        if self._news != self._stream.senders.news:
            self._news = self._stream.senders.news
            self._tell_senders()
        if self._health.link != "open":
            self._since = None
            return
        since = self._since = now if self._since is None else self._since
        quiet = [
            frame for frame in self._frames
            if now - max(self._last.get(frame, since), since) >= _ABSENT
        ]  # fmt: skip
        age = self._health.age(now)
        if len(quiet) < len(self._frames) and age is not None and age < _ABSENT:
            for frame in quiet:
                if frame not in self._last:
                    self._say(f"no frame {self._frames[frame].where} has come")
            quiet = []
        self._tell_absent(quiet)

    def _tell_absent(self, quiet: list[int]) -> None:
        health, what = self._health, f"{self._health.name}, frames"
        if not quiet:
            health.troubles.end(what, f"{what}: those that are needed come")
            return
        signals = [self._frames[frame] for frame in quiet]
        reason = (
            f"none came for {_ABSENT:g} s of {', '.join(sorted(one.where for one in signals))}; "
            "bus, bit rate and .dbc that fit the vehicle were expected"
        )
        if any(frame & EXTENDED and not self._frames[frame].j1939 for frame in quiet):
            reason += "; a .dbc marks messages of J1939 by VFrameFormat (J1939PG)"
        health.troubles.begin(what, reason, f"{what}: {reason}")

    def _tell_senders(self) -> None:
        health = self._health
        told = {one.message: one for one in self._stream.senders.told()}
        for message, one in told.items():
            what = f"{health.name}, {message}"
            if one.others:
                health.troubles.begin(what, one.text, f"{what}: {one.text}")
            else:
                self._say(f"{message} is {one.text}")
        for message in self._told.keys() - told.keys():
            what = f"{health.name}, {message}"
            line = f"{what}: the sender of the .dbc is heard now, and read"
            if health.troubles.holds(what):
                health.troubles.end(what, line)
            else:
                health.troubles.report(line)
        self._told = told

    def _say(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            self._health.troubles.report(f"{self._health.name}: {line}")
