"""Playback of recorded messages: its clock, its controls and its viewers.

The clock runs at `speed` times real time.  A viewer gets the newest message and may miss
some between.  No viewer slows the clock.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

import numpy as np

from ..live.message_types import EstimateMessage, PlayMessage
from .recorded_messages import RecordedMessages, Window
from .timeline import timeline
from .truth import Truth

Remake = Callable[[list[Window]], RecordedMessages]

TICK = 0.05  # s between updates of the clock
FASTEST = 100.0  # multiple of real time for `as fast as possible`
_MOMENT = 1e-3  # s, before now, where an open mask ends
_LATER = 1e12  # s since 1970; a mask that is not over


class Refused(ValueError):
    """A control that cannot be executed; the text is for the user."""


class Player:
    """Plays recorded messages to any number of viewers.

    Args:
        recorded: The messages.
        remake: Matches the drive again with fixes withheld in some windows; None: the drive
            is not known.
        position: Position at the beginning, s.
        paused: Whether playback begins paused.
        truth: Where the vehicle really was.

    Raises:
        DriveError: The truth is of another time.
    """

    def __init__(
        self,
        recorded: RecordedMessages,
        remake: Remake | None = None,
        *,
        position: float = 0.0,
        paused: bool = False,
        truth: Truth | None = None,
    ) -> None:
        self.recorded, self.truth = recorded, truth
        if truth is not None:
            truth.beside(recorded, np.zeros(0, np.int64))
        self._remake = remake
        self._windows: list[Window] = list(recorded.masked)
        self.position, self.speed, self.paused = position, 1.0, paused
        self._max = False
        self._seq, self._sent, self._edition = 0, -1, 0
        self._changed = asyncio.Condition()
        self._making = asyncio.Lock()
        self.message: EstimateMessage = recorded.message(recorded.at(position), 0, self._play())

    def _play(self) -> PlayMessage:
        return {
            "mode": "replay",
            "paused": self.paused,
            "speed": None if self._max else self.speed,
            "position_s": round(self.position, 3),
            "length_s": round(self.recorded.length, 3),
        }

    async def run(self) -> None:
        """Run the clock until cancelled."""
        last = time.monotonic()
        while True:
            await asyncio.sleep(TICK)
            now = time.monotonic()
            if not self.paused:
                ahead = (now - last) * (FASTEST if self._max else self.speed)
                await self._go(self.position + ahead)
            last = now

    async def _go(self, position: float, always: bool = False) -> None:
        """Set the position, and send a message if the epoch has changed."""
        self.position = min(max(position, 0.0), self.recorded.length)
        if self.position >= self.recorded.length:
            self.paused = True
        k = self.recorded.at(self.position)
        if k == self._sent and not always:
            return
        self._sent = k
        self._seq += 1
        self.message = self.recorded.message(k, self._seq, self._play())
        async with self._changed:
            self._changed.notify_all()

    async def messages(self) -> AsyncIterator[dict[str, Any]]:
        """Each new message, and a notice of each new timeline."""
        seen, edition = -1, self._edition
        while True:
            if self._edition != edition:
                edition = self._edition
                yield {"type": "timeline", "edition": edition}
            if self.message["seq"] != seen:
                seen = self.message["seq"]
                yield dict(self.message)
                continue
            async with self._changed:
                await self._changed.wait()

    def timeline(self) -> dict[str, Any]:
        """The thinned timeline of the drive, and whether fixes can be withheld."""
        columns = timeline(self.recorded, truth=self.truth)
        return {**columns, "maskable": self._remake is not None}

    async def open(self, recorded: RecordedMessages, remake: Remake | None) -> None:
        """Play another drive from its beginning, as the page's viewers asked."""
        async with self._making:
            self.recorded, self._remake, self.truth = recorded, remake, None
            self._windows = list(recorded.masked)
            self.position, self.paused = 0.0, False
            self._edition += 1
        await self._go(0.0, always=True)

    async def control(self, action: str, value: Any = None) -> None:
        """Execute a control.

        Args:
            action: mask, unmask, pause, resume, step, speed or seek.
            value: Of speed (times real time, None: as fast as possible) and of seek (s).

        Raises:
            Refused: It cannot be done.
        """
        match action:
            case "mask" | "unmask":
                await self._mask(action == "mask")
            case "pause" | "resume":
                self.paused = action == "pause"
                if not self.paused and self.position >= self.recorded.length:
                    self.position = 0.0
            case "step":
                self.paused = True
                k = min(self.recorded.at(self.position) + 1, len(self.recorded) - 1)
                self.position = float(self.recorded.time[k] - self.recorded.time[0])
            case "speed":
                self._max = value is None
                if value is not None:
                    self.speed = _number(value, "speed", 0.01, FASTEST)
            case "seek":
                self.position = _number(value, "seek", 0.0, 1e9)
            case _:
                raise Refused(f"action is {action!r:.40}; mask, pause, step ... were expected")
        await self._go(self.position, always=True)

    async def _mask(self, on: bool) -> None:
        """Withhold fixes from the position on, or stop doing so, and match again."""
        if self._remake is None:
            raise Refused("this is a result without its drive: replay the drive to mask GNSS")
        async with self._making:
            now = float(self.recorded.time[0]) + self.position
            kept = [(a, min(b, now - _MOMENT)) for a, b in self._windows if a < now - _MOMENT]
            if on:
                kept.append((now, _LATER))
            self._windows = kept
            self.recorded = await asyncio.to_thread(self._remake, list(kept))
            self._edition += 1


def _number(value: Any, name: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise Refused(f"{name}: a number from {low:g} to {high:g} was expected")
    return float(value)
