"""One sender a port: fixes of a second vehicle on the same port would be taken for the first's."""

import time
from typing import Any

_HELD = 3.0  # s of silence after which another sender may take over
_INTERVALS = 3.0  # usual intervals between its fixes, where that is longer
_LONGEST = 60.0  # s, at most


class OneSender:
    """Which of the senders of a port is listened to: the first that gives a fix.

    It holds the port until it leaves, or is silent for some seconds.  Connections that give no
    fix hold nothing, so rubbish cannot keep a receiver out.
    """

    def __init__(self) -> None:
        self._holder: Any = None
        self._heard = self._interval = 0.0

    def takes(self, sender: Any, now: float | None = None) -> bool:
        """Whether fixes of a sender are taken.

        Args:
            sender: Who sends them.
            now: s on a clock of one's own.
        """
        now = time.perf_counter() if now is None else now
        if self._holder is not None and self._holder is not sender:
            patience = min(max(_HELD, _INTERVALS * self._interval), _LONGEST)
            if now - self._heard <= patience:
                return False
            self._interval = 0.0
        elif self._holder is sender:
            self._interval = now - self._heard
        self._holder, self._heard = sender, now
        return True

    def hears(self, sender: Any) -> bool:
        """Whether readings of a sender's own sensors are taken: not beside another that holds."""
        return self._holder is None or self._holder is sender

    def leaves(self, sender: Any) -> None:
        """A sender is gone: the next that gives a fix is listened to."""
        if self._holder is sender:
            self._holder = None
