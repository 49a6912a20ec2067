"""Beliefs made by hand."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad.core.belief import (
    CAPACITY,
    MX,
    MY,
    NO_EDGE,
    NOW,
    OFF_ROAD,
    STARTED,
    Belief,
    D,
    H,
    K,
    N,
    X,
    Y,
    new_belief,
)
from whichroad.core.grid import vertex_at
from whichroad.core.network import Roads
from whichroad.core.segment import locate

SIGMAS = np.array([3.0, 3.0, 0.05, 0.01, 3e-4, 1.8, 0.0, 0.0, 1.0, 1.0])


class On(NamedTuple):
    """A hypothesis to be: at abscissa s of an edge, `right` metres right of its line."""

    edge: int
    s: float = 0.0
    p: float = 1.0
    right: float = 0.0
    sigma: float = 3.0  # m, of the position on each axis


def roomy_belief(spare: int = 100) -> Belief:
    """An empty belief with spare rows, which no kernel may touch."""
    rows = new_belief()
    belief = Belief(*(np.concatenate([a, a[:spare]]) if len(a) == CAPACITY else a for a in rows))
    return belief._replace(scratch=np.zeros((len(belief.scratch), CAPACITY + spare)))


def untouched(belief: Belief) -> bool:
    """Whether the spare rows are as they were."""
    spare = [a[CAPACITY:] for a in (belief.mean, belief.cov, belief.log_weight)]
    return not any(a.any() for a in spare) and bool((belief.edge[CAPACITY:] == NO_EDGE).all())


def belief_on(roads: Roads, places: Sequence[On]) -> Belief:
    """A belief of hypotheses that drive along their edges; the map has no offset.

    Off the roads, s and right are plane coordinates x and −y.
    """
    belief = roomy_belief()
    for i, place in enumerate(places):
        mean, sigmas = np.zeros(N), SIGMAS.copy()
        sigmas[[X, Y]] = place.sigma
        mean[[X, Y, K]] = place.s, -place.right, 1.0
        if place.edge != OFF_ROAD:
            v = vertex_at(roads, place.edge, place.s)
            _, x, y, tx, ty = locate(roads, place.edge, v, place.s)
            mean[[X, Y]] = x + place.right * ty, y - place.right * tx
            mean[H] = np.arctan2(ty, tx)
            mean[D] = roads.lane[place.edge]
            belief.segment[i] = v
        belief.mean[i], belief.cov[i] = mean, np.diag(sigmas**2)
        belief.edge[i], belief.probability[i] = place.edge, place.p
        belief.log_weight[i] = np.log(place.p)
        belief.abscissa[i], belief.spread[i] = place.s, place.sigma
    belief.size[0] = len(places)
    belief.clock[[NOW, STARTED]] = 0.0, 1.0
    return belief


def weights(belief: Belief) -> NDArray[np.float64]:
    """Weights of the hypotheses, not normalised, (n,)."""
    return np.exp(belief.log_weight[: belief.size[0]])


def edge_weights(belief: Belief) -> dict[int, float]:
    """Weight of each edge, its components added up."""
    total: dict[int, float] = {}
    for edge, w in zip(belief.edge[: belief.size[0]].tolist(), weights(belief), strict=True):
        total[edge] = total.get(edge, 0.0) + float(w)
    return total


def doubt_map(belief: Belief, sigma: float) -> None:
    """Give every hypothesis a map offset of that spread, independent of the rest."""
    n = belief.size[0]
    belief.cov[:n, MX, MX] = belief.cov[:n, MY, MY] = sigma**2
