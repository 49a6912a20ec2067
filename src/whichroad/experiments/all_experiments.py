"""All experiments: simulate, match, evaluate, draw, report."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import SettingError, WriteError
from ..writers import check_folder
from .example_drive import answer_example, median_seed
from .experiments_report import key_table, write_report
from .gst import KINDS, PER_FIX, Kind, score_gst
from .kept_drives import keep_drive, keep_map
from .logs import write_log
from .numbers import Row
from .other_answers import OtherAnswers, score_other
from .pictures import Picture, draw_scene
from .runs import ALIVE, MODELS, STEP_S, SURE, Run, answer, run_of
from .scenes import SCENES, Scene, fixed_sigma
from .scores import score
from .summary_text import seen
from .wheels_alone import wheels_alone_error

Progress = Callable[[str, int, int], None]

NUMBERS, REPORT, TABLE = "experiments.json", "experiments.html", "experiments.md"
_MADE_BY = "whichroad experiments"
SEEDS = range(200)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One scene, done."""

    scene: Scene
    rows: list[Row]
    seen: list[str]  # what is seen, in sentences made from the rows
    example_seed: int
    pictures: list[Picture]
    logs: list[Path]


def _silent(what: str, done: int, total: int) -> None:
    pass


def run_experiments(
    out: str | os.PathLike[str], *, scenes: Sequence[str] = (), seeds: range | None = None,
    force: bool = False, keep: bool = False,
    answers: Mapping[str, str | os.PathLike[str]] | None = None, progress: Progress = _silent,
) -> dict[str, Any]:  # fmt: skip
    """Drive the paper's scenes over many seeds, by its method and by ours, and report.

    Args:
        out: Folder for everything; earlier experiments' is used again.
        scenes: Names among `SCENES`; none: all.
        seeds: Drives of each scene.
        force: Use a folder that holds something else.
        keep: Also write every drive to `drives/SCENE/SEED` in the folder, with its truth.
        answers: Answers of other programs to the same drives, by their names: folders with
            `SCENE/SEED.parquet`, tables as `evaluate` takes them.
        progress: Called with (task, drives done, total).

    Returns:
        What `experiments.json` holds, and the path of the `report`.

    Raises:
        SettingError: No such scene, or no seed, or an answer of another program is missing.
        WriteError: The folder holds something else, or cannot be written to.
    """
    seeds = SEEDS if seeds is None else seeds
    chosen = _chosen(scenes, seeds)
    others = [OtherAnswers.of(name, Path(folder)) for name, folder in (answers or {}).items()]
    for other in others:
        for scene in chosen:
            for seed in seeds:
                other.file(scene.name, seed)  # missing ones are named before the work
    out = Path(out)
    check_folder(out, NUMBERS, _MADE_BY, "earlier experiments'", force=force)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(
            f"{out}: cannot be made ({error.strerror}); a folder to write to was expected; "
            "choose another with --out"
        ) from error
    outcomes = []
    for number, scene in enumerate(chosen):
        if keep:
            keep_map(scene, out)
        outcomes.append(_run_scene(scene, seeds, out, number, len(chosen), progress, keep, others))
    about = {
        "made_by": _MADE_BY,
        "version": __version__,
        "seeds": f"{seeds.start}:{seeds.stop}",
        "terms": {"counts_from_p": ALIVE, "declared_from_p": SURE, "step_s": STEP_S},
        "scenes": {o.scene.name: _about(o) for o in outcomes},
        "rows": [row.as_json() for o in outcomes for row in o.rows],
    }
    text = json.dumps(about, indent=1, ensure_ascii=False, allow_nan=False)
    (out / NUMBERS).write_text(text + "\n", encoding="utf-8")
    write_report(out / REPORT, outcomes, about)
    (out / TABLE).write_text(key_table(outcomes), encoding="utf-8")
    return about | {"report": str(out / REPORT)}


def _chosen(names: Sequence[str], seeds: range) -> list[Scene]:
    for name in names:
        if name not in SCENES:
            raise SettingError(
                f"scene is {name!r}; one of {', '.join(SCENES)} was expected; choose one"
            )
    if len(seeds) == 0 or seeds.start < 0:
        raise SettingError(
            f"seeds are {seeds.start}:{seeds.stop}; A:B with 0 <= A < B was expected; choose some"
        )
    return [SCENES[name] for name in names or SCENES]


def _about(o: Outcome) -> dict[str, Any]:
    return {
        "figure": o.scene.figure,
        "title": o.scene.title,
        "paper": o.scene.claim,
        "seen": o.seen,
        "shown_seed": o.example_seed,
        "pictures": [p.path.name for p in o.pictures],
        "logs": [p.name for p in o.logs],
    }


def _run_scene(
    scene: Scene, seeds: range, out: Path, number: int, count: int, progress: Progress,
    keep: bool, others: Sequence[OtherAnswers],
) -> Outcome:  # fmt: skip
    kinds: Sequence[Kind] = KINDS if scene.name == "gst" else [(m, PER_FIX) for m in MODELS]
    runs: dict[Kind, list[Run]] = {kind: [] for kind in kinds}
    theirs: dict[str, list[Run]] = {other.name: [] for other in others}
    alone = []
    for done, seed in enumerate(seeds):
        progress(f"{scene.name}, seed {seed}", number * len(seeds) + done, count * len(seeds))
        drive = scene.drive(scene.roads, seed)
        if keep:
            keep_drive(scene, drive, out)
        for other in others:
            theirs[other.name].append(other.run(scene, drive))
        if scene.name == "outage":
            alone.append(wheels_alone_error(drive))
        for kind in kinds:
            model, noise = kind
            given = drive if noise == PER_FIX else fixed_sigma(drive)
            runs[kind].append(run_of(scene, given, answer(scene, given, model)))
    progress(f"{scene.name}, drawing", (number + 1) * len(seeds), count * len(seeds))
    example = answer_example(scene, median_seed(scene, runs["default", PER_FIX]))
    logs = [
        path
        for model, log in example.logs.items()
        for path in write_log(out, scene.name, model, log)
    ]
    rows = (
        score_gst(scene, runs)
        if scene.name == "gst"
        else [row for model in MODELS for row in score(scene, model, runs[model, PER_FIX], alone)]
    )
    pictures = draw_scene(scene, runs, example, out)
    told = seen(scene, rows)
    rows += [row for name, found in theirs.items() for row in score_other(scene, name, found)]
    return Outcome(scene, rows, told, example.drive.seed, pictures, logs)
