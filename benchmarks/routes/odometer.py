"""Trips in Heidelberg with an odometer that is read at the fixes alone: what does it tell?

It counts in steps of 10 m, and 1 % too much.  Beside it stand the fixes alone.
"""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

import whichroad

from .. import Figure, Options, interval, share
from . import matched
from .wrong_fix import mismatch

STEP, SCALE = 10.0, 1.01
RATES = (10, 30, 60)  # s, of those asked for


def pairs(options: Options, every: int) -> Iterator[tuple[float, float, float]]:
    """Of each trip: metres wrong with the odometer and without it, and metres driven."""
    for name, roads, trace, truth in matched.city_traces(options, every):
        _, trip, index = truth
        driven = SCALE * (trip.s[index] - trip.s[index[0]])
        table = {
            "time": trace.t, "lat": trace.lat, "lon": trace.lon,
            "sigma_m": np.full(len(trace.t), trace.sigma),
        }  # fmt: skip
        told = np.floor(driven / STEP) * STEP
        with_it, length = _wrong(options, name, roads, {**table, "odometer_m": told}, truth)
        without, _ = _wrong(options, name, roads, table, truth)
        yield with_it, without, length


def _wrong(
    options: Options, name: str, roads: Any, table: dict[str, Any], truth: Any
) -> tuple[float, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = whichroad.match(table, roads, lag="full").path_arrow()
    none = np.empty(0)
    one = matched.Matched(
        name, roads, none, none, none, none, none, none, none, none, path, truth
    )  # fmt: skip
    return mismatch(options, one)


def measure(options: Options) -> list[Figure]:
    """At each rate."""
    figures = []
    for every in RATES:
        if every not in matched.intervals(options):
            continue
        rows = np.array(list(pairs(options, every)))
        for column, what in enumerate(("with an odometer", "fixes alone")):
            counts = rows[:, [column, 2]]
            text = f"route mismatch, {what}, Heidelberg {every} s"
            figures.append(Figure(text, share(counts), "", "%", len(rows), interval(share, counts)))
    return figures
