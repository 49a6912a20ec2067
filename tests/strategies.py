"""Random examples for the laws: angles, Gaussians over the state, bent roads."""

import math
from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from whichroad.filter.state import N

Array = NDArray[np.float64]

# what one unit of each state is worth: metres, radians, scale, rad/m, metres, sigmas
UNITS = np.array([5.0, 5.0, 0.2, 0.02, 1e-3, 2.0, 4.0, 4.0, 1.0, 1.0, 1.0, 1.0])

angles = st.floats(-50.0, 50.0)
# not `integers`: it also draws the constants of whatever modules are loaded, and so depends on
# which tests run beside
seeds = st.sampled_from(range(2**16))


class Gaussian(NamedTuple):
    """A Gaussian over the state."""

    mean: Array  # (N,)
    cov: Array  # (N, N)

    def copy(self) -> "Gaussian":
        """One that can be changed by itself."""
        return Gaussian(self.mean.copy(), self.cov.copy())


def random_gaussian(rng: np.random.Generator) -> Gaussian:
    """A correlated Gaussian with spreads as the filter meets them."""
    root = rng.normal(size=(N, N)) * UNITS[:, None]
    mean = rng.normal(size=N) * UNITS
    mean[2] = rng.uniform(-math.pi, math.pi)
    mean[3] = 1.0 + 0.02 * rng.normal()
    return Gaussian(mean, root @ root.T / N + np.diag(1e-4 * UNITS**2))


gaussians = seeds.map(lambda seed: random_gaussian(np.random.default_rng(seed)))


@st.composite
def bent_lines(draw: st.DrawFn) -> Array:
    """Polylines (n, 2) of a road: segments of 5 to 80 m that turn by less than 75 degrees."""
    return bent_line(draw(seeds), draw(st.integers(1, 8)))


def bent_line(seed: int, n: int) -> Array:
    """One of them, of n segments."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-math.pi, math.pi) + np.cumsum(rng.uniform(-1.3, 1.3, n))
    length = rng.uniform(5.0, 80.0, n)
    step = np.column_stack([length * np.cos(heading), length * np.sin(heading)])
    return np.vstack([[0.0, 0.0], np.cumsum(step, axis=0)]) + rng.uniform(-500, 500, 2)
