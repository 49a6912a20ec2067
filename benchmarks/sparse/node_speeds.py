"""How fast real drives pass junctions, by the turn there: where the prior of turns is from.

    python -m benchmarks.sparse.node_speeds [--tracks 0-49]

The path is the one that is answered with all knowledge.  The speed is that between the fixes from
2 s before the junction to 1 s behind it.
"""

import argparse
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import Options, data_folder
from ..kubicka import numbers
from . import harness

Array = NDArray[np.float64]

_TURNS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 1.2, 1.5, 1.8, 2.3, 3.2)  # rad
_QUANTILES = (5, 25, 50, 75, 95)
_LONGEST = 4.0  # s, from the first of four fixes to the last


def node_speeds(raw: Any, roads: Any, trace: Any) -> list[tuple[float, float, float]]:
    """Turn (rad), its prior and speed (m/s) at each junction that a drive has passed."""
    time, lat = np.asarray(trace.t), np.radians(trace.lat)
    east = np.radians(trace.lon) * np.cos(lat.mean()) * 6.371e6
    north = lat * 6.371e6
    path = raw.path_arrow()
    entered = path["enter_time"].cast("int64").to_numpy() / 1e6
    edges, turns, rows = roads.arrays.edges, roads.arrays.turns, []
    for k, (a, b) in enumerate(pairwise(path["edge_id"].to_pylist()), 1):
        if a is None or b is None:
            continue
        there = turns[edges.first_turn[a] : edges.end_turn[a]]
        taken = there[there.edge == b]
        at = int(np.searchsorted(time, entered[k]))
        choice = len(taken) and (there.edge != edges.opposite[a]).sum() > 1
        if not choice or not 2 <= at < len(time) - 1 or time[at + 1] - time[at - 2] > _LONGEST:
            continue
        way = np.hypot(east[at + 1] - east[at - 2], north[at + 1] - north[at - 2])
        speed = way / (time[at + 1] - time[at - 2])
        rows.append((abs(float(taken.angle[0])), float(taken.prior[0]), float(speed)))
    return rows


def _print(rows: Array) -> None:
    turn, prior, speed = rows.T
    print("turn, rad    junctions  mean prior  speed, m/s: quantiles", *_QUANTILES)
    for low, high in pairwise(_TURNS):
        here = (turn >= low) & (turn < high)
        if here.any():
            found = np.percentile(speed[here], _QUANTILES)
            mean = prior[here].mean()
            print(f"{low:4} .. {high:4} {here.sum():9} {mean:11.2f}  ", found.round(1))
    corner = (turn > 0.15) & (turn < 2.0)
    found = np.percentile(speed[corner] * np.sqrt(turn[corner]), _QUANTILES)
    print(f"speed times the root of the turn, 0.15 to 2 rad, {corner.sum()}:", found.round(1))


def main() -> None:
    """All tracks, one table."""
    parser = argparse.ArgumentParser(description="Speeds of real drives at junctions.")
    parser.add_argument("--tracks", type=numbers, default=numbers("0-49"))
    told = parser.parse_args()
    options = Options(data=data_folder())
    tracks, _ = harness.real_tracks(options)
    pbf, _ = harness.real_map(options)
    adapter = harness.our_adapter(options, pbf)
    rows = []
    for n in (n for n in told.tracks if n in tracks):
        trace = harness.real_trace(options, tracks[n], 1)
        rows += node_speeds(adapter.match(trace), adapter.roads(float(trace.lon[0])), trace)
    _print(np.array(rows))


if __name__ == "__main__":
    main()
