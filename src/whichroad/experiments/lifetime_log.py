"""Lifetime log: every hypothesis of one drive of a scene, when it was created, its weight, its end.

What a hypothesis is, and why it ends, is told by `lineage.lives`.
"""

from dataclasses import dataclass

import numpy as np

from ..epochs import build_timeline
from ..lineage import Hypothesis, lives_of
from ..observations import Array
from ..settings import Settings
from ..simulate import SimulatedDrive
from .scenes import Scene


@dataclass(frozen=True, slots=True)
class LifetimeLog:
    """All hypotheses of one drive under one model; time and distance of its n epochs."""

    since: Array
    past: Array  # m past the scene's decision
    hypotheses: list[Hypothesis]


def log_hypotheses(scene: Scene, drive: SimulatedDrive, model: str) -> LifetimeLog:
    """Run a model over a drive and log every hypothesis; what no hypothesis knows is left out."""
    timeline = build_timeline(drive.drive, scene.roads.plane, drive.vehicle)
    lives = lives_of(
        scene.roads, timeline, vehicle=drive.vehicle, settings=Settings(unknown=0.0), model=model
    )  # fmt: skip
    since = lives.time - lives.time[0]
    truth = drive.truth
    past = np.interp(since, truth.time - truth.time[0], truth.travelled) - scene.decision_m
    return LifetimeLog(since, past, lives.hypotheses)
