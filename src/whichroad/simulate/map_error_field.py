"""Map error as a smooth random displacement field between map and world."""

from typing import NamedTuple

import numpy as np

from ..observations import Array
from .simulation_settings import SimulationSettings

_MODES = 24


class Field(NamedTuple):
    """A sum of Fourier modes: a smooth, homogeneous Gaussian field.

    Shapes: (modes,) wave vectors, (modes, 2) amplitudes of cosine and sine in x and y.
    """

    kx: Array  # rad/m
    ky: Array
    cosine: Array  # m
    sine: Array

    def at(self, x: Array, y: Array) -> Array:
        """Displacement at plane points (n,): (n, 2) m."""
        phase = np.outer(x, self.kx) + np.outer(y, self.ky)
        shift: Array = np.cos(phase) @ self.cosine + np.sin(phase) @ self.sine
        return shift


def draw_field(sigma: float, shortest: float, longest: float, random: np.random.Generator) -> Field:
    """Draw a field of `sigma` m rms per axis, wavelengths log-uniform between two (m)."""
    wave = 2 * np.pi / np.exp(random.uniform(np.log(shortest), np.log(longest), _MODES))
    direction = random.uniform(-np.pi, np.pi, _MODES)
    amplitude = random.normal(0.0, sigma / np.sqrt(_MODES), (2, _MODES, 2))
    return Field(wave * np.cos(direction), wave * np.sin(direction), amplitude[0], amplitude[1])


class MapErrorField(NamedTuple):
    """World minus map: an absolute error over kilometres, a relative one over blocks."""

    absolute: Field
    relative: Field

    def at(self, x: Array, y: Array) -> Array:
        """Displacement from map to world at plane points (n,): (n, 2) m."""
        return self.absolute.at(x, y) + self.relative.at(x, y)


def draw_map_error(settings: SimulationSettings, random: np.random.Generator) -> MapErrorField:
    """Draw the map error of one drive."""
    return MapErrorField(
        draw_field(settings.map_sigma, settings.map_shortest, settings.map_longest, random),
        draw_field(
            settings.relative_sigma,
            settings.relative_shortest,
            settings.relative_longest,
            random,
        ),
    )
