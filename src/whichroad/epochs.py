"""Sensor streams to time-ordered epochs: one clock, outages made visible.

An epoch is a moment at which a sensor spoke.  Odometry is kept cumulative until here
and differenced between epochs, so a fix between two wheel readings splits the arc.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from ._compile import Records
from .errors import DriveError, SettingError
from .evidence.sensed import Row, Sensed
from .filter.evidence.evidence_kinds import MOST_AT_ONCE, NO_EVIDENCE, Evidence
from .filter.state import CLOCK, DISTANCE, WHEELS, new_epochs
from .filter.vetting.latency import LONGEST
from .filter.vetting.motion_sources import BELOW
from .filter.vetting.windows import BY_GYRO, BY_WHEELS, GYRO_ALONE, HEARD_AGAIN
from .geodesy.plane import Plane
from .observations import (
    INTERPOLATED,
    LATE_PLACE,
    STRAY,
    Array,
    Drive,
    Fixes,
    SensorReading,
    WithGyro,
)
from .sensors.clock_delay import delay_of
from .sensors.dead_band import below, is_counted, whole_dead_band
from .sensors.filled_gaps import HELD, filled_gaps
from .sensors.glitches import without_glitches
from .sensors.gnss import fix_rows
from .sensors.odometry import Motion, motion_of
from .sensors.seldom_read import without_seldom
from .sensors.takeover import Takeover
from .sensors.whole_columns import less_wrong
from .settings import Vehicle
from .wording import by_reason

_SAME = 1e-4  # s, distance below which readings are one epoch
_SHARED = 0.9  # share of the fixes that were read from rows of the odometry, from which all were
_SLACK = 1.0  # s by which a mask may miss a drive
SPARSE = 15.0  # s between fixes, beyond which the path is chosen as a whole
_GAP = 2.0  # s without odometry after which it no longer counts as known


@dataclass(frozen=True, slots=True)
class Timeline:
    """A drive in epochs, and how it is moved."""

    epochs: Records  # (n,) filter.state.EPOCH
    mode: int
    masked: int  # fixes withheld
    evidence: Evidence = NO_EVIDENCE  # of further sensors, in the order of the epochs
    sensors: tuple[str, ...] = ()  # their names
    takeover: Takeover | None = None  # of a gyro beside wheels
    wrong: tuple[str, ...] = ()  # what of the odometry is wrong throughout, see `whole_columns`
    delay: float = 0.0  # s by which fixes are late against the odometry as it was recorded
    late: float = 0.0  # s by which they still are in the epochs
    tick: float = 0.0  # rad that the wheels' counters resolve; 0: they measure no turns
    least_speed: float = 0.0  # m/s, below which odometry reads 0; 0: there is no such
    skipped: Mapping[str, int] = field(default_factory=dict)  # readings left out, by reason

    @property
    def interval(self) -> float:
        """Median of the seconds between epochs that are not filled; 0 where there is but one."""
        rows = self.epochs.view(np.ndarray)  # of which a field is had at once
        steps = np.sort(np.diff(rows["time"][rows["filled"] == 0]))
        n = len(steps)
        return float(0.5 * (steps[(n - 1) // 2] + steps[n // 2])) if n else 0.0


def mask_windows(mask: Sequence[tuple[float, float]], start: float) -> list[tuple[float, float]]:
    """Windows in absolute seconds; numbers below ten years count from the drive's start."""
    ten_years = 10 * 365.25 * 86400.0
    return [tuple(start + t if abs(t) < ten_years else t for t in w) for w in mask]  # type: ignore[misc]


def check_mask(drives: Sequence[Drive], mask: Sequence[tuple[float, float]]) -> None:
    """Refuse a window that holds no moment of any drive.

    Args:
        drives: All that the mask is for.
        mask: Windows as `mask_windows` takes them.

    Raises:
        SettingError: There is such a window.
    """
    spans = []
    for drive in drives:
        logs = [log.time for log in (drive.fixes, drive.odometry) if log is not None]
        times = [time for time in logs if len(time)]
        if times:
            spans.append((float(min(t[0] for t in times)), float(max(t[-1] for t in times))))
    for window in mask if spans else ():
        held = [mask_windows([window], begin)[0] for begin, _ in spans]
        if all(
            high < begin - _SLACK or low > end + _SLACK
            for (low, high), (begin, end) in zip(held, spans, strict=True)
        ):
            begin, end = spans[0]
            low, high = (t - begin for t in held[0])
            raise SettingError(
                f"mask: it withholds fixes from {low:,.0f} to {high:,.0f} s after the drive's "
                f"start, and the drive lasts {end - begin:,.0f} s; a window within the drive was "
                "expected"
            )


def _union(times: list[Array]) -> Array:
    merged: Array = np.sort(np.concatenate(times), kind="stable")  # merges what is in order
    return np.asarray(merged[np.append(True, np.diff(merged) > _SAME)])


def _share_rows(streams: list[Array]) -> bool:
    """Whether fixes were read from rows of the odometry, at whose times answers are expected."""
    motion, *fixes = streams
    return bool(fixes) and bool(np.isin(fixes[0], motion).mean() > _SHARED)


def build_timeline(
    drive: Drive, plane: Plane, vehicle: Vehicle, mask: Sequence[tuple[float, float]] = (),
    sensed: Sensed | None = None, clocks: bool = True,
) -> Timeline:  # fmt: skip
    """Put the sensors of a drive on one clock.

    Args:
        drive: What the readers gave; at least fixes or odometry.
        plane: The map's plane.
        vehicle: For the odometry.
        mask: Time windows (s) in which fixes are withheld.
        sensed: Makes evidence of what further sensors say; None: there are none.
        clocks: Whether clocks that differ are looked for and put right.

    Returns:
        Epochs in time order and the mode of motion.

    Raises:
        DriveError: There is neither a fix nor odometry.
    """
    fixes = drive.fixes if drive.fixes is not None and len(drive.fixes) else None
    drive, skipped = _without_glitches(drive)
    drive, seldom = without_seldom(drive, fixes, vehicle)
    motion, wrong, delay = _motion(drive, fixes, plane, vehicle, mask, clocks)
    if motion is None and fixes is None:
        why = by_reason(drive.skipped)
        raise DriveError(
            f"{drive.drive_id}: it holds neither fixes nor odometry"
            f"{f' (skipped: {why})' if why else ''}; a table or log with time, lat, lon or wheel "
            "data was expected"
        )
    between = seldom.between(fixes)
    if motion is None and fixes is not None and not mask and sensed is None and not len(between):
        epochs, own = epochs_of_fixes(fixes, [0], plane)
        if own[0]:
            return Timeline(epochs, CLOCK, 0, wrong=(*wrong, *seldom.write_to(epochs)))
    late = delay if 0.0 < delay <= LONGEST else 0.0
    streams = [m.time for m in (motion, fixes) if m is not None]
    if motion is not None and delay != late:  # late odometry, or a clock that was never set
        motion = motion._replace(time=motion.time + (delay - late))
        if not _share_rows(streams):
            streams[0] = motion.time
    told = [] if sensed is None else sensed.within(drive.sensed, streams)
    if sensed is not None and motion is None and fixes is not None:
        told = sensed.beside(told, fixes.time)
    streams += [between, np.array([one.time for one in told])]
    time = _union(streams)
    arc, turn, valid = _odometry(motion, time)
    if motion is not None and motion.least_speed:
        valid[_below(motion, time) & (valid == 1)] = BELOW
    half = 0.5 * turn
    chord = arc * np.sinc(half / math.pi)
    epochs = new_epochs(len(time))
    epochs.time, epochs.arc, epochs.turn, epochs.odometry_valid = time, arc, turn, valid
    epochs.forward, epochs.left = chord * np.cos(half), chord * np.sin(half)
    epochs.speed_sigma = epochs.course_sigma = np.inf
    epochs.gyro = _turned_by(motion, time)
    epochs.geared, epochs.unsure = drive.geared, 0.0 if motion is None else motion.unsure_at(time)
    epochs.odometry_valid[np.isin(epochs.gyro, (GYRO_ALONE, HEARD_AGAIN))] = 0
    masked = 0
    if fixes is not None:
        at = _nearest(time, fixes.time)
        keep = _kept(fixes, mask, float(time[0]))
        masked = int((~keep).sum())
        if motion is not None or told:  # which tell more than a row that waits
            keep &= ~_made(fixes)
        fix, heading, sigma = fix_rows(fixes, plane)
        at = at[keep]
        epochs.has_fix[at] = 1
        epochs.fix[at] = fix[keep]
        epochs.speed[at], epochs.speed_sigma[at] = fixes.speed[keep], fixes.sigma_speed[keep]
        epochs.course[at], epochs.course_sigma[at] = heading[keep], sigma[keep]
        if motion is None:
            gaps = filled_gaps(time[at], fix[keep, :2], fix[keep, 2], [0])
            _hold(epochs, at, gaps | _made(fixes)[keep], [0])
    mode = CLOCK if motion is None else DISTANCE if motion.turn is None else WHEELS
    takeover = None if motion is None else motion.takeover
    tick = motion.tick if motion is not None and mode == WHEELS else 0.0
    heard, names = (NO_EVIDENCE, ()) if sensed is None else (
        _heard(epochs, told, sensed), sensed.names
    )  # fmt: skip
    least = 0.0 if motion is None else motion.least_speed
    return Timeline(
        epochs, mode, masked, heard, names, takeover, (*wrong, *seldom.write_to(epochs)), delay,
        late, tick, least, skipped,
    )  # fmt: skip


def _made(fixes: Fixes) -> NDArray[np.bool_]:
    """Which fixes are none, as their places were interpolated, cannot be or are unknown, (n,)."""
    flags = fixes.flags.astype(np.uint16, copy=False)
    return np.asarray((flags & (INTERPOLATED | STRAY | LATE_PLACE)) > 0)


def _hold(
    epochs: Records, at: NDArray[np.int64], waits: NDArray[np.bool_], first: Sequence[int]
) -> None:
    """Mark epochs whose fix is none; before the first fix of a drive there is no belief to hold.

    Args:
        epochs: In place.
        at: (n,) the epochs that have a fix.
        waits: (n,) of which of them it is none.
        first: (d,) where each drive begins among them.
    """
    epochs["filled"][at] = waits
    for begin in first:
        row = begin
        while row < len(at) and waits[row]:  # a stray place
            epochs["filled"][at[row]] = epochs["has_fix"][at[row]] = 0
            row += 1


def is_interpolated(epochs: Records) -> bool:
    """Whether epochs of a drive wait as their places were interpolated, mostly not repeated."""
    filled = epochs["filled"] > 0
    at = np.flatnonzero(filled)
    if not len(at):
        return False
    before = np.maximum.accumulate(np.where(filled, 0, np.arange(len(filled))))[at]
    away = np.hypot(*(epochs.fix[at, :2] - epochs.fix[before, :2]).T)
    return bool(2 * np.count_nonzero(away > 2.0 * HELD) >= len(at))


def _kept(
    fixes: Fixes, mask: Sequence[tuple[float, float]], begin: float
) -> NDArray[np.bool_]:  # fmt: skip
    """Which fixes are not withheld, (n,)."""
    keep = np.ones(len(fixes), bool)
    for low, high in mask_windows(mask, begin):
        keep &= ~((fixes.time >= low) & (fixes.time <= high))
    return keep


def _motion(
    drive: Drive, fixes: Fixes | None, plane: Plane, vehicle: Vehicle,
    mask: Sequence[tuple[float, float]], clocks: bool,
) -> tuple[Motion | None, tuple[str, ...], float]:  # fmt: skip
    """What moves the vehicle, what of that is wrong throughout, and how late fixes are to it, s.

    None where there are less than two readings, or nothing of it is left.
    """
    if drive.odometry is None or len(drive.odometry.time) < 2:
        return None, (), 0.0
    told = fixes
    made = fixes is not None and bool(_made(fixes).any())
    if fixes is not None and (mask or made or isinstance(drive.odometry, WithGyro)):
        begin = min(float(fixes.time[0]), float(drive.odometry.time[0]))
        keep = _kept(fixes, mask, begin) & ~_made(fixes)
        told = Fixes(**{f.name: getattr(fixes, f.name)[keep] for f in fields(Fixes)})
    motion = motion_of(drive.odometry, vehicle, told)
    if len(motion.time) < 2:
        return None, (), 0.0
    coarse = motion.unsure is not None  # who stands between steps may not stand
    least = 0.0 if coarse else whole_dead_band(drive.odometry, motion[:2], vehicle.least_speed)
    motion = motion._replace(least_speed=least, counted=is_counted(drive.odometry))
    sound, wrong = less_wrong(motion, told, plane)
    return sound, wrong, delay_of(sound, told, plane) if clocks and sound is not None else 0.0


def _without_glitches(drive: Drive) -> tuple[Drive, Mapping[str, int]]:
    """The drive without nonsense between sound readings, and how many that were, by reason."""
    if drive.odometry is None:
        return drive, {}
    odometry, skipped = without_glitches(drive.odometry)
    return replace(drive, odometry=odometry) if skipped else drive, skipped


def _turned_by(motion: Motion | None, time: Array) -> NDArray[np.uint8] | int:
    """What measures the turn to each moment, (n,), or to all of them."""
    if motion is None:
        return BY_WHEELS
    if motion.by is None:
        return BY_GYRO if motion.gyro else BY_WHEELS
    step = np.searchsorted(motion.time, time).clip(0, len(motion.time) - 1)
    by = np.asarray(motion.by[step], np.uint8)
    by[(by == HEARD_AGAIN) & (time < motion.time[step])] = GYRO_ALONE
    return by


def _below(motion: Motion, time: Array) -> NDArray[np.bool_]:
    """Over which epochs odometry reads 0 and tells nothing by it, (n,)."""
    steps = below(motion.time, motion.distance, motion.least_speed, motion.counted)
    step = np.searchsorted(motion.time, time).clip(0, len(steps) - 1)
    return np.asarray(steps[step])


def _heard(epochs: Records, told: Sequence[SensorReading], sensed: Sensed) -> Evidence:
    """The evidence of readings, each at its epoch."""
    fixes = np.flatnonzero(epochs.has_fix)
    places = epochs.fix[fixes, :2] if len(fixes) else np.zeros((1, 2))
    near = np.searchsorted(fixes, np.arange(len(epochs))).clip(0, len(places) - 1)
    metres = np.cumsum(np.abs(epochs.arc))
    if not metres[-1]:  # no odometry: along the fixes
        steps = np.hypot(*np.diff(places, axis=0, prepend=places[:1]).T)
        metres = np.interp(np.arange(len(epochs)), fixes if len(fixes) else [0], np.cumsum(steps))
    at = _nearest(epochs.time, np.array([one.time for one in told], np.float64))
    rows: list[Row] = []
    for k, one in zip(at, told, strict=True):
        made = sensed.rows(one, float(metres[k]), tuple(places[near[k]].tolist()))
        made = made[: MOST_AT_ONCE - int(epochs.evidence[k])]
        if made and not epochs.evidence[k]:
            epochs.first_evidence[k] = len(rows)
        epochs.evidence[k] += len(made)
        rows += made
    return sensed.evidence(rows)


def epochs_of_fixes(
    fixes: Fixes, first: Sequence[int], plane: Plane
) -> tuple[Records, NDArray[np.bool_]]:
    """Epochs of drives that are fixes alone, made at once.

    Args:
        fixes: (n,) of the drives, one behind the other, each in the order of time.
        first: (d,) the row at which each begins.
        plane: The map's plane.

    Returns:
        One epoch for each fix, and (d,) of which drives they are: False where fixes are too
        close to be epochs of their own.
    """
    apart = np.ones(len(fixes), bool)
    apart[1:] = np.diff(fixes.time) > _SAME
    apart[first] = True
    epochs = new_epochs(len(fixes))
    rows = epochs.view(np.ndarray)
    rows["time"], rows["has_fix"] = fixes.time, 1
    rows["speed"], rows["speed_sigma"] = fixes.speed, fixes.sigma_speed
    fix, rows["course"], rows["course_sigma"] = fix_rows(fixes, plane)
    rows["fix"] = fix
    waits = filled_gaps(fixes.time, fix[:, :2], fix[:, 2], first) | _made(fixes)
    if waits.any():
        _hold(rows, np.arange(len(rows)), waits, first)
    return epochs, np.logical_and.reduceat(apart, first) if len(first) else apart[:0]


def _nearest(time: Array, wanted: Array) -> NDArray[np.int64]:
    at = np.searchsorted(time, wanted)
    at = np.clip(at, 1, max(len(time) - 1, 1)) if len(time) > 1 else np.zeros(len(wanted), int)
    if len(time) > 1:
        at = at - (wanted - time[at - 1] <= time[at] - wanted)
    return at.astype(np.int64)


def _odometry(motion: Motion | None, time: Array) -> tuple[Array, Array, NDArray[np.uint8]]:
    """Arc, turn and whether they were measured, from the epoch before to each epoch."""
    n = len(time)
    if motion is None:
        return np.zeros(n), np.zeros(n), np.zeros(n, np.uint8)
    when, distance, angle = motion.time, motion.distance, motion.turn
    known = (time >= when[0]) & (time <= when[-1])
    # between readings far apart the turn is not known; a mere odometer takes it from the road
    long = np.diff(when) > _GAP
    if angle is not None and long.any():
        known &= ~long[np.searchsorted(when, time).clip(1, len(when) - 1) - 1]
    if time[0] < when[0]:  # before the first reading: at the speed that came then
        head = min(when[0] + 1.0, when[-1])
        speed = (np.interp(head, when, distance) - distance[0]) / (head - when[0])
        distance = np.concatenate([[distance[0] - speed * (when[0] - time[0])], distance])
        angle = np.concatenate([angle[:1], angle]) if angle is not None else None
        when = np.concatenate([time[:1], when])
    if time[-1] > when[-1]:  # after the last one: at the speed that was then
        tail = max(when[-1] - 1.0, when[0])
        speed = (distance[-1] - np.interp(tail, when, distance)) / (when[-1] - tail)
        distance = np.concatenate([distance, [distance[-1] + speed * (time[-1] - when[-1])]])
        angle = np.concatenate([angle, angle[-1:]]) if angle is not None else None
        when = np.concatenate([when, time[-1:]])
    travelled = np.interp(time, when, distance)
    turned = np.interp(time, when, angle) if angle is not None else np.zeros(n)
    return (
        np.diff(travelled, prepend=travelled[0]),
        np.diff(turned, prepend=turned[0]),
        known.astype(np.uint8),
    )
