"""Pictures of an answer, after the paper's Figures 9 to 11.

Positions are drawn in the map's plane, in metres.  Along a whole drive blue is probable
and red is not; in a zoom each road has its colour, and opacity is its probability.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import comes_with
from .scene import Window as Window
from .scene import ambiguous_windows, make_scene, origin_of

if TYPE_CHECKING:
    import pyarrow as pa

    from ..observations import Fixes
    from ..roadmap import RoadMap
    from ..tables.result import Result


def plot_drive(
    result: "Result",
    roads: "RoadMap",
    truth: "pa.Table | None" = None,
    fixes: "Fixes | None" = None,
    *,
    out: str | os.PathLike[str],
    windows: Sequence[Window] = (),
    masked: Iterable[tuple[float, float]] = (),
    reckoning: "pa.Table | None" = None,
    title: str = "",
) -> list[Path]:
    """Draw one drive: where, among which roads, how probable, how far from the truth.

    Args:
        result: the answer, kept with its hypotheses.
        roads: the map that it was matched to.
        truth: `time, lat, lon`, if known.
        fixes: the receiver's.
        out: folder for the pictures; those of the same name there are replaced.
        windows: stretches to zoom in on; the two most ambiguous ones when empty.
        masked: stretches without GNSS, s from the drive's start.
        reckoning: `lat, lon` of dead reckoning alone, for comparison.
        title: one sentence that describes the picture.

    Returns:
        The PNG files: `overview`, `hypotheses`, `probability`, and `drive` with all of it.
        Beside each lies the same picture as SVG.

    Raises:
        DriveError: the answer was kept without its hypotheses.
    """
    with comes_with("plot", "pictures"):
        from .pages import draw_pages

    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    scene = make_scene(result, roads, truth, fixes, masked, reckoning)
    chosen = list(windows) or ambiguous_windows(scene)
    return draw_pages(scene, chosen, title, out)


def plot_methods(
    answers: "Sequence[tuple[str, Result]]",
    roads: "RoadMap",
    truth: "pa.Table | None" = None,
    fixes: "Fixes | None" = None,
    *,
    out: str | os.PathLike[str],
    windows: Sequence[Window],
    masked: Iterable[tuple[float, float]] = (),
    title: str = "",
) -> list[Path]:
    """Draw several answers to one drive, one above the other, and their P beneath.

    Args:
        answers: a name and an answer, kept with its hypotheses, for each row.
        roads: the map that they were matched to.
        truth: `time, lat, lon`, if known.
        fixes: the receiver's.
        out: folder for the pictures; those of the same name there are replaced.
        windows: stretches, a column each, s from the drive's start.
        masked: stretches without GNSS, s from the drive's start.
        title: one sentence that describes the picture.

    Returns:
        The files `methods.png` and `methods.svg`.

    Raises:
        DriveError: an answer was kept without its hypotheses.
    """
    with comes_with("plot", "pictures"):
        from .pages import draw_methods

    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    dark, first = list(masked), answers[0][1]
    origin = origin_of(first, roads)
    scenes = [
        (name, make_scene(answer, roads, truth, fixes, dark, None, origin))
        for name, answer in answers
    ]
    return draw_methods(scenes, list(windows), title, out)
