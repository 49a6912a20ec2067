"""True road nets for SUMO: crops of real extracts, towns drawn at random, netgenerate's.

A net is SUMO's file, and here its streets: one for both directions where SUMO has two edges
with one line.  Coordinates are metres, east and north, about `Place.lat_deg, lon_deg`.
"""

import os
import subprocess
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import Skipped
from .towns import draw_town

SIDE = 3200.0  # m, of the square that a world drives in
LEAST = 120  # streets of a crop
# extract: latitude and longitude of a town in it, where crops are drawn; reach, m
EXTRACTS = {
    "heidelberg": (49.403, 8.68, 4000.0),
    "monaco": (43.738, 7.422, 800.0),
    "andorra": (42.507, 1.522, 2000.0),
}
PLACES = (*EXTRACTS, "drawn", "random")
_COMMON = (
    "--geometry.remove", "--no-turnarounds.except-deadend", "--roundabouts.guess",
    "--keep-edges.components", "1", "--offset.disable-normalization",
    "--no-warnings", "--tls.discard-simple",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Street:
    """One road between two nodes, in the direction in which it was drawn."""

    line: np.ndarray  # (n, 2) m
    nodes: tuple[str, str]
    lanes: int  # of both directions
    oneway: bool
    highway: str
    speed: float  # m/s
    ring: bool


@dataclass(frozen=True, slots=True)
class Net:
    """A net of SUMO and its streets.

    A directed road is a code: twice the street's number, plus 1 where driven against its line.
    """

    file: Path
    lat_deg: float
    lon_deg: float
    streets: list[Street]
    code: dict[str, int]  # of SUMO's edges
    following: dict[int, list[int]]  # directed roads that may follow each one
    leaving: dict[str, list[int]]  # directed roads out of each node

    def ends(self, code: int) -> tuple[str, str]:
        """From which node to which a directed road runs."""
        a, b = self.streets[code >> 1].nodes
        return (b, a) if code & 1 else (a, b)

    def line(self, code: int) -> np.ndarray:
        """Its vertices in driving direction, (n, 2) m."""
        line = self.streets[code >> 1].line
        return line[::-1] if code & 1 else line


def sumo_tool(name: str) -> str:
    """The path of one of SUMO's programs, or a `Skipped` that says how to get it."""
    try:
        import sumo
    except ImportError:
        raise Skipped('SUMO is not installed; pip install "whichroad[worlds]"') from None
    os.environ["SUMO_HOME"] = sumo.SUMO_HOME
    return str(Path(sumo.SUMO_HOME) / "bin" / name)


def call(name: str, *arguments: str) -> None:
    """Run one of SUMO's programs.

    Raises:
        RuntimeError: It failed; with the end of what it said.
    """
    done = subprocess.run([sumo_tool(name), *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{name} failed: {(done.stderr or done.stdout)[-2000:]}")


def make_net(place: str, seed: int, folder: Path, data: Path) -> Net:
    """The net of a world.

    Args:
        place: One of `PLACES`.
        seed: Of everything that is drawn.
        folder: Where files are kept between runs.
        data: The folder of real data.

    Raises:
        Skipped: SUMO or the extract is not here.
    """
    random = np.random.default_rng([seed, PLACES.index(place)])
    file = folder / f"{place}-{seed}.net.xml"
    if place in EXTRACTS:
        lat, lon, reach = EXTRACTS[place]
        while not file.exists():
            _crop(_whole(place, folder, data), file, random.uniform(-reach, reach, 2))
            if len(read_net(file, lat, lon).streets) < LEAST:
                file.unlink()
    else:
        lat, lon = random.uniform(35.0, 60.0), random.uniform(-5.0, 25.0)
        if not file.exists():
            draw = _drawn if place == "drawn" else _netgenerate
            draw(file, random)
    return read_net(file, float(lat), float(lon))


def _whole(place: str, folder: Path, data: Path) -> Path:
    """The net of a whole extract."""
    file = folder / f"{place}.net.xml"
    if file.exists():
        return file
    source = data / "maps" / f"{place}.osm.pbf"
    if not source.exists():
        raise Skipped(f"{source} is not here; set WHICHROAD_DATA or --data")
    import osmium

    xml = folder / f"{place}.osm"
    with osmium.SimpleWriter(str(xml), overwrite=True) as writer:
        for item in osmium.FileProcessor(str(source)):
            writer.add(item)
    lat, lon, _ = EXTRACTS[place]
    part = file.with_suffix(".part.xml")
    call(
        "netconvert", "--osm-files", str(xml), "-o", str(part),
        "--proj", f"+proj=aeqd +lat_0={lat} +lon_0={lon}", "--keep-edges.by-vclass", "passenger",
        "--tls.guess-signals", *_COMMON,
    )  # fmt: skip
    part.rename(file)
    return file


def _crop(whole: Path, file: Path, middle: np.ndarray) -> None:
    low, high = middle - 0.5 * SIDE, middle + 0.5 * SIDE
    box = f"{low[0]:.0f},{low[1]:.0f},{high[0]:.0f},{high[1]:.0f}"
    call("netconvert", "-s", str(whole), "-o", str(file), "--keep-edges.in-boundary", box, *_COMMON)


def _netgenerate(file: Path, random: np.random.Generator) -> None:
    call(
        "netgenerate", "--rand", "-o", str(file), "--rand.iterations", "220",
        "--rand.min-distance", "60", "--rand.max-distance", "350", "--rand.random-lanenumber",
        "-L", "3", "--rand.random-priority", "--default.speed", "13.9", "--tls.guess",
        "--seed", str(int(random.integers(1, 2**31 - 1))), "--no-turnarounds.tls", "--no-warnings",
    )  # fmt: skip


def _drawn(file: Path, random: np.random.Generator) -> None:
    """A town of `towns`."""
    nodes, edges = draw_town(SIDE, random)
    plain = file.with_suffix("")
    node_file, edge_file = Path(f"{plain}.nod.xml"), Path(f"{plain}.edg.xml")
    node_file.write_text("<nodes>\n" + "\n".join(nodes) + "\n</nodes>\n", encoding="utf-8")
    edge_file.write_text("<edges>\n" + "\n".join(edges) + "\n</edges>\n", encoding="utf-8")
    call(
        "netconvert", "-n", str(node_file), "-e", str(edge_file), "-o", str(file), "--tls.guess",
        *_COMMON,
    )  # fmt: skip


def _points(text: str) -> np.ndarray:
    return np.array([[float(v) for v in p.split(",")[:2]] for p in text.split()])


def read_net(file: Path, lat_deg: float, lon_deg: float) -> Net:
    """The streets of a net of SUMO."""
    place: dict[str, np.ndarray] = {}
    rows: list[tuple[str, str, str, str, dict[str, Any]]] = []
    exits: dict[str, list[str]] = {}
    rings: set[str] = set()
    for _, item in ElementTree.iterparse(file):
        got = item.attrib
        if item.tag == "edge" and "function" not in got:
            lanes = item.findall("lane")
            cars = [v for v in lanes if _for_cars(v.attrib)]
            what = {
                "lanes": len(cars), "speed": float(lanes[0].attrib["speed"]),
                "highway": got.get("type", "").removeprefix("highway.") or "residential",
            }  # fmt: skip
            if cars:
                rows.append((got["id"], got["from"], got["to"], got.get("shape", ""), what))
        elif item.tag == "junction" and got.get("type") != "internal":
            place[got["id"]] = np.array([float(got["x"]), float(got["y"])])
        elif item.tag == "roundabout":
            rings |= set(got["edges"].split())
        elif item.tag == "connection" and not got["from"].startswith(":"):
            exits.setdefault(got["from"], []).append(got["to"])
        if item.tag in ("edge", "junction", "connection", "roundabout"):
            item.clear()
    streets: list[Street] = []
    code: dict[str, int] = {}
    open_: dict[tuple[str, str], list[int]] = {}  # streets without their other direction
    drawn: dict[tuple[str, str], list[tuple[int, np.ndarray]]] = {}  # directed roads
    for name, a, b, shape, what in rows:
        line = _points(shape) if shape else np.array([place[a], place[b]])
        line[0], line[-1] = place[a], place[b]
        again = next((c for c, p in drawn.get((a, b), []) if _same(p, line)), None)
        if again is not None:  # two ways over the same nodes are one road
            code[name] = again
            continue
        twin = next((k for k in open_.get((b, a), []) if _same(streets[k].line[::-1], line)), None)
        if twin is None:
            code[name] = 2 * len(streets)
            open_.setdefault((a, b), []).append(len(streets))
            streets.append(Street(line, (a, b), oneway=True, ring=name in rings, **what))
        else:
            code[name] = 2 * twin + 1
            open_[b, a].remove(twin)
            old = streets[twin]
            streets[twin] = Street(
                old.line, old.nodes, old.lanes + what["lanes"], False, old.highway, old.speed,
                old.ring,
            )  # fmt: skip
        drawn.setdefault((a, b), []).append((code[name], line))
    exits = {a: sorted({b for b in after if b in code}) for a, after in exits.items() if a in code}
    leaving: dict[str, list[int]] = {}
    for k, s in enumerate(streets):
        leaving.setdefault(s.nodes[0], []).append(2 * k)
        if not s.oneway:
            leaving.setdefault(s.nodes[1], []).append(2 * k + 1)
    following: dict[int, set[int]] = {}
    for name, after in exits.items():
        following.setdefault(code[name], set()).update(code[e] for e in after)
    roads = {c: sorted(after) for c, after in following.items()}
    return Net(file, lat_deg, lon_deg, streets, code, roads, leaving)


def _for_cars(lane: dict[str, str]) -> bool:
    if "allow" in lane:
        return lane["allow"] == "all" or "passenger" in lane["allow"].split()
    return "passenger" not in lane.get("disallow", "").split() and lane.get("disallow") != "all"


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two lines run beside each other within 1.5 m."""
    return float(np.abs(_spread(a) - _spread(b)).max()) < 1.5


def _spread(line: np.ndarray) -> np.ndarray:
    """Nine points of a line at equal distances, (9, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, along[-1], 9)
    return np.column_stack([np.interp(at, along, line[:, i]) for i in (0, 1)])
