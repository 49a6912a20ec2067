"""A vehicle that is on no road of this map: it drives on roads like those, elsewhere.

It rivals the roads of the map by what it would have driven.  Its own road fits as the right one
does, and as the best ones here do; but that road might have turned otherwise, and this map's road
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
_STRAIGHT, _OF_STRAIGHT = 0.18, 0.36  # rad, sigma of the turn in a straight piece; their share
_BENT, _OF_BENT = 0.2, 0.53  # rad, mean change of the turn from piece to piece; share of bends
_CORNER = 0.015  # pieces that turn by anything, times the density of these turns over a peak
_FITS = 0.175  # nats/m that a right road gains on one that fits as usual, where it is straight
_TURNED = 1.0  # rad of recent turns, with which it gains nothing: lines say little of corners
_GOES_ON = 0.5  # share of those who leave the map where a road of it ends


def turn_cost(turn: float, metres: float, before: float = 0.0) -> float:
    """What a vehicle elsewhere pays for a turn, nats.

    With n = metres / 5 m pieces, τ = turn / n, and τ₀ that of the piece before, the density of τ
    over that of a perfect fit:

        q = a exp(−½ (τ/σ)²) + b exp(−|τ − τ₀| / β) + c,    cost = −n log q

    The numbers make the probability of being elsewhere the best forecast of it: drives in Andorra
    and Monaco, seeds 24100 to 24149.

    Args:
        turn: rad, over so many metres.
        metres: Driven.
        before: rad/m, how the road turned until then.
    """
    if metres <= 0.0:
        return 0.0
    pieces = metres / _PIECE
    each = turn / pieces
    straight = _OF_STRAIGHT * math.exp(-0.5 * (each / _STRAIGHT) ** 2)
    steady = _OF_BENT * math.exp(-abs(each - before * _PIECE) / _BENT)
    return -pieces * math.log(straight + steady + _CORNER)


def gain_of(before: Array, gain: Array, usual: float, metres: float, swing: float) -> float:
    """The log-likelihood of the map's rows for a road elsewhere, less its turns.

    It fits as right roads do, and they fit better than usual, in bends as well.  What fits by
    chance among the roads of a map does not.

    Args:
        before: (n,) log-weights of the hypotheses on roads.
        gain: (n,) their log-likelihoods.
        usual: That of rows which fit as a road does on average.
        metres: Driven.
        swing: Sum of the recent turns, rad.

    Returns:
        The mean of `gain` by weight afterwards, at least that of a right road.
    """
    least = usual + _FITS * metres * max(1.0 - swing / _TURNED, 0.0)
    if not len(before):
        return least
    log_weight = before + gain
    weight = np.exp(log_weight - log_weight.max())
    return max(least, float(weight @ gain / weight.sum()))


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
