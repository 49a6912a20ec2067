"""What the map and the trips cost us: building, opening, memory per thread, threads.

`python -m benchmarks.sparse.cost COMPILED TRIPS.parquet TRACES.json` prints JSON; it is run
as a process of its own, so that nothing else stands in its memory.
"""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from .. import Options, data_folder
from . import harness, runner

COPIES = 25  # of the trips of a seed
ROWS = 20_000  # about, of a table of trips whose rate is measured
ALL = ("valhalla", "osrm", "fastmm", runner.OURS)


def measure(options: Options) -> dict[str, Any]:
    """Builds of every map as the harness measured them, and our own costs."""
    import pyarrow.parquet as pq

    pbf = options.need("maps", "heidelberg.osm.pbf")
    graph, trips = harness.heidelberg(options, 2)
    made = harness.module(options, "simulate").make_trace
    some = {"10s/5m/gm": [made(graph, t, 10, 5, harness.TAU, seed=2)[0] for t in trips[:2]]}
    found: dict[str, Any] = {"maps": {}}
    for name in runner.present(options, ALL):
        done = runner.run(options, name, pbf, some)
        if done is not None:
            found["maps"][name] = {"build": done.prepare, "load": done.load}
    some |= {
        text: [made(graph, t, *harness.condition(text), seed=2)[0] for t in trips]
        for text in ("1s/5m/gm", "10s/5m/gm", "60s/5m/gm")
    }
    fastest = runner.run(options, "osrm", pbf, some) if "osrm" in found["maps"] else None
    if fastest is not None:
        found["osrm"] = {
            text: c["points"] / max(c["wall"], 1e-9) for text, c in fastest.conditions.items()
        }
    traces = harness.cache(options) / "cost.traces.json"
    traces.write_text(json.dumps({text: [t.to_json() for t in ts] for text, ts in some.items()}))
    table = harness.cache(options) / "cost.parquet"
    pq.write_table(_table(graph, trips, made), table, row_group_size=1 << 15)
    compiled = harness.our_maps(options, pbf) / "region0.map"
    arguments = [sys.executable, "-m", "benchmarks.sparse.cost", compiled, table, traces]
    done_ = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    if done_.returncode:
        options.say(f"cost: {done_.stderr.strip().splitlines()[-1]}")
    else:
        found |= json.loads(done_.stdout)
    return found


def _table(graph: Any, trips: list[Any], made: Any) -> Any:
    """Many trips at 1 Hz as one table."""
    import pyarrow as pa

    parts = []
    for copy in range(COPIES):
        for trip in trips:
            t = made(graph, trip, 1, 5, harness.TAU, seed=100 + copy)[0]
            name = [f"{copy}-{trip.id}"] * len(t.t)
            time_ = t.t + 1.6e9
            parts.append(pa.table({"drive_id": name, "time": time_, "lat": t.lat, "lon": t.lon}))
    return pa.concat_tables(parts)


def _status(name: str) -> float:
    """A line of this process's memory, MiB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name):
            return int(line.split()[1]) / 1024
    return 0.0


def _spread() -> None:
    """A core for each worker: what a scheduler is free to do, and does not everywhere."""
    name = threading.current_thread().name
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        number = int(name.rpartition("_")[2])
        os.sched_setaffinity(threading.get_native_id(), {cores[number % len(cores)]})


def _pass(roads: Any, table: Path, threads: int, rows: int) -> float:
    """Fixes per second over the stream, tables built and thrown away."""
    from whichroad.batch import batches

    plain = batches.ThreadPoolExecutor

    def pinned(workers: int, **more: Any) -> Any:
        return plain(workers, initializer=_spread, **more)

    batches.ThreadPoolExecutor = pinned  # type: ignore[assignment,misc]
    start = time.perf_counter()
    for _ in batches.match_stream(table, roads, threads=threads):
        pass
    batches.ThreadPoolExecutor = plain  # type: ignore[misc]
    return rows / (time.perf_counter() - start)


def _rates(roads: Any, traces: Path) -> dict[str, tuple[float, float]]:
    """Fixes per second trip by trip: the answer alone, and with its tables read out."""
    from ..peers.whichroad_adapter import Adapter

    simulate = harness.module(Options(data=data_folder()), "simulate")
    adapter = Adapter()
    adapter.maps = [(-180.0, 180.0, roads)]
    out = {}
    for text, rows in json.loads(traces.read_text()).items():
        trips = [simulate.Trace.from_json(row) for row in rows]
        fixes, spent = sum(len(t.t) for t in trips), [0.0, 0.0]
        for trip in trips:
            adapter.match(trip)  # warm
            start = time.perf_counter()
            result = adapter.match(trip)
            spent[0] += time.perf_counter() - start
            result.to_arrow()
            result.path_arrow()
            spent[1] += time.perf_counter() - start
        out[text] = (fixes / spent[0], fixes / spent[1])
    return out


def _together(roads: Any, traces: Path) -> dict[str, float]:
    """Fixes per second of `match_many`, one thread, tables built, the best of three."""
    import pyarrow as pa

    import whichroad

    out = {}
    for text, trips in json.loads(traces.read_text()).items():
        copies = max(1, ROWS // sum(len(t["t"]) for t in trips))
        parts = [
            {"drive_id": [f"{copy}-{t['id']}"] * len(t["t"]), "time": np.add(t["t"], 1.6e9)}
            | {"lat": t["lat"], "lon": t["lon"], "sigma_m": [t["sigma"]] * len(t["t"])}
            for copy in range(copies)
            for t in trips
        ]
        table = pa.concat_tables([pa.table(part) for part in parts])
        spent = []
        for _ in range(4):  # the first warms up
            start = time.perf_counter()
            whichroad.match_many(table, roads, threads=1)
            spent.append(time.perf_counter() - start)
        out[text] = table.num_rows / min(spent[1:])
    return out


def main(compiled: Path, table: Path, traces: Path) -> None:
    import pyarrow.parquet as pq

    import whichroad

    whichroad.Localizer(whichroad.RoadMap.open(compiled))  # libraries and compiled kernels
    base, opened = _status("VmRSS"), []
    whole = [np.array(a) for a in whichroad.RoadMap.open(compiled).arrays if hasattr(a, "nbytes")]
    touched = sum(a.nbytes for a in whole) / 2**20
    for _ in range(20):
        start = time.perf_counter()
        roads = whichroad.RoadMap.open(compiled)
        opened.append(time.perf_counter() - start)
    rows = pq.read_metadata(table).num_rows
    small = pq.ParquetFile(table).read_row_group(0)
    whichroad.match_many(small, roads, threads=1)  # compiled, and the map's pages touched
    before = _status("VmRSS")
    one = _pass(roads, table, 1, rows)
    after_one = _status("VmHWM")
    two = _pass(roads, table, 2, rows)
    print(
        json.dumps(
            {
                "open_ms": 1e3 * float(np.median(opened)),
                "rates": _rates(roads, traces),
                "many": _together(roads, traces),
                "fixes": rows,
                "one_thread": one,
                "two_threads": two,
                "libraries_mib": base,
                "map_mib": touched,
                "rss_before": before,
                "one_thread_mib": after_one - before,
                "two_threads_mib": _status("VmHWM") - before,
            }
        )
    )


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
