"""Real drives with hand-corrected routes (Kubicka et al. 2015), GNSS alone.

Each track brings its own road network of directed straight arcs.  The score is the
route mismatch: length driven but not found, plus length found but not driven, over the
length driven; roads are the same within 3 m and 60 degrees.
"""

import csv
import tarfile
import tempfile
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import whichroad
from whichroad.evaluate import route_mismatch

from . import Figure, Options, interval, share

EARTH = 6371008.8  # m, mean radius: the flat map on which roads are compared


@dataclass(frozen=True, slots=True)
class Track:
    """One drive and its network."""

    number: int
    nodes: np.ndarray  # (n, 2) lon, lat
    arcs: np.ndarray  # (a, 2) from, to
    route: np.ndarray  # (r,) arcs in driving order
    fixes: np.ndarray  # (f, 3) lon, lat, s

    def plane(self, lonlat: np.ndarray) -> np.ndarray:
        """Metres around the network's middle."""
        middle = np.median(self.nodes, axis=0)
        scale = [np.cos(np.radians(middle[1])), 1.0]
        return (np.asarray(lonlat) - middle) * scale * np.radians(1.0) * EARTH


@dataclass(frozen=True, slots=True)
class Score:
    """What one track's answer is worth, and what it cost."""

    missed: float  # m driven, not found
    extra: float  # m found, not driven
    driven: float  # m
    fixes: int
    seconds: float  # matching, the map ready


def read(folder: Path, number: int) -> Track:
    """One track of the unpacked archive."""
    name = folder / f"{number:08d}" / f"{number:08d}"

    def load(suffix: str, dtype: type, columns: int) -> np.ndarray:
        return np.loadtxt(f"{name}.{suffix}", dtype=dtype, ndmin=columns)

    return Track(
        number,
        load("nodes", float, 2)[:, :2],
        load("arcs", int, 2)[:, :2],
        load("route", int, 1),
        load("track", float, 2)[:, :3],
    )


def tracks(archive: Path, numbers: list[int]) -> Iterator[Track]:
    """Unpack the wanted tracks into a temporary folder and read them one by one."""
    wanted = {f"{n:08d}" for n in numbers}
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(archive) as tar:
            members = (m for m in tar if Path(m.name).parts[0] in wanted)
            tar.extraction_filter = getattr(tarfile, "data_filter", None)  # from 3.11.4 on
            tar.extractall(folder, members=members)
        for number in numbers:
            yield read(Path(folder), number)


def network(track: Track) -> Any:
    """The track's arcs as a table of directed edges."""
    import geopandas
    import shapely

    return geopandas.GeoDataFrame(
        {
            "id": np.arange(len(track.arcs)),
            "from": track.arcs[:, 0],
            "to": track.arcs[:, 1],
        },
        geometry=shapely.linestrings(track.nodes[track.arcs]),
        crs="EPSG:4326",
    )


def drive(track: Track, every: float) -> Any:
    """The fixes as a drive table, thinned to one in `every` seconds (the last one always)."""
    import pandas as pd

    kept, last = [], -np.inf
    for i, t in enumerate(track.fixes[:, 2]):
        if t - last >= every - 1e-6 or i == len(track.fixes) - 1:
            kept.append(i)
            last = t
    lon, lat, seconds = track.fixes[kept].T
    return pd.DataFrame({"time": seconds, "lat": lat, "lon": lon})


def score(track: Track, every: float, model: str, settings: Any) -> Score:
    """Match one track and compare its path with the true route."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        roads = whichroad.RoadMap.from_edges(network(track), directed=True)
        fixes = drive(track, every)
        start = time.perf_counter()
        path = whichroad.match(fixes, roads, model=model, settings=settings).path
        seconds = time.perf_counter() - start
    true = [track.plane(line) for line in track.nodes[track.arcs[track.route]]]
    found = [track.plane(np.asarray(g.coords)[:, :2]) for g in path.geometry]
    missed, extra, driven = route_mismatch(true, true, found)
    return Score(missed, extra, driven, len(fixes), seconds)


def numbers(text: str) -> list[int]:
    """'0-3,7' as [0, 1, 2, 3, 7]."""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def pooled(figure: str, goal: str, scores: list[Score]) -> Figure:
    """Route mismatch of a set, weighed by length, in percent."""
    rows = np.array([(s.missed + s.extra, s.driven) for s in scores])
    value = share(rows) if len(rows) else None
    return Figure(figure, value, goal, "%", len(scores), interval(share, rows))


def run(options: Options) -> list[Figure]:
    """Match the tracks and pool their route mismatch by set."""
    archive = options.need("kubicka", "tracks-00-49.tar.gz")
    with open(options.need("kubicka", "sets.csv"), newline="") as file:
        sets = {int(row["track"]): row for row in csv.DictReader(file)}
    every = options.more.get("every", 1.0)
    wanted = numbers(options.more.get("tracks", "0-49"))
    scores: dict[int, Score] = {}
    options.say("track    km   mismatch %  missed  extra   fixes      s  set")
    for track in tracks(archive, wanted):
        row = sets[track.number]
        label = "clean" if row["clean"] == "1" else "usable" if row["usable"] == "1" else row["why"]
        try:
            model = options.more.get("model", "default")
            s = scores[track.number] = score(track, every, model, options.settings())
        except whichroad.WhichroadError as error:
            options.say(f"{track.number:5}  no result: {error}")
            continue
        options.say(
            f"{track.number:5} {s.driven / 1e3:6.1f} {100 * (s.missed + s.extra) / s.driven:10.2f}"
            f" {100 * s.missed / s.driven:8.2f} {100 * s.extra / s.driven:6.2f}"
            f" {s.fixes:7} {s.seconds:6.2f}  {label}"
        )
    usable = [s for n, s in scores.items() if sets[n]["usable"] == "1" and n != 43]
    clean = [s for n, s in scores.items() if sets[n]["clean"] == "1"]
    rate = sum(s.fixes for s in scores.values()) / max(
        sum(s.seconds for s in scores.values()), 1e-9
    )
    at_one = every == 1.0
    return [
        pooled("route mismatch, usable without 43", "<= 2.3" if at_one else "", usable),
        pooled("route mismatch, clean", "<= 1.6" if at_one else "", clean),
        Figure("tracks with a result", float(len(scores)), f">= {len(wanted)}", "", len(wanted)),
        Figure("fixes matched, tables built", rate, "", "1/s", len(scores)),
    ]
