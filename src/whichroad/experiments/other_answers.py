"""Answers of other programs to the experiments' drives: read, compared, scored."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import SettingError
from ..evaluate import compare
from ..evaluate.input_tables import Table, read_table
from ..simulate import SimulatedDrive, truth_table
from .numbers import Row
from .runs import MODELS, Run
from .scene_maps import street_of
from .scenes import Scene
from .scores import ASKED, Rows, choice, ends, everywhere, honesty, through_mask

_SUFFIXES = (".parquet", ".arrow", ".feather", ".csv", ".geojson")


class OtherAnswers(NamedTuple):
    """Answers of one program: `folder/SCENE/SEED.parquet`, or another table."""

    name: str
    folder: Path

    @classmethod
    def of(cls, name: str, folder: Path) -> "OtherAnswers":
        """The same, checked.

        Raises:
            SettingError: The name is one of ours, or there is no such folder.
        """
        if not name or name in (*MODELS, *MODELS.values()) or "," in name:
            raise SettingError(
                f"answers: the name is {name!r}; another than {', '.join(MODELS)} was expected, "
                "without a comma"
            )
        if not folder.is_dir():
            raise SettingError(
                f"answers: {folder} is not a folder; one that holds SCENE/SEED.parquet was expected"
            )
        return cls(name, folder)

    def file(self, scene: str, seed: int) -> Path:
        """The answer to one drive.

        Raises:
            SettingError: There is none.
        """
        found = [path for s in _SUFFIXES if (path := self.folder / scene / f"{seed}{s}").is_file()]
        if not found:
            raise SettingError(
                f"answers: {self.folder / scene} has no answer to seed {seed}; {seed}.parquet, or "
                f"one of {', '.join(_SUFFIXES[1:])}, was expected; answer it, or choose other "
                "--seeds"
            )
        return found[0]

    def run(self, scene: Scene, drive: SimulatedDrive) -> Run:
        """One drive's answer beside its truth.

        Raises:
            SettingError: There is no answer.
            ReadError: It is no table with time, lat and lon.
            DriveError: It has no epoch in common with the drive.
        """
        path = self.file(scene.name, drive.seed)
        return _run(scene, drive, Table(read_table(path), str(path)))


def _run(scene: Scene, drive: SimulatedDrive, points: Table) -> Run:
    roads, truth = scene.roads, drive.truth
    c = compare(points.table, truth_table(drive, roads))
    time = truth.time[0] + c.since
    own = points.times()
    order = np.argsort(own, kind="stable")
    row = order[np.clip(np.searchsorted(own[order], time - 1e-3), 0, len(own) - 1)]
    edge = points.edges()[row]
    p = np.where(np.isfinite(c.p_road), c.p_road, 1.0)  # without it the road that is named
    streets = {e: street_of(roads, e) for e in np.unique(edge).tolist() if 0 <= e < len(roads)}
    driven = {street_of(roads, int(e)) for e in drive.route}
    right = np.isin(edge, [e for e, street in streets.items() if street in driven])
    on = np.isin(edge, list(streets))
    sigma = np.full(len(row), np.nan)
    if {"cov_ee_m2", "cov_nn_m2"} <= points.names:
        sigma = np.sqrt(points.numbers("cov_ee_m2")[row] + points.numbers("cov_nn_m2")[row])
    elif "sigma_m" in points.names:
        sigma = np.sqrt(2.0) * points.numbers("sigma_m")[row]
    return Run(
        seed=drive.seed,
        past=np.interp(c.since, truth.time - truth.time[0], truth.travelled) - scene.decision_m,
        since=c.since,
        right=np.where(right, p, 0.0),
        wrong={},
        wrongest=np.where(on & ~right, p, 0.0),
        sigma=sigma,
        answer=c,
        dark=c.outage,
    )


def score_other(scene: Scene, name: str, runs: Sequence[Run]) -> list[Row]:
    """The numbers of one program in one scene that its answers allow.

    Args:
        scene: Which.
        name: Of the program.
        runs: One per seed.
    """
    rows = Rows(scene.name, name)
    spread = all(np.isfinite(r.sigma).all() for r in runs)
    named = all(r.answer.edge_known.all() for r in runs)
    stated = all(np.isfinite(r.answer.p_road).all() for r in runs)
    if scene.name == "outage":
        through_mask(rows, runs, [], named=named, spread=spread)
    elif named and scene.name in ASKED:
        choice(rows, runs, ASKED[scene.name], stated=stated)
    if named and scene.name == "outage":
        ends(rows, runs, stated=stated)
    if scene.name != "outage":
        honesty(rows, runs, everywhere, "", spread=spread)
    return rows.rows
