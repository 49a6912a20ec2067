"""One sender a port: fixes of a second vehicle on the same port would be taken for the first's."""

import math
import time
from typing import Any

from .troubles import Troubles

_HELD = 3.0  # s of silence after which another sender may take over
_INTERVALS = 3.0  # usual intervals between its fixes, where that is longer
_LONGEST = 60.0  # s, at most
_MANY, _LONG = 10, 5.0  # refused fixes of others, and s over which they came, that are told
_TOLD = 60.0  # s for which something is told after it was
_CHANGED, _BESIDE = "another sender", "a second sender"


class OneSender:
    """Which of the senders of a port is listened to: the first that gives a fix.

    It holds the port until it leaves, or is silent for some seconds.  Who was refused beside it
    waits as long where it leaves, as it may connect again at once.  Connections that give no
    fix hold nothing, so rubbish cannot keep a receiver out.

    Args:
        port: Its name, for people.
        troubles: Where it is told that another sender has taken over, and that fixes are refused.

    A sender is anything that can be a key.  As text it is its address, the host before a colon.
    """

    def __init__(self, port: str = "", troubles: Troubles | None = None) -> None:
        self._port, self._troubles = port, troubles or Troubles()
        self._holder: Any = None
        self._last = ""  # who held it last
        self._heard, self._interval = -math.inf, 0.0
        self._refused: set[Any] = set()  # senders that were, beside one that held
        self._since = self._changed = self._unheard = -math.inf  # s: refusals, a change, the last
        self._count = 0  # fixes that were refused since then

    def takes(self, sender: Any, now: float | None = None) -> bool:
        """Whether fixes of a sender are taken.

        Args:
            sender: Who sends them.
            now: s on a clock of one's own.
        """
        now = time.perf_counter() if now is None else now
        if self._waits(sender, now):
            self._refused.add(sender)
            self._tell_refused(sender, now)
            return False
        if self._holder == sender:
            self._interval = now - self._heard
        else:
            self._interval = 0.0 if self._holder is not None else self._interval
            self._tell_change(sender, now)
            self._refused.discard(sender)
        self._holder, self._last, self._heard = sender, str(sender), now
        self._forget(now)
        return True

    def hears(self, sender: Any, now: float | None = None) -> bool:
        """Whether readings of a sender's own sensors are taken: not beside another that holds."""
        now = time.perf_counter() if now is None else now
        return self._holder == sender or (self._holder is None and not self._waits(sender, now))

    def leaves(self, sender: Any) -> None:
        """A sender is gone: the next that gives a fix is listened to, if it is new."""
        self._refused.discard(sender)
        if self._holder == sender:
            self._holder = None

    def _waits(self, sender: Any, now: float) -> bool:
        """Whether another one holds the port, or has just left it and may be back."""
        if self._holder == sender or (self._holder is None and sender not in self._refused):
            return False
        return now - self._heard <= min(max(_HELD, _INTERVALS * self._interval), _LONGEST)

    def _tell_change(self, sender: Any, now: float) -> None:
        """Another vehicle perhaps; a receiver that has connected again is not told."""
        again = sender not in self._refused and _host(str(sender)) == _host(self._last)
        if not self._last or again:
            return
        if now - self._changed > _TOLD:
            reason = (
                f"fixes are those of {sender} now; {self._last} had been silent for "
                f"{now - self._heard:.1f} s"
            )
            self._tell(_CHANGED, reason)
        self._changed, self._count = now, 0

    def _tell_refused(self, sender: Any, now: float) -> None:
        """Many fixes of others are, for a while."""
        if not self._count or now - self._unheard > _TOLD:
            self._since, self._count = now, 0
        self._unheard, self._count = now, self._count + 1
        if self._count >= _MANY and now - self._since >= _LONG:
            reason = f"fixes of others are refused, as those of {self._last} are taken"
            self._tell(_BESIDE, reason, f" (those of {sender})")

    def _tell(self, what: str, reason: str, more: str = "") -> None:
        what = f"{self._port}, {what}"
        line = f"{what}: {reason}{more}; give each vehicle a port and a name of its own"
        self._troubles.begin(what, reason, line)

    def _forget(self, now: float) -> None:
        """Nothing of it has happened for a while."""
        for what, at in ((_CHANGED, self._changed), (_BESIDE, self._unheard)):
            if now - at > _TOLD:
                what = f"{self._port}, {what}"
                self._troubles.end(what, f"{what}: not for {_TOLD:g} s")


def _host(sender: str) -> str:
    return sender.rpartition(":")[0]
