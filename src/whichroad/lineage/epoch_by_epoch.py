"""The filter epoch by epoch: its hypotheses, and which of them each one's weight came from."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..epochs import Timeline
from ..filter.lookback.history import new_history
from ..filter.state import KEPT, START, Belief, Context, Path, new_belief, new_path, new_work
from ..filter.step import run
from ..filter.summary.estimate import new_output
from ..observations import Array, StartPose
from ..recorded import begin, begin_paper
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle, parameters

_ENTRIES = 1 << 15  # of the path tree, initial capacity


class Gaussians(NamedTuple):
    """The Gaussians after an epoch, g of them, and what they came from."""

    epoch: int
    entry: list[int]  # (g,) of the path tree
    edge: list[int]
    p: Array  # (g,) as the points say it: those on roads sum to 1 - p_off_road
    along: list[float]  # abscissa on the edge, m
    before: list[int]  # (b,) entries of the Gaussians of the epoch before
    flow: Array  # (g, b) part of p that came from each of these; the paper's is not known
    path: Path
    started: bool  # from a fix in this epoch: whatever was before is given up


class Rerun(NamedTuple):
    """A drive that goes through the filter again."""

    epochs: Iterator[Gaussians]  # those with hypotheses
    estimates: Records  # (n,) ESTIMATE, filled on the way


def run_again(
    roads: RoadMap, timeline: Timeline, *, vehicle: Vehicle, settings: Settings,
    start: StartPose | str | None, model: str,
) -> Rerun:  # fmt: skip
    """Run a drive through the filter as `recorded` does, one epoch at a time.

    Args:
        roads: The map.
        timeline: The drive in epochs.
        vehicle: The car.
        settings: The model's numbers.
        start: As `recorded.localize_recorded` takes it.
        model: "default" or "paper".

    Returns:
        An iterator over the epochs that the filter answers, and its estimates.  Epochs of a
        search over the map come before them.
    """
    paper = model == "paper"
    par = parameters(settings, vehicle, timeline.mode, paper=paper)
    ctx = Context(par, roads.arrays, new_work(paper, timeline.evidence))
    belief, path = new_belief(lineage=True), new_path(0 if paper else _ENTRIES)
    output, first = new_output(len(timeline.epochs), False), 0
    if paper:
        begin_paper(belief, roads, timeline, start)
    else:
        first, path = begin(
            roads, timeline, belief, path, ctx, output, vehicle=vehicle, settings=settings,
            start=start,
        )  # fmt: skip

    def epochs() -> Iterator[Gaussians]:
        nonlocal path
        history, hyp = new_history(0), belief.hyp.view(np.ndarray)  # records are slow to read
        state = belief.state.view(np.ndarray)  # (1,)
        step = run.bind(belief, path, history, timeline.epochs, output, ctx, ..., ...)
        for k in range(first, len(timeline.epochs)):
            b = _count_from_here(belief)
            before: list[int] = hyp["path_entry"][:b].tolist()
            while step(k, k + 1) == k:
                path = _larger(path)
                step = run.bind(belief, path, history, timeline.epochs, output, ctx, ..., ...)
            g = int(state["count"][0])
            known = 1.0 - float(state["ranking"]["unknown"][0])
            p = known * hyp["weight"][:g]
            if g:
                yield Gaussians(
                    k, hyp["path_entry"][:g].tolist(), hyp["edge"][:g].tolist(), p,
                    hyp["along"][:g].tolist(), before, p[:, None] * belief.lineage[:g, :b], path,
                    int(state["motion"][0]) == START,
                )  # fmt: skip

    return Rerun(epochs(), output.rows)


def _count_from_here(belief: Belief) -> int:
    """Let the kernels count shares of weight from the present hypotheses; returns how many."""
    state = belief.state.view(np.ndarray)
    used = int(state["count"][0])
    count = min(used, KEPT)
    belief.lineage[:used] = 0.0
    diagonal: NDArray[np.int64] = np.arange(count)
    belief.lineage[diagonal, diagonal] = 1.0
    state["parents"] = count
    return count


def _larger(path: Path) -> Path:
    """The same tree with more room: its entries keep their numbers."""
    size = int(path.size[0])
    larger = new_path(2 * max(len(path.entry), _ENTRIES))
    larger.entry[:size] = path.entry[:size]
    larger.size[0] = size
    return larger
