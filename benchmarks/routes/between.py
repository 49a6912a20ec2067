"""Are the edges of the path true that no fix lies on, where it says P >= 0.999?"""

from collections.abc import Callable, Iterator

import numpy as np
import shapely

from whichroad.evaluate import route_mismatch

from .. import Figure, Options, interval
from ..sparse import harness
from . import matched
from .matched import Matched

SURE = 0.999
RATES = (30, 60)  # s, of those asked for
NEARBY = 100.0  # m, beyond which the true route does not matter to an edge


def true_lines(options: Options, m: Matched) -> list[np.ndarray]:
    """The true route in the map's plane."""
    if isinstance(m.truth, tuple):
        graph, trip, _ = m.truth
        ll = [graph.latlon(*graph.edge_xy(graph.edges[i]).T) for i in trip.edges]
    else:
        _, places = harness.real_tracks(options)
        ll = [np.array(places.nodes_latlon(run)).T for run in m.truth["route"]]
    return [np.column_stack(m.roads.plane.from_geodetic(*np.array(line))) for line in ll]


def wrong_edges(options: Options, m: Matched) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the path that no fix lies on and that are sure; which of them were not driven."""
    rows = np.flatnonzero(~np.isin(m.path, m.edge) & (m.path_p >= SURE))
    rows = rows[(rows > 0) & (rows < len(m.path) - 1)]
    truth = true_lines(options, m)
    boxes = shapely.STRtree([shapely.LineString(line) for line in truth if len(line) > 1])
    lines = [line for line in truth if len(line) > 1]
    wrong = np.zeros(len(rows), bool)
    geometry = shapely.from_wkb(m.path_rows["geometry"].to_numpy(zero_copy_only=False))
    for at, row in enumerate(rows):
        lon, lat = np.asarray(geometry[row].coords)[:, :2].T
        line = np.column_stack(m.roads.plane.from_geodetic(lat, lon))
        near = boxes.query(shapely.LineString(line).buffer(NEARBY))
        some = [lines[k] for k in near]
        _, extra, _ = route_mismatch(some, some, [line])
        length = float(np.hypot(*np.diff(line, axis=0).T).sum())
        wrong[at] = extra > 0.5 * length
    return rows, wrong


def told(options: Options, drives: Iterator[Matched], label: str, goal: str) -> Figure:
    """Wrong ones in 1,000."""
    table = []
    for m in drives:
        rows, wrong = wrong_edges(options, m)
        table.append((float(wrong.sum()), float(len(rows))))
        if wrong.any():
            which = ", ".join(str(r) for r in rows[wrong])
            options.say(f"  {label}, {m.name}: {wrong.sum()} of {len(rows)} (rows {which})")
    counts = np.array(table)

    def rate(r: np.ndarray) -> float:
        return float(1e3 * r[:, 0].sum() / max(r[:, 1].sum(), 1.0))

    n = int(counts[:, 1].sum())
    name = f"sure edges between fixes, wrong, {label}"
    return Figure(name, rate(counts), goal, "/1000", n, interval(rate, counts))


def measure(options: Options) -> list[Figure]:
    """Real tracks and Heidelberg, 30 and 60 s between fixes."""
    sources: tuple[tuple[str, Callable[..., Iterator[Matched]], str], ...] = (
        ("real", matched.real, "<= 3"), ("Heidelberg", matched.city, "<= 1"),
    )  # fmt: skip
    return [
        told(options, drives(options, every), f"{name} {every} s", goal)
        for name, drives, goal in sources
        for every in RATES
        if every in matched.intervals(options)
    ]
