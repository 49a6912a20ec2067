"""Rauch, Tung and Striebel's gain, for one link of the graph of hypotheses."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Matrix, Vector, part
from .belief import N
from .rows import add_times, scale_by, set_times, ten


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
    unit = ten()
    for a in range(N):
        variance = bench.cov[a, a]
        unit[a] = 1.0 / math.sqrt(variance) if variance > 1e-18 else 0.0
    for a in range(N):
        set_times(gain[a], unit[a], bench.cross[a])
        set_times(root[a], unit[a], bench.cov[a])
        scale_by(root[a], 1.0, unit)
    for a in range(N):  # what an equation says is taken out of those that follow
        pivot = root[a, a]
        pivot = 1.0 / math.sqrt(pivot) if pivot > 1e-9 else 0.0
        set_times(root[a], pivot, root[a])
        set_times(gain[a], pivot, gain[a])
        root[a, a] = pivot
        for b in range(a + 1, N):
            add_times(root[b], -root[a, b], root[a])
            add_times(gain[b], -root[a, b], gain[a])
    for a in range(N - 1, -1, -1):
        set_times(gain[a], root[a, a], gain[a])
        for b in range(a):
            add_times(gain[b], -root[b, a], gain[a])
        set_times(gain[a], unit[a], gain[a])
