"""Beliefs made by hand."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad._compile import Records
from whichroad.filter.state import (
    CAPACITY,
    MX,
    MY,
    NO_EDGE,
    OFF_ROAD,
    Belief,
    D,
    H,
    K,
    N,
    X,
    Y,
    new_belief,
)
from whichroad.graph.geometry import locate
from whichroad.graph.index import vertex_at
from whichroad.graph.network import Roads

SIGMAS = np.array([3.0, 3.0, 0.05, 0.01, 3e-4, 1.8, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0])


class On(NamedTuple):
    """A hypothesis to be: at abscissa s of an edge, `right` metres right of its line."""

    edge: int
    s: float = 0.0
    p: float = 1.0
    right: float = 0.0
    sigma: float = 3.0  # m, of the position on each axis


def roomy_belief(spare: int = 100) -> Belief:
    """An empty belief with spare rows, which no kernel may touch."""
    return new_belief(capacity=CAPACITY + spare)


def untouched(belief: Belief) -> bool:
    """Whether the spare rows are as they were."""
    spare = belief.hyp[CAPACITY:]
    written = any(spare[name].any() for name in ("mu", "cov", "log_weight"))
    return not written and bool((spare["edge"] == NO_EDGE).all())


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
            mean[D] = roads.edges.lane[place.edge]
            belief.hyp.segment[i] = v
        hyp = belief.hyp[i]
        hyp["mu"], hyp["cov"] = mean, np.diag(sigmas**2)
        hyp.edge, hyp.weight, hyp.log_weight = place.edge, place.p, np.log(place.p)
        hyp.along, hyp.along_sigma = place.s, place.sigma
    state = belief.state[0]
    state.count, state.started, state.scale = len(places), 1, 1.0
    return belief


def living(belief: Belief) -> Records:
    """The hypotheses, (n,)."""
    return belief.hyp[: belief.state[0].count]


def weights(belief: Belief) -> NDArray[np.float64]:
    """Weights of the hypotheses, not normalised, (n,)."""
    return np.exp(living(belief).log_weight)


def edge_weights(belief: Belief) -> dict[int, float]:
    """Weight of each edge, its components added up."""
    total: dict[int, float] = {}
    for edge, w in zip(living(belief).edge.tolist(), weights(belief), strict=True):
        total[edge] = total.get(edge, 0.0) + float(w)
    return total


def doubt_map(belief: Belief, sigma: float) -> None:
    """Give every hypothesis a map offset of that spread, independent of the rest."""
    cov = living(belief)["cov"]
    cov[:, MX, MX] = cov[:, MY, MY] = sigma**2
