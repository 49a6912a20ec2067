"""Kernels that make a road graph of streets: chains between junctions, end headings.

A half is one direction of one straight segment: half 2i runs along segment i as its
street was drawn, half 2i + 1 runs back.
"""

import math

from ._jit import Bytes, Ints32, Vector, kernel


@kernel
def _follow(
    half: int, head: Ints32, cut: Bytes, out_first: Ints32, out: Ints32,
    chain_half: Ints32, done: Bytes, n: int,
) -> int:  # fmt: skip
    """Write the halves from `half` on, up to the next junction; the new end of the list."""
    while True:
        chain_half[n] = half
        done[half] = 1
        n += 1
        node = head[half]
        if cut[node]:
            return n
        back = half ^ 1
        half = out[out_first[node]]
        if half == back:
            half = out[out_first[node] + 1]


@kernel
def chains(
    head: Ints32, cut: Bytes, out_first: Ints32, out: Ints32,
    chain_first: Ints32, chain_half: Ints32, done: Bytes,
) -> int:  # fmt: skip
    """Join halves to directed chains that run from junction to junction.

    Every half is in exactly one chain.  A ring without a junction gets one: the node at
    which its first segment starts.

    Args:
        head: (2M,) node at which each half ends.
        cut: (N,) 1 for junctions; every other node has exactly two halves leaving it.
            Those of rings are added.
        out_first: (N+1,) first place in `out` of the halves that leave each node.
        out: (2M,) those halves.
        chain_first: (2M+1,) out, first place of each chain in `chain_half`.
        chain_half: (2M,) out, halves in driving order.
        done: (2M,) zeros, for work.

    Returns:
        Number of chains.
    """
    count = 0
    n = 0
    chain_first[0] = 0
    for half in range(len(head)):
        if cut[head[half ^ 1]]:
            n = _follow(half, head, cut, out_first, out, chain_half, done, n)
            count += 1
            chain_first[count] = n
    for half in range(len(head)):
        if done[half]:
            continue
        node = head[half ^ 1]
        cut[node] = 1
        for i in range(out_first[node], out_first[node + 1]):
            n = _follow(out[i], head, cut, out_first, out, chain_half, done, n)
            count += 1
            chain_first[count] = n
    return count


@kernel
def end_headings(
    x: Vector, y: Vector, s: Vector, first: Ints32, reach: float, start: Vector, end: Vector
) -> None:
    """Headings of the chords from each edge's start, and to its end.

    Args:
        x: (V,) m, plane.
        y: (V,) m.
        s: (V,) abscissae, m.
        first: (E+1,) first vertex of each edge.
        reach: Length of the chord along the edge, m; the whole edge where it is shorter.
        start: (E,) out, heading away from the start, rad.
        end: (E,) out, heading into the end, rad.
    """
    for e in range(len(first) - 1):
        low = first[e]
        high = first[e + 1] - 1
        length = s[high]
        v = low + 1
        while v < high and s[v] < reach:
            v += 1
        t = min((reach - s[v - 1]) / (s[v] - s[v - 1]), 1.0)
        px = x[v - 1] + t * (x[v] - x[v - 1])
        py = y[v - 1] + t * (y[v] - y[v - 1])
        start[e] = math.atan2(py - y[low], px - x[low])
        v = high - 1
        while v > low and length - s[v] < reach:
            v -= 1
        t = max((length - reach - s[v]) / (s[v + 1] - s[v]), 0.0)
        px = x[v] + t * (x[v + 1] - x[v])
        py = y[v] + t * (y[v + 1] - y[v])
        end[e] = math.atan2(y[high] - py, x[high] - px)
