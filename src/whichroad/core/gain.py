"""Rauch, Tung and Striebel's gain, for one link of the graph of hypotheses."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Matrix, Vector, part
from .angles import wrap
from .belief import H, N, X, Y
from .rows import add_times, scale_by, set_times, set_to, ten


class Bench(NamedTuple):
    """What one link is worked out on."""

    f: Matrix  # (N, N) F
    mean: Vector  # (N,) x⁻
    cov: Matrix  # (N, N) P⁻
    cross: Matrix  # (N, N) F Pᵢ
    root: Matrix  # (N, N) Cholesky factor of P⁻, scaled, its columns as rows
    gain: Matrix  # (N, N) Gᵀ


def new_bench() -> Bench:
    """Scratch space for one thread."""
    f, cov, cross, root, gain = np.zeros((5, N, N))
    return Bench(f, np.zeros(N), cov, cross, root, gain)


@part
def spread_forward(bench: Bench, q: Vector, cov: Matrix) -> None:
    """F P and F P Fᵀ + Q; the part of Q off the diagonal is in `cov` already."""
    f = bench.f
    for a in range(N):
        row = bench.cross[a]
        set_times(row, f[a, 0], cov[0])
        for c in range(1, N):
            if f[a, c] != 0.0:
                add_times(row, f[a, c], cov[c])
    turned = bench.gain
    for a in range(N):
        for b in range(N):
            turned[b, a] = bench.cross[a, b]
    for a in range(N):
        row = bench.cov[a]
        for c in range(N):
            if f[a, c] != 0.0:
                add_times(row, f[a, c], turned[c])
        row[a] += q[a]
    for a in range(N):
        for b in range(a):
            bench.cov[a, b] = bench.cov[b, a]


@part
def solve_gain(bench: Bench) -> None:
    """Gᵀ = (P⁻)⁻¹ F Pᵢ, by a Cholesky factor that leaves out what has no variance."""
    root = bench.root
    gain = bench.gain
    unit, left, right = ten(), ten(), ten()
    for a in range(N):
        variance = bench.cov[a, a]
        unit[a] = 1.0 / math.sqrt(variance) if variance > 1e-18 else 0.0
    for a in range(N):
        set_times(left, unit[a], bench.cov[a])
        scale_by(left, 1.0, unit)
        set_times(right, unit[a], bench.cross[a])
        for b in range(a):
            factor = -root[b, a]
            add_times(left, factor, root[b])
            add_times(right, factor, gain[b])
        pivot = left[a]
        pivot = 1.0 / math.sqrt(pivot) if pivot > 1e-9 else 0.0
        set_times(root[a], pivot, left)
        set_times(gain[a], pivot, right)
        root[a, a] = pivot
    for a in range(N - 1, -1, -1):
        set_to(right, gain[a])
        for b in range(N - 1, a, -1):
            add_times(right, -root[a, b], gain[b])
        set_times(gain[a], root[a, a], right)
    for a in range(N):
        set_times(gain[a], unit[a], gain[a])


@part
def add_link(
    bench: Bench, later: Vector, later_cov: Matrix, then_cov: Matrix, mean: Vector, cov: Matrix,
    share: float, scale: float,
) -> None:  # fmt: skip
    """Add what j tells of i to what others have told of it.

    Args:
        bench: i as predicted for j.
        later: Smoothed state of j, (N,).
        later_cov: Its covariance, (N, N).
        then_cov: Filtered covariance of i, (N, N).
        mean: Deviation of i from its filtered state, as gathered so far, (N,).
        cov: Its covariance; below the diagonal it is added to, above it means nothing.
        share: Of this link in all so far.
        scale: Local scale of the plane.
    """
    solve_gain(bench)
    gain = bench.gain
    change = bench.root  # Pⱼ − P⁻; nobody needs the factor any more
    off, shift, row, moved = ten(), ten(), ten(), ten()
    set_to(off, later)
    add_times(off, -1.0, bench.mean)
    off[X] /= scale
    off[Y] /= scale
    off[H] = wrap(off[H])
    set_times(shift, off[0], gain[0])
    for c in range(1, N):
        add_times(shift, off[c], gain[c])
    for c in range(N):
        set_to(row, later_cov[c])
        add_times(row, -1.0, bench.cov[c])
        set_to(change[c], row)
    set_to(off, shift)
    add_times(off, -1.0, mean)
    for a in range(N):
        set_times(moved, gain[0, a], change[0])
        for c in range(1, N):
            add_times(moved, gain[c, a], change[c])
        set_to(row, then_cov[a])
        for c in range(N):
            add_times(row, moved[c], gain[c])
        add_times(row, -1.0, cov[a])
        add_times(cov[a], share, row)
        add_times(cov[a], share * (1.0 - share) * off[a], off)
    add_times(mean, share, off)
