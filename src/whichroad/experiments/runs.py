"""One drive matched by one model, beside its truth."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..evaluate import Comparison, compare
from ..lineage.lives import COUNTS
from ..matching import match
from ..observations import Array
from ..simulate import SimulatedDrive, truth_table
from ..tables.result import Result
from .scene_maps import street_of
from .scenes import Scene

MODELS = {"paper": "the paper's method", "default": "whichroad"}
"""Names of `matching.match` to what they are called here."""

ALIVE = COUNTS
"""Probability from which on a hypothesis counts."""

SURE = 0.999
"""Probability from which on a road is declared."""

STEP_S = 1.0
"""One step of the paper, s: its receiver spoke once a second."""


class Run(NamedTuple):
    """One drive matched by one model; n compared epochs."""

    seed: int
    past: Array  # (n,) m driven since the scene's decision
    since: Array  # (n,) s since the drive's start
    right: Array  # (n,) P of the streets that the drive goes along
    wrong: dict[str, Array]  # (n,) each: P of every other street that ever counts
    wrongest: Array  # (n,) P of the most probable one of these, and of the others
    sigma: Array  # (n,) m, stated rms error: the root of the covariance's trace
    answer: Comparison  # (n,) rows
    dark: NDArray[np.bool_]  # (n,) without GNSS


def answer(scene: Scene, drive: SimulatedDrive, model: str) -> Result:
    """Match one drive by one model, hypotheses kept."""
    return match(drive.drive, scene.roads, vehicle=drive.vehicle, model=model, hypotheses=True)


def run_of(scene: Scene, drive: SimulatedDrive, result: Result) -> Run:
    """Compare a result with the truth."""
    roads, truth = scene.roads, drive.truth
    points = result.to_arrow()
    c = compare(points, truth_table(drive, roads))
    assert result.hypotheses is not None
    time = result.hypotheses["time"]
    row = np.searchsorted(time, truth.time[0] + c.since - 1e-3)
    edge, p = result.hypotheses["edge"][row], result.hypotheses["p"][row]
    streets = {e: street_of(roads, e) for e in np.unique(edge[edge >= 0]).tolist()}
    driven = {street_of(roads, int(e)) for e in drive.route}
    mass: dict[str, Array] = {}
    for e, street in streets.items():
        mass[street] = mass.get(street, 0.0) + np.where(edge == e, p, 0.0).sum(axis=1)
    none = np.zeros(len(row))
    wrong = {s: m for s, m in mass.items() if s not in driven}
    ee, nn = (points[name].to_numpy()[row] for name in ("cov_ee_m2", "cov_nn_m2"))
    return Run(
        seed=drive.seed,
        past=np.interp(c.since, truth.time - truth.time[0], truth.travelled) - scene.decision_m,
        since=c.since,
        right=sum((m for s, m in mass.items() if s in driven), none),
        wrong={s: m for s, m in wrong.items() if m.max() >= ALIVE},
        wrongest=np.max([none, *wrong.values()], axis=0),
        sigma=np.sqrt(ee + nn),
        answer=c,
        dark=c.outage,
    )


class Lifetime(NamedTuple):
    """The time during which a wrong road had a probability of `ALIVE` or more."""

    street: str
    created_m: float  # past the decision
    seconds: float
    metres: float
    ended: bool  # before the drive did


def lifetimes(scene: Scene, r: Run) -> list[Lifetime]:
    """Lifetimes of the wrong roads that began where the scene counts them."""
    first_m, last_m = scene.counted_m
    out = []
    for street, p in r.wrong.items():
        counts = np.flatnonzero((p >= ALIVE) & (r.past >= first_m))
        if len(counts) == 0 or r.past[counts[0]] >= last_m:
            continue
        a, b = counts[0], counts[-1]
        end = b + 1 < len(p)
        after = min(b + 1, len(p) - 1)
        seconds, metres = r.since[after] - r.since[a], r.past[after] - r.past[a]
        out.append(Lifetime(street, float(r.past[a]), float(seconds), float(metres), end))
    return out
