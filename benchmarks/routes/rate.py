"""Fixes per second of the processor beside OSRM, with all tables made, by turns in one run.

Of each side counts the best of several turns.  OSRM runs in a process of its own, in the
environment `venv-osrm` below `--peers`; without it only our own rates are told.
"""

import json
import subprocess
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

import whichroad

from .. import Figure, Options
from ..sparse import harness, runner
from . import matched

RATES, MOST = (1, 10, 60), {1: 4.0, 10: 5.0, 60: 6.0}  # s between fixes; asked of `match_many`
ALONE = 1.5  # asked of `match(lag="full")`
TURNS = 4
ROWS = 20_000  # about, of a table of trips

# match the traces of a file one by one, and print processor time of the best of some rounds
_THEIRS = """
import importlib.util, json, sys, time
sys.path.insert(0, sys.argv[1])
from simulate import Trace
spec = importlib.util.spec_from_file_location("peer", sys.argv[2])
peer = importlib.util.module_from_spec(spec)
spec.loader.exec_module(peer)
adapter = peer.Adapter()
adapter.load(None, None, sys.argv[3])
for text, rows in json.load(open(sys.argv[4])).items():
    traces = [Trace.from_json(row) for row in rows]
    for t in traces:
        adapter.match(t)
    start = time.process_time()
    for t in traces:
        adapter.match(t)
    print(json.dumps([text, time.process_time() - start]))
"""


def theirs(options: Options, file: Path) -> Callable[[], dict[str, float]] | None:
    """What measures OSRM once: processor seconds by s between fixes; None: it is not here."""
    python = runner.interpreter(options, "osrm")
    if python is None:
        return None
    folder, pbf = harness.folder(options), options.need("maps", "heidelberg.osm.pbf")
    adapter = folder / "adapters" / runner.FILES["osrm"][1]
    work = harness.cache(options) / "rate-osrm"
    if not (work / "map.osrm.mldgr").exists():
        work.mkdir(exist_ok=True)
        make = (
            "import importlib.util, sys\n"
            "spec = importlib.util.spec_from_file_location('peer', sys.argv[1])\n"
            "peer = importlib.util.module_from_spec(spec)\n"
            "spec.loader.exec_module(peer)\n"
            "peer.Adapter().prepare(sys.argv[2], None, sys.argv[3])"
        )
        subprocess.run([python, "-c", make, adapter, pbf, work], check=True, capture_output=True)

    def measure() -> dict[str, float]:
        command = [python, "-c", _THEIRS, folder, adapter, work, file]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return dict(json.loads(line) for line in done.stdout.splitlines() if line.startswith("["))

    return measure


def ours(traces: list[Any], roads: Any) -> tuple[float, float]:
    """Fixes per processor second of `match_many`, and of `match(lag="full")` trip by trip."""
    copies = max(1, ROWS // sum(len(t.t) for t in traces))
    parts = [
        pa.table({
            "drive_id": np.full(len(t.t), copy * len(traces) + k), "time": t.t + 1.6e9,
            "lat": t.lat, "lon": t.lon, "sigma_m": np.full(len(t.t), t.sigma),
        })
        for copy in range(copies) for k, t in enumerate(traces)
    ]  # fmt: skip
    table = pa.concat_tables(parts)
    start = time.process_time()
    whichroad.match_many(table, roads, threads=1)
    many = table.num_rows / (time.process_time() - start)
    start = time.process_time()
    for t in traces:
        fixes = {"time": t.t, "lat": t.lat, "lon": t.lon, "sigma_m": np.full(len(t.t), t.sigma)}
        found = whichroad.match(fixes, roads, lag="full")
        found.to_arrow()
        found.path_arrow()
    return many, sum(len(t.t) for t in traces) / (time.process_time() - start)


def measure(options: Options) -> list[Figure]:
    """Both rates at each interval, and their ratios to OSRM's."""
    warnings.simplefilter("ignore")
    rates = [r for r in RATES if r in matched.intervals(options)]
    traces: dict[int, list[Any]] = {every: [] for every in rates}
    roads: Any = None
    for every in rates:
        for _, roads, trace, _ in matched.city_traces(options, every):  # noqa: B007
            traces[every].append(trace)
    file = harness.cache(options) / "rate.json"
    file.write_text(json.dumps({str(e): [t.to_json() for t in ts] for e, ts in traces.items()}))
    peer = theirs(options, file)
    best = {every: [0.0, 0.0, 0.0] for every in rates}
    for _ in range(TURNS):
        told = peer() if peer else {}
        for every in rates:
            own = ours(traces[every], roads)
            fixes = sum(len(t.t) for t in traces[every])
            rate = fixes / told[str(every)] if told else 0.0
            best[every] = [max(a, b) for a, b in zip(best[every], (*own, rate), strict=True)]
    figures = []
    for every, (many, alone, other) in best.items():
        n = sum(len(t.t) for t in traces[every])
        both = (("match_many", many, MOST[every]), ("match, lag full", alone, ALONE))
        for name, rate, goal in both:
            label = f"{name}, {every} s"
            figures.append(Figure(label, rate, "", "fixes/s", n))
            if other:
                figures.append(Figure(f"{label}, over OSRM", rate / other, f">= {goal}", "", n))
    return figures
