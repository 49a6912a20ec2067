"""Do points and path say the same?

Of the epochs whose most probable edge has P >= 0.99, how many find the path on another edge at
that moment?  At the very second of a change both edges count.
"""

from collections.abc import Callable, Iterator

import numpy as np

from .. import Figure, Options, interval, share
from . import matched
from .matched import Matched

SURE = 0.99
AT_ONCE = 1e-5  # s; times in tables are microseconds
LAGS = (("full", "full"), ("no lag", None))


def disagrees(m: Matched) -> np.ndarray:
    """Of each sure epoch, whether the path is on another edge at that moment."""
    sure = np.flatnonzero((m.edge >= 0) & (m.p >= SURE))
    wrong = np.ones(len(sure), bool)
    for at, k in enumerate(sure):
        first = np.searchsorted(m.leave, m.time[k] - AT_ONCE)
        last = np.searchsorted(m.enter, m.time[k] + AT_ONCE, side="right")
        wrong[at] = m.edge[k] not in m.path[first:last]
    return wrong


def told(options: Options, drives: Iterator[Matched], label: str, lag: str) -> list[Figure]:
    """The share of sure epochs that disagree, and beside it what P admits."""
    rows = []
    doubt = []
    for m in drives:
        wrong = disagrees(m)
        sure = (m.edge >= 0) & (m.p >= SURE)
        rows.append((float(wrong.sum()), float(max(len(wrong), 1))))
        doubt.append(float((1.0 - m.p[sure]).sum()))
        if wrong.any():
            options.say(f"  {label}, {lag}, {m.name}: {wrong.sum()} of {len(wrong)}")
    table = np.array(rows)
    agree = 100.0 - share(table)
    epochs = int(table[:, 1].sum())
    if lag == "full":
        ends = interval(lambda r: 100.0 - share(r), table)
        return [Figure(f"agree, {label}, lag full", agree, ">= 99.9", "%", epochs, ends)]
    admitted = 100.0 * sum(doubt) / epochs + 0.1
    return [Figure(f"disagree, {label}, no lag", 100.0 - agree, f"<= {admitted:.3f}", "%", epochs)]


def measure(options: Options) -> list[Figure]:
    """Real tracks and Heidelberg at each rate, with the whole drive known and without a lag."""
    found = []
    sources: dict[str, Callable[..., Iterator[Matched]]] = {
        "real": matched.real, "Heidelberg": matched.city,
    }  # fmt: skip
    for name, drives in sources.items():
        for every in matched.intervals(options):
            for label, lag in LAGS:
                found += told(options, drives(options, every, lag), f"{name} {every} s", label)
    return found
