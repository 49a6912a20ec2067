"""Does the truth lie in the ellipses as often as they say?  Short drives in Heidelberg.

Good and urban GNSS, and the 1.5 km of an outage; the absolute position and the one in
the map's frame, in which the map is exact.  The first 20 s and standstill are left out.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import GOOD, URBAN, SimulatedDrive, simulate_drive

from .. import Figure, Options
from .drives import Answer, Row, Table, answer, each, read_town, world

SEEDS = range(10_000, 10_400)
LENGTH_M = 3000.0
WARM_UP_S = 20.0
CLASSES = {
    "good": GOOD,
    "urban": URBAN,
    "outage": replace(GOOD, outage_first=1000.0, outage_length=1500.0),
}
GOALS = {"good": "0.9..1.1", "urban": "0.9..1.3", "outage": "0.9..1.2"}
MAP_GOAL = "0.7..1.3"
LEVELS = (50, 90, 95, 99)  # %
# x, y and covariance in the estimates, and elements xx, xy, yy of that
FRAMES = {"world": ("x", "y", "cov", [0, 1, 3]), "map": ("map_x", "map_y", "map_cov", [0, 1, 2])}


def errors(
    roads: RoadMap, drive: SimulatedDrive, said: Answer, frame: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Error (m) and squared error in units of the covariance, (n,) each."""
    truth, (vx, vy, cov, elements) = drive.truth, FRAMES[frame]
    x, y = (truth.x, truth.y) if frame == "world" else (truth.map_x, truth.map_y)
    scale = roads.plane.scale(truth.x, truth.y)
    dx, dy = (said.rows[vx] - x) / scale, (said.rows[vy] - y) / scale
    a, b, c = said.rows[cov][:, elements].T
    det = np.maximum(a * c - b * b, 1e-12)
    return np.hypot(dx, dy), (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / det


def one(seed: int, *, length_m: float, classes: tuple[str, ...], settings: Settings) -> Row:
    """One drive of each class."""
    row: Row = {}
    for name in classes:
        drive = simulate_drive(
            world["roads"], seed=seed, length_m=length_m, scenario=CLASSES[name],
            allowed=world["allowed"],
        )  # fmt: skip
        said = answer(world["roads"], drive, settings)
        row |= {f"{name} {k}": v for k, v in _score(drive, said, name == "outage").items()}
    return row


def _score(drive: SimulatedDrive, said: Answer, in_outage: bool) -> Row:
    """Sums over the epochs that count."""
    truth = drive.truth
    keep = ~truth.stopped & (truth.time > truth.time[0] + WARM_UP_S) & said.started
    if in_outage:
        keep &= np.any([(truth.time > a) & (truth.time < b) for a, b in drive.outages], axis=0)
    row: Row = {"epochs": float(keep.sum())}
    for frame in FRAMES:
        error, weighed = errors(world["roads"], drive, said, frame)
        row[f"{frame} nees"] = float(weighed[keep].sum())
        row[f"{frame} squared"] = float((error[keep] ** 2).sum())
        for level in LEVELS:
            within = weighed[keep] <= -2.0 * np.log1p(-level / 100.0)
            row[f"{frame} {level}"] = float(within.sum())
        if frame == "world":
            level_m = said.rows.protection_level[keep]
            row["beyond"] = float((error[keep] > level_m).sum())
            row["ever beyond"] = float((error[keep] > level_m).any())
            row["level"] = float(level_m.sum())
    return row


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    chosen = options.more.get("preset")
    classes = (chosen,) if chosen else tuple(CLASSES)
    work = partial(
        one,
        length_m=options.more.get("metres", LENGTH_M),
        classes=classes,
        settings=options.settings(),
    )
    map_file = options.need("maps", "heidelberg.osm.pbf")
    table = Table(each(work, seeds, options, read_town, [map_file]), seeds)
    figures = []
    for name in classes:
        below = f"{name} epochs"
        for frame in FRAMES:
            what, key = f"{name}, {frame} frame: ", f"{name} {frame} "
            goal = GOALS[name] if frame == "world" else MAP_GOAL
            figures.append(table.share(what + "ANEES", key + "nees", below, goal, "", 0.5))
            figures += [
                table.share(
                    f"{what}in the {level} % ellipse",
                    f"{key}{level}",
                    below,
                    "93..97" if level == 95 else "",
                )
                for level in LEVELS
            ]
            figures.append(table.root(what + "RMSE", key + "squared", below))
        what, risk = f"{name}: ", options.settings().protection_risk
        figures += [
            table.share(
                what + "beyond the protection level", f"{name} beyond", below,
                f"<= {1000 * risk:g}", "per mille", 1000.0,
            ),
            table.share(what + "drives ever beyond it", f"{name} ever beyond"),
            table.share(what + "protection level, mean", f"{name} level", below, "", "m", 1.0),
        ]  # fmt: skip
    return figures
