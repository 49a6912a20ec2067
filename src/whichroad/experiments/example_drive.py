"""The one drive of a scene that is drawn and logged."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..result import Result
from ..simulate import SimulatedDrive
from .lifetime_log import Log, watch
from .runs import MODELS, Ride, answer, lives
from .scenes import Scene, fixed_sigma


@dataclass(frozen=True, slots=True)
class Shown:
    """A drive, its answers and its life-cycle logs, by model."""

    scene: Scene
    drive: SimulatedDrive
    results: dict[str, Result]
    logs: dict[str, Log]
    fixed: Result | None  # `gst` only: by the default model, one covariance for all fixes


def middling(scene: Scene, rides: Sequence[Ride]) -> int:
    """The seed of the drive in which wrong roads counted for a middling time."""
    doubt = [max((life.seconds for life in lives(scene, r)), default=0.0) for r in rides]
    return rides[int(np.argsort(doubt, kind="stable")[len(doubt) // 2])].seed


def show(scene: Scene, seed: int) -> Shown:
    """Answer one drive again by every model, and log it."""
    drive = scene.drive(scene.roads, seed)
    return Shown(
        scene,
        drive,
        {model: answer(scene, drive, model) for model in MODELS},
        {model: watch(scene, drive, model) for model in MODELS},
        answer(scene, fixed_sigma(drive), "default") if scene.name == "gst" else None,
    )
