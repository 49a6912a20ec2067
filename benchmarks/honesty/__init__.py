"""Are the printed probabilities and ellipses true?  Short simulated drives by the ten thousand."""

import os
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from .. import Figure, Options, seeds_text
from .classes import CLASSES, NOISES
from .drives import Memory, Task, spread, tasks
from .figures import Summary, figures_of
from .report import write_report

DRIVES = 1200  # per class and noise, unless asked otherwise


def chosen(text: str | None, known: dict[str, object], default: str) -> list[str]:
    """Names of a comma-separated list, which may be patterns such as `parallel-*`."""
    names: list[str] = []
    for word in (text or default).split(","):
        found = [n for n in known if fnmatch(n, word)]
        if not found:
            raise SystemExit(f"{word!r} is not known; one of {', '.join(known)} was expected")
        names += found
    return list(dict.fromkeys(names))


def run(options: Options) -> list[Figure]:
    """All classes and noises that were asked for."""
    more = options.more
    names = chosen(more.get("classes"), dict(CLASSES), ",".join(CLASSES))
    noises = chosen(more.get("noise"), dict(NOISES), ",".join(NOISES))
    seeds = options.seeds or range(more.get("drives", DRIVES))
    few = seeds[: more["drives"]] if options.seeds and "drives" in more else seeds
    settings = more.get("settings", {})
    memory = Memory(Path(more["resume"]) if "resume" in more else None)
    todo: list[Task] = [
        task
        for noise in noises
        for name in names
        for task in tasks(name, noise, seeds if noise == "good" else few, settings)
    ]
    done = spread(todo, memory, more.get("processes", os.cpu_count() or 1), options.say)
    summaries = [
        Summary(
            name,
            noise,
            np.concatenate([done[t] for t in todo if (t.name, t.noise) == (name, noise)]),
        )
        for noise in noises
        for name in names
    ]
    if "write" in more:
        write_report(Path(more["write"]), summaries, seeds, few)
        options.say(f"wrote {more['write']}")
    return [f for s in summaries for f in figures_of(s, seeds_text(seeds))]
