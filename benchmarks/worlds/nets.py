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
from xml.sax.saxutils import quoteattr

import numpy as np

from .. import Skipped

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
            draw = _town if place == "drawn" else _netgenerate
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


# --- a town drawn at random ---------------------------------------------------------------------

_KINDS = ("street", "wide", "one-way", "dual", "frontage")
_SHARES = (0.45, 0.1, 0.1, 0.15, 0.2)


def _town(file: Path, random: np.random.Generator) -> None:
    """Wavy streets in two families, dual carriageways, frontage roads, roundabouts, gaps."""
    roads: list[tuple[Any, dict[str, Any]]] = []
    for turn in (0.0, float(random.uniform(1.2, 1.9))):
        at = -0.42 * SIDE
        while at < 0.42 * SIDE:
            roads += _lines(at, turn, random)
            at += float(random.uniform(130.0, 480.0))
    nodes, edges = _noded(_with_rings(roads, random), random)
    plain = file.with_suffix("")
    node_file, edge_file = Path(f"{plain}.nod.xml"), Path(f"{plain}.edg.xml")
    node_file.write_text("<nodes>\n" + "\n".join(nodes) + "\n</nodes>\n", encoding="utf-8")
    edge_file.write_text("<edges>\n" + "\n".join(edges) + "\n</edges>\n", encoding="utf-8")
    call(
        "netconvert", "-n", str(node_file), "-e", str(edge_file), "-o", str(file), "--tls.guess",
        *_COMMON,
    )  # fmt: skip


def _lines(at: float, turn: float, random: np.random.Generator) -> list[tuple[Any, dict[str, Any]]]:
    """One road across the town, with what runs beside it."""
    from shapely import LineString, affinity

    u = np.arange(-0.5 * SIDE, 0.5 * SIDE, 20.0)
    wave, length, phase = random.uniform(0, 60), random.uniform(600, 2500), random.uniform(0, 7)
    line = LineString(np.column_stack([u, at + wave * np.sin(2 * np.pi * u / length + phase)]))
    line = affinity.rotate(line, turn, origin=(0, 0), use_radians=True)
    kind = str(random.choice(_KINDS, p=_SHARES))
    gap = float(random.uniform(8.0, 25.0))
    lanes = int(random.integers(1, 4))
    fast = float(random.choice([8.3, 13.9, 13.9, 19.4]))
    main = {"lanes": 1, "oneway": False, "highway": "residential", "speed": fast, "ring": False}
    if kind == "wide":
        main |= {"lanes": 2, "highway": "secondary", "speed": 13.9}
    if kind == "one-way":
        main |= {"lanes": lanes, "oneway": True, "highway": "tertiary"}
        return [(line if random.random() < 0.5 else line.reverse(), main)]
    if kind == "dual":
        main |= {"lanes": lanes, "oneway": True, "highway": "primary", "speed": 19.4}
        right, left = line.offset_curve(-0.5 * gap), line.offset_curve(0.5 * gap)
        return [(right, main), (left.reverse(), main)]
    if kind == "frontage":
        main |= {"lanes": min(lanes, 2), "highway": "secondary", "speed": 19.4}
        side = main | {"lanes": 1, "highway": "service", "speed": 8.3}
        beside = line.offset_curve(gap if random.random() < 0.5 else -gap)
        found = [(line, main), (beside, side)]
        s = float(random.uniform(100, 400))
        while s < line.length - 200:
            slant = float(random.uniform(10, 60))
            ends = [
                line.interpolate(s),
                beside.interpolate(beside.project(line.interpolate(s)) + slant),
            ]
            found.append((LineString(ends), side))
            s += float(random.uniform(250, 700))
        return found
    return [(line, main)]


def _with_rings(
    roads: list[tuple[Any, dict[str, Any]]], random: np.random.Generator
) -> list[tuple[Any, dict[str, Any]]]:
    """Roundabouts at some of the crossings of the first lines."""
    from shapely import LineString, Point
    from shapely.ops import unary_union

    rings, discs = [], []
    for i, (a, what) in enumerate(roads):
        for b, other in roads[i + 1 :]:
            crossing = a.intersection(b)
            plain = what["highway"] != "service" != other["highway"]
            if crossing.geom_type != "Point" or not plain or random.random() > 0.12:
                continue
            radius = float(random.uniform(12.0, 30.0))
            if any(crossing.distance(Point(d.centroid)) < 100.0 for d in discs):
                continue
            angle = np.linspace(0.0, 2.0 * np.pi, 25)
            points = np.column_stack(
                [crossing.x + radius * np.cos(angle), crossing.y + radius * np.sin(angle)]
            )
            points[-1] = points[0]
            discs.append(crossing.buffer(radius * 0.999, 64))
            ring = {"lanes": 1, "oneway": True, "highway": "tertiary", "speed": 8.3, "ring": True}
            rings.append((LineString(points), ring))
    if not discs:
        return roads
    hole = unary_union(discs)
    out = []
    for line, what in roads:
        rest = line.difference(hole)
        parts = getattr(rest, "geoms", [rest])
        # what was cut is prolonged a little, so that it crosses the ring
        out += [(_longer(p), what) for p in parts if p.length > 15.0]
    return out + rings


def _longer(line: Any) -> Any:
    from shapely import LineString

    p = np.array(line.coords)
    a, b = p[0] - p[1], p[-1] - p[-2]
    p[0] += 1.0 * a / np.hypot(*a)
    p[-1] += 1.0 * b / np.hypot(*b)
    return LineString(p)


def _noded(
    roads: list[tuple[Any, dict[str, Any]]], random: np.random.Generator
) -> tuple[list[str], list[str]]:
    """Lines of the node and edge files: roads cut where they cross, some pieces left out."""
    import shapely
    from shapely.ops import substring

    lines = np.array([line for line, _ in roads], dtype=object)
    tree = shapely.STRtree(lines)
    names: dict[tuple[int, int], str] = {}
    nodes, edges = [], []

    def node(p: Any) -> str:
        key = round(p[0] / 2.0), round(p[1] / 2.0)
        for near in ((key[0] + i, key[1] + j) for i in (0, -1, 1) for j in (0, -1, 1)):
            if near in names:
                return names[near]
        names[key] = f"n{len(names)}"
        nodes.append(f'<node id="{names[key]}" x="{p[0]:.2f}" y="{p[1]:.2f}"/>')
        return names[key]

    for i, (line, what) in enumerate(roads):
        cuts = {0.0, line.length}
        for j in tree.query(line, predicate="intersects"):
            if j != i:
                met = shapely.get_coordinates(line.intersection(lines[j]))
                cuts |= {float(line.project(shapely.Point(p))) for p in met}
        at = np.array(sorted(cuts))
        at = at[np.concatenate([[True], np.diff(at) > 4.0])]
        at[-1] = line.length
        for k in range(len(at) - 1):
            piece = np.array(substring(line, at[k], at[k + 1]).coords)
            if not what["ring"] and random.random() < 0.07:
                continue
            if not what["ring"] and at[k + 1] - at[k] < 12.0 and k in (0, len(at) - 2):
                continue
            ends = node(piece[0]), node(piece[-1])
            if ends[0] == ends[1]:
                continue
            edges += _edge(f"e{i}_{k}", ends, piece, what)
    return nodes, edges


def _edge(name: str, ends: tuple[str, str], p: np.ndarray, what: dict[str, Any]) -> list[str]:
    out = []
    for back in (False,) if what["oneway"] else (False, True):
        a, b = ends[::-1] if back else ends
        shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in (p[::-1] if back else p))
        inner = f" shape={quoteattr(shape)}" if len(p) > 2 else ""
        spread = ' spreadType="center"' if what["oneway"] else ""
        out.append(
            f'<edge id="{"-" if back else ""}{name}" from="{a}" to="{b}" '
            f'numLanes="{what["lanes"]}" speed="{what["speed"]}" '
            f'type="highway.{what["highway"]}"{inner}{spread}/>'
        )
    return out


# --- reading -------------------------------------------------------------------------------------


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
