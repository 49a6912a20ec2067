"""The drives that routes are judged on, and our answers to them."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import whichroad

from .. import Options
from ..kubicka import numbers
from ..sparse import harness

SEEDS = range(20, 30)  # those of choosing; 30 to 39 are for reports
TRIPS = 4  # a seed of Heidelberg
NOISE = (5.0, harness.TAU)  # sigma, m, and correlation time, s, of fixes in Heidelberg


@dataclass(frozen=True, slots=True)
class Matched:
    """One drive's answer as arrays, and what is known of the truth."""

    name: str
    roads: Any  # RoadMap
    time: np.ndarray  # (n,) s, of the points
    edge: np.ndarray  # (n,) the most probable edge; -1: none
    p: np.ndarray  # (n,) its P
    s: np.ndarray  # (n,) m
    path: np.ndarray  # (r,) edges
    enter: np.ndarray  # (r,) s
    leave: np.ndarray  # (r,) s
    path_p: np.ndarray  # (r,)
    path_rows: Any  # the table of the path
    truth: Any  # of the track or the trip


def intervals(options: Options) -> list[int]:
    """Seconds between fixes that were asked for."""
    return [int(s) for s in options.more.get("intervals", "1,5,10,30,60").split(",")]


def tracks(options: Options) -> list[int]:
    """Numbers of usable real tracks: `even`, `odd`, or a list."""
    told = options.more.get("tracks", "even")
    sets = harness.sets(options)
    usable = [n for n, row in sets.items() if row["usable"] == "1" and n != 43]
    if told in ("even", "odd"):
        return [n for n in usable if n % 2 == int(told == "odd")]
    return [n for n in numbers(told) if n in usable]


def answer(name: str, roads: Any, trace: Any, lag: Any, truth: Any) -> Matched:
    """Match one trace of the harness."""
    fixes = {
        "time": trace.t, "lat": trace.lat, "lon": trace.lon,
        "sigma_m": np.full(len(trace.t), trace.sigma),
    }  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = whichroad.match(fixes, roads, lag=lag)
    points, path = found.to_arrow(), found.path_arrow()

    def seconds(column: Any) -> np.ndarray:
        return np.asarray(column.cast("int64").to_numpy() / 1e6)

    def floats(column: Any) -> np.ndarray:
        return np.asarray(column.to_numpy(zero_copy_only=False), float)

    edge = points["edge_id"].fill_null(-1).to_numpy(zero_copy_only=False)
    return Matched(
        name, roads, seconds(points["time"]), edge, floats(points["p_road"]),
        floats(points["abscissa_m"]), path["edge_id"].to_numpy(), seconds(path["enter_time"]),
        seconds(path["exit_time"]), floats(path["p"]), path, truth,
    )  # fmt: skip


def real_traces(options: Options, every: int) -> Iterator[tuple[str, Any, Any, Any]]:
    """The real tracks asked for, thinned: name, map, trace and truth."""
    known, _ = harness.real_tracks(options)
    pbf, _ = harness.real_map(options)
    adapter = harness.our_adapter(options, pbf)
    for n in (n for n in tracks(options) if n in known):
        trace = harness.real_trace(options, known[n], every)
        yield f"track {n}", adapter.roads(float(trace.lon[0])), trace, known[n]


def city_traces(options: Options, every: int) -> Iterator[tuple[str, Any, Any, Any]]:
    """The harness's trips in Heidelberg: name, map, trace and truth."""
    simulate = harness.module(options, "simulate")
    pbf = options.need("maps", "heidelberg.osm.pbf")
    adapter = harness.our_adapter(options, pbf)
    for seed in options.seeds or SEEDS:
        count = options.more.get("drives", TRIPS)
        graph, trips = harness.heidelberg(options, seed, count)
        for trip in trips:
            trace, index = simulate.make_trace(graph, trip, every, *NOISE, seed=seed)
            roads = adapter.roads(float(trace.lon[0]))
            yield f"seed {seed} trip {trip.id}", roads, trace, (graph, trip, index)


def real(options: Options, every: int, lag: Any = "full") -> Iterator[Matched]:
    """The real tracks asked for, thinned, and our answers."""
    for name, roads, trace, truth in real_traces(options, every):
        yield answer(name, roads, trace, lag, truth)


def city(options: Options, every: int, lag: Any = "full") -> Iterator[Matched]:
    """The harness's trips in Heidelberg, and our answers."""
    for name, roads, trace, truth in city_traces(options, every):
        yield answer(name, roads, trace, lag, truth)
