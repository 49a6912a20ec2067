"""A vehicle that is on no road of this map: it drives on roads like those, elsewhere.

It rivals the roads of the map by what it would have driven.  Its own road fits as the best ones
here do, and at least as usual; but that road might have turned otherwise, and this map's road
could not.  So it pays for each metre, and for turns: that much the turns driven tell.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..graph.network import Roads
from ..observations import Array

PRIOR = 0.25  # probability of a start that is on no road of the map
RETURN = 1e-7  # 1/m, rate of coming on to the map
SIGMA = 1e6  # m, of where it is

_PIECE = 5.0  # m of road that may turn
_RUNS_ON = 0.3  # rad, sigma of the turn in such a piece where a road runs on, straight or as before
_CORNERS = 0.2  # share of the pieces that turn by anything
_CORNER = 0.2  # density of these turns over the peak of the others
_GOES_ON = 0.5  # share of those who leave the map where a road of it ends


def turn_cost(turn: float, metres: float, before: float = 0.0) -> float:
    """What a vehicle elsewhere pays for a turn, nats.

    With n = metres / 5 m pieces, τ = turn / n, and τ₀ that of the piece before, the density of τ
    over that of a perfect fit:

        q = (1 − c) (½ exp(−½ (τ/σ)²) + ½ exp(−½ ((τ − τ₀)/σ)²)) + c k,    cost = −n log q

    The numbers make it fall as the evidence of all roads of a map does while these are many:
    drives in Andorra and Monaco, seeds 100 to 111.

    Args:
        turn: rad, over so many metres.
        metres: Driven.
        before: rad/m, how the road turned until then.
    """
    if metres <= 0.0:
        return 0.0
    pieces = metres / _PIECE
    straight = turn / pieces / _RUNS_ON
    steady = straight - before * _PIECE / _RUNS_ON
    runs_on = 0.5 * (math.exp(-0.5 * straight**2) + math.exp(-0.5 * steady**2))
    return -pieces * math.log((1.0 - _CORNERS) * runs_on + _CORNERS * _CORNER)


def gain_of(before: Array, gain: Array, usual: float) -> float:
    """The log-likelihood of the map's rows for a road elsewhere, less its turns.

    Args:
        before: (n,) log-weights of the hypotheses on roads.
        gain: (n,) their log-likelihoods.
        usual: That of rows which fit as a road does on average.

    Returns:
        The mean of `gain` by weight afterwards, at least `usual`.
    """
    if not len(before):
        return usual
    log_weight = before + gain
    weight = np.exp(log_weight - log_weight.max())
    return max(usual, float(weight @ gain / weight.sum()))


def behind_ends(roads: Roads) -> NDArray[np.bool_]:
    """Edges (E,) that are entered by turning round where a road ends, or the map does."""
    edges, turns = roads.edges, roads.turns
    found = np.zeros(len(edges), np.bool_)
    if len(turns):
        only = turns.edge[np.minimum(edges.first_turn, len(turns) - 1)]
        alone = edges.end_turn - edges.first_turn == 1
        found[edges.opposite[alone & (only == edges.opposite)]] = True
    return found


def leaving(edge: NDArray[Any], new: NDArray[np.bool_], behind: NDArray[np.bool_]) -> Array:
    """The share of each hypothesis (n,) that goes on beyond the end of its road.

    Args:
        edge: (n,) edges.
        new: (n,) whether the edge was entered just now.
        behind: (E,) `behind_ends`.
    """
    share = np.zeros(len(edge))
    share[new & (edge >= 0) & behind[np.maximum(edge, 0)]] = _GOES_ON
    return share
