"""J1939: a message is told by its group of parameters (PGN); who sends it is not known before.

An id of 29 bits has the priority, the group, and the address of its sender.  A .dbc usually has FE
for that, which no sender has.
"""

from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

from .can_frames import EXTENDED

_LAST = 0xFF  # bits of the sender's address
_BROADCAST = 240  # from this number on the second byte of a group is a part of it


class Told(NamedTuple):
    """Of which sender a message is read, where the .dbc does not have that one."""

    message: str
    text: str
    others: bool  # whether others send it too, that are not read


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
    """Which sender each message is read from: that of the .dbc, else the first that is heard.

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
        self._chosen: dict[int, int] = {}  # bare id of the .dbc -> that on the bus
        self._heard: dict[int, list[int]] = {}  # group -> bare ids, in the order of coming
        self.news = 0

    def take(self, frame: int) -> list[int]:
        """A frame has come.

        Args:
            frame: Its id, of 29 bits.

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
                if ours == frame or ours not in self._chosen:
                    self._chosen[ours] = frame
        return [ours for ours in wanted if self._chosen[ours] == frame]

    def chosen(self, frames: Collection[int]) -> dict[int, int]:
        """Bare ids of the .dbc -> those that are read, of all that came, the first one first."""
        for frame in frames:
            if frame == bare(frame):
                self.take(frame)
        return dict(self._chosen)

    def told(self) -> list[Told]:
        """What to tell of messages that the .dbc's sender does not send."""
        found = []
        for group, wanted in self._of_group.items():
            for ours, message in wanted.items():
                read = self._chosen.get(ours, ours)
                if read == ours:
                    continue
                others = [frame for frame in self._heard[group] if frame != read]
                text = f"read from source address {_address(read)}, as {_address(ours)} of the "
                text += f".dbc does not send PGN {group}"
                if others:
                    also = ", ".join(map(_address, others))
                    text += (
                        f"; {also} sends it too and is not read: write the address that is meant "
                        f"in the .dbc (id {message.frame_id & ~_LAST | others[0] & _LAST:08X} for "
                        f"{_address(others[0])})"
                    )
                found.append(Told(message.name, text, bool(others)))
        return found


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
