"""Further sensors (`whichroad.sensors`) on simulated drives in Heidelberg, sound and faulty.

Classes, by `--classes`:

    ranges   5 km without GNSS, a range of 1 m to a point every 200 m, surveyed or read off the map
    compass  started by wheels and the map alone, with a compass of 5 degrees and without one
    mounted  a drawn town: fixes, wheels and a compass that is off by some degrees, cold starts
    removed  a full set, and the set less each sensor: ANEES, truth in the 95 % ellipse
    faults   each sensor with each fault from a minute on: level exceeded, named
"""

import math
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from whichroad.epochs import Timeline, build_timeline
from whichroad.evidence.sensed import Sensed
from whichroad.recorded import Recorded, localize_recorded
from whichroad.sensors import Compass
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, simulate_drive

from . import Figure, Options
from .added_sensors import FAULT_S, FAULTS, SENSORS, Told, faulty, ranges, still_compass
from .scenes.drives import SURE, Row, Table, each, world
from .search import first_held, prepare
from .town import CHI2_95, WARM_UP_S, right_edges

SEEDS = range(7500, 7540)
CLASSES = ("ranges", "compass", "mounted", "removed", "faults")
_OFF_DEG = (0.0, 20.0, 140.0, 180.0)  # of the class mounted
_CLAIMS = {"compass": Compass(), "compass that claims independent errors of 2 degrees": Compass(
    sigma_deg=2.0, lasts_m=0.0)}  # fmt: skip
_FAR_M = 30.0
_AFTER_M, _OUTAGE_M = 1500.0, 5000.0  # of the class ranges
_LENGTH_M = 7500.0
_POINTS = ("none", "surveyed", "none in its frame", "read off the map")  # of the map


def _drive(seed: int, length_m: float, scenario: str = "good") -> SimulatedDrive:
    return simulate_drive(
        world["roads"], seed=seed, length_m=length_m, scenario=scenario, allowed=world["allowed"]
    )


def localize(
    drive: SimulatedDrive, told: list[Told], settings: Settings,
    mask: tuple[tuple[float, float], ...] = (), start: str | None = None,
) -> tuple[Timeline, Recorded, int]:  # fmt: skip
    """The drive with what further sensors said of it; how much of that was impossible."""
    readings = sorted((one for _, given in told for one in given), key=lambda one: one.time)
    sensed = Sensed([sensor for sensor, _ in told], world["roads"]) if told else None
    recording = replace(drive.drive, sensed=tuple(readings))
    if start is not None:
        recording = replace(recording, fixes=None)
    timeline = build_timeline(recording, world["roads"].plane, drive.vehicle, mask, sensed)
    found = localize_recorded(
        world["roads"], timeline, vehicle=drive.vehicle, settings=settings, start=start
    )
    return timeline, found, sum(sensed.skipped.values()) if sensed is not None else 0


class _Errors:
    """What an answer errs by, at the times of the truth."""

    def __init__(self, drive: SimulatedDrive, timeline: Timeline, found: Recorded, on_map: bool):
        t = drive.truth
        at = np.searchsorted(timeline.epochs.time, t.time - 1e-3).clip(0, len(timeline.epochs) - 1)
        self.rows, self.time = found.output.rows[at], t.time
        scale = world["roads"].plane.scale(t.x, t.y)
        if on_map:
            x, y = (self.rows.map_x - t.map_x) / scale, (self.rows.map_y - t.map_y) / scale
            xx, xy, yy = self.rows.map_cov.T
        else:
            x, y = (self.rows.x - t.x) / scale, (self.rows.y - t.y) / scale
            xx, xy, yy = self.rows.cov[:, 0], self.rows.cov[:, 1], self.rows.cov[:, 3]
        self.along = np.abs(x * np.cos(t.heading) + y * np.sin(t.heading))
        self.error = np.hypot(x, y)
        with np.errstate(all="ignore"):
            self.nees = (x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy)
        self.moving = ~t.stopped & (self.rows.live > 0) & (t.time > t.time[0] + WARM_UP_S)


def one_ranges(seed: int, *, settings: Settings) -> Row:
    """A drive without GNSS for 5 km: without ranges, with them, and to points of the map."""
    drive = _drive(seed, _LENGTH_M)
    t = drive.truth
    first, last = np.searchsorted(t.travelled, (_AFTER_M, _AFTER_M + _OUTAGE_M))
    window = (float(t.time[first]), float(t.time[min(last, len(t) - 1)]))
    row: Row = {}
    rng = np.random.default_rng([seed, 5])
    for name in _POINTS:
        on_map = name in ("none in its frame", "read off the map")
        none = name.startswith("none")
        told = [] if none else [ranges(world["roads"], drive, rng, on_map=on_map)]
        errors = _Errors(drive, *localize(drive, told, settings, (window,))[:2], on_map)
        dark = errors.moving & (t.time > window[0]) & (t.time < window[1])
        along = errors.along[dark]
        row |= {
            f"{name}: epochs": float(dark.sum()), f"{name}: nees": float(errors.nees[dark].sum()),
            f"{name}: median": float(np.median(along)),
            f"{name}: p95": float(np.quantile(along, 0.95)),
            f"{name}: squared": float((along**2).sum()),
        }  # fmt: skip
    return row


def one_compass(seed: int, *, settings: Settings) -> Row:
    """A drive without a fix: metres to the first declaration."""
    drive, row = _drive(seed, 5600.0), Row()
    for name in ("without", "with"):
        rng = np.random.default_rng([seed, 7])
        told = [SENSORS["compass"](world["roads"], drive, rng)] if name == "with" else []
        errors = _Errors(drive, *localize(drive, told, settings, start="map")[:2], False)
        rows, travelled = errors.rows, drive.truth.travelled
        sure = rows.p_edge > SURE
        first = first_held(sure, travelled)
        right = right_edges(drive, rows.edge)
        row[f"{name}: declared"] = float(first is not None)
        good = np.flatnonzero(sure & right)
        row[f"{name}: metres"] = float(travelled[good[0]] if len(good) else travelled[-1])
        if first is not None:
            row[f"{name}: wrong"] = float(not right[first])
        row[f"{name}: sure"] = float(sure.sum())
        row[f"{name}: sure and wrong"] = float((sure & ~right).sum())
    return row


def one_mounted(seed: int, *, settings: Settings) -> Row:
    """A drive of 1.5 km with a compass that is off by each of some angles: how far off it ends."""
    drive, row = _drive(seed, 1500.0), Row()
    for claimed, sensor in _CLAIMS.items():
        for off in _OFF_DEG:
            turned = still_compass(world["roads"], drive, off, sensor)
            errors = _Errors(drive, *localize(drive, [turned], settings)[:2], False)
            far = errors.error[-1] > _FAR_M
            row[f"{claimed}, {off:g}: far"] = float(far)
            row[f"{claimed}, {off:g}: far and sure"] = float(far and errors.rows.p_edge[-1] > 0.99)
    return row


def one_removed(seed: int, *, settings: Settings) -> Row:
    """A drive with 1.5 km without GNSS, by all sensors, by none, and by all but one."""
    drive = _drive(seed, 5600.0, "outage")
    row: Row = {}
    told = {
        name: make(world["roads"], drive, np.random.default_rng([seed, k]))
        for k, (name, make) in enumerate(SENSORS.items())
    }
    for removed in ("none", *SENSORS, "all"):
        kept = [one for name, one in told.items() if removed not in (name, "all")]
        errors = _Errors(drive, *localize(drive, kept, settings)[:2], False)
        nees = errors.nees[errors.moving]
        row |= {
            f"{removed}: epochs": float(len(nees)), f"{removed}: nees": float(nees.sum()),
            f"{removed}: inside": float((nees < CHI2_95).sum()),
            f"{removed}: squared": float((errors.error[errors.moving] ** 2).sum()),
        }  # fmt: skip
    return row


def one_faulty(seed: int, *, settings: Settings) -> Row:
    """A drive for each sensor and fault: how often the error is beyond the level; what is named."""
    drive, row = _drive(seed, 3000.0), Row()
    for k, (name, make) in enumerate(SENSORS.items()):
        told = make(world["roads"], drive, np.random.default_rng([seed, k]))
        for fault in ("sound", *FAULTS):
            given = told if fault == "sound" else faulty(name, told, fault)
            timeline, found, skipped = localize(drive, [given], settings)
            errors = _Errors(drive, timeline, found, False)
            since = errors.moving & (errors.time > errors.time[0] + FAULT_S)
            beyond = errors.error > errors.rows.protection_level
            case = f"{name}, {fault}"
            row[f"{case}: epochs"] = float(since.sum())
            row[f"{case}: exceeded"] = float((since & beyond).sum())
            named = any(finding.what == f"sensor {told[0].name}" for finding in found.diagnosis)
            row[f"{case}: named"] = float(named or skipped > 0)
    return row


def run(options: Options) -> list[Figure]:
    """The classes asked for, one after the other."""
    seeds = options.seeds or SEEDS
    heidelberg = options.need("maps", "heidelberg.osm.pbf")
    figures: list[Figure] = []
    ones = (one_ranges, one_compass, one_mounted, one_removed, one_faulty)
    shown = (_ranges_table, _compass_table, _mounted_table, _removed_table, _faults_table)
    works = dict(zip(CLASSES, ones, strict=True))
    tables = dict(zip(CLASSES, shown, strict=True))
    for name in options.more.get("classes", ",".join(CLASSES)).split(","):
        work = partial(works[name], settings=options.settings())
        maps = (None, None) if name == "mounted" else (heidelberg, heidelberg)
        figures += tables[name](Table(each(work, seeds, options, prepare, maps), seeds))
    return figures


def _mean(table: Table, name: str, what: str, below: str, goal: str = "", by: float = 1.0) -> Any:
    return table.share(name, what, below, goal, "", 1.0 / by)


def _ranges_table(table: Table) -> list[Figure]:
    figures = []
    for name in _POINTS:
        asked = not name.startswith("none")
        figures += [
            table.quantile(
                f"ranges {name}: median along, median drive", f"{name}: median", 0.5,
                goal="<= 1.0" if asked else "",
            ),
            table.share(f"ranges {name}: p95 along, mean of drives", f"{name}: p95", None,
                        "<= 3.5" if asked else "", "m", 1.0),
            _mean(table, f"ranges {name}: ANEES", f"{name}: nees", f"{name}: epochs",
                  "0.8..1.2" if asked else "", 2.0),
        ]  # fmt: skip
    return figures


def _compass_table(table: Table) -> list[Figure]:
    figures = []
    for name in ("without", "with"):
        figures += [
            table.quantile(f"{name} compass: metres, median", f"{name}: metres", 0.5),
            table.share(f"{name} compass: metres, mean", f"{name}: metres", None, "", "m", 1.0),
            table.share(f"{name} compass: first declaration wrong", f"{name}: wrong"),
            table.share(f"{name} compass: sure epochs wrong", f"{name}: sure and wrong",
                        f"{name}: sure"),
        ]  # fmt: skip
    both = [(r["with: metres"], r["without: metres"]) for r in table.rows]
    means = np.array(both).mean(axis=0) if both else (math.nan, 1.0)
    medians = np.median(np.array(both), axis=0) if both else (math.nan, 1.0)
    n = len(both)
    return [
        *figures,
        Figure("compass: mean way, of that without", float(means[0] / means[1]), "<= 0.7", "", n),
        Figure("compass: median way, of that without", float(medians[0] / medians[1]), "<= 0.7",
               "", n),
    ]  # fmt: skip


def _mounted_table(table: Table) -> list[Figure]:
    figures = []
    for claimed, off in product(_CLAIMS, _OFF_DEG):
        name = f"{claimed}, off by {off:g} degrees: ends {_FAR_M:g} m off"
        case = f"{claimed}, {off:g}"
        figures += [
            table.share(name, f"{case}: far", None, "<= 0"),
            table.share(f"{name}, and sure of its road", f"{case}: far and sure"),
        ]
    return figures


def _removed_table(table: Table) -> list[Figure]:
    figures = []
    for name in ("none", *SENSORS, "all"):
        figures += [
            _mean(table, f"removed {name}: ANEES", f"{name}: nees", f"{name}: epochs",
                  "0.8..1.2", 2.0),
            table.share(f"removed {name}: truth in the 95 % ellipse", f"{name}: inside",
                        f"{name}: epochs", "92..98"),
            _mean(table, f"removed {name}: mean squared error, m²", f"{name}: squared",
                  f"{name}: epochs"),
        ]  # fmt: skip
    return figures


def _faults_table(table: Table) -> list[Figure]:
    figures = []
    for name in SENSORS:
        for fault in ("sound", *FAULTS):
            case = f"{name}, {fault}"
            goal = "" if fault == "sound" else "<= 1e-3"
            figures += [
                _mean(table, f"{case}: level exceeded", f"{case}: exceeded", f"{case}: epochs",
                      goal),
                table.share(f"{case}: named", f"{case}: named"),
            ]  # fmt: skip
    return figures
