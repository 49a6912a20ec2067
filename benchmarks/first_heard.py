"""On line, the first fix before the first wheel reading or after it, then 5 km without GNSS.

The same drives in Heidelberg are told twice: in one order the wheels are silent until the second
fix, in the other the fixes until the second wheel reading.  Receivers report their speed.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from whichroad import Localizer, WheelTicks
from whichroad.simulate import PRESETS, SimulatedDrive, simulate_drive

from . import Figure, Options, interval, seeds_text, town
from .readings import observations

SEEDS = range(7100, 7300)
_OUTAGE = replace(PRESETS["good"], outage_length=5000.0, outage_every=20_000.0)
_LENGTH = 7000.0  # m, with 1.5 km before the outage


def ordered(drive: SimulatedDrive, first: str) -> list[Any]:
    """The observations, begun by a fix or by a wheel reading."""
    seen = observations(drive.drive)
    fixes = [one.time for one in seen if not isinstance(one, WheelTicks)]
    if first == "fix":  # the bus wakes up just before the second fix
        return [one for one in seen if not isinstance(one, WheelTicks) or one.time > fixes[1] - 0.3]
    wheels = [one.time for one in seen if isinstance(one, WheelTicks)]
    return [one for one in seen if isinstance(one, WheelTicks) or one.time > wheels[1]]


def errors(drive: SimulatedDrive, roads: Any, first: str) -> np.ndarray:
    """(n, 2) squared error of the position (m²) and NEES of the pose, through the outage."""
    truth = drive.truth
    online = Localizer(roads, vehicle=drive.vehicle)
    begin, end = drive.outages[0]
    found = []
    for one in ordered(drive, first):
        online.take(one)
        if not isinstance(one, WheelTicks) or not begin < one.time < end:
            continue
        row = int(np.searchsorted(truth.time, one.time - 1e-3))
        if truth.stopped[row]:
            continue
        said = online.estimate()
        if said.pose is None or said.cov is None:
            continue
        scale = float(roads.plane.scale(truth.x[row], truth.y[row]))
        turned = said.pose.heading - truth.heading[row]
        error = np.array([
            (said.pose.x - truth.x[row]) / scale, (said.pose.y - truth.y[row]) / scale,
            np.arctan2(np.sin(turned), np.cos(turned)),
        ])  # fmt: skip
        found.append((error[:2] @ error[:2], error @ np.linalg.solve(said.cov, error)))
    return np.array(found).reshape(-1, 2)


def run(options: Options) -> list[Figure]:
    """RMSE and ANEES of both orders, and their ratio."""
    seeds = options.seeds or SEEDS
    town._open(options.need("maps", "heidelberg.osm.pbf"))
    roads, allowed = town._world["roads"], town._world["allowed"]
    sums: dict[str, list[np.ndarray]] = {"fix": [], "wheels": []}
    for seed in seeds:
        drive = simulate_drive(
            roads, seed=seed, length_m=_LENGTH, scenario=_OUTAGE, allowed=allowed
        )
        for first, rows in sums.items():
            found = errors(drive, roads, first)
            rows.append(np.array([len(found), *found.sum(axis=0)]))
        options.say(f"seed {seed}: done")

    def rmse(table: np.ndarray) -> float:
        return float(np.sqrt(table[:, 1].sum() / table[:, 0].sum()))

    def anees(table: np.ndarray) -> float:
        return float(table[:, 2].sum() / table[:, 0].sum() / 3.0)

    tables = {first: np.array(rows) for first, rows in sums.items()}
    count, text = len(seeds), seeds_text(seeds)
    figures = []
    for first, table in tables.items():
        figures += [
            Figure(f"{first} first: position RMSE", rmse(table), "", "m", count,
                   interval(rmse, table), text),
            Figure(f"{first} first: ANEES of the pose", anees(table), "0.85..1.2", "", count,
                   interval(anees, table), text),
        ]  # fmt: skip
    for name, value in (("RMSE", rmse), ("ANEES", anees)):
        ratio = value(tables["fix"]) / value(tables["wheels"])
        title = f"fix first over wheels first: {name}"
        figures.append(Figure(title, ratio, "0.95..1.05", "", count, None, text))
    return figures
