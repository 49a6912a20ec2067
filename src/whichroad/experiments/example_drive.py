"""The example drive of a scene, which is drawn and logged."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..simulate import SimulatedDrive
from ..tables.result import Result
from .lifetime_log import LifetimeLog, log_hypotheses
from .runs import MODELS, Run, answer, lifetimes
from .scenes import Scene, fixed_sigma


@dataclass(frozen=True, slots=True)
class ExampleDrive:
    """A drive, its results and its lifetime logs, by model."""

    scene: Scene
    drive: SimulatedDrive
    results: dict[str, Result]
    logs: dict[str, LifetimeLog]
    fixed: Result | None  # `gst` only: by the default model, one covariance for all fixes


def median_seed(scene: Scene, runs: Sequence[Run]) -> int:
    """The seed of the drive with the median of the longest lifetime of a wrong road."""
    longest = [
        max((lifetime.seconds for lifetime in lifetimes(scene, r)), default=0.0) for r in runs
    ]
    return runs[int(np.argsort(longest, kind="stable")[len(longest) // 2])].seed


def answer_example(scene: Scene, seed: int) -> ExampleDrive:
    """Match one drive by every model, and log its hypotheses."""
    drive = scene.drive(scene.roads, seed)
    return ExampleDrive(
        scene,
        drive,
        {model: answer(scene, drive, model) for model in MODELS},
        {model: log_hypotheses(scene, drive, model) for model in MODELS},
        answer(scene, fixed_sigma(drive), "default") if scene.name == "gst" else None,
    )
