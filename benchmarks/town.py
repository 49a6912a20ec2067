"""Simulated drives in Heidelberg: wheel ticks at 10 Hz, GNSS of 2.5 m at 1 Hz.

Every seed is a drive of its own: route, map error, car, receiver.  The first 20 s and
all standstill are left out; an edge counts as right within 10 m of travel of it.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import whichroad
from whichroad.epochs import build_timeline
from whichroad.evaluate.compare import within_slack
from whichroad.recorded import Recorded, localize_by_paper, localize_recorded
from whichroad.simulate import SimulatedDrive, drivable, simulate_drive

from . import Figure, Options, interval, seeds_text, share
from .processes import spread

SEEDS = range(1000, 1064)
LENGTH_M = 10_000.0
WARM_UP_S = 20.0
CHI2_95 = 5.991  # two degrees of freedom


@dataclass(frozen=True, slots=True)
class Score:
    """Sums over the epochs of one drive (or of its outages)."""

    epochs: int
    right: int  # within 10 m of travel
    strict: int
    nees_position: float  # sums
    nees_pose: float
    inside: int  # truth in the 95 % ellipse
    squared: float  # m², sum of squared position errors
    sure: int  # P(edge) >= 0.999
    sure_wrong: int
    live: int


_world: dict[str, Any] = {}  # the map of this process


def _open(map_file: Path) -> None:
    roads = whichroad.RoadMap.from_osm(map_file)
    _world["roads"] = roads
    _world["allowed"] = drivable(roads.arrays, np.random.default_rng(0))


def right_edges(drive: SimulatedDrive, edge: np.ndarray) -> np.ndarray:
    """Whether an edge (n,), at the times of the truth, is driven within 10 m of travel."""
    truth = drive.truth
    right: np.ndarray = within_slack(edge, np.arange(len(edge)), truth.edge, truth.travelled)
    return right


def nees(drive: SimulatedDrive, rows: Any, scale: np.ndarray) -> tuple[np.ndarray, ...]:
    """Squared error weighed by the inverse covariance: position, pose; and m² unweighed."""
    truth = drive.truth
    turned = rows.heading - truth.heading
    error = np.column_stack(
        [
            (rows.x - truth.x) / scale,
            (rows.y - truth.y) / scale,
            np.arctan2(np.sin(turned), np.cos(turned)),
        ]
    )
    cov = rows.cov[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)

    def weigh(k: int) -> np.ndarray:
        e = error[:, :k, None]
        return np.einsum("nij,nij->n", e, np.linalg.solve(cov[:, :k, :k], e))

    return weigh(2), weigh(3), (error[:, :2] ** 2).sum(axis=1)


def score(drive: SimulatedDrive, recorded: Recorded, epochs: Any, in_outage: bool) -> Score:
    """Compare one answer with its truth."""
    truth = drive.truth
    at = np.searchsorted(epochs.time, truth.time - 1e-3)
    rows = recorded.output.rows[at]
    edge = rows.edge
    keep = ~truth.stopped & (truth.time > truth.time[0] + WARM_UP_S)
    keep &= rows.live > 0
    if in_outage:
        keep &= np.any([(truth.time > a) & (truth.time < b) for a, b in drive.outages], axis=0)
    right = right_edges(drive, edge)
    scale = _world["roads"].plane.scale(truth.x, truth.y)
    kept = rows.copy()
    kept[~keep] = 0
    kept.cov[np.ix_(~keep, [0, 3, 5])] = 1.0
    position, pose, squared = nees(drive, kept, scale)
    sure = keep & (rows.p_edge >= 0.999)
    return Score(
        epochs=int(keep.sum()),
        right=int((keep & right).sum()),
        strict=int((keep & (edge == truth.edge)).sum()),
        nees_position=float(position[keep].sum()),
        nees_pose=float(pose[keep].sum()),
        inside=int((position[keep] < CHI2_95).sum()),
        squared=float(squared[keep].sum()),
        sure=int(sure.sum()),
        sure_wrong=int((sure & ~right).sum()),
        live=int(rows.live[keep].sum()),
    )


LOCALIZE = {"default": localize_recorded, "paper": localize_by_paper}


def one(
    seed: int, *, scenario: str, length_m: float, in_outage: bool, model: str, settings: Any
) -> Score:
    """Simulate, localize and score one seed."""
    roads = _world["roads"]
    drive = simulate_drive(
        roads, seed=seed, length_m=length_m, scenario=scenario, allowed=_world["allowed"]
    )
    timeline = build_timeline(drive.drive, roads.plane, drive.vehicle)
    recorded = LOCALIZE[model](roads, timeline, vehicle=drive.vehicle, settings=settings)
    return score(drive, recorded, timeline.epochs, in_outage)


def scores(options: Options, scenario: str, in_outage: bool) -> dict[int, Score]:
    """All seeds, one after the other or over some processes."""
    map_file = options.need("maps", "heidelberg.osm.pbf")
    seeds = options.seeds or SEEDS
    preset = options.more.get("preset", scenario)
    work = partial(
        one,
        scenario=preset,
        length_m=options.more.get("metres", LENGTH_M),
        in_outage=in_outage,
        model=options.more.get("model", "default"),
        settings=options.settings(),
    )
    found: dict[int, Score] = {}
    for seed, s in zip(seeds, spread(work, seeds, options, _open, [map_file]), strict=True):
        found[seed] = s
        options.say(
            f"seed {seed}: right {100 * s.right / max(s.epochs, 1):6.2f} %, "
            f"ANEES {s.nees_pose / 3 / max(s.epochs, 1):5.2f}, "
            f"RMSE {np.sqrt(s.squared / max(s.epochs, 1)):5.2f} m, epochs {s.epochs}"
        )
    return found


def figures(found: dict[int, Score], seeds: range, goals: dict[str, str]) -> list[Figure]:
    """Pool the drives; intervals are over drives."""
    rows = [s for s in found.values() if s.epochs]

    def pooled(
        name: str, top: str, unit: str, factor: float, below: str = "epochs", root: bool = False
    ) -> Figure:
        table = np.array([(getattr(s, top), getattr(s, below)) for s in rows], float)

        def value(t: np.ndarray) -> float:
            ratio = factor * share(t) / 100.0
            return float(np.sqrt(ratio)) if root else ratio

        known = len(table) > 0 and table[:, 1].sum() > 0
        return Figure(
            name,
            value(table) if known else None,
            goals.get(name, ""),
            unit,
            len(rows),
            interval(value, table) if known else None,
            seeds_text(seeds),
        )

    return [
        pooled("right edge within 10 m", "right", "%", 100.0),
        pooled("ANEES of the pose", "nees_pose", "", 1 / 3),
        pooled("ANEES of the position", "nees_position", "", 1 / 2),
        pooled("truth in the 95 % ellipse", "inside", "%", 100.0),
        pooled("position RMSE", "squared", "m", 1.0, root=True),
        pooled("right edge, strictly", "strict", "%", 100.0),
        pooled("declared with P >= 0.999", "sure", "%", 100.0),
        pooled("wrong among those", "sure_wrong", "per mille", 1000.0, below="sure"),
        pooled("live hypotheses", "live", "", 1.0),
    ]


def run(options: Options) -> list[Figure]:
    """All epochs of drives with GNSS throughout."""
    found = scores(options, "good", in_outage=False)
    goals = {"right edge within 10 m": ">= 98", "ANEES of the pose": "0.8..1.3"}
    return figures(found, options.seeds or SEEDS, goals)


def outage(options: Options) -> list[Figure]:
    """The epochs of 1.5 km without GNSS, in the same drives."""
    found = scores(options, "outage", in_outage=True)
    goals = {"right edge within 10 m": ">= 98", "position RMSE": "<= 5"}
    return figures(found, options.seeds or SEEDS, goals)
