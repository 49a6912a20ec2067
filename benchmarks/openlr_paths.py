"""OpenLR: are references of random paths followed to the same edges by `openlr-dereferencer`?

Paths are legal drives at random in the middle of Heidelberg, of up to forty edges, which begin
and end anywhere on an edge.  The bytes are read by `openlr`; the decoder sees our map.
"""

import numpy as np
import openlr
import openlr_dereferencer
import pyarrow as pa
from openlr_dereferencer.decoding import LRDecodeError

import whichroad

from . import Figure, Options, seeds_text
from .openlr_map import OurMap

BOX = (8.66, 49.39, 8.72, 49.43)
PATHS, SEEDS = 1000, range(41, 42)
STEP = 2.4  # m, of coordinates in the bytes
# the default of 20 m takes short edges for their neighbours
CONFIG = openlr_dereferencer.Config(candidate_threshold=2)


def drives(roads, rng, most=40):
    """A legal drive at random, without turning round, and where it begins and ends."""
    edges, turns = roads.arrays.edges, roads.arrays.turns
    legal = np.flatnonzero(edges.rule == 0)
    route = [int(rng.choice(legal))]
    for _ in range(int(rng.integers(0, most))):
        e = route[-1]
        onward = [int(turns.edge[k]) for k in range(edges.first_turn[e], edges.end_turn[e])
                  if turns.rule[k] == 0 and turns.edge[k] != edges.opposite[e]]  # fmt: skip
        onward = [x for x in onward if x not in route]
        if not onward:
            break
        route.append(onward[int(rng.integers(len(onward)))])
    length = edges.length[route]
    enter = float(rng.uniform(0.0, 0.9) * length[0])
    leave = float(rng.uniform(0.1, 1.0) * length[-1])
    if len(route) == 1:
        enter, leave = 0.1 * float(length[0]), 0.9 * float(length[0])
    return route, enter, leave


def path_of(roads, route, enter, leave):
    length = roads.arrays.edges.length[route]
    begin, end = np.zeros(len(route)), length.copy()
    begin[0], end[-1] = enter, leave
    return pa.table({"edge_id": route, "enter_m": begin, "exit_m": end})


def followed(reader, code):
    """Edges, and where on the first and the last one."""
    found = openlr_dereferencer.decode(openlr.binary_decode(code), reader, config=CONFIG)
    lines = [line.line_id for line in found.lines]
    return lines, found.p_off, found.n_off


def compare(roads, count, seed, most=40):
    """How many references were made, and how many lead to the same edges, and places on them.

    The last number is that of paths that begin or end on an edge shorter than the bytes' step.
    """
    rng, reader = np.random.default_rng(seed), OurMap(roads)
    made = same = exact = stubs = 0
    while made < count:
        route, enter, leave = drives(roads, rng, most)
        [code] = set(roads.openlr(path_of(roads, route, enter, leave), by="stretch"))
        if code is None:
            assert len(route) == 1  # too short
            continue
        made += 1
        length = roads.arrays.edges.length[route]
        stubs += min(length[0], length[-1]) < STEP
        try:
            lines, before, behind = followed(reader, code)
        except LRDecodeError:
            continue
        same += lines == route
        near = abs(before - enter) < 1.0 + length[0] / 200
        exact += lines == route and near and abs(length[-1] - behind - leave) < 1 + length[-1] / 200
    return made, same, exact, stubs


def run(options: Options) -> list[Figure]:
    """Share of the same edges, and of the same places on them."""
    extract = options.need("maps", "heidelberg.osm.pbf")
    roads = whichroad.RoadMap.from_osm(extract, bbox=BOX)
    seeds = options.seeds or SEEDS
    told = np.array([compare(roads, options.more.get("drives") or PATHS, seed) for seed in seeds])
    made, same, exact, stubs = told.sum(axis=0).tolist()
    text = seeds_text(seeds)
    return [
        Figure("the same edges", 100.0 * same / made, ">= 99", "%", made, seeds=text),
        Figure(
            "and the same ends to 1 m and 0.5 %", 100.0 * exact / made, "", "%", made, seeds=text
        ),
        Figure("paths that end on an edge below 2.4 m", stubs, "", "", made, seeds=text),
    ]
