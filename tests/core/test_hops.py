"""What the search reads of edges and turns says the same as the map."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from whichroad.core.hops import (
    CHEAPEST,
    DEAREST,
    HOP_LENGTH,
    HOP_PRICE,
    HOP_TIME,
    HOP_X,
    HOP_Y,
    hops,
    turn_costs,
)

from scenes import grid_town, network

TOWN = network(grid_town(4, 4, 90.0), one_way=(2, 7))


def test_a_hop_ends_where_its_edge_does():
    end = TOWN.first[1:] - 1
    np.testing.assert_allclose(TOWN.hop[:, HOP_X], TOWN.x[end], rtol=1e-6)
    np.testing.assert_allclose(TOWN.hop[:, HOP_Y], TOWN.y[end], rtol=1e-6)
    np.testing.assert_allclose(TOWN.hop[:, HOP_LENGTH], TOWN.length, rtol=1e-6)
    np.testing.assert_allclose(TOWN.hop[:, HOP_TIME], TOWN.length / TOWN.speed, rtol=1e-6)


@given(st.lists(st.floats(0.1, 60.0), min_size=2, max_size=8))
def test_slower_roads_are_dearer_within_bounds(speeds: list[float]):
    speed = np.sort(np.array(speeds, np.float32))
    n = len(speed)
    first = 2 * np.arange(n + 1, dtype=np.int32)
    x = np.tile([0.0, 100.0], n)
    price = hops(x, np.zeros(2 * n), first, np.full(n, 100.0), speed)[:, HOP_PRICE]
    assert (np.diff(price) <= 0.0).all()
    assert (price >= 100.0 * CHEAPEST - 1e-3).all()
    assert (price <= 100.0 * DEAREST + 1e-3).all()


def test_the_likeliest_turn_costs_nothing_and_the_others_their_odds():
    for e in range(len(TOWN.length)):
        turns = slice(TOWN.succ_first[e], TOWN.succ_first[e + 1])
        prior, cost = TOWN.succ_prior[turns].astype(float), TOWN.succ_cost[turns]
        assert cost.min() == 0.0
        np.testing.assert_allclose(np.exp(-cost.astype(float)), prior / prior.max(), rtol=1e-5)


def test_edges_that_lead_nowhere_have_no_turns():
    costs = turn_costs(np.array([0, 0, 2, 2, 2], np.int32), np.array([0.8, 0.2], np.float32))
    assert costs.tolist() == pytest.approx([0.0, np.log(4.0)])
