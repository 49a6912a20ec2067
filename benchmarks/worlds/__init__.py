"""A second simulator: SUMO's drivers, replayed and drawn errors, faults at the rates of one table.

It shares no code and no assumption with `whichroad.simulate` and the filter.  `faults.FAULTS` is
the table of rates; what the figures mean stands in benchmarks/README.md and `scoring`.
"""

import heapq
import itertools
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .. import Figure, Options, seeds_text
from ..exact_bounds import clopper_pearson, upper_bound
from .drives import Run, Scored, run_worlds
from .faults import BY_NAME, FAULTS, SUITES
from .figures import badness, wrong_by_world
from .nets import sumo_tool
from .pictures import drive_picture, stanford
from .receivers import absent
from .report import summary_line, summary_table, write_run

SEEDS = range(10)
WORST = 10  # drives of which there are pictures


def run(options: Options) -> list[Figure]:
    """The classes of faults that were asked for, each on the same worlds."""
    sumo_tool("sumo")
    more = options.more
    seeds, drives = options.seeds or SEEDS, more.get("drives")
    classes: dict[str, list[Scored]] = {}
    with _folder(more.get("cache")) as folder:
        for name in names(more.get("faults", "none"), absent(options.data)):
            chosen = {"none": [], "all": None}.get(name, name.split("+"))
            options.say(f"faults: {name}")
            runs = run_worlds(
                seeds, drives, chosen, folder, options.data, options.settings(), options.say,
                bool(more.get("told")), _suite(more.get("sensors", "")), more.get("lag"),
            )  # fmt: skip
            classes[name] = _kept(name, runs, Path(more["out"]) if "out" in more else None)
            if "out" in more:
                page = Path(more["out"]) / "summary.md"
                page.write_text(summary_table(classes) + "\n", encoding="utf-8")
    return [
        f for name, scored in classes.items() for f in _figures(name, scored, seeds_text(seeds))
    ]


def names(text: str, missing: set[str]) -> list[str]:
    """Classes of a comma-separated list; `each`: sound sensors, all together, each fault alone."""
    if text == "each":
        return ["none", "all", *(n for n in FAULTS if n not in missing)]
    for name in (n for word in text.split(",") for n in word.split("+")):
        if name not in FAULTS and name not in ("none", "all"):
            raise SystemExit(f"{name!r} is no fault; one of none, all, each, {', '.join(FAULTS)}")
    return text.split(",")


def _suite(name: str) -> str:
    """The sensors that all drives have; nothing: each draws its own."""
    known = (*SUITES, *BY_NAME)
    if name and name not in known:
        raise SystemExit(f"{name!r} is no set of sensors; one of {', '.join(known)}")
    return name


@contextmanager
def _folder(cache: str | None) -> Iterator[Path]:
    """Where nets and drives are kept."""
    if cache is not None:
        Path(cache).mkdir(parents=True, exist_ok=True)
        yield Path(cache)
    else:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)


def _kept(name: str, runs: Iterator[Run], out: Path | None) -> list[Scored]:
    """The scores of all drives; tables and pictures of the worst go to a folder."""
    scored: list[Scored] = []
    worst: list[tuple[tuple[int, float, float], int, Run]] = []
    number = itertools.count()
    for one in runs:
        scored.append(one.scored)
        if out is not None:
            heapq.heappush(worst, (badness(one.scored), next(number), one))
            if len(worst) > WORST:
                heapq.heappop(worst)
    if out is not None and scored:
        write_run(name, scored, out)
        stanford(np.vstack([s.at for s in scored]), out / f"{name}-stanford.png")
        for rank, (_, _, one) in enumerate(sorted(worst, reverse=True)):
            drive_picture(one, out / name / f"{rank}-{one.scored.name.replace('/', '-')}.png")
    return scored


def _figures(name: str, drives: list[Scored], seeds: str) -> list[Figure]:
    """The figures of one class of faults."""
    rows, pose, alert = summary_line(name, drives)
    if pose is None or not rows.decisions:
        return []
    sound = name == "none"
    bound = upper_bound(rows.wrong, rows.declared) if rows.declared else 1.0
    low, high = clopper_pearson(rows.wrong, max(rows.declared, 1))
    exceeded = pose.exceeded_ci and (1e3 * pose.exceeded_ci[0], 1e3 * pose.exceeded_ci[1])

    def figure(
        what: str, value: float, goal: str, unit: str, n: int,
        ci: tuple[float, float] | None = None,
    ) -> Figure:  # fmt: skip
        return Figure(f"{name}: {what}", value, goal if sound else "", unit, n, ci, seeds)

    rate, over_worlds = wrong_by_world(drives)
    named = sum(bool(d.named) for d in drives)
    return [
        figure("wrong among declared, interval over worlds", rate, "", "per mille", rows.declared,
               over_worlds),
        figure("wrong among declared, upper bound", 1e3 * bound, "<= 1", "per mille",
               rows.declared, (1e3 * low, 1e3 * high)),
        figure("wrong declarations", rows.wrong, "", "", rows.declared),
        figure("drives with a wrong declaration", rows.wrong_drives, "", "", rows.drives),
        figure("decisions declared", 100.0 * rows.declared / rows.decisions, "", "%",
               rows.decisions),
        figure("time to declare, median", rows.seconds, "", "s", rows.declared),
        figure("protection level, median", pose.level, "", "m", pose.drives),
        figure("error above the protection level", 1e3 * pose.exceeded, "<= 1", "per mille",
               pose.drives, exceeded),
        figure("ANEES of the position", pose.anees, "0.8..1.3", "", pose.drives, pose.anees_ci),
        figure("truth in the 95 % ellipse", 100.0 * pose.inside, "", "%", pose.drives),
        figure("position RMSE", pose.rmse, "", "m", pose.drives),
        figure("right road", 100.0 * pose.right, "", "%", pose.drives),
        figure("longest time to alert", alert, "", "s", len(drives)),
        figure("drives in which something is named", 1e3 * named / len(drives), "<= 2", "per mille",
               len(drives)),
    ]  # fmt: skip
