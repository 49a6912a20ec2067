"""Directed edges out of straight pieces: chains between junctions, headings at their ends.

A half is one direction of one straight segment: half 2i runs along segment i as its
street was drawn, half 2i + 1 runs back.  All is NumPy's: building a map compiles nothing.
"""

import numpy as np
from numpy.typing import NDArray

from ..observations import Array
from .streets import Bytes

Ints32 = NDArray[np.int32]


def chains(head: Ints32, cut: Bytes, out_first: Ints32, out: Ints32) -> tuple[Ints32, Ints32]:
    """Join halves to directed chains that run from junction to junction.

    Every half is in exactly one chain; chains are in the order of their first halves.  A ring
    without a junction gets one, the node at which its first segment starts, and comes last.

    Args:
        head: (2M,) node at which each half ends.
        cut: (N,) 1 for junctions; every other node has exactly two halves leaving it.
        out_first: (N+1,) first place in `out` of the halves that leave each node.
        out: (2M,) those halves.

    Returns:
        (C+1,) first place of each chain, and (2M,) halves in driving order.
    """
    successor = _following(head, out_first, out)
    last = cut[head] > 0
    at = np.flatnonzero(last.reshape(-1, 2)[:, ::-1].ravel()).astype(np.int32)
    count = len(at)
    which = np.arange(count, dtype=np.int32)
    length = np.zeros(count, np.int32)
    steps = []
    while len(at):  # all chains at once, one half further
        steps.append((at, which))
        length[which] += 1
        going = ~last[at]
        at, which = successor[at[going]], which[going]
    first = np.concatenate([[0], np.cumsum(length)]).astype(np.int32)
    ordered = np.empty(first[-1], np.int32)
    for step, (at, which) in enumerate(steps):
        ordered[first[which] + step] = at
    rings = _rings(ordered, successor)
    if rings:
        more = np.cumsum([len(ring) for ring in rings]) + first[-1]
        first = np.concatenate([first, more]).astype(np.int32)
        ordered = np.concatenate([ordered, *rings]).astype(np.int32)
    return first, ordered


def _following(head: Ints32, out_first: Ints32, out: Ints32) -> Ints32:
    """The half that follows each one where it does not end at a junction."""
    start = out_first[head]
    one = out[start]
    back = one == np.arange(len(head), dtype=np.int32) ^ 1
    start[back] = np.minimum(start[back] + 1, len(out) - 1)  # a dead end has no second
    following: Ints32 = np.where(back, out[start], one)
    return following


def _rings(done: Ints32, successor: Ints32) -> list[list[int]]:
    """Both directions of every ring without a junction."""
    rings: list[list[int]] = []
    left = np.ones(len(successor), bool)
    left[done] = False
    for half in np.flatnonzero(left).tolist():
        if left[half]:
            # back, the same node is left by the half that led there, reversed
            ring = _round(half, successor)
            pair = sorted((ring, _round(ring[-1] ^ 1, successor)))
            rings += pair
            for found in pair:
                left[found] = False
    return rings


def _round(half: int, successor: Ints32) -> list[int]:
    """The halves of a ring from one of them on."""
    ring = [half]
    while (after := int(successor[ring[-1]])) != half:
        ring.append(after)
    return ring


def end_headings(x: Array, y: Array, s: Array, first: Ints32, reach: float) -> tuple[Array, Array]:
    """Headings of the chords from each edge's start, and to its end.

    Args:
        x: (V,) m, plane.
        y: (V,) m.
        s: (V,) along-track positions, m.
        first: (E+1,) first vertex of each edge.
        reach: Length of the chord along the edge, m; the whole edge where it is shorter.

    Returns:
        (E,) heading away from the start, and (E,) into the end, rad.
    """
    low, high = first[:-1], first[1:] - 1
    length = s[high]
    v = np.minimum(low + np.add.reduceat(s < reach, low, dtype=np.int32), high)
    t = np.minimum((reach - s[v - 1]) / (s[v] - s[v - 1]), 1.0)
    px, py = (p[v - 1] + t * (p[v] - p[v - 1]) for p in (x, y))
    start: Array = np.arctan2(py - y[low], px - x[low])
    near = np.repeat(length, np.diff(first)) - s < reach
    v = np.maximum(high - np.add.reduceat(near, low, dtype=np.int32), low)
    t = np.maximum((length - reach - s[v]) / (s[v + 1] - s[v]), 0.0)
    px, py = (p[v] + t * (p[v + 1] - p[v]) for p in (x, y))
    end: Array = np.arctan2(y[high] - py, x[high] - px)
    return start, end
