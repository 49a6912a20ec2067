"""The last minutes of messages, for whoever comes later."""

import json
import math
from collections import deque

from .message_types import VERSION, EstimateMessage

KEPT = 300.0  # s of event time that are kept
SPACING = 0.2  # s of event time between the messages that are kept
_MOST_BYTES = 8 * 1024 * 1024  # of messages, at most; older ones are dropped before


class History:
    """A sink of a filter loop that keeps some of its messages.

    Args:
        kept: s of event time that are kept.
        spacing: s of event time between those that are kept.
    """

    def __init__(self, kept: float = KEPT, spacing: float = SPACING) -> None:
        self._kept, self._spacing = kept, spacing
        self._texts: deque[tuple[float, bytes]] = deque()
        self._size = 0

    def __len__(self) -> int:
        return len(self._texts)

    def send(self, text: bytes, message: EstimateMessage) -> None:
        """Keep a message, if one is due."""
        when = message["epoch_s"]
        newest = self._texts[-1][0] if self._texts else -math.inf
        if when < newest:  # a recording was sought back, or all clocks were set back
            self._texts.clear()
            self._size = 0
        elif when - newest < self._spacing - 1e-6:
            return
        self._texts.append((when, text))
        self._size += len(text)
        while self._texts[0][0] < when - self._kept or self._size > _MOST_BYTES:
            self._size -= len(self._texts.popleft()[1])

    def since(self, seconds: float, every: float = 0.0) -> list[bytes]:
        """Messages of so many last seconds, in order, at least `every` seconds apart."""
        if not self._texts:
            return []
        begin, last, found = self._texts[-1][0] - seconds, -math.inf, []
        for when, text in self._texts:
            if when >= begin and when - last >= every - 1e-6:
                found.append(text)
                last = when
        return found


def history_json(texts: list[bytes]) -> bytes:
    """The answer of `/history`."""
    head = json.dumps({"version": VERSION, "type": "history"})[:-1].encode()
    return head + b', "estimates": [' + b",".join(texts) + b"]}"
