"""Starting without a fix and without a pose: wheels and the map alone.

Simulated drives whose every fix is taken away, in Heidelberg (28,000 directed edges), there
with a vague pose (500 m, no bearing), in the drawn town, and in Andorra.  `elsewhere` are
drives in Monaco on the map of Andorra, which holds none of them.  A drive knows its road at its
first P > 0.95 that holds for 10 m, and declares it at its first P >= 0.999; both are right if that
edge is driven within 10 m of travel.  After so many metres: what the last 50 m were sure of.
"""

import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

from whichroad.epochs import build_timeline
from whichroad.observations import StartPose
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, draw_town, drivable, simulate_drive

from . import Figure, Options
from .scenes.drives import SURE, Row, Table, each, world
from .town import right_edges

SEEDS = range(10_000, 10_040)
LENGTH_M = 5_600.0
AFTER_M = (500, 1000, 2000, 5000)
SHORT_M = 1_100.0  # of drives in Andorra and elsewhere
KNOWS_OFF_M, KNOWS_OFF = 1_000.0, 0.9  # P(off the map) that is asked after so many metres
VAGUE_M = 500.0  # sigma of the vague pose, drawn about the truth
DECLARED = 0.999
_HOLDS_M = 10.0
_LAST_M = 50.0


def prepare(driven: Path | None, searched: Path | None) -> None:
    """The maps of this process, of the drives and of the search; None: the drawn town."""
    world["roads"] = _opened(driven)
    world["searched"] = world["roads"] if searched == driven else _opened(searched)
    world["allowed"] = drivable(world["roads"].arrays, np.random.default_rng(0))


def _opened(map_file: Path | None) -> RoadMap:
    if map_file is not None:
        return RoadMap.from_osm(map_file)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "town.osm"
        path.write_text(draw_town(), encoding="utf-8")
        return RoadMap.from_osm(path)


def vague_pose(drive: SimulatedDrive, seed: int) -> StartPose:
    """A pose off by its sigma, without a bearing."""
    off = np.random.default_rng(seed).normal(0.0, VAGUE_M, 2)
    plane = world["roads"].plane
    lat, lon = plane.to_geodetic(drive.truth.x[:1] + off[0], drive.truth.y[:1] + off[1])
    return StartPose(float(lat[0]), float(lon[0]), 0.0, VAGUE_M, 180.0)


def one(seed: int, *, vague: bool, scenario: str, length_m: float, settings: Settings) -> Row:
    """A drive in the dark, and when its road was known."""
    roads = world["searched"]
    drive = simulate_drive(
        world["roads"], seed=seed, length_m=length_m, scenario=scenario, allowed=world["allowed"]
    )
    truth = drive.truth
    unseen = drive.drive.__class__(drive.drive.drive_id, None, drive.drive.odometry)
    timeline = build_timeline(unseen, roads.plane, drive.vehicle)
    start = vague_pose(drive, seed) if vague else "map"
    begun = time.process_time()
    output = localize_recorded(
        roads, timeline, vehicle=drive.vehicle, settings=settings, start=start
    ).output
    spent = time.process_time() - begun
    at = np.searchsorted(timeline.epochs.time, truth.time - 1e-3)
    at = np.minimum(at, len(timeline.epochs.time) - 1)
    p, off = output.rows.p_edge[at], output.rows.p_off_road[at]
    right, travelled = right_edges(drive, output.rows.edge[at]), truth.travelled
    row: Row = {"seconds": spent, "off": float(off[travelled > 100.0].mean())}
    if roads is not world["roads"]:
        right = np.zeros(len(right), bool)
        row["knows"] = float(off[np.searchsorted(travelled, KNOWS_OFF_M) - 1] >= KNOWS_OFF)
    sure = p > SURE
    first = first_held(sure, travelled)
    row |= {"known": float(first is not None), "wrong": float(first is not None)}
    if first is not None:
        row |= {"right": float(right[first]), "wrong": float(not right[first])}
        row["metres"] = float(travelled[first])
    row |= _declaration(np.flatnonzero(p >= DECLARED), right, travelled)
    for metres in AFTER_M:
        if metres > travelled[-1]:
            continue
        last = sure & (travelled > metres - _LAST_M) & (travelled <= metres)
        row[f"right after {metres}"] = float(right[last].mean() > 0.5) if last.any() else 0.0
        row[f"wrong after {metres}"] = float(right[last].mean() <= 0.5) if last.any() else 0.0
        row[f"undecided after {metres}"] = float(not last.any())
    known = first is not None and travelled > travelled[first]
    row |= {
        "later": float(np.sum(known & sure)),
        "later wrong": float(np.sum(known & sure & ~right)),
    }
    return row


def _declaration(at: np.ndarray, right: np.ndarray, travelled: np.ndarray) -> Row:
    """Whether a road was ever declared, after how many metres, and whether wrongly."""
    if not len(at):
        return {"declared": 0.0, "declared wrong": 0.0}
    wrong = float(not right[at[0]])
    return {"declared": 1.0, "declared wrong": wrong, "declared after": float(travelled[at[0]])}


def first_held(sure: np.ndarray, travelled: np.ndarray) -> int | None:
    """The first row from which all rows are sure for some metres."""
    for k in np.flatnonzero(sure & np.append(True, ~sure[:-1])):
        ahead = (travelled >= travelled[k]) & (travelled < travelled[k] + _HOLDS_M)
        if sure[ahead].all():
            return int(k)
    return None


def run(options: Options) -> list[Figure]:
    """All of them, one after the other."""
    seeds = options.seeds or SEEDS
    heidelberg = options.need("maps", "heidelberg.osm.pbf")
    andorra, monaco = (options.need("maps", f"{m}.osm.pbf") for m in ("andorra", "monaco"))
    maps = {
        "heidelberg": (heidelberg, heidelberg), "vague": (heidelberg, heidelberg),
        "town": (None, None), "andorra": (andorra, andorra), "elsewhere": (monaco, andorra),
    }  # fmt: skip
    wanted = options.more.get("classes", ",".join(maps)).split(",")
    figures = []
    for name in wanted:
        length = SHORT_M if name in ("andorra", "elsewhere") else LENGTH_M
        work = partial(
            one, vague=name == "vague", scenario=options.more.get("preset", "good"),
            length_m=options.more.get("metres", length), settings=options.settings(),
        )  # fmt: skip
        table = Table(each(work, seeds, options, prepare, maps[name]), seeds)
        figures += _figures(name, table)
    return figures


def _figures(name: str, table: Table) -> list[Figure]:
    figures = [
        table.share(f"{name}: declared at all", "declared"),
        table.share(f"{name}: first declaration wrong", "declared wrong", None, "<= 0.2"),
        table.quantile(f"{name}: metres until then, median", "declared after", 0.5),
        table.share(f"{name}: known at all", "known"),
        table.share(f"{name}: first known wrongly", "wrong"),
        table.share(
            f"{name}: P(off the map) >= 0.9 after 1 km",
            "knows",
            None,
            ">= 90" if name == "elsewhere" else "",
        ),
        table.quantile(
            f"{name}: metres until it knows, median",
            "metres",
            0.5,
            "" if name == "elsewhere" else "<= 300",
        ),
        table.quantile(f"{name}: metres until it knows, 90 %", "metres", 0.9),
        table.share(f"{name}: sure epochs wrong", "later wrong", "later"),
        table.share(f"{name}: P(off-road) on average", "off"),
    ]
    for metres in AFTER_M:
        for what in ("right", "wrong", "undecided"):
            if any(f"{what} after {metres}" in row for row in table.rows):
                figures.append(
                    table.share(f"{name}: {what} after {metres} m", f"{what} after {metres}")
                )
    return [*figures, table.quantile(f"{name}: CPU time", "seconds", 0.5, unit="s")]
