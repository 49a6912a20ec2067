"""Fixes one to sixty seconds apart, beside the peers: accuracy, honesty, speed, costs.

    python -m benchmarks sparse --peers ENVIRONMENTS [--parts real,city,drives,cost]
                                [--write docs/benchmarks.md]

Matchers run one after the other on the same traces, each in a process of its own, through
the peers' harness.  What was measured is kept in the cache folder, part by part, so that the
page can be written from several runs.  `--seeds A:B` are trips in Heidelberg (2 is the
harness's own seed); our own simulator's drives are seeds 3000 on.
"""

import json
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .. import Figure, Options
from ..kubicka import numbers
from . import city, cost, drives, harness, real
from .figures import figures_of

SEEDS = range(2, 5)  # 2 is the harness's; the others were looked at by nobody
DRIVES = range(3000, 3060)


def run(options: Options) -> list[Figure]:
    """Measure the parts asked for, keep them, and give the figures of all that is known."""
    more = options.more
    every = tuple(int(s) for s in more.get("intervals", "1,5,10,30,60").split(","))
    conditions = more["conditions"].split(",") if "conditions" in more else city.CONDITIONS
    trips = more.get("drives", 20)
    drives_of_ours = DRIVES[: more.get("drives", len(DRIVES))]
    measures: dict[str, Callable[[], Any]] = {
        "real": lambda: real.measure(options, every, numbers(more.get("tracks", "0-49"))),
        "city": lambda: {
            str(s): city.measure(options, s, conditions, trips) for s in options.seeds or SEEDS
        },
        "drives": lambda: drives.measure(options, drives_of_ours, every),
        "cost": lambda: cost.measure(options),
    }
    file = harness.cache(options) / "sparse.json"
    store: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {}
    for part in more.get("parts", ",".join(measures)).split(","):
        store[part] = measures[part]()
        store["python"] = platform.python_version()
        file.write_text(json.dumps(store))
    if "write" in more:
        from .report import write_page

        write_page(Path(more["write"]), store, harness.sets(options))
        options.say(f"wrote {more['write']}")
    return figures_of(store, harness.sets(options))
