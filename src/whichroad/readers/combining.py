"""Files to drives: which files are parts of one drive, and one drive out of its parts."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..errors import ReadError
from ..observations import (
    Drive,
    Fixes,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
    WithGyro,
    YawRates,
)
from ..settings import Vehicle
from ..wording import moment
from .checks import Skipped, in_order, listed
from .drive_columns import steered
from .odometry_fit import with_fit_notes, with_speed_notes
from .reckoned_places import without_reckoned
from .units_by_places import distances
from .wheel_counters import cumulative
from .without_times import NOTE

_APART = 600.0  # s between files, beyond which they are no parts of one log
_FASTEST = 70.0  # m/s, at which a vehicle gets from the end of one file to the begin of the next
_SLACK = 60.0  # s, allowed for clocks of files
_NEAR = 150.0  # m between two receivers of one vehicle
_COMPARED = 3  # fixes, the fewest that show whether files that overlap are of one vehicle
_AT_ONCE = 5.0  # s between fixes that are compared
_OVERLAP = 5.0  # s, by which logs of odometry that follow each other may overlap
_PREFERRED = (WheelCounts, WheelSpeeds, SpeedYawRate, Odometer)


class Part(NamedTuple):
    """What one file gave."""

    name: str  # of the file
    kind: str
    drives: list[Drive]
    named: bool  # whether the file says what its drives are called
    folder: str = ""  # where the file is


def combined(parts: Sequence[Part], vehicle: Vehicle) -> list[Drive]:
    """The drives of several files, put together by their ids, else by time and place.

    Files of fixes are parts of one drive where one follows the other within ten minutes, or
    where they overlap and are at the same places; else they are drives of their own.

    Args:
        parts: Of all files, on one clock.
        vehicle: For its wheel counters.

    Raises:
        ReadError: It cannot be said which odometry belongs to which fixes.
    """
    groups: dict[str, list[Drive]] = {}
    loose: list[Drive] = []
    wheels: list[Drive] = []
    for part in parts:
        for drive in part.drives:
            if part.named and (has_fixes(drive) or drive.drive_id in groups or _many(part)):
                groups.setdefault(drive.drive_id, []).append(drive)
            elif has_fixes(drive) or _is_empty(drive):
                loose.append(drive)
            else:
                wheels.append(drive)
    notes: list[str] = []
    for group in _by_place(loose, notes):
        name = _free(group[0].drive_id, groups)
        groups[name] = group
    _add_odometry(groups, wheels, parts)
    if len(groups) > 1:
        _check_pairs(groups, parts)
    drives = [_one(group, name, vehicle) for name, group in groups.items()]
    return [replace(drive, notes=(*notes, *drive.notes)) for drive in drives] if notes else drives


def _many(part: Part) -> bool:
    return len(part.drives) > 1


def has_fixes(drive: Drive) -> bool:
    """Whether a drive has a fix."""
    return drive.fixes is not None and len(drive.fixes) > 0


def _is_empty(drive: Drive) -> bool:
    """Whether a drive without fixes has nothing that could belong to another's."""
    return drive.odometry is None and drive.gyro is None and not drive.sensed


def _free(name: str, taken: dict[str, Any]) -> str:
    """The name, with a number where another drive has it."""
    number = 2
    while name in taken:
        name = f"{name.removesuffix(f'-{number - 1}')}-{number}"
        number += 1
    return name


def _by_place(drives: Sequence[Drive], notes: list[str]) -> list[list[Drive]]:
    """Files without ids, those of one vehicle and one time together."""
    groups: list[list[Drive]] = []
    recent: list[list[Drive]] = []  # groups that may go on
    for drive in sorted(drives, key=_begin):
        recent = [g for g in recent if max(map(_end, g)) >= _begin(drive) - _APART]
        home = None
        if NOTE not in drive.notes:  # of invented times none is another's
            home = next((g for g in recent if all(_belong(one, drive) for one in g[-3:])), None)
        if home is None:
            home = []
            groups.append(home)
            if NOTE not in drive.notes:
                recent.append(home)
        home.append(drive)
    if len(groups) > 1:
        notes.append(
            f"{len(drives)} files are {len(groups)} drives: their times or places do not "
            "join; one drive is named by the same id in each file (--id)"
        )
    for group in groups:
        if len(group) > 1:
            names = listed((drive.drive_id for drive in group), 4)
            notes.append(
                f"{names}: joined to one drive by their times and places; a column drive_id in "
                "each keeps drives apart"
            )
    order = {id(drive): k for k, drive in enumerate(drives)}
    for group in groups:
        group.sort(key=lambda drive: order[id(drive)])  # the first file named gives the name
    return sorted(groups, key=lambda group: order[id(group[0])])


def _begin(drive: Drive) -> float:
    return float(drive.fixes.time[0]) if drive.fixes is not None and has_fixes(drive) else np.inf


def _end(drive: Drive) -> float:
    return float(drive.fixes.time[-1]) if drive.fixes is not None and has_fixes(drive) else np.inf


def _belong(first: Drive, second: Drive) -> bool:
    """Whether two logs of fixes, the second beginning later, may be of one drive."""
    a, b = first.fixes, second.fixes
    if a is None or b is None or not len(a) or not len(b):
        return True
    if _both_measure(first.odometry, second.odometry):
        return False
    apart = _apart(a, b)
    if apart is not None:
        return apart < _NEAR
    gap = float(b.time[0] - a.time[-1])
    if gap <= 0.0:  # they overlap, without times that can be compared
        gap = float(np.abs(a.time - b.time[0]).min())
        last = int(np.abs(a.time - b.time[0]).argmin())
    else:
        last = len(a) - 1
    lat = np.array([a.lat_deg[last], b.lat_deg[0]])
    lon = np.array([a.lon_deg[last], b.lon_deg[0]])
    return gap <= _APART and float(distances(lat, lon)[0]) <= _FASTEST * max(gap, _SLACK)


def _both_measure(first: OdometryLog | None, second: OdometryLog | None) -> bool:
    """Whether two logs of odometry of one kind cover the same time, as no two of a drive do."""
    if first is None or type(first) is not type(second) or second is None:
        return False
    begin = max(first.time[0], second.time[0])
    return bool(min(first.time[-1], second.time[-1]) - begin > _OVERLAP)


def _apart(a: Fixes, b: Fixes) -> float | None:
    """Median metres between two logs at the same times; None: too few times are the same."""
    inside = np.flatnonzero((b.time >= a.time[0]) & (b.time <= a.time[-1]))
    if len(inside) < _COMPARED:
        return None
    after = np.searchsorted(a.time, b.time[inside]).clip(1, max(len(a) - 1, 1))
    if len(a) < 2:
        return None
    close = (a.time[after] - a.time[after - 1] <= 2.0 * _AT_ONCE) | (
        np.minimum(
            np.abs(a.time[after] - b.time[inside]), np.abs(a.time[after - 1] - b.time[inside])
        ) <= _AT_ONCE
    )  # fmt: skip
    inside = inside[close]
    if len(inside) < _COMPARED:
        return None
    lat = np.interp(b.time[inside], a.time, a.lat_deg)
    lon = np.interp(b.time[inside], a.time, a.lon_deg)
    lat = np.column_stack([lat, b.lat_deg[inside]]).ravel()
    lon = np.column_stack([lon, b.lon_deg[inside]]).ravel()
    return float(np.median(distances(lat, lon)[::2]))


def _add_odometry(
    groups: dict[str, list[Drive]], wheels: list[Drive], parts: Sequence[Part]
) -> None:
    """Give odometry, and what further sensors say, without an id to the drive of its time."""
    if not wheels:
        return
    with_fixes = [name for name, group in groups.items() if any(map(has_fixes, group))]
    if not groups:
        groups[wheels[0].drive_id] = wheels
    elif len(with_fixes) == 1:
        groups[with_fixes[0]] += wheels
    else:
        for drive in wheels:
            homes = [name for name in with_fixes if _share_time(groups[name], drive)]
            if len(homes) > 1:  # day1.nmea and day1.log are of one drive
                homes = [
                    name for name in homes
                    if any(one.drive_id == drive.drive_id for one in groups[name])
                ]  # fmt: skip
            if len(homes) != 1:
                raise ReadError(_no_pairs(parts))
            groups[homes[0]].append(drive)


def _share_time(group: Sequence[Drive], wheels: Drive) -> bool:
    if wheels.odometry is not None:
        time = wheels.odometry.time
    elif wheels.gyro is not None:
        time = wheels.gyro.time
    elif wheels.sensed:
        time = np.array([one.time for one in wheels.sensed])
    else:
        return False
    logs = [drive.fixes.time for drive in group if drive.fixes is not None and len(drive.fixes)]
    return any(log[0] <= time[-1] and time[0] <= log[-1] for log in logs)


def _check_pairs(groups: dict[str, list[Drive]], parts: Sequence[Part]) -> None:
    """Refuse files of fixes and of odometry of which no two drives have an id in common."""
    if all(any(map(has_fixes, part.drives)) for part in parts):  # odometry has its fixes beside it
        return
    fixes = {n for n, group in groups.items() if any(map(has_fixes, group))}
    wheels = {n for n, group in groups.items() if any(d.odometry is not None for d in group)}
    if fixes - wheels and wheels - fixes and not fixes & wheels:
        raise ReadError(_no_pairs(parts))


def _no_pairs(parts: Sequence[Part]) -> str:
    counts = ", ".join(f"{part.name}: {len(part.drives)}" for part in parts)
    return (
        f"files of several drives ({counts}) share no drive_id; one drive per call, or a column "
        "drive_id in each file (--id COLUMN), was expected; or give each drive a folder of its "
        "own, or its files one name (day1.nmea, day1.log)"
    )


def _one(drives: list[Drive], name: str, vehicle: Vehicle) -> Drive:
    """One drive out of its files."""
    if len(drives) == 1:
        drive = drives[0] if drives[0].drive_id == name else replace(drives[0], drive_id=name)
    else:
        skipped: Skipped = Counter()
        for drive in drives:
            skipped.update(drive.skipped)
        notes = [note for drive in drives for note in drive.notes]
        fixes = _join_fixes([d.fixes for d in drives if d.fixes is not None], skipped)
        odometry = _join_odometry(
            [d.odometry for d in drives if d.odometry is not None], vehicle, skipped, notes, name
        )
        gyros = [d.gyro for d in drives if d.gyro is not None]
        odometry, gyro = _steered(odometry, gyros, skipped)
        _same_clock(name, fixes, odometry)
        drive = Drive(
            drive_id=name,
            fixes=fixes,
            odometry=odometry,
            sources=tuple(source for drive in drives for source in drive.sources),
            skipped=dict(skipped),
            notes=tuple(dict.fromkeys(notes)),
            sensed=tuple(sorted((s for d in drives for s in d.sensed), key=lambda s: s.time)),
            gyro=gyro,
            geared=any(one.geared for one in drives),
        )
    return with_speed_notes(with_fit_notes(without_reckoned(drive, vehicle), vehicle))


def _same_clock(name: str, fixes: Fixes | None, odometry: OdometryLog | None) -> None:
    if fixes is None or odometry is None or not len(fixes) or not len(odometry.time):
        return
    a, b = fixes.time, odometry.time
    if max(b[0] - a[-1], a[0] - b[-1]) > _APART:
        raise ReadError(
            f"{name}: fixes from {moment(a[0])} to {moment(a[-1])} and odometry from "
            f"{moment(b[0])} to {moment(b[-1])} do not overlap in time; one clock was expected; "
            "give the offset under [clock] in vehicle.toml"
        )


def _join_fixes(logs: list[Fixes], skipped: Skipped) -> Fixes | None:
    if len(logs) < 2:
        return logs[0] if logs else None
    logs = sorted(logs, key=lambda log: log.time[0] if len(log) else np.inf)
    columns = {
        f.name: np.concatenate([getattr(log, f.name) for log in logs]) for f in fields(Fixes)
    }
    rows = in_order(columns["time"], skipped)
    return Fixes(**{name: values[rows] for name, values in columns.items()})


def _join_gyros(gyros: list[YawRates], skipped: Skipped) -> YawRates:
    """Readings of gyros as one log."""
    time = np.concatenate([gyro.time for gyro in gyros])
    rows = in_order(time, skipped)
    return YawRates(time[rows], np.concatenate([gyro.rate for gyro in gyros])[rows])


def _steered(
    log: OdometryLog | None, gyros: list[YawRates], skipped: Skipped
) -> tuple[OdometryLog | None, YawRates | None]:
    """Odometry with the gyro of files of its own beside it, and a gyro that has no place there."""
    if not gyros:
        return log, None
    if isinstance(log, WithGyro):
        return WithGyro(log.distance, _join_gyros([log.gyro, *gyros], skipped)), None
    gyro = _join_gyros(gyros, skipped)
    if not isinstance(log, Odometer | WheelCounts | WheelSpeeds):
        return log, gyro
    beside = steered(log, gyro)
    return beside, None if isinstance(beside, WithGyro) else gyro


def _join_odometry(
    logs: list[OdometryLog], vehicle: Vehicle, skipped: Skipped, notes: list[str], name: str
) -> OdometryLog | None:
    """Logs of the best kind, one behind the other; other kinds are left out and noted."""
    if len(logs) < 2:
        return logs[0] if logs else None
    gyros = [log.gyro for log in logs if isinstance(log, WithGyro)]
    if gyros:
        plain: list[OdometryLog] = [
            log.distance if isinstance(log, WithGyro) else log for log in logs
        ]
        joined = _join_odometry(plain, vehicle, skipped, notes, name)
        if not isinstance(joined, Odometer | WheelCounts | WheelSpeeds):
            return joined
        return steered(joined, _join_gyros(gyros, skipped))
    kind = next(k for k in _PREFERRED if any(isinstance(log, k) for log in logs))
    others = sorted({type(log).__name__ for log in logs if not isinstance(log, kind)})
    if others:
        notes.append(f"{kind.__name__} used, {' and '.join(others)} left out")
    mine = sorted((log for log in logs if isinstance(log, kind)), key=lambda log: log.time[0])
    for first, second in pairwise(mine):
        if first.time[-1] - second.time[0] > _OVERLAP:
            raise ReadError(
                f"{name}: two logs of odometry cover the same time; consecutive logs of one "
                "vehicle were expected; leave one out, or give a column drive_id in each file "
                "(--id COLUMN)"
            )
    columns: dict[str, Any] = {
        f.name: np.concatenate([getattr(log, f.name) for log in mine]) for f in fields(kind)
    }
    if len(mine) > 1:
        rows = in_order(columns["time"], skipped)
        columns = {name: values[rows] for name, values in columns.items()}
        if kind is WheelCounts:
            for side in ("left", "right"):
                columns[side] = cumulative(
                    columns["time"],
                    columns[side],
                    bits=vehicle.counter_bits,
                    metres_per_tick=getattr(vehicle, f"metres_per_tick_{side}"),
                    skipped=skipped,
                )
    return kind(**columns)
