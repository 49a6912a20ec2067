"""What a route search needs to know of each edge and turn, side by side: the map holds it."""

import numpy as np

from ._jit import Floats32, Ints32, Vector

HOP_X, HOP_Y, HOP_LENGTH, HOP_PRICE, HOP_TIME = range(5)  # of an edge's end, m, plane; m; m; s
USUAL = 12.0  # m/s
CHEAPEST, DEAREST = 0.75, 2.0
_BY_TIME = 0.6  # of the price of a way is its time, the rest its length
_LEAST = 1e-12  # probability of a turn


def hops(x: Vector, y: Vector, first: Ints32, length: Vector, speed: Floats32) -> Floats32:
    """Where each edge ends, and what it takes to drive it.

    The price is in metres of a street of usual speed: drivers save time.

    Args:
        x: (V,) of the vertices, m, plane.
        y: (V,) m.
        first: (E+1,) first vertex of each edge.
        length: (E,) m.
        speed: (E,) usual speed, m/s.

    Returns:
        (E, 5), columns as named above.
    """
    end = first[1:] - 1
    pace = np.maximum(speed.astype(np.float64), 1.0)
    dear = np.clip(1.0 + _BY_TIME * (USUAL / pace - 1.0), CHEAPEST, DEAREST)
    columns = x[end], y[end], length, length * dear, length / pace
    return np.column_stack(columns).astype(np.float32)


def turn_costs(succ_first: Ints32, succ_prior: Floats32) -> Floats32:
    """-log(prior / the largest prior there) of each turn, nats, (S,)."""
    prior = np.maximum(succ_prior.astype(np.float64), _LEAST)
    count = np.diff(succ_first)
    best = np.maximum.reduceat(np.append(prior, _LEAST), succ_first[:-1])
    return np.log(np.repeat(best, count) / prior).astype(np.float32)
