"""Memory and time of `whichroad map build`, by the slope over extracts of growing size.

Each extract holds a town several times, every copy with ids and places of its own.

    python -m benchmarks build [--copies 4,16]
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import whichroad

from . import Figure, Options

COPIES = "4,16"
_IDS = 1 << 36  # between the ids of copies: more than OpenStreetMap has
_LON, _LAT, _ROW = 1.5, 0.25, 6  # degrees between copies, copies of a row
MILLION = 1_000_000


def run(options: Options) -> list[Figure]:
    """Peak memory, processor time and size of the map for 10 million edges, by the slope."""
    town = options.need("maps", "heidelberg.osm.pbf")
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for copies in map(int, options.more.get("copies", COPIES).split(",")):
            extract = Path(folder) / f"{copies}.osm.pbf"
            replicate(town, extract, copies)
            found.append(built(extract, Path(folder) / "built.map"))
            edges, mib, seconds, size = found[-1]
            options.say(f"{copies} copies, {edges:,} edges: {mib:,.0f} MiB, {seconds:.1f} s, "
                        f"{size / 1e6:,.0f} MB")  # fmt: skip
    (few, low, quick, _), (many, high, slow, size) = found[0], found[-1]
    slope = (high - low) / (many - few)
    whole = low + slope * (10 * MILLION - few)
    return [
        Figure("memory for 10 million edges, by the slope", whole / 1024, "<= 3.73", "GiB", many),
        Figure("memory of an edge more", slope * 2**20, "", "bytes"),
        Figure("processor time of 10 million edges", (slow - quick) / (many - few) * 1e7, "", "s"),
        Figure("the map's bytes of an edge", size / many, "", "bytes"),
    ]


def built(extract: Path, target: Path) -> tuple[int, float, float, int]:
    """Edges, peak MiB, processor seconds and size of a build, in a process of its own."""
    code = (
        "import resource, sys, whichroad.cli; sys.argv[1:] = ['map', 'build', *sys.argv[1:]]\n"
        "try: whichroad.cli.main()\n"
        "except SystemExit: pass\n"
        "u = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print('used', u.ru_maxrss, u.ru_utime + u.ru_stime)"
    )
    line = [sys.executable, "-c", code, str(extract), "-o", str(target), "--force"]
    # arrays of a country are given back to the system when they are freed: so are these
    given_back = {**os.environ, "MALLOC_MMAP_THRESHOLD_": str(1 << 16)}
    done = subprocess.run(line, capture_output=True, text=True, check=False, env=given_back)
    told = [text.split() for text in done.stdout.splitlines() if text.startswith("used ")]
    if not told:
        raise RuntimeError(done.stderr[-2000:])
    edges = len(whichroad.RoadMap.open(target))
    return edges, float(told[0][1]) / 1024, float(told[0][2]), target.stat().st_size


def replicate(source: Path, target: Path, copies: int) -> None:
    """Write an extract that holds another one several times."""
    import osmium

    moves: dict[str, Callable[[Any, int], Any]] = {"n": _node, "w": _way, "r": _relation}
    with osmium.SimpleWriter(str(target)) as writer:
        for kind, move in moves.items():
            entity = {"n": osmium.osm.NODE, "w": osmium.osm.WAY, "r": osmium.osm.RELATION}[kind]
            add = {"n": writer.add_node, "w": writer.add_way, "r": writer.add_relation}[kind]
            for copy in range(copies):
                for one in osmium.FileProcessor(str(source), entity):
                    add(move(one, copy))


def _node(one: Any, copy: int) -> Any:
    import osmium

    lon = one.location.lon + _LON * (copy % _ROW)
    lat = one.location.lat + _LAT * (copy // _ROW)
    location = osmium.osm.Location(lon, lat)
    return osmium.osm.mutable.Node(one, id=one.id + copy * _IDS, location=location)


def _way(one: Any, copy: int) -> Any:
    import osmium

    nodes = [node.ref + copy * _IDS for node in one.nodes]
    return osmium.osm.mutable.Way(one, id=one.id + copy * _IDS, nodes=nodes)


def _relation(one: Any, copy: int) -> Any:
    import osmium

    members = [(m.type, m.ref + copy * _IDS, m.role) for m in one.members]
    return osmium.osm.mutable.Relation(one, id=one.id + copy * _IDS, members=members)
