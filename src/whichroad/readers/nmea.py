"""NMEA 0183: one fix per epoch out of GGA, GST, RMC, VTG and ZDA of any talker.

Sentences with one time of day are one epoch, in whatever order a burst has them; VTG
has no time and belongs to the sentence before it.  The date comes from RMC or ZDA and
is carried over midnight.
"""

from collections import Counter
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from ..errors import ReadError
from ..records import Array, Drive, Fixes, GeoFix
from ..settings import Settings
from .door import BACKWARDS, REPEATED, Bools, Ints, Skipped, keep, read_bytes
from .fixes import Reported, as_records, from_gst, make_fixes
from .sentences import Sentences, scan

_BLOCK = 1 << 22  # bytes scanned at once
_LONGEST_LINE = 1 << 16  # bytes without a line break that a stream may hold back
_DAY = 86_400_000  # ms
_NO_FIX = "epoch without a fix"
# Later types overwrite: GGA's position is the finer one, RMC's date and speed the surer.
_ORDER = ("ZDA", "VTG", "RMC", "GGA", "GST")


def read_nmea(path: str | PathLike[str], settings: Settings | None = None) -> Drive:
    """Read an NMEA 0183 log.

    Args:
        path: The log; binary messages between sentences are passed over.
        settings: Gives the range error and the sigma of fixes that report none.

    Raises:
        ReadError: The file cannot be read or holds no good sentence of a known type.
    """
    where, data = Path(path).name, read_bytes(path)
    parser = NmeaParser(settings)
    batches = []
    begin = 0
    while begin < len(data):
        end = data.rfind(b"\n", begin, begin + _BLOCK) + 1
        if end == 0 or begin + _BLOCK >= len(data):
            end = min(begin + _BLOCK, len(data))
        batches.append(scan(data[begin:end], parser.skipped, parser.others, begin))
        begin = end
    sentences = _concatenate(batches)
    if not sentences.keys() & {"GGA", "RMC"}:
        seen = ", ".join(f"{n} {k}" for k, n in (parser.skipped + parser.others).items())
        raise ReadError(
            f"{where}: no GGA or RMC sentence ({seen or 'nothing like NMEA'}); "
            "an NMEA 0183 log was expected; is this the right file?"
        )
    fixes = parser.fixes(sentences)
    return Drive(
        drive_id=Path(path).stem,
        fixes=fixes,
        sources=(str(path),),
        skipped=dict(parser.skipped),
        notes=parser.notes(),
    )


class NmeaParser:
    """NMEA bytes in, fixes out, with bounded memory.

    Feed whatever the receiver sends, in pieces of any size.  A fix comes out when the
    first sentence of the next epoch has arrived, or with `flush` when the line falls
    silent.

    Attributes:
        skipped: How many sentences were not used, by reason.
        others: How many good sentences were of types that are not needed.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.skipped: Skipped = Counter()
        self.others: Counter[str] = Counter()
        self._settings = settings or Settings()
        self._calendar = _Calendar()
        self._line = b""
        self._place = 0
        self._waiting: dict[str, Sentences] = {}
        self._last = -np.inf

    def feed(self, data: bytes) -> list[GeoFix]:
        """Take the next bytes; returns the fixes of the epochs that they complete."""
        data = self._line + data
        end = data.rfind(b"\n") + 1
        if end == 0 and len(data) > _LONGEST_LINE:
            end = len(data)
        self._line = data[end:]
        if end == 0:
            return []
        found = scan(data[:end], self.skipped, self.others, self._place)
        self._place += end
        self._waiting = _concatenate([self._waiting, found])
        begin = _last_epoch(self._waiting)
        if begin < 0:  # untimed sentences only
            self._waiting = {}
            return []
        done = {kind: s.before(begin) for kind, s in self._waiting.items()}
        self._waiting = {kind: s.after(begin) for kind, s in self._waiting.items()}
        return self._emit(done)

    def flush(self) -> list[GeoFix]:
        """The fix of the burst that has ended; call it when the line is silent."""
        done, self._waiting = self._waiting, {}
        return self._emit(done)

    def _emit(self, sentences: dict[str, Sentences]) -> list[GeoFix]:
        fixes = []
        for fix in as_records(self.fixes(sentences)):
            if fix.time > self._last:
                self._last = fix.time
                fixes.append(fix)
            else:
                self.skipped["time running backwards"] += 1
        return fixes

    def fixes(self, sentences: dict[str, Sentences]) -> Fixes:
        """The fixes of whole epochs; the date is carried from call to call."""
        epochs = _join(sentences, self._calendar, self.skipped)
        reported = _report(epochs, self.skipped)
        return make_fixes(reported, self._settings, self.skipped)

    def notes(self) -> tuple[str, ...]:
        """What a reader of the result should know."""
        notes = []
        if self.others:
            kinds = ", ".join(f"{count} {kind}" for kind, count in self.others.most_common(8))
            notes.append(f"sentences not needed: {kinds}")
        if not self._calendar.dated:
            notes.append("no date in the log (no RMC, no ZDA): days are counted from 1970-01-01")
        return tuple(notes)


@dataclass(slots=True)
class _Calendar:
    """The day of the last sentence; `day` counts from 1970."""

    tod: float = np.nan  # ms
    day: int = 0
    dated: bool = False

    def days(self, tod: Array, said: Array) -> Ints:
        """The day of each sentence in log order.

        Time of day falling by more than half a day is midnight.  Days before the first
        date are counted back from it.

        Args:
            tod: Time of day, ms, shape (n,).
            said: Day that this sentence's epoch says, NaN: none.
        """
        before = np.concatenate([[tod[0] if np.isnan(self.tod) else self.tod], tod[:-1]])
        step = tod - before
        midnights = np.cumsum((step < -_DAY / 2).astype(np.int64) - (step > _DAY / 2))
        known = np.flatnonzero(~np.isnan(said))
        base = np.full(len(tod), self.day, np.int64)
        if len(known):
            latest = np.searchsorted(known, np.arange(len(tod)), side="right") - 1
            if not self.dated:
                latest = np.maximum(latest, 0)
            dates = said[known].astype(np.int64) - midnights[known]
            base = np.where(latest >= 0, dates[np.maximum(latest, 0)], base)
            self.dated = True
        days: Ints = base + midnights
        self.tod, self.day = float(tod[-1]), int(days[-1])
        return days


def _concatenate(batches: list[dict[str, Sentences]]) -> dict[str, Sentences]:
    """Batches of sentences, one behind the other."""
    joined = {}
    for kind in _ORDER:
        parts = [batch[kind] for batch in batches if kind in batch]
        if len(parts) == 1:
            joined[kind] = parts[0]
        elif parts:
            joined[kind] = Sentences(
                np.concatenate([p.order for p in parts]),
                np.concatenate([p.tod for p in parts]),
                {k: np.concatenate([p.columns[k] for p in parts]) for k in parts[0].columns},
            )
    return joined


def _in_log_order(sentences: dict[str, Sentences]) -> tuple[Ints, Array]:
    """Order and time of all sentences as the log has them, VTG with its neighbour's time."""
    order = np.concatenate([s.order for s in sentences.values()])
    tod = np.concatenate([s.tod for s in sentences.values()])
    rank = np.argsort(order, kind="stable")
    order, tod = order[rank], tod[rank]
    timed = np.flatnonzero(~np.isnan(tod))
    if len(timed):
        latest = np.searchsorted(timed, np.arange(len(tod)), side="right") - 1
        tod = tod[timed[np.maximum(latest, 0)]]
    return order, tod


def _last_epoch(sentences: dict[str, Sentences]) -> int:
    """Place in the log where the last epoch begins, -1 where no sentence has a time."""
    if not any(len(s.order) for s in sentences.values()):
        return -1
    order, tod = _in_log_order(sentences)
    if np.isnan(tod[-1]):
        return -1
    changes = np.flatnonzero(np.diff(tod))
    return int(order[changes[-1] + 1]) if len(changes) else int(order[0])


def _join(
    sentences: dict[str, Sentences], calendar: _Calendar, skipped: Skipped
) -> dict[str, Array]:
    """One row per epoch, NaN where no sentence says anything; `time` in s."""
    sentences = {kind: sentences[kind] for kind in _ORDER if kind in sentences}
    if not any(np.isfinite(s.tod).any() for s in sentences.values()):
        return {}
    order, tod = _in_log_order(sentences)
    run = np.concatenate([[0], np.cumsum(np.diff(tod) != 0)])  # sentences side by side, one time
    begin = np.flatnonzero(np.diff(run, prepend=-1))
    said = np.full(len(begin), np.nan)
    for kind in ("ZDA", "RMC"):
        if kind in sentences:
            mine = run[np.searchsorted(order, sentences[kind].order)]
            day = sentences[kind].columns["day"]
            said[mine[~np.isnan(day)]] = day[~np.isnan(day)]
    key = calendar.days(tod[begin], said) * _DAY + tod[begin].astype(np.int64)
    times, epoch_of_run = np.unique(key, return_inverse=True)

    epochs = {"time": times / 1e3, "late": _late(epoch_of_run)}
    for kind, sentence in sentences.items():
        epoch = epoch_of_run[run[np.searchsorted(order, sentence.order)]]
        if kind == ("GGA" if "GGA" in sentences else "RMC"):
            repeated = len(epoch) - len(np.unique(epoch))
            skipped.update({REPEATED: repeated} if repeated else {})
        for name, values in sentence.columns.items():
            said_here = ~np.isnan(values)
            column = epochs.setdefault(name, np.full(len(times), np.nan))
            column[epoch[said_here]] = values[said_here]
    return epochs


def _late(epoch_of_run: Ints) -> Array:
    """1 where an epoch came after a later one, else 0; times that return count once."""
    _, first = np.unique(epoch_of_run, return_index=True)
    appearance = np.argsort(first)  # epochs in the order in which they first came
    late = np.zeros(len(first))
    late[appearance] = appearance < np.maximum.accumulate(appearance)
    return late


def _report(epochs: dict[str, Array], skipped: Skipped) -> Reported:
    """What the epochs with a fix say."""
    n = len(epochs.get("time", ()))

    def column(name: str) -> Array:
        return epochs.get(name, np.full(n, np.nan))

    quality = column("quality")
    from_gga = ~np.isnan(quality)
    lat = np.where(from_gga, column("lat"), column("rmc_lat"))
    lon = np.where(from_gga, column("lon"), column("rmc_lon"))
    fix: Bools = ~(np.isnan(lat) | np.isnan(lon)) & ~(quality == 0)
    keep(fix, _NO_FIX, skipped)
    late = int(np.count_nonzero(column("late")[fix] == 1))
    if late:
        skipped[BACKWARDS] += late
    # RMC says when its speed is not to be trusted
    speed = np.where(column("status") == 0, np.nan, column("speed"))
    ellipse = ("sigma_lat", "sigma_lon", "major", "minor", "orientation")
    cov_ee, cov_en, cov_nn, doubt = from_gst(*(column(name) for name in ellipse))
    rows = np.flatnonzero(fix)
    return Reported(
        time=column("time"),
        lat_deg=lat,
        lon_deg=lon,
        cov_ee=cov_ee,
        cov_en=cov_en,
        cov_nn=cov_nn,
        no_correlation=doubt,
        hdop=column("hdop"),
        speed=speed,
        bearing_deg=column("course"),
    ).rows(rows)
