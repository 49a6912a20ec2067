"""docs/honesty.md: method, table, pictures, misses; the words of `notes.md` at its end."""

from pathlib import Path

import numpy as np

from .. import Figure, seeds_text
from ..exact_bounds import upper_bound
from .classes import VARIANTS
from .figures import WRONG_GOAL, Summary, calibration_error, figures_of
from .plots import coverage_plot, declare_plot, reliability_plot, stanford_plot

_HEAD = """# Are the printed probabilities true?

Written by `python -m benchmarks honesty --write docs/honesty.md`; do not edit by hand.

{drives:,} short drives, each with a truth that is known and noise of its own (drives
{seeds}). {misses} of {asked} figures miss their goal.

## What was done

*Scenes.* Ten kinds of small maps with one thing to decide on each, in {variants} geometries:
`junction` (Y of 12 to 60 degrees, T, cross), `parallel-G` (a fork into two one-way roads G m
apart), `roundabout`, `grid` (blocks of 60 to 100 m), `ramp` (leaving a motorway at 4 to 8 degrees,
then 12 to 25 m beside it), `off-map` (over a street that the map lacks), `tunnel` (500 to 1,500 m
without GNSS and one or two forks in it). They are compiled by the same code as any map. `-gnss`:
no wheels, fixes at 1 Hz with speed and course; `-fixes`: with positions alone.

*Drives.* Everything else is drawn for each drive: the branch taken (all alike), map error (4.1 m
over 1.5 to 4 km and 0.7 m over 60 to 250 m, sums of Fourier modes), lane offsets and changes of
lane, speed, stops, wheels (scale 1 %, left against right 0.03 %, ticks, walk), receiver.
`good`: a slow error of 2.5 m per axis and 1 m white, reported as 2.7 m. `urban`: 8 to 14 m with
30 s, 3 m white and multipath, reported as 6 m. `misspecified`: as `good`, but 1.5 times larger and
three times longer than what is reported and assumed. The simulator is not the filter's model.

*Declaration.* The first epoch beyond the branch point at which a road has P >= 0.999, once per
drive. A road is all edges between two branch points in one direction; its P is the sum over them.
It is wrong if the vehicle is not on that road within 10 m of travel. The road that leads to the
branch point counts as a declaration only 30 m beyond it.

*Decision.* The most probable road 30 m and 100 m beyond the branch point and at the drive's end,
with its P: calibration error, reliability, log score and Brier score are over these, never over
epochs. Bounds of rates are Clopper and Pearson's, the upper one at 95 %; intervals of other
figures are over drives. Fewer than 3,000 declarations cannot show a bound of 1 ‰, however right
they are. Figures of the pose leave out the first 20 s and standstill.

*Exact test.* For two roads and GNSS alone, the share declared is compared with that of the test
that knows all covariances of the simulator (receiver, map, lanes) and sees every fix's distance
from both roads.

"""


def _which(seeds: range, few: range) -> str:
    """Which drives of each class and noise were driven."""
    if seeds == few:
        return f"{seeds_text(seeds)} of each class and noise"
    return f"{seeds_text(seeds)} of each class; {seeds_text(few)} of the noises other than `good`"


def write_report(path: Path, summaries: list[Summary], seeds: range, few: range) -> None:
    """Write the page and its pictures, which lie in `img` beside it."""
    noises = list(dict.fromkeys(s.noise for s in summaries))
    found = [f for s in summaries for f in figures_of(s, seeds_text(seeds))]
    missed = [f for f in found if f.met is False]
    parts = [
        _HEAD.format(
            drives=sum(s.drives for s in summaries), seeds=_which(seeds, few), misses=len(missed),
            asked=sum(f.met is not None for f in found), variants=VARIANTS,
        )
    ]  # fmt: skip
    for noise in noises:
        parts.append(f"## {noise}\n\n" + _table([s for s in summaries if s.noise == noise]))
    parts.append(_pictures(path, summaries, noises))
    parts.append(_exact([s for s in summaries if s.row.test_declared.any()]))
    parts.append(_missed(missed))
    parts.append((Path(__file__).parent / "notes.md").read_text(encoding="utf-8"))
    path.write_text("\n".join(p for p in parts if p.strip()), encoding="utf-8")


def _bold(text: str, miss: bool) -> str:
    return f"**{text}**" if miss else text


def _table(summaries: list[Summary]) -> str:
    """One row a class; what misses its goal is bold."""
    lines = [
        "| class | drives | declared % | wrong | upper bound ‰ | median s | ECE | right at 100 m % "
        "| ANEES | in 95 % | ANEES map | level, m | above it ‰ |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for s in summaries:
        by_name = {f.figure.partition(": ")[2]: f for f in figures_of(s, "")}

        def cell(name: str, form: str, table: dict[str, Figure] = by_name) -> str:
            f = table.get(name)
            if f is None or f.value is None:
                return ""
            return _bold(format(f.value, form), f.met is False)

        p, right, _, _ = s.decisions()
        _, far, _, _ = s.decisions(("far",))
        bound = 1e3 * upper_bound(s.wrong, s.declared) if s.declared else 1e3
        miss = bound > 1e3 * WRONG_GOAL.get(s.noise, 1e-3)
        ece = calibration_error(p, right)
        cells = [
            s.name,
            f"{s.drives:,}",
            cell("declared", ".1f"),
            str(s.wrong),
            _bold(f"{bound:.2f}", miss),
            cell("time to declare, median", ".1f"),
            _bold(f"{ece:.4f}", ece > 0.01),
            f"{100 * float(np.mean(far)):.2f}" if len(far) else "",
            cell("ANEES of the position", ".2f"),
            cell("truth in the 95 % ellipse", ".1f"),
            cell("ANEES in the map's frame", ".2f"),
            cell("mean protection level", ".1f"),
            cell("error above the protection level", ".2f"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, ""])


def _pictures(path: Path, summaries: list[Summary], noises: list[str]) -> str:
    folder = path.parent / "img"
    draw = {
        "honesty-reliability.png": (reliability_plot, "Reliability of decisions"),
        "honesty-declared.png": (declare_plot, "When a road is declared"),
        "honesty-coverage.png": (coverage_plot, "Coverage of the ellipses"),
        "honesty-stanford.png": (stanford_plot, "Error against protection level"),
    }
    lines = ["## Pictures", ""]
    for name, (plot, what) in draw.items():
        if plot is stanford_plot and not any(s.row.level.any() for s in summaries):
            continue
        plot(summaries, noises, folder / name)
        lines += [f"![{what}](img/{name})", ""]
    return "\n".join(lines)


def _exact(summaries: list[Summary]) -> str:
    if not summaries:
        return ""
    lines = [
        "## Beside the exact test",
        "",
        "| class | noise | declared % | test declares % | wrong | test wrong | median s | test s |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for s in summaries:
        tested, row = s.row.test_declared > 0, s.row
        seconds = np.median(row.seconds[row.declared > 0]) if s.declared else 0.0
        lines.append(
            f"| {s.name} | {s.noise} | {100 * s.declared / s.drives:.1f} | "
            f"{100 * tested.mean():.1f} | {s.wrong} | {int(row.test_wrong.sum())} | "
            f"{seconds:.0f} | {np.median(row.test_seconds[tested]):.0f} |"
        )
    return "\n".join([*lines, ""])


def _missed(missed: list[Figure]) -> str:
    """One row for each figure and noise, with all classes that miss its goal."""
    lines = ["## Missed", ""]
    if not missed:
        return "\n".join([*lines, "Nothing.", ""])
    groups: dict[tuple[str, str, str], list[str]] = {}
    for f in missed:
        label, _, what = f.figure.partition(": ")
        name, _, noise = label.rpartition(" ")
        value = "none" if f.value is None else f"{f.value:.3g}"
        groups.setdefault((what, noise, f"{f.goal} {f.unit}".strip()), []).append(f"{name} {value}")
    lines += ["| figure | noise | goal | misses |", "|---|---|---|---|"]
    for (what, noise, goal), classes in groups.items():
        lines.append(f"| {what} | {noise} | {goal} | {', '.join(classes)} |")
    return "\n".join([*lines, ""])
