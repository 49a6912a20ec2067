"""Wheels and a gyro together: one of them is wrong or silent, and the other takes over.

Drives in Heidelberg.  The gyro has a bias of 0.5 deg/s, which nobody is told, and white noise of
0.1 deg/s.  Classes, by `--classes`:

    good     GNSS throughout, each fault: by both, by wheels alone, and by both on line
    outage   the same with 1.5 km without GNSS; faults that come begin 10 s after its begin
"""

import math
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import whichroad
from whichroad.epochs import build_timeline
from whichroad.filter.records import EPOCH
from whichroad.filter.summary.estimate import ESTIMATE
from whichroad.live.playback import RecordedObservations
from whichroad.observations import WheelCounts, WithGyro, YawRates
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, simulate_drive

from . import Figure, Options
from .scenes.drives import Row, Table, each, world
from .search import prepare
from .town import WARM_UP_S, right_edges

SEEDS = range(18_500, 18_540)
CLASSES = ("good", "outage")
_BIAS, _NOISE = math.radians(0.5), math.radians(0.1)  # rad/s
_COMES_S, _LASTS_S = 60.0, 60.0
_FRESH_S = 0.15  # s, largest age of what is counted
_GRACE_S = 10.0  # s after a fault's begin, from which on roads are counted
FAULTS = {
    "sound": "", "wheels swapped": "wheels", "left counter at 0": "wheels",
    "left counter stops": "wheels", "wheels silent 60 s": "wheels", "gyro of other sign": "gyro",
    "gyro in degrees": "gyro", "gyro at 0": "gyro", "gyro stops": "gyro", "gyro silent": "gyro",
}  # fmt: skip
HEARD = ("both", "wheels alone", "on line")


class Faulty(NamedTuple):
    """What was heard of a drive, and since when something is wrong."""

    log: WithGyro
    begin: float  # s


def gyro_of(drive: SimulatedDrive) -> YawRates:
    """The gyro of a drive."""
    t, draw = drive.truth, np.random.default_rng([drive.seed, 79])
    rate = np.gradient(np.unwrap(t.heading), t.time) + _BIAS
    return YawRates(t.time, rate + _NOISE * draw.standard_normal(len(rate)))


def faulty(drive: SimulatedDrive, fault: str) -> Faulty:
    """The wheels and the gyro of a drive with a fault."""
    wheels, gyro = drive.drive.odometry, gyro_of(drive)
    assert isinstance(wheels, WheelCounts)
    begin = float(wheels.time[0])
    comes = drive.outages[0][0] + 10.0 if drive.outages else begin + _COMES_S
    at = np.searchsorted(wheels.time, comes)
    since = gyro.time >= comes
    match fault:
        case "wheels swapped":
            wheels = replace(wheels, left=wheels.right, right=wheels.left)
        case "left counter at 0":
            wheels = replace(wheels, left=0.0 * wheels.left)
        case "left counter stops":
            left = wheels.left.copy()
            left[at:] = left[at]
            wheels, begin = replace(wheels, left=left), comes
        case "wheels silent 60 s":
            keep = (wheels.time < comes) | (wheels.time > comes + _LASTS_S)
            columns = (x[keep] for x in (wheels.time, wheels.left, wheels.right))
            wheels, begin = WheelCounts(*columns), comes
        case "gyro of other sign":
            gyro = replace(gyro, rate=-gyro.rate)
        case "gyro in degrees":
            gyro = replace(gyro, rate=np.degrees(gyro.rate))
        case "gyro at 0":
            gyro = replace(gyro, rate=0.0 * gyro.rate)
        case "gyro stops":
            gyro, begin = replace(gyro, rate=np.where(since, 0.0, gyro.rate)), comes
        case "gyro silent":
            gyro, begin = YawRates(gyro.time[~since], gyro.rate[~since]), comes
    possible = np.abs(gyro.rate) <= 4.0 * math.pi  # as readers take them
    return Faulty(WithGyro(wheels, YawRates(gyro.time[possible], gyro.rate[possible])), begin)


class Said(NamedTuple):
    """The estimate at the times of the truth, (n,)."""

    rows: Any
    fresh: np.ndarray  # whether it was said then, and not long before
    names: list[str]  # of what is named


def _recorded(drive: SimulatedDrive, log: Any, settings: Settings) -> Said:
    """Of a recorded drive."""
    recording = replace(drive.drive, odometry=log)
    timeline = build_timeline(recording, world["roads"].plane, drive.vehicle)
    found = localize_recorded(world["roads"], timeline, vehicle=drive.vehicle, settings=settings)
    at = np.searchsorted(timeline.epochs.time, drive.truth.time + 1e-3).clip(1) - 1
    fresh = drive.truth.time - timeline.epochs.time[at] < _FRESH_S
    return Said(found.output.rows[at], fresh, [one.what for one in found.diagnosis])


def _on_line(drive: SimulatedDrive, log: WithGyro, settings: Settings) -> Said:
    """The same, reading by reading."""
    online = whichroad.Localizer(world["roads"], vehicle=drive.vehicle, settings=settings)
    recording = replace(drive.drive, odometry=log)
    rows = np.zeros(len(drive.truth), ESTIMATE).view(np.recarray)
    k, time, said_at = 0, drive.truth.time, np.zeros(len(drive.truth))
    played = RecordedObservations(recording)
    for one in (played[n] for n in range(len(played))):
        while k < len(time) and time[k] < one.time - 1e-3:
            epoch, rows[k] = _last(online)
            said_at[k], k = epoch.time, k + 1
        online.take(one)
    epoch, rows[k:] = _last(online)
    said_at[k:] = epoch.time
    return Said(rows, time - said_at < _FRESH_S, [one.what for one in online.diagnosis])


def _last(online: whichroad.Localizer) -> tuple[Any, Any]:
    """The last epoch, and what was said at it."""
    epoch, row = online.last_rows()
    return np.frombuffer(epoch, EPOCH).view(np.recarray)[0], np.frombuffer(row, ESTIMATE)[0]


def one(seed: int, *, settings: Settings, scenario: str) -> Row:
    """A drive with each fault."""
    length = 3000.0 if scenario == "good" else 5600.0
    drive = simulate_drive(
        world["roads"], seed=seed, length_m=length, scenario=scenario, allowed=world["allowed"]
    )
    t, row = drive.truth, Row()
    scale = world["roads"].plane.scale(t.x, t.y)
    for fault, who in FAULTS.items():
        log, begin = faulty(drive, fault)
        for heard in HEARD:
            if heard == "wheels alone":
                rows, fresh, names = _recorded(drive, log.distance, settings)
            else:
                locate = _recorded if heard == "both" else _on_line
                rows, fresh, names = locate(drive, log, settings)
            error = np.hypot(rows.x - t.x, rows.y - t.y) / scale
            kept = (
                fresh & ~t.stopped & (rows.live > 0) & (t.time > max(begin, t.time[0] + WARM_UP_S))
            )
            if drive.outages:
                begun, ended = drive.outages[0]
                kept &= (t.time > begun) & (t.time < ended)
            late = kept & (t.time > begin + _GRACE_S)
            right, sure = right_edges(drive, rows.edge), late & (rows.p_edge >= 0.999)
            case = f"{fault}, {heard}"
            row |= {
                f"{case}: epochs": float(kept.sum()), f"{case}: later": float(late.sum()),
                f"{case}: exceeded": float((kept & (error > rows.protection_level)).sum()),
                f"{case}: squared": float((error[late] ** 2).sum()),
                f"{case}: right": float((late & right).sum()),
                f"{case}: sure": float(sure.sum()),
                f"{case}: wrong": float((sure & ~right).sum()),
                f"{case}: named": float(any(n.startswith(f"{who}:") for n in names)),
                f"{case}: any": float(len(names) > 0),
            }  # fmt: skip
    return row


def run(options: Options) -> list[Figure]:
    """The classes asked for."""
    seeds = options.seeds or SEEDS
    heidelberg = options.need("maps", "heidelberg.osm.pbf")
    figures: list[Figure] = []
    for name in options.more.get("classes", ",".join(CLASSES)).split(","):
        work = partial(one, settings=options.settings(), scenario=name)
        rows = each(work, seeds, options, prepare, (heidelberg, heidelberg))
        figures += _figures(name, Table(rows, seeds))
    return figures


def _figures(scenario: str, table: Table) -> list[Figure]:
    figures = []
    for fault, who in FAULTS.items():
        for heard in HEARD:
            case, title = f"{fault}, {heard}", f"{scenario}, {fault}, {heard}"
            asked = heard != "wheels alone"
            figures += [
                table.share(f"{title}: level exceeded", f"{case}: exceeded", f"{case}: epochs",
                            "<= 1" if asked else "", "per mille", 1000.0),
                table.share(f"{title}: right edge", f"{case}: right", f"{case}: later"),
                table.share(f"{title}: mean squared error, m²", f"{case}: squared",
                            f"{case}: later", "", "", 1.0),
                table.share(f"{title}: P >= 0.999", f"{case}: sure", f"{case}: later"),
                table.share(f"{title}: wrong of these", f"{case}: wrong", f"{case}: sure",
                            "<= 1" if asked else "", "per mille", 1000.0),
                table.share(f"{title}: {who or 'anything'} named",
                            f"{case}: {'named' if who else 'any'}", None,
                            (">= 99" if who else "<= 1") if asked else ""),
            ]  # fmt: skip
    return figures
