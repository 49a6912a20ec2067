"""Places that scatter from fix to fix as no vehicle moves, as where a vendor hides them by noise.

Fourth differences of places at equal intervals tell the noise of each: a vehicle goes on smoothly
over 15 s.  Second differences of noise alternate in sign.
"""

from typing import NamedTuple

import numpy as np

from ..observations import ASSUMED, SCATTERED, Array, Fixes
from .checks import Bools, Ints
from .interpolated_places import FEWEST, metres

_LONGEST = 15.0  # s between rows, beyond which vehicles move as noise does
_EQUAL = 1.2  # largest of four intervals over the smallest
_LEAST, _DRIVEN = 20.0, 0.3  # m, and m/s² with the square of the interval: sigma of scatter
_MOST = 1000.0  # m, beyond which rows are of several vehicles
_TURNS = (-0.8, -0.3)  # mean cosine from one second difference to the next: of two places in turn
_FOURTH = 1.1774 * 70.0**0.5  # median of fourth differences over sigma, in two dimensions
_MAY, _SHARE = 50.0, 0.3  # m, of second differences, and share of the rows that has them
_SPARSE = 3.0  # s between rows, from which on a sigma of that size makes answers better
_DENSE = 40.0  # m: scatter of denser rows, which average out


class Scatter(NamedTuple):
    """Noise of places, (n,) each."""

    sigma: Array  # m, of an axis; 0: of drives that move as vehicles do
    sparse: Bools  # rows are so far apart that it may be taken for the error of each


def scatter(time: Array, lat: Array, lon: Array, first: Ints) -> Scatter | None:
    """By how much the places of each drive scatter; None: those of no drive do.

    Args:
        time: (n,) s, drive after drive.
        lat: (n,) degrees.
        lon: (n,) degrees.
        first: (d,) where each drive begins.
    """
    n = len(time)
    if n < FEWEST:
        return None
    row = np.arange(1, n)
    east, north = metres(lat, lon, row - 1, row)
    may = np.zeros(n, np.bool_)
    with np.errstate(invalid="ignore", over="ignore"):
        may[1:-1] = np.diff(east) ** 2 + np.diff(north) ** 2 > _MAY**2
    size = np.diff(first, append=n)
    suspects = np.add.reduceat(may, first, dtype=np.int64) > _SHARE * size
    found: Scatter | None = None
    for drive in np.flatnonzero(suspects & (size >= FEWEST)).tolist():
        low, high = first[drive], first[drive] + size[drive]
        steps = slice(low, high - 1)
        lasted = np.diff(time[low:high])
        if sigma := _sigma(lasted, east[steps], north[steps]):
            found = found or Scatter(np.zeros(n), np.zeros(n, np.bool_))
            found.sigma[low:high] = sigma
            found.sparse[low:high] = _median(lasted) >= _SPARSE
    return found


def _sigma(lasted: Array, east: Array, north: Array) -> float:
    """By how much the places of one drive scatter, m, from its steps, (n - 1,); 0: as they may."""
    interval = _median(lasted)
    if not 0.0 < interval <= _LONGEST:
        return 0.0
    longest = np.maximum(lasted[1:], lasted[:-1])
    shortest = np.minimum(lasted[1:], lasted[:-1])
    even = np.maximum(longest[2:], longest[:-2]) < _EQUAL * np.minimum(shortest[2:], shortest[:-2])
    if np.count_nonzero(even) < max(FEWEST - 4, len(even) // 2):
        return 0.0
    second = (east[1:] - east[:-1]) + 1j * (north[1:] - north[:-1])
    fourth = np.abs(second[2:] - 2.0 * second[1:-1] + second[:-2])[even]
    sigma = _median(fourth) / _FOURTH
    least = _DENSE if interval < _SPARSE else _LEAST
    if not max(least, _DRIVEN * interval**2) < sigma < _MOST:
        return 0.0
    turn = np.angle(second[1:] * second[:-1].conj())[:-1][even]
    return sigma if _TURNS[0] < float(np.cos(turn).mean()) < _TURNS[1] else 0.0


def _median(values: Array) -> float:
    """The median, NaN where one is, in less time than `np.median` takes for some hundred."""
    ordered = np.sort(values)  # NaN is last
    half = len(values) // 2
    middle = ordered[half] if len(values) % 2 else 0.5 * (ordered[half - 1] + ordered[half])
    return float(ordered[-1] if np.isnan(ordered[-1]) else middle)


def scatter_notes(fixes: Fixes, first: int = 0, end: int | None = None) -> list[str]:
    """What is to be said of the fixes of one drive, from `first` on, that scatter."""
    flags = fixes.flags[first:end]
    if not (flags & SCATTERED).any():
        return []
    part = slice(first, end)
    only = np.zeros(1, np.int64)
    noise = scatter(fixes.time[part], fixes.lat_deg[part], fixes.lon_deg[part], only)
    size = "widely" if noise is None else f"by {noise.sigma[0]:.0f} m (1 sigma)"
    what = f"places scatter {size} from row to row, as no vehicle moves"
    if not (flags & ASSUMED).any():
        told = float(np.median(np.sqrt(fixes.cov_nn[part])))
        return [
            f"{what}, and errors of {told:.0f} m are told; tell errors of that size, or give the "
            "places without that noise"
        ]
    if noise is not None and not noise.sparse[0]:
        return [
            f"{what}, and no errors are told; give the places without that noise, or one row in "
            "10 s and that size as sigma_m"
        ]
    return [
        f"{what}; no errors are told, so that size is taken: give it as sigma_m, or the places "
        "without that noise"
    ]
