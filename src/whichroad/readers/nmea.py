"""NMEA 0183: one fix per epoch out of GGA, GNS, GST, RMC, VTG and ZDA of any talker.

One parser reads logs and receivers on line.  Sentences with one time of day are one
epoch, in whatever order a burst has them; VTG has no time and belongs to the sentence
before it.  The date comes from RMC or ZDA and is carried over midnight.
"""

from collections import Counter, deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ReadError
from ..observations import Array, Drive, Fixes, GeoFix
from ..settings import Settings
from ..wording import by_reason
from .checks import BACKWARDS, REPEATED, Bools, Ints, Skipped, keep
from .fix_quality import NO_FIX
from .names import told_of
from .nmea_bursts import Bursts
from .nmea_sentences import COLUMNS, LONGEST, TYPES, Sentences, joined, scan, sealed
from .nmea_told import READ_BY, NmeaTold
from .reckoned_places import Beside, OnLine, Stood, never_stood, nothing_beside
from .reported_fixes import Reported, as_records, from_gst, make_fixes
from .source import Source

_BLOCK = 1 << 19  # bytes of a log scanned at once
_LONGEST_LINE = 1 << 12  # bytes without a line break that a stream may hold back
_KEPT = 64  # times of fixes of a stream that are known as having come
_DAY = 86_400_000  # ms
_PLACES = ("GGA", "GNS", "RMC")  # sentences with a position
_NO_FIX = "epoch without a fix"
_FOREIGN = "stretch of bytes outside NMEA sentences"
_NO_CHECKSUMS = "no checksums in the log: sentences were used as they are"


def read_nmea(file: Any, settings: Settings | None = None, columns: Iterable[str] = ()) -> Drive:
    """Read an NMEA 0183 log.

    Args:
        file: A path or source of the log; binary messages between sentences are passed over.
        settings: Gives the range error and the sigma of fixes that report none.
        columns: Aliases of columns that further sensors read, as `Sensed.columns` has them.

    Raises:
        ReadError: The file cannot be read or holds no good sentence of a known type.
    """
    source = Source.of(file)
    where, data = source.name, source.data
    parser = NmeaParser(settings)
    bare = b"*" not in data
    if bare:
        data = sealed(data)
    batches: list[Sentences] = []
    begin = 0
    while begin < len(data) or not batches:
        end = data.rfind(b"\n", begin, begin + _BLOCK) + 1
        if end == 0 or begin + _BLOCK >= len(data):
            end = min(begin + _BLOCK, len(data))
        batches.append(scan(data[begin:end], parser.skipped, parser.others)[0])
        begin = end
    sentences = joined(batches)
    if not any(kind in sentences for kind in _PLACES):
        seen = by_reason(parser.skipped + parser.others)
        raise ReadError(
            f"{where}: no GGA, GNS or RMC sentence ({seen or 'nothing like NMEA'}); "
            "an NMEA 0183 log was expected; is this the right file?"
        )
    fixes = parser.fixes(sentences)
    names = told_of(columns)
    told = NmeaTold(fixes.time[0], names).feed(data + b"\n") if names and len(fixes) else []
    return Drive(
        drive_id=source.stem,
        fixes=fixes,
        sources=(source.path,),
        skipped=dict(parser.skipped),
        notes=(*parser.notes(names), *((_NO_CHECKSUMS,) if bare else ())),
        sensed=tuple(sorted(told, key=lambda one: one.time)),
    )


class NmeaParser:
    """NMEA bytes in, fixes out, with bounded memory.

    Feed whatever the receiver sends, in chunks of any size.  A fix comes out when its
    burst has ended.  That is known from the first sentence of the next burst, from
    silence (`pause`), or from the burst's last sentence: a receiver that ended three
    bursts with one type of sentence ends the next one with it too.  Sentences of different
    epochs may come mixed.  Epochs come out in the order in which they are complete: a late one
    comes out late, with its own time, and each but once.

    Args:
        settings: Gives the range error and the sigma of fixes that report none.
        today: A time (s since 1970) of the day that is taken until RMC or ZDA gives the date.
        beside: Whether odometry that measures turns was heard about a time: places that the
            receiver dead-reckoned are left out then.
        stood: For how many s it has read no motion: places that move on meanwhile stay.

    Attributes:
        skipped: How many sentences were not used, by reason.
        others: How many good sentences were of types that are not needed.
    """

    def __init__(
        self, settings: Settings | None = None, today: float = 0.0,
        beside: Beside = nothing_beside, stood: Stood = never_stood,
    ) -> None:  # fmt: skip
        self._reckoned = OnLine(beside, stood)
        self.skipped: Skipped = Counter()
        self.others: Counter[str] = Counter()
        self._settings = settings or Settings()
        self._calendar = _Calendar(day=int(today // 86_400))
        self._bursts = Bursts()
        self._line = b""
        self._outside = False  # other bytes than of a sentence came last
        self._out: deque[float] = deque(maxlen=_KEPT)  # times of the last fixes

    def feed(self, data: bytes) -> list[GeoFix]:
        """Take the next bytes; returns the fixes of the bursts that they complete."""
        data = self._line + data
        end = data.rfind(b"\n") + 1
        if end == 0 and len(data) > _LONGEST_LINE:  # all but the sentence that may have begun
            begun = data.rfind(b"$", len(data) - LONGEST)
            end = begun if begun > 0 else len(data)
        self._line = data[end:]
        if end == 0:
            return []
        found, foreign = scan(data[:end], self.skipped, self.others)
        if foreign.any():
            goes_on = self._outside and bool(foreign[0])
            self.skipped[_FOREIGN] += int(foreign.sum()) - goes_on
        self._outside = bool(foreign[-1])
        return self._emit(self._bursts.take(found))

    def pause(self) -> list[GeoFix]:
        """The fix of the burst that has ended, when nothing arrives any more.

        Nothing comes out of a burst that stands in the middle of a sentence.
        """
        return [] if self._line else self._emit(self._bursts.pause())

    def flush(self) -> list[GeoFix]:
        """The stream has ended: the fixes of its last bursts."""
        return self._emit(self._bursts.flush())

    def _emit(self, done: Sentences | None) -> list[GeoFix]:
        """The fixes of sentences whose bursts have ended; of one time the first."""
        if done is None:
            return []
        fixes = []
        for fix in as_records(self._reckoned.without(self.fixes(done), self.skipped)):
            if fix.time in self._out:
                self.skipped[REPEATED] += 1
            else:
                self._out.append(fix.time)
                fixes.append(fix)
        return fixes

    def fixes(self, sentences: Sentences) -> Fixes:
        """The fixes of whole epochs; the date is carried from call to call."""
        reported = _report(sentences, self._calendar, self.skipped)
        return make_fixes(reported, self._settings, self.skipped)

    def notes(self, told: Collection[str] = ()) -> tuple[str, ...]:
        """What a reader of the result should know.

        Args:
            told: Columns of `names.TOLD` that sensors have asked for.
        """
        notes, kinds = [], []
        for kind, count in self.others.most_common(8):
            column, sensor = READ_BY.get(kind, ("", ""))
            if column not in told:
                hint = f" (--sensor {sensor} reads them)" if sensor else ""
                kinds.append(f"{count} {kind}{hint}")
        if kinds:
            notes.append(f"sentences not needed: {', '.join(kinds)}")
        if not self._calendar.dated:
            notes.append("no date in the log (no RMC, no ZDA): days are counted from 1970-01-01")
        return tuple(notes)


@dataclass(slots=True)
class _Calendar:
    """The day of the last sentence; `day` counts from 1970."""

    tod: float = np.nan  # ms
    day: int = 0
    dated: bool = False

    def days(self, tod: Array, reported: Array) -> Ints:
        """The day of each sentence in log order.

        Time of day falling by more than half a day is midnight.  Days before the first
        date are counted back from it.

        Args:
            tod: Time of day, ms, shape (n,).
            reported: Day that this sentence's epoch reports, NaN: none.
        """
        before = np.concatenate([[tod[0] if np.isnan(self.tod) else self.tod], tod[:-1]])
        step = tod - before
        midnights = np.cumsum((step < -_DAY / 2).astype(np.int64) - (step > _DAY / 2))
        known = np.flatnonzero(~np.isnan(reported))
        base = np.full(len(tod), self.day, np.int64)
        if len(known):
            latest = np.searchsorted(known, np.arange(len(tod)), side="right") - 1
            if not self.dated:
                latest = np.maximum(latest, 0)
            dates = reported[known].astype(np.int64) - midnights[known]
            base = np.where(latest >= 0, dates[np.maximum(latest, 0)], base)
            self.dated = True
        days: Ints = base + midnights
        self.tod, self.day = float(tod[-1]), int(days[-1])
        return days


def _late(epoch_of_run: Ints) -> Bools:
    """Whether an epoch came after a later one; times that return count once."""
    _, first = np.unique(epoch_of_run, return_index=True)
    appearance = np.argsort(first)  # epochs in the order in which they first came
    late = np.zeros(len(first), np.bool_)
    late[appearance] = appearance < np.maximum.accumulate(appearance)
    return late


def _report(sentences: Sentences, calendar: _Calendar, skipped: Skipped) -> Reported:
    """What the epochs with a fix report, by time; NaN where no sentence reports it."""
    timed = np.flatnonzero(~np.isnan(sentences.tod))
    if not len(timed):
        return Reported(time=np.empty(0), lat_deg=np.empty(0), lon_deg=np.empty(0))
    # sentences without a time have that of the timed one before them
    _, sentences = sentences.split(int(timed[0]))
    timed -= timed[0]
    latest = np.searchsorted(timed, np.arange(len(sentences)), side="right") - 1
    tod = sentences.tod[timed[latest]]
    run = np.concatenate([[0], np.cumsum(np.diff(tod) != 0)])  # sentences side by side, one time
    begin = np.flatnonzero(np.diff(run, prepend=-1))
    runs = {name: run[sentences.code == kind.code] for name, kind in TYPES.items()}

    dates = np.full(len(begin), np.nan)
    for name in ("ZDA", "RMC"):
        day = sentences.values[name][TYPES[name].columns.index(_DATE)]
        known = ~np.isnan(day)
        dates[runs[name][known]] = day[known]
    times = calendar.days(tod[begin], dates) * _DAY + tod[begin].astype(np.int64)
    times, epoch_of_run = np.unique(times, return_inverse=True)

    counted = next((kind for kind in _PLACES if kind in sentences), "")
    table = np.full((len(COLUMNS), len(times)), np.nan)
    for name, kind in TYPES.items():
        values = sentences.values[name]
        column, row = np.nonzero(~np.isnan(values))
        epoch = epoch_of_run[runs[name]]
        table[np.array(kind.columns)[column], epoch[row]] = values[column, row]
        if name == counted:
            repeated = len(epoch) - len(np.unique(epoch))
            skipped.update({REPEATED: repeated} if repeated else {})
    return _reported(
        times / 1e3, dict(zip(COLUMNS, table, strict=True)), _late(epoch_of_run), skipped
    )


_DATE = COLUMNS.index("day")


def _reported(time: Array, reported: dict[str, Array], late: Bools, skipped: Skipped) -> Reported:
    """The epochs with a fix: RMC's position where GGA and GNS give none, GST's covariance."""
    from_gga = ~np.isnan(reported["quality"])
    lat = np.where(from_gga, reported["lat"], reported["rmc_lat"])
    lon = np.where(from_gga, reported["lon"], reported["rmc_lon"])
    quality = np.where(from_gga, reported["quality"], reported["rmc_quality"])
    fix: Bools = ~(np.isnan(lat) | np.isnan(lon)) & ~(quality == NO_FIX)
    keep(fix, _NO_FIX, skipped)
    if disordered := int(np.count_nonzero(late[fix])):
        skipped[BACKWARDS] += disordered
    # RMC flags an invalid speed
    speed = np.where(reported["valid"] == 0, np.nan, reported["speed"])
    ellipse = ("sigma_lat", "sigma_lon", "major", "minor", "orientation")
    cov_ee, cov_en, cov_nn, no_correlation = from_gst(*(reported[name] for name in ellipse))
    return Reported(
        time=time,
        lat_deg=lat,
        lon_deg=lon,
        cov_ee=cov_ee,
        cov_en=cov_en,
        cov_nn=cov_nn,
        no_correlation=no_correlation,
        hdop=reported["hdop"],
        quality=quality,
        speed=speed,
        bearing_deg=reported["course"],
    ).rows(np.flatnonzero(fix))
