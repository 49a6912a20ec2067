"""Overture: the streets of an extract, as segments after its schema, beside the extract itself."""

from pathlib import Path

import numpy as np

from whichroad import RoadMap

from . import Figure, Options
from .overture_segments import of_osm, table

EDGES, SEED = 4000, 1
_LEVELS = ("layer", "bridge", "tunnel")


def compare(path: Path, count: int = EDGES, seed: int = SEED) -> dict[str, int]:
    """Directed edges of an extract at random, and what they are in the map of its segments.

    Returns:
        How many were `chosen`; of how many the same way is `found` in the same direction at the
        same place; of how many of these the `rule` is the same, the `levels`, the `limits`.
    """
    rows = of_osm(path)
    osm, ours = RoadMap.from_osm(path), RoadMap.from_edges(table(rows))
    written = {r["id"]: r["speed_limits"][0]["max_speed"] for r in rows if "speed_limits" in r}
    edges = osm.arrays.edges
    middle = 0.5 * edges.length
    ids, forward = osm.sources(np.arange(len(osm)), middle)
    chosen = np.random.default_rng(seed).choice(len(osm), min(count, len(osm)), replace=False)
    told = dict.fromkeys(("found", "rule", "levels", "limits"), 0) | {"chosen": len(chosen)}
    for e in chosen.tolist():
        x, y, _ = osm.at(e, middle[e])
        lat, lon = osm.plane.to_geodetic(np.array([x]), np.array([y]))
        px, py = ours.plane.from_geodetic(lat, lon)
        near = ours.near(float(px[0]), float(py[0]), 1.0)
        for edge, s in zip(near.edge.tolist(), near.s.tolist(), strict=True):
            if ours.source(edge, s) != (f"w{ids[e]}", bool(forward[e])):
                continue
            a, b = osm.attributes(e, middle[e]), ours.attributes(edge, s)
            limit = written.get(b["source_id"], {"value": None})["value"]
            told["found"] += 1
            told["rule"] += edges.rule[e] == ours.arrays.edges.rule[edge]
            told["levels"] += [a[n] for n in _LEVELS] == [b[n] for n in _LEVELS]
            told["limits"] += limit == b["speed_limit_kmh"] and (
                limit is None or limit == a["speed_limit_kmh"]
            )
            break
    return told


def run(options: Options) -> list[Figure]:
    """Shares of the same directions, rules, levels and limits."""
    told = compare(options.need("maps", "heidelberg.osm.pbf"))
    n = told["found"]
    return [
        Figure("directed edges found", 100.0 * n / told["chosen"], ">= 99.5", "%", told["chosen"]),
        Figure("the same legal directions", 100.0 * told["rule"] / n, ">= 99.5", "%", n),
        Figure("levels, bridges, tunnels", 100.0 * told["levels"] / n, ">= 100", "%", n),
        Figure("limits", 100.0 * told["limits"] / n, ">= 100", "%", n),
    ]
