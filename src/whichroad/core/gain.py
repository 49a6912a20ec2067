"""Rauch, Tung and Striebel's gain, for one link of the graph of hypotheses."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Matrix, Vector, kernel
from .belief import N


class Bench(NamedTuple):
    """What one link is worked out on."""

    f: Matrix  # (N, N) F
    mean: Vector  # (N,) x⁻
    cov: Matrix  # (N, N) P⁻
    cross: Matrix  # (N, N) Pᵢ Fᵀ
    root: Matrix  # (N, N) Cholesky factor of P⁻, scaled
    gain: Matrix  # (N, N)


def new_bench() -> Bench:
    """Scratch space for one thread."""
    f, cov, cross, root, gain = np.zeros((5, N, N))
    return Bench(f, np.zeros(N), cov, cross, root, gain)


@kernel
def spread_forward(bench: Bench, q: Vector, cov: Matrix) -> None:
    """P Fᵀ and F P Fᵀ + Q; the part of Q off the diagonal is in `cov` already."""
    f = bench.f
    for a in range(N):
        for b in range(N):
            total = 0.0
            for c in range(N):
                if f[b, c] != 0.0:
                    total += cov[a, c] * f[b, c]
            bench.cross[a, b] = total
    for a in range(N):
        for b in range(a, N):
            total = bench.cov[a, b]
            for c in range(N):
                if f[a, c] != 0.0:
                    total += f[a, c] * bench.cross[c, b]
            if a == b:
                total += q[a]
            bench.cov[a, b] = total
    for a in range(N):
        for b in range(a):
            bench.cov[a, b] = bench.cov[b, a]


@kernel
def solve_gain(bench: Bench) -> None:
    """G = Pᵢ Fᵀ (P⁻)⁻¹, by a Cholesky factor that leaves out what has no variance."""
    cov = bench.cov
    root = bench.root
    for a in range(N):
        for b in range(a + 1):
            norm = math.sqrt(max(cov[a, a], 0.0) * max(cov[b, b], 0.0))
            total = cov[a, b] / norm if norm > 1e-18 else 0.0
            for c in range(b):
                total -= root[a, c] * root[b, c]
            if a == b:
                root[a, a] = math.sqrt(total) if total > 1e-9 else 0.0
            else:
                root[a, b] = total / root[b, b] if root[b, b] > 0.0 else 0.0
    for r in range(N):
        row = bench.gain[r]
        for a in range(N):
            total = bench.cross[r, a] / math.sqrt(cov[a, a]) if cov[a, a] > 1e-18 else 0.0
            for c in range(a):
                total -= root[a, c] * row[c]
            row[a] = total / root[a, a] if root[a, a] > 0.0 else 0.0
        for a in range(N - 1, -1, -1):
            total = row[a]
            for c in range(a + 1, N):
                total -= root[c, a] * row[c]
            row[a] = total / root[a, a] if root[a, a] > 0.0 else 0.0
        for a in range(N):
            row[a] = row[a] / math.sqrt(cov[a, a]) if cov[a, a] > 1e-18 else 0.0
