"""Ten minutes at a stop beside a gyro with a bias, then 1.5 km without GNSS, in Heidelberg.

The drives are those of `outage`, with an odometer and a gyro whose bias is 0.005 rad/s.  Each is
answered as it is, and with its last stop before the outage prolonged by 600 s.  The fixes of the
stop have the errors that the drive's receiver has from its beginning on.
"""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np

from whichroad.epochs import build_timeline
from whichroad.geodesy.angles import wrap_degrees
from whichroad.recorded import localize_recorded
from whichroad.simulate import SimulatedDrive, simulate_drive

from . import Figure, Options, town
from .sensors import sensed

SEEDS = range(7000, 7016)
_BIAS = math.degrees(0.005)  # deg/s
_STAND = 600.0  # s
_AFTER = 60.0  # s of outage


def last_stop(drive: SimulatedDrive) -> int | None:
    """Epoch of the last stop before the outage, at which there is a fix soon; None: no stop."""
    truth, begin = drive.truth, drive.outages[0][0]
    stops = np.flatnonzero(truth.stopped & (truth.time < begin) & (truth.time > truth.time[0] + 60))
    return int(stops[-1]) if len(stops) else None


def prolonged(drive: SimulatedDrive, at: int) -> SimulatedDrive:
    """The drive with a stop prolonged."""
    truth, seen = drive.truth, drive.drive.fixes
    assert seen is not None
    when = truth.time[at]
    rows = np.concatenate(
        [np.arange(at), np.full(int(_STAND * 10) + 1, at), np.arange(at + 1, len(truth))]
    )
    moved = {f.name: getattr(truth, f.name)[rows] for f in fields(truth)}
    inserted = np.arange(int(_STAND * 10) + 1) * 0.1
    moved["time"] = np.concatenate(
        [truth.time[:at], when + inserted, truth.time[at + 1 :] + _STAND]
    )
    moved["speed"][at : at + len(inserted)] = 0.0
    before = int(np.searchsorted(seen.time, when))
    drawn = np.arange(int(_STAND)) % len(drive.fix_error)
    row = np.concatenate(
        [np.arange(before), np.full(len(drawn), before - 1), np.arange(before, len(seen))]
    )
    fixes: dict[str, Any] = {f.name: getattr(seen, f.name)[row] for f in fields(seen)}
    own = slice(before, before + len(drawn))
    extra = drive.fix_error[drawn] - drive.fix_error[drive.seen_fix][before - 1]
    degree = 111_195.0
    fixes["lat_deg"] = fixes["lat_deg"].copy()
    fixes["lat_deg"][own] += extra[:, 1] / degree
    fixes["lon_deg"][own] += extra[:, 0] / (degree * np.cos(np.radians(fixes["lat_deg"][own])))
    fixes["speed"][own] = 0.0
    fixes["sigma_bearing_deg"][own] = np.inf
    fixes["time"] = np.concatenate(
        [seen.time[:before], when + 0.5 + np.arange(len(drawn)), seen.time[before:] + _STAND]
    )
    outages = tuple((a + _STAND, b + _STAND) for a, b in drive.outages)
    later = replace(truth, **moved)
    return replace(
        drive, truth=later, outages=outages, drive=replace(drive.drive, fixes=type(seen)(**fixes))
    )


def turned(drive: SimulatedDrive, recorded: Any, epochs: Any) -> float:
    """Error of the heading a minute into the outage, degrees."""
    row = int(np.searchsorted(drive.truth.time, drive.outages[0][0] + _AFTER))
    row = min(row, len(drive.truth) - 1)
    at = int(np.searchsorted(epochs.time, drive.truth.time[row] - 1e-3))
    error = np.degrees(recorded.output.rows.heading[at] - drive.truth.heading[row])
    return abs(float(wrap_degrees(error)))


def run(options: Options) -> list[Figure]:
    """The outages of the same drives, without and with the stand."""
    seeds = options.seeds or SEEDS
    town._open(options.need("maps", "heidelberg.osm.pbf"))
    roads, allowed = town._world["roads"], town._world["allowed"]
    length = options.more.get("metres", town.LENGTH_M)
    found: dict[str, dict[int, town.Score]] = {"as it is": {}, "after a stand of 600 s": {}}
    headings: dict[str, list[float]] = {case: [] for case in found}
    for seed in seeds:
        drive = simulate_drive(
            roads, seed=seed, length_m=length, scenario="outage", allowed=allowed
        )
        at = last_stop(drive)
        if at is None:
            options.say(f"seed {seed}: never stops before its outage; left out")
            continue
        for case, driven in zip(found, (drive, prolonged(drive, at)), strict=True):
            recording = replace(driven.drive, odometry=sensed(driven, "odometer", _BIAS))
            timeline = build_timeline(recording, roads.plane, driven.vehicle)
            recorded = localize_recorded(
                roads, timeline, vehicle=driven.vehicle, settings=options.settings()
            )
            found[case][seed] = town.score(driven, recorded, timeline.epochs, True)
            headings[case].append(turned(driven, recorded, timeline.epochs))
        options.say(f"seed {seed}: done")
    figures = []
    for case, scores in found.items():
        for figure in town.figures(scores, seeds, {})[:5]:
            figures.append(replace(figure, figure=f"{case}: {figure.figure}"))
        root = float(np.sqrt(np.mean(np.square(headings[case])))) if headings[case] else None
        figures.append(
            replace(figures[-1], figure=f"{case}: heading, RMSE after 60 s", value=root,
                    unit="degrees", ci95=None)
        )  # fmt: skip
    return figures
