"""UBX of u-blox receivers: NAV-PVT with the covariance of NAV-COV, and ESF-MEAS.

Logs and receivers on line share the scan for frames and the meaning of the fields.
"""

from collections import Counter, deque
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError
from ..observations import Drive, Fixes, GeoFix, SensorReading
from ..wording import by_reason
from .checks import REPEATED, Bools, Ints, Skipped, keep
from .fix_quality import RECKONED, SINGLE
from .names import told_of
from .reading import Reading
from .reckoned_places import Beside, OnLine, Stood, never_stood, nothing_beside
from .reported_fixes import RADIUS_68, Reported, as_records, make_fixes
from .source import Source
from .ubx_frames import (
    CUT,
    ESF_MEAS,
    HEAD,
    LONGEST,
    NAV_COV,
    NAV_PVT,
    NAV_RELPOSNED,
    TAIL,
    Frames,
    payloads,
    scan,
    without,
)
from .ubx_sensors import measurements, odometry, on_utc
from .ubx_told import RELPOSNED, UbxTold, has_place

_PVT = np.dtype({  # the fields that are used; places in the payload
    "names": ["itow", "year", "month", "day", "hour", "minute", "second", "valid", "nano",
              "kind", "flags", "satellites", "lon", "lat", "height", "h_acc", "speed", "course",
              "s_acc", "flags3"],
    "formats": ["<u4", "<u2", "u1", "u1", "u1", "u1", "u1", "u1", "<i4",
                "u1", "u1", "u1", "<i4", "<i4", "<i4", "<u4", "<i4", "<i4", "<u4", "u1"],
    "offsets": [0, 4, 6, 7, 8, 9, 10, 11, 16, 20, 21, 23, 24, 28, 36, 40, 60, 64, 68, 78],
    "itemsize": 84,
})  # fmt: skip
_COV = np.dtype({
    "names": ["itow", "valid", "nn", "ne", "ee"],
    "formats": ["<u4", "u1", "<f4", "<f4", "<f4"],
    "offsets": [0, 5, 16, 20, 28],
    "itemsize": 64,
})  # fmt: skip
_DATED = 0b11  # valid date and valid time of day
_DEAD_RECKONED, _TIME_ONLY = 1, 5  # kinds of fixes
_NO_FIX = "epoch without a fix"
_NO_DATE = "epoch without a date"
_RECKONED = "dead-reckoned fix (without GNSS)"
_NAMES = {NAV_PVT: "NAV-PVT", NAV_COV: "NAV-COV", ESF_MEAS: "ESF-MEAS"}
_BEGIN = np.zeros(1, np.int64)  # of a frame alone
_KEPT = 64  # times of fixes of a stream that are known as having come
_MOST_HELD = 2 * LONGEST  # bytes of a stream that wait for the end of a frame


def read_ubx(source: Source, reading: Reading) -> list[Drive]:
    """Read a UBX log; other protocols between its messages are passed over.

    Args:
        source: The file.
        reading: Wheels, and the sigma of fixes that report none.

    Raises:
        ReadError: No NAV-PVT message with a right checksum is in it.
    """
    skipped: Skipped = Counter()
    data = source.data
    frames, _ = scan(data, skipped)
    mine = frames.kind == NAV_PVT
    if not mine.any():
        seen = by_reason(_seen(frames, skipped))
        raise ReadError(
            f"{source.name}: no NAV-PVT message ({seen or 'nothing like UBX'}); a UBX log was "
            "expected; switch NAV-PVT on in the receiver, or give the log of its NMEA sentences"
        )
    pvt = payloads(data, _long(frames, NAV_PVT, _PVT, skipped).start, _PVT)
    pvt_at = _long(frames, NAV_PVT, _PVT, Counter()).start
    cov_frames = _long(frames, NAV_COV, _COV, skipped)
    cov = payloads(data, cov_frames.start, _COV)
    found = measurements(data, _of(frames, ESF_MEAS), skipped)
    time, dated = _times(pvt)
    at = on_utc(found, pvt_at[dated], time[dated])
    reported = _reported(pvt, time, dated, _cov_of(pvt, pvt_at, cov, cov_frames.start), skipped,
                         keep_reckoned=not len(found.tag))  # fmt: skip
    fixes = make_fixes(reported, reading.settings, skipped)
    wheels, notes = odometry(found, at, fixes, reading.vehicle, skipped)
    others = Counter({k: n for k, n in _seen(frames, Counter()).items() if k.startswith("0x")})
    if others:
        notes.append(f"UBX messages not needed: {by_reason(others.most_common(8))}")
    return [
        Drive(source.stem, fixes, wheels, (source.path,), dict(skipped), tuple(notes),
              _told(data, frames, pvt, pvt_at, told_of(reading.columns)))
    ]  # fmt: skip


def _told(
    data: bytes, frames: Frames, pvt: NDArray[np.void], pvt_at: Ints, names: frozenset[str]
) -> tuple[SensorReading, ...]:
    """What further sensors ask for, in the order of the log."""
    if not names:
        return ()
    told, made = UbxTold(names), list[SensorReading]()
    headings = _long(frames, NAV_RELPOSNED, RELPOSNED, Counter())
    messages = payloads(data, headings.start, RELPOSNED)
    time, dated = _times(pvt)
    begin = 0
    for k, end in enumerate(np.searchsorted(headings.start, [*pvt_at[1:].tolist(), len(data)])):
        made += told.of_epochs(pvt[k : k + 1], time[k : k + 1], dated[k : k + 1])
        made += told.of_headings(messages[begin:end])
        begin = int(end)
    return tuple(sorted(made, key=lambda one: one.time))


class Sensors(Protocol):
    """Who takes what sensors of a receiver measure."""

    @property
    def useful(self) -> bool:
        """Whether odometry comes of it."""

    def measured(self, frame: bytes) -> None:
        """An ESF-MEAS has come."""

    def epoch(self, time: float) -> None:
        """A NAV-PVT of this time has come, s since 1970."""

    def fix(self, fix: GeoFix) -> None:
        """A fix came out."""


class UbxParser:
    """UBX bytes in, fixes out, with bounded memory.

    A fix comes out with its NAV-COV where the receiver sends one, else with its NAV-PVT.
    A late one comes out late, with its own time; of one time the first comes out.

    Args:
        reading: Gives the sigma of fixes that report none.
        sensors: Takes ESF-MEAS; None: it is passed over.
        beside: Whether odometry that measures turns was heard about a time: places that the
            receiver dead-reckoned are left out then.
        stood: For how many s it has read no motion: places that move on meanwhile stay.

    Attributes:
        told: What further sensors ask for, since it was last taken from here.
        skipped: How many messages were not used, by reason.
        seen: Whether a NAV-PVT has come.
    """

    def __init__(
        self, reading: Reading | None = None, sensors: Sensors | None = None,
        beside: Beside = nothing_beside, stood: Stood = never_stood,
    ) -> None:  # fmt: skip
        self.skipped: Skipped = Counter()
        self._reckoned = OnLine(beside, stood)
        self.seen = False
        self.told: list[SensorReading] = []
        self._sensors = sensors
        self._names = told_of(reading.columns) if reading is not None else frozenset[str]()
        self._teller = UbxTold(self._names)
        self._reading = reading or Reading()
        self._held = b""
        self._waiting = b""  # a NAV-PVT whose NAV-COV may follow
        self._with_cov = False
        self._out: deque[float] = deque(maxlen=_KEPT)  # times of the last fixes

    def feed(self, data: bytes) -> tuple[list[GeoFix], bytes]:
        """Take the next bytes.

        Returns:
            The fixes that they complete, and the bytes that belong to other protocols.
        """
        data = self._held + data
        frames, done = scan(data, self.skipped, ended=len(data) > _MOST_HELD)
        self._held = data[done:]
        fixes: list[GeoFix] = []
        for start, end, kind in zip(*(column.tolist() for column in frames), strict=True):
            frame = data[start:end]
            if kind == NAV_PVT:
                fixes += self.pause()
                self._waiting, self.seen = frame, True
                self._tell_epoch(frame)
                if not self._with_cov:
                    fixes += self.pause()
            elif kind == NAV_COV:
                self._with_cov = True
                if _itow(frame) == _itow(self._waiting):
                    fixes += self.pause(frame)
            elif kind == ESF_MEAS and self._sensors is not None:
                self._sensors.measured(frame)
            elif kind == NAV_RELPOSNED and len(frame) >= HEAD + RELPOSNED.itemsize + TAIL:
                self.told += self._teller.of_headings(payloads(frame, _BEGIN, RELPOSNED))
        return fixes, without(data[:done], frames)

    def pause(self, cov_frame: bytes = b"") -> list[GeoFix]:
        """The fix that waits for its covariance, when none comes any more."""
        frame, self._waiting = self._waiting, b""
        if not frame:
            return []
        reckoned = self._sensors is None or not self._sensors.useful
        whole = _fixes_of(frame + cov_frame, self._reading, self.skipped, keep_reckoned=reckoned)
        whole = self._reckoned.without(whole, self.skipped)
        fixes = [fix for fix in as_records(whole) if fix.time not in self._out]
        if len(fixes) < len(whole):
            self.skipped[REPEATED] += 1
        self._out.extend(fix.time for fix in fixes)
        if self._sensors is not None:
            for fix in fixes:
                self._sensors.fix(fix)
        return fixes

    def _tell_epoch(self, frame: bytes) -> None:
        if len(frame) < HEAD + _PVT.itemsize + TAIL or not (self._sensors or self._names):
            return
        pvt = payloads(frame, _BEGIN, _PVT)
        time, dated = _times(pvt)
        self.told += self._teller.of_epochs(pvt, time, dated)
        if dated[0] and self._sensors is not None:
            self._sensors.epoch(float(time[0]))


def _itow(frame: bytes) -> bytes:
    """The epoch of a NAV-PVT or NAV-COV, as it is written."""
    return frame[HEAD : HEAD + 4]


def _fixes_of(data: bytes, reading: Reading, skipped: Skipped, *, keep_reckoned: bool) -> Fixes:
    """The fix of one epoch."""
    frames, _ = scan(data, skipped)
    mine = _long(frames, NAV_PVT, _PVT, skipped)
    cov_frames = _long(frames, NAV_COV, _COV, skipped)
    pvt, cov = payloads(data, mine.start, _PVT), payloads(data, cov_frames.start, _COV)
    matched = _cov_of(pvt, mine.start, cov, cov_frames.start)
    reported = _reported(pvt, *_times(pvt), matched, skipped, keep_reckoned=keep_reckoned)
    return make_fixes(reported, reading.settings, skipped)


def _of(frames: Frames, kind: int) -> Frames:
    mine = frames.kind == kind
    return Frames(*(column[mine] for column in frames))


def _long(frames: Frames, kind: int, layout: "np.dtype[np.void]", skipped: Skipped) -> Frames:
    """The messages of a type that hold all fields."""
    mine = _of(frames, kind)
    long = keep(mine.end - mine.start - HEAD - TAIL >= layout.itemsize, CUT, skipped)
    return Frames(*(column[long] for column in mine))


def _seen(frames: Frames, skipped: Skipped) -> Counter[str]:
    """Messages by their names, and what was not used."""
    kinds, counts = np.unique(frames.kind, return_counts=True)
    named = {
        _NAMES.get(kind, f"0x{kind >> 8:02x} 0x{kind & 255:02x}"): int(n)
        for kind, n in zip(kinds.tolist(), counts.tolist(), strict=True)
    }
    return Counter(named) + skipped


def _times(pvt: NDArray[np.void]) -> tuple[NDArray[np.float64], Bools]:
    """Times in s since 1970 UTC, and whether the receiver knows them."""
    month, day, year = (pvt[name].astype(np.int64) for name in ("month", "day", "year"))
    dated = (pvt["valid"] & _DATED == _DATED) & (month >= 1) & (month <= 12)
    dated &= (day >= 1) & (day <= 31) & (year >= 1980) & (year < 9999)
    dated &= (pvt["hour"] < 24) & (pvt["minute"] < 60) & (pvt["second"] <= 60)
    dated &= np.abs(pvt["nano"].astype(np.int64)) <= 1_000_000_000
    months = np.where(dated, (year - 1970) * 12 + month - 1, 0)
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    days += np.where(dated, day - 1, 0)
    seconds = pvt["hour"].astype(np.int64) * 3600 + pvt["minute"].astype(np.int64) * 60
    whole = 86_400 * days + seconds + pvt["second"]
    return whole + 1e-9 * pvt["nano"], dated


def _cov_of(
    pvt: NDArray[np.void], pvt_at: Ints, cov: NDArray[np.void], cov_at: Ints
) -> NDArray[np.float64]:
    """ee, en and nn of each epoch, m², (3, n): of the NAV-COV beside it; NaN without one."""
    matched = np.full((3, len(pvt)), np.nan)
    if not len(cov):
        return matched
    behind = np.searchsorted(cov_at, pvt_at)
    for one in (behind - 1, behind):
        near = one.clip(0, len(cov) - 1)
        same = (near == one) & (cov["itow"][near] == pvt["itow"]) & (cov["valid"][near] == 1)
        for row, name in enumerate(("ee", "ne", "nn")):
            with np.errstate(invalid="ignore"):  # floats may hold anything
                values = cov[name][near[same]].astype(np.float64)
            matched[row, same] = np.where(np.isfinite(values), values, -1.0)  # counted as none
    return matched


def _reported(
    pvt: NDArray[np.void],
    time: NDArray[np.float64],
    dated: Bools,
    cov: NDArray[np.float64],
    skipped: Skipped,
    *,
    keep_reckoned: bool,
) -> Reported:
    """The epochs with a fix and a date."""
    kind = pvt["kind"]
    fix = has_place(pvt) & (kind >= _DEAD_RECKONED) & (kind < _TIME_ONLY)
    keep(fix, _NO_FIX, skipped)
    if not keep_reckoned:
        fix &= keep(~fix | (kind != _DEAD_RECKONED), _RECKONED, skipped)
    fix &= keep(~fix | dated, _NO_DATE, skipped)
    ee, en, nn = cov
    radius = 1e-3 * pvt["h_acc"].astype(np.float64)
    round_error = np.where(radius > 0, (radius / RADIUS_68) ** 2, np.nan)
    lone = np.isnan(ee)
    return Reported(
        time=time,
        lat_deg=1e-7 * pvt["lat"],
        lon_deg=1e-7 * pvt["lon"],
        cov_ee=np.where(lone, round_error, ee),
        cov_en=np.where(lone, 0.0, en),
        cov_nn=np.where(lone, round_error, nn),
        speed=1e-3 * pvt["speed"],
        sigma_speed=1e-3 * pvt["s_acc"],
        bearing_deg=1e-5 * pvt["course"],
        quality=np.where(kind == _DEAD_RECKONED, RECKONED, SINGLE),
    ).rows(np.flatnonzero(fix))
