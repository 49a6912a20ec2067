"""Where the bursts of a stream of NMEA sentences end, and whose sentences are mixed."""

from collections import Counter
from itertools import islice

from .nmea_sentences import TYPES, Sentences, joined

_SURE = 3  # bursts that must end alike before their end is known
_LONGEST = 1000  # sentences that a stream may hold back
_KEPT = 64  # bursts whose types of sentences are kept
_USUAL = 16  # the last of these, which tell what a burst holds
_SELDOM = 0.25  # part of the bursts up to which a type is not waited for
_PATIENCE = 500.0  # ms by which a burst among mixed ones may be behind the newest
_SET_BACK = -60_000.0  # ms by which one is ahead where the clock was set back
_MIXED = 100  # bursts after which sentences count as mixed no more
_DAY = 86_400_000.0  # ms
_NONE = 0  # no type of sentence
_UNTIMED = TYPES["VTG"].code


class Bursts:
    """Sentences wait here until their burst has ended; those with one time of day are one burst.

    The next burst ends one, and so does silence, or the type of sentence that ended three
    bursts.  Where sentences of different bursts come mixed, as datagrams do, a burst ends when
    it holds the usual types, or is half a second behind the newest.
    """

    def __init__(self) -> None:
        self._waiting: list[Sentences] = []
        self._keys: list[float] = []  # the time of day of each that waits, ms; NaN: of none
        self._types: dict[float, set[int]] = {}  # of the last bursts, by their times
        self._open: dict[float, None] = {}  # times of bursts that have begun, in order
        self._at: float | None = None  # time of the last sentence
        self._out: float | None = None  # time of the burst that ended last
        self._newest = _NONE  # type of the last sentence
        self._known = _NONE  # type that ends a burst
        self._seen, self._times = _NONE, 0  # type that ended the last bursts, and how many
        self._mixed = 0  # bursts for which sentences still count as mixed

    def __len__(self) -> int:
        """How many sentences wait."""
        return len(self._keys)

    def take(self, found: Sentences) -> Sentences | None:
        """Take sentences as they come; returns those of bursts that have ended, if there are."""
        self._waiting.append(found)
        for code, tod in zip(found.code.tolist(), found.tod.tolist(), strict=True):
            key = self._key(code, tod)
            self._keys.append(key)
            if key != key:
                continue
            self._at, self._newest = key, code
            self._types[key].add(code)
            if self._mixed:
                self._end_mixed(key)
            elif code == self._known:
                self._end(key)
        if len(self._keys) > _LONGEST and self._open:
            self._open.clear()
        return self._ended()

    def pause(self) -> Sentences | None:
        """Nothing comes any more for a while; mixed sentences may still."""
        return None if self._mixed else self.flush()

    def flush(self) -> Sentences | None:
        """Nothing follows: all that waits."""
        if not self._mixed:
            self._learn()
        for tod in list(self._open):
            self._end(tod)
        return self._ended()

    def _key(self, code: int, tod: float) -> float:
        """The burst of a sentence, which begins where it is new; NaN: of none."""
        if tod != tod:
            return self._at if self._at is not None and self._at in self._open else tod
        if tod in self._open:
            if self._mixed and tod != self._at:
                self._mixed = _MIXED
            return tod
        others = tod != self._out
        if not self._mixed and self._open:
            others = True
            self._learn()
            for one in list(self._open):
                self._end(one)
        if tod in self._types:  # it was believed to have ended
            self._known, self._seen, self._times = _NONE, _NONE, 0
            if others and code not in self._types[tod]:
                self._mixed = _MIXED
        else:
            self._mixed = max(self._mixed - 1, 0)
            if len(self._types) >= _KEPT:
                oldest = next((one for one in self._types if one not in self._open), None)
                if oldest is not None:
                    del self._types[oldest]
            self._types[tod] = set()
        self._open[tod] = None
        return tod

    def _end_mixed(self, newest: float) -> None:
        """End what is complete, or has waited for long."""
        last = list(islice(reversed(self._types.values()), _USUAL))
        counts = Counter(code for codes in last for code in codes)
        usual = {code for code, n in counts.items() if n > _SELDOM * len(last)}
        known = len(last) > _SURE
        for tod in list(self._open):
            behind = (newest - tod + _DAY / 2) % _DAY - _DAY / 2
            waited = behind >= _PATIENCE or behind < _SET_BACK
            if waited or (known and usual <= self._types[tod]):
                self._end(tod)

    def _learn(self) -> None:
        """The open burst has ended, as silence or the next burst shows."""
        if self._open:
            self._times = self._times + 1 if self._newest == self._seen else 1
            self._seen = self._newest
            self._known = self._newest if self._times >= _SURE else _NONE

    def _end(self, tod: float) -> None:
        self._out = tod
        del self._open[tod]

    def _ended(self) -> Sentences | None:
        """The waiting sentences of bursts that are open no more."""
        out = [key not in self._open for key in self._keys]
        if not any(out):
            return None
        ended, others = joined(self._waiting).parted(out)
        self._waiting = [others] if len(others) else []
        self._keys = [key for key, gone in zip(self._keys, out, strict=True) if not gone]
        return ended
