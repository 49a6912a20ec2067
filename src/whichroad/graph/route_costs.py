"""What routes cost.

A route costs `per_metre` nats for each metre of a street of usual speed, more on slow roads,
and for each turn -log(prior / the largest prior there).
"""

import numpy as np

from .._compile import Records, kernel

MIN_FACTOR, MAX_FACTOR = 0.75, 2.0  # cost of a metre on the fastest and the slowest roads

_USUAL_SPEED = 12.0  # m/s, of a street on which a metre costs a metre
_TIME_SHARE = 0.6  # share of the time in the cost of an edge; the rest is its length
_LEAST_PRIOR = 1e-12  # probability of a turn


def edge_costs(edges: Records, vertices: Records) -> None:
    """Fill where each edge ends, and what it takes to drive it.

    The cost is in metres of a street of usual speed: drivers save time.

    Args:
        edges: (E,) EDGE with length, speed and last vertex; `end_x`, `end_y`,
            `route_length`, `cost` and `time` are set.
        vertices: (V,) VERTEX.
    """
    end, length = edges["last_vertex"], edges["length"]
    speed = np.maximum(edges["speed"].astype(np.float64), 1.0)
    factor = np.clip(1.0 + _TIME_SHARE * (_USUAL_SPEED / speed - 1.0), MIN_FACTOR, MAX_FACTOR)
    edges["end_x"] = vertices["x"][end]
    edges["end_y"] = vertices["y"][end]
    edges["route_length"] = length
    edges["cost"] = length * factor
    edges["time"] = length / speed


@kernel
def cost_factor(speed: float) -> float:
    """Cost of roads of a usual speed (m/s) over their length, as `edge_costs` fills it."""
    factor = 1.0 + _TIME_SHARE * (_USUAL_SPEED / max(speed, 1.0) - 1.0)
    return min(max(factor, MIN_FACTOR), MAX_FACTOR)


def turn_costs(edges: Records, turns: Records) -> None:
    """Fill the costs of turns: -log(prior / the largest prior there), nats.

    Args:
        edges: (E,) EDGE with `first_turn` and `end_turn`.
        turns: (S,) TURN with `prior`, in the order of edges; `cost` is set.
    """
    prior = np.maximum(turns["prior"].astype(np.float64), _LEAST_PRIOR)
    first = edges["first_turn"]
    best = np.maximum.reduceat(np.append(prior, _LEAST_PRIOR), first)
    turns["cost"] = np.log(np.repeat(best, edges["end_turn"] - first) / prior)
