"""J1939: a message is told by its group of parameters (PGN); who sends it is not known before.

An id of 29 bits has the priority, the group, and the address of its sender.  A .dbc usually has FE
for that, which no sender has.
"""

import math
from collections.abc import Callable, Collection, Iterable
from typing import Any, NamedTuple

from .can_frames import EXTENDED

_LAST = 0xFF  # bits of the sender's address
_BROADCAST = 240  # from this number on the second byte of a group is a part of it


class Told(NamedTuple):
    """Of which sender a message is read, where the .dbc does not have that one."""

    message: str
    text: str
    others: bool  # whether others give values too, that are not read


def group_of(frame: int) -> int:
    """The number of the group (PGN) of an id; a destination in it is 0."""
    group = frame >> 8 & 0x3FFFF
    return group if group >> 8 & 0xFF >= _BROADCAST else group & 0x3FF00


def bare(frame: int) -> int:
    """An id without priority and destination, as `can_frames.key` makes it."""
    return EXTENDED | group_of(frame) << 8 | frame & _LAST


def mask_of(frame: int) -> int:
    """The bits of an id that tell its group, for a filter of frames."""
    return 0x3FFFF00 if group_of(frame) >> 8 & 0xFF >= _BROADCAST else 0x3FF0000


class Senders:
    """Which sender each message is read from: that of the .dbc, else the first that gives values.

    Several units may send one message, and say in it that they do not have what it is about.
    Until one gives a value, that of the .dbc is taken, else the first that is heard.

    Args:
        messages: cantools' descriptions of those that are needed.

    Attributes:
        news: Rises by one where something new is to be told.
    """

    def __init__(self, messages: Iterable[Any]) -> None:
        self._of_group: dict[int, dict[int, Any]] = {}  # group -> bare id of the .dbc -> message
        for message in messages:
            of_group = self._of_group.setdefault(group_of(message.frame_id), {})
            of_group[bare(message.frame_id)] = message
        self._heard: dict[int, list[int]] = {}  # group -> bare ids, in the order of coming
        # id of the .dbc -> those on the bus that gave values, the first one first
        self._gave = {ours: list[int]() for wanted in self._of_group.values() for ours in wanted}
        self.news = 0

    def take(self, frame: int, gives: Callable[[int], bool] = lambda _: True) -> list[int]:
        """A frame has come.

        Args:
            frame: Its id, of 29 bits.
            gives: Whether it has a value of a needed signal, if read as a message of the .dbc.

        Returns:
            Bare ids of the .dbc's messages that it is read as.
        """
        group = group_of(frame)
        if not (wanted := self._of_group.get(group)):
            return []
        frame = bare(frame)
        heard = self._heard.setdefault(group, [])
        if frame not in heard:
            heard.append(frame)
            self.news += 1
        for ours in wanted:
            if frame not in self._gave[ours] and gives(ours):
                self._gave[ours].append(frame)
                self.news += 1
        return [ours for ours in wanted if self._read(ours) == frame]

    def chosen(self, frames: Collection[int], first: Callable[[int, int], float]) -> dict[int, int]:
        """Which senders are read of a whole log.

        Args:
            frames: Ids that came, the first one first.
            first: When a frame, read as a message of the .dbc (given before it), has a value of
                a needed signal first, s; inf: never.

        Returns:
            Bare ids of the .dbc -> those that are read.
        """
        for frame in frames:
            if frame == bare(frame):
                self.take(frame, lambda _: False)
        for ours in self._gave:
            at = {frame: first(ours, frame) for frame in self._heard_of(ours)}
            self._gave[ours] = sorted((f for f in at if at[f] < math.inf), key=at.__getitem__)
        return {ours: self._read(ours) for ours in self._gave if self._heard_of(ours)}

    def _heard_of(self, ours: int) -> list[int]:
        return self._heard.get(group_of(ours), [])

    def _read(self, ours: int) -> int:
        """The id on the bus that a message of the .dbc is read from; its own if none came."""
        among = self._gave[ours] or self._heard_of(ours)
        return ours if ours in among or not among else among[0]

    def told(self) -> list[Told]:
        """What to tell of messages that are not read from the .dbc's sender."""
        found = []
        for group, wanted in self._of_group.items():
            for ours, message in wanted.items():
                read, gave = self._read(ours), self._gave[ours]
                if read == ours:
                    continue
                heard = self._heard[group]
                others = [frame for frame in heard if frame != read and frame in gave]
                mute = [frame for frame in heard if frame not in (read, ours, *gave)]
                text = f"read from source address {_address(read)}, as {_address(ours)} of the "
                text += f".dbc {'gives no value in' if ours in heard else 'does not send'} "
                text += f"PGN {group}"
                if others:
                    also = ", ".join(map(_address, others))
                    text += (
                        f"; {also} sends it too and is not read: write the address that is meant "
                        f"in the .dbc (id {message.frame_id & ~_LAST | others[0] & _LAST:08X} for "
                        f"{_address(others[0])})"
                    )
                if mute:
                    text += f"; {', '.join(map(_address, mute))} sends it without a value"
                found.append(Told(message.name, text, bool(others)))
        return found

    def heard(self) -> str:
        """Who sends the messages that came, for a log of which nothing can be used."""
        return " and ".join(
            f"{message.name} (PGN {group}) comes from source address "
            + ", ".join(
                _address(frame) + ("" if frame in self._gave[ours] else " without a value")
                for frame in self._heard[group]
            )
            for group in self._heard
            for ours, message in self._of_group[group].items()
        )


def _address(frame: int) -> str:
    return f"{frame & _LAST:02X}"


def unmarked(signals: Iterable[Any], frames: Iterable[int]) -> str:
    """What to do with ids of 29 bits that did not come, where others of their groups did.

    Args:
        signals: As `can.Signal`.
        frames: Bare ids that came.
    """
    hints = []
    for message in {s.message.name: s.message for s in signals if not s.j1939}.values():
        same = [f for f in frames if f & EXTENDED and group_of(f) == group_of(message.frame_id)]
        if message.is_extended_frame and same:
            hints.append(f"{message.name} from {', '.join(map(_address, same))}")
    if not hints:
        return ""
    return (
        f"by J1939 it has {' and '.join(hints)}; mark these messages in the .dbc by the attribute "
        "VFrameFormat (J1939PG), or write the sender's address in their ids"
    )
