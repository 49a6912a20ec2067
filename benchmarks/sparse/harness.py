"""The peers' harness as a library: its graph, trips, noise and scores, and what it measured.

The harness is data to this project (`bench/peers` beside the folder of real data, or
where WHICHROAD_PEERS points); what it makes is kept in a cache folder between runs.
"""

import csv
import hashlib
import importlib
import json
import os
import pickle
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from .. import Options, Skipped

INTERVALS = (1, 5, 10, 30, 60)  # s
PEERS = ("valhalla", "osrm", "osrm-tidy", "fastmm")  # of which the best is chosen in hindsight
SIGMA = 5.0  # m, told to everyone on real tracks
TAU = 45.0  # s, of the harness's correlated noise


def folder(options: Options) -> Path:
    """Where the harness lies.

    Raises:
        Skipped: It is not on this machine.
    """
    path = Path(os.environ.get("WHICHROAD_PEERS") or options.data.parent / "bench" / "peers")
    if not (path / "run.py").exists():
        raise Skipped(f"{path} is not here; set WHICHROAD_PEERS")
    return path


def module(options: Options, name: str) -> Any:
    """A module of the harness: `metrics`, `roadgraph`, `simulate` or `real`."""
    path = str(folder(options))
    if path not in sys.path:
        sys.path.append(path)
    return importlib.import_module(name)


def cache(options: Options) -> Path:
    """Where data sets and compiled maps are kept between runs."""
    told = options.more.get("cache") or os.environ.get("WHICHROAD_BENCH_CACHE")
    path = Path(told) if told else Path(tempfile.gettempdir()) / "whichroad-bench"
    path.mkdir(parents=True, exist_ok=True)
    return path


def kept(path: Path, make: Callable[[], Any]) -> Any:
    """The pickle at `path`, made first where it is not there."""
    if not path.exists():
        value = make()
        part = path.with_suffix(f".{os.getpid()}")
        part.write_bytes(pickle.dumps(value, protocol=4))
        part.replace(path)
    return pickle.loads(path.read_bytes())


def stored(options: Options, name: str) -> dict[str, Any]:
    """What the harness measured of the peers: `heidelberg`, `kubicka-dev`, ..., or nothing."""
    path = folder(options) / "results" / f"{name}.json"
    return dict(json.loads(path.read_text())) if path.exists() else {"peers": {}}


def key(interval: float, sigma: float, tau: float) -> str:
    """The harness's name of a condition."""
    return f"{interval:g}s/{sigma:g}m/{'white' if tau == 0 else 'gm'}"


def condition(text: str) -> tuple[float, float, float]:
    """`10s/5m/gm` as interval (s), sigma (m) and correlation time (s)."""
    interval, sigma, noise = text.split("/")
    return float(interval.rstrip("s")), float(sigma.rstrip("m")), 0.0 if noise == "white" else TAU


def heidelberg(options: Options, seed: int, count: int = 20) -> tuple[Any, list[Any]]:
    """The harness's graph of Heidelberg and its trips of one seed."""
    simulate = module(options, "simulate")
    pbf = options.need("maps", "heidelberg.osm.pbf")
    graph = module(options, "roadgraph").RoadMap.load(graph_file(options, pbf))
    trips = kept(
        cache(options) / f"heidelberg.trips{seed}x{count}.pkl",
        lambda: simulate.sample_trips(graph, count, seed),
    )
    return graph, trips


def graph_file(options: Options, pbf: Path) -> Path:
    """The harness's own graph of a map, which some peers are given."""
    path = cache(options) / f"{pbf.name.split('.')[0]}.harness.pkl"
    if not path.exists():
        module(options, "roadgraph").build(str(pbf)).save(str(path))
    return path


def real_map(options: Options) -> tuple[Path, Path]:
    """The usable real tracks as one extract, and their truth, as the harness joins them."""
    where = cache(options) / "maps"
    pbf, truth = where / "kubicka-dev.osm.pbf", where / "kubicka-dev.truth.json"
    if not (pbf.exists() and truth.exists()):
        archive = options.need("kubicka", "tracks-00-49.tar.gz")
        real = module(options, "real")
        with tempfile.TemporaryDirectory() as unpacked:
            with tarfile.open(archive) as tar:
                tar.extraction_filter = getattr(tarfile, "data_filter", None)  # from 3.11.4 on
                tar.extractall(unpacked)
            before = sys.argv
            sys.argv = ["real.py", unpacked, str(where), "--tracks", "0-49", "--usable",
                        "--name", "kubicka-dev"]  # fmt: skip
            try:
                real.main()
            finally:
                sys.argv = before
    return pbf, truth


def real_tracks(options: Options) -> tuple[dict[int, Any], Any]:
    """The usable real tracks by number, and a stand-in for the graph that holds their routes."""
    pbf, truth = real_map(options)

    def make() -> Any:
        import osmium

        tracks = json.loads(truth.read_text())
        wanted = {n for t in tracks for run in t["route"] for n in run}
        nodes = osmium.FileProcessor(str(pbf), osmium.osm.NODE)
        every = [(o.id, o.location.lat, o.location.lon) for o in nodes]
        middle = np.median([r[1:] for r in every], axis=0)  # as the harness places its plane
        places = {i: (lat, lon) for i, lat, lon in every if i in wanted}
        return {t["id"]: t for t in tracks}, places, middle.tolist()

    tracks, places, (lat0, lon0) = kept(cache(options) / "kubicka-dev.tracks.pkl", make)
    earth = module(options, "roadgraph").EARTH
    ky = float(np.radians(1.0) * earth)
    kx = ky * float(np.cos(np.radians(lat0)))
    graph = SimpleNamespace(
        xy=lambda lat, lon: ((np.asarray(lon) - lon0) * kx, (np.asarray(lat) - lat0) * ky),
        nodes_latlon=lambda nodes: [places[n] for n in nodes],
    )
    return tracks, graph


def real_trace(options: Options, track: Any, interval: float) -> Any:
    """One real track as a matcher is given it."""
    t = np.array(track["t"])
    keep = module(options, "real").thin(t, interval)
    zero = np.zeros(len(keep))
    return module(options, "simulate").Trace(
        track["id"], t[keep], np.array(track["lat"])[keep], np.array(track["lon"])[keep],
        SIGMA, float(interval), zero, zero,
    )  # fmt: skip


def sets(options: Options) -> dict[int, dict[str, str]]:
    """Which real tracks are usable and which are clean."""
    with open(options.need("kubicka", "sets.csv"), newline="") as file:
        return {int(row["track"]): row for row in csv.DictReader(file)}


def map_digest() -> str:
    """What a compiled map depends on, as text."""
    import whichroad

    room = Path(whichroad.__file__).parent
    files: Iterable[Path] = [
        *sorted((room / "roadmap").glob("*.py")), *sorted((room / "graph").glob("*.py"))
    ]  # fmt: skip
    return hashlib.sha256(b"\0".join(f.read_bytes() for f in files)).hexdigest()[:12]


def our_adapter(options: Options, pbf: Path, lag: Any = "full") -> Any:
    """Our adapter with its maps ready, compiled anew where the compiler changed."""
    from ..peers.whichroad_adapter import Adapter

    adapter = Adapter(lag)
    where = our_maps(options, pbf)
    if not (where / "regions.json").exists():
        adapter.prepare(str(pbf), None, str(where))
    adapter.load(str(pbf), None, str(where))
    return adapter


def our_maps(options: Options, pbf: Path) -> Path:
    """Where our compiled maps of an extract lie."""
    return cache(options) / f"{pbf.name.split('.')[0]}-{map_digest()}"
