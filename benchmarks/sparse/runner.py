"""One matcher after the other on the same traces, each in its own environment and process.

The harness's `worker.py` runs an adapter; what it writes is read here.  Peers whose
environment is not on this machine are left out.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import Options
from . import harness

OURS = "whichroad"
ADAPTER = Path(__file__).parents[1] / "peers" / "whichroad_adapter.py"
# peer: its environment, its adapter in the harness
FILES = {
    "valhalla": ("valhalla", "valhalla_meili.py"),
    "osrm": ("osrm", "osrm_match.py"),
    "osrm-tidy": ("osrm", "osrm_tidy.py"),
    "fastmm": ("fastmm", "fastmm_fmm.py"),
}


@dataclass(frozen=True, slots=True)
class Run:
    """What a matcher said and what it cost."""

    prepare: dict[str, float]  # wall (s), cpu, peak_mib, disk_mib
    load: dict[str, float]  # wall (s), rss_before, rss (MiB)
    conditions: dict[str, dict[str, Any]]  # by key: results by trace, errors, wall, points


def environments(options: Options) -> Path | None:
    """The folder of the peers' environments, `venv-NAME` each, or None."""
    told = options.more.get("peers") or os.environ.get("WHICHROAD_PEER_ENVS")
    return Path(told) if told else None


def interpreter(options: Options, name: str) -> Path | None:
    """The Python that runs a matcher, or None where it is not installed."""
    if name == OURS:
        return Path(sys.executable)
    room = environments(options)
    python = room / f"venv-{FILES[name][0]}" / "bin" / "python" if room else None
    return python if python is not None and python.exists() else None


def present(options: Options, names: Sequence[str]) -> list[str]:
    """Those of the matchers that can run here, ourselves last."""
    return [n for n in names if interpreter(options, n) is not None]


def run(
    options: Options, name: str, pbf: Path, traces: dict[str, list[Any]], budget_s: float = 1e9
) -> Run | None:
    """Run a matcher on traces by condition; its map is built once and kept.

    Returns:
        None where its environment is missing or it fell over, which is said.
    """
    python = interpreter(options, name)
    if python is None:
        return None
    own = name == OURS
    adapter = ADAPTER if own else harness.folder(options) / "adapters" / FILES[name][1]
    work = harness.cache(options) / "runs"
    work.mkdir(exist_ok=True)
    theirs = work / f"{pbf.name.split('.')[0]}-{FILES[name][0]}" if not own else None
    maps = theirs or harness.our_maps(options, pbf)
    graph = harness.graph_file(options, pbf)
    base = [str(python), str(harness.folder(options) / "worker.py")]
    log = work / f"{name}.log"
    prepared = maps.with_suffix(".json")
    with log.open("w") as told:

        def call(mode: str, *rest: Path) -> bool:
            arguments = [*base, mode, str(adapter), str(pbf), str(graph), str(maps)]
            done = subprocess.run([*arguments, *map(str, rest)], stdout=told, stderr=told)
            if done.returncode:
                options.say(f"{name}: {mode} failed ({done.returncode}), see {log}")
            return done.returncode == 0

        if not prepared.exists() and not call("prepare", prepared):
            return None
        job, out = work / f"{name}.job.json", work / f"{name}.out.json"
        rows = [{"key": key, "traces": [t.to_json() for t in some]} for key, some in traces.items()]
        job.write_text(json.dumps({"budget_s": budget_s, "conditions": rows}))
        out.unlink(missing_ok=True)
        if not call("match", job, out):
            return None
    first, *rest = (json.loads(line) for line in out.read_text().splitlines())
    return Run(json.loads(prepared.read_text()), first["load"], {r["key"]: r for r in rest})
