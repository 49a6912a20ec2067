"""The bounded search finds the cheapest routes, and all goals that are worth it."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from whichroad.core.hops import HOP_LENGTH, HOP_PRICE, hops
from whichroad.core.network import Roads
from whichroad.core.routes import LABELS, find_routes, goal_of, new_search, set_goals

from oracles.cheapest import cheapest
from scenes import grid_town, network
from strategies import seeds

TOWN = network(grid_town(6, 6, 90.0), one_way=(3, 11, 40))
TOWN.speed[:] = np.random.default_rng(1).uniform(3.0, 30.0, len(TOWN.speed))
TOWN.hop[:] = hops(TOWN.x, TOWN.y, TOWN.first, TOWN.length, TOWN.speed)
SEARCH = new_search()  # one for all: what a search leaves behind must not matter


def found(
    roads: Roads, goals: np.ndarray, edge: int, s: float, *, per_metre: float = 0.02,
    longest: float = 1e9, limit: float = math.inf, slack: float = 1e9, u_turn: float = math.inf,
    most: int = LABELS, middle: tuple[float, float] = (0.0, 0.0), radius: float = 1e9,
    later: bool = False,
) -> dict[int, tuple[float, float]]:  # fmt: skip
    """Cost and length of the routes to goals."""
    if not later:
        set_goals(SEARCH, goals, len(goals))
    hits = find_routes(
        roads, SEARCH, goals, edge, s, *middle, radius, per_metre, u_turn, longest, limit, slack,
        most,
    )  # fmt: skip
    labels = SEARCH.hit[:hits]
    return {int(SEARCH.edge[i]): (SEARCH.cost[i], SEARCH.length[i]) for i in labels}


def places(seed: int, count: int = 5) -> tuple[int, float, np.ndarray]:
    rng = np.random.default_rng(seed)
    edge = int(rng.integers(len(TOWN.length)))
    goals = rng.choice(len(TOWN.length), count, replace=False)
    return edge, float(rng.uniform(0.0, TOWN.length[edge])), goals


@given(seeds)
def test_routes_cost_what_dijkstra_says(seed: int):
    edge, s, goals = places(seed)
    true = cheapest(TOWN, edge, s, 0.02)
    ours = found(TOWN, goals, edge, s)
    assert ours.keys() == set(goals.tolist())
    for goal, (cost, length) in ours.items():
        assert cost == pytest.approx(true[goal][0])
        assert length == pytest.approx(true[goal][1], rel=1e-6) or cost < true[goal][0] + 1e-9


@given(seeds)
def test_a_search_towards_a_place_finds_the_same_as_one_that_looks_everywhere(seed: int):
    edge, s, goals = places(seed, 1)
    v = TOWN.first[goals[0]]
    near = found(TOWN, goals, edge, s, middle=(float(TOWN.x[v]), float(TOWN.y[v])), radius=5.0)
    assert near[int(goals[0])][0] == pytest.approx(cheapest(TOWN, edge, s, 0.02)[int(goals[0])][0])


@given(seeds)
def test_goals_that_cost_more_than_is_allowed_are_not_found_and_all_others_are(seed: int):
    edge, s, goals = places(seed)
    true = {g: cheapest(TOWN, edge, s, 0.02)[g][0] for g in goals.tolist()}
    limit = sorted(true.values())[2] + 1e-6
    assert found(TOWN, goals, edge, s, limit=limit).keys() == {g for g in true if true[g] <= limit}
    slack = limit - min(true.values())
    assert found(TOWN, goals, edge, s, slack=slack).keys() == {g for g in true if true[g] <= limit}


@given(seeds)
def test_hits_come_in_order_of_cost(seed: int):
    edge, s, goals = places(seed, 12)
    costs = [cost for cost, _ in found(TOWN, goals, edge, s).values()]
    assert costs == sorted(costs)


@given(seeds)
def test_the_edges_of_a_route_follow_one_another_and_sum_to_its_length(seed: int):
    edge, s, goals = places(seed, 3)
    found(TOWN, goals, edge, s)
    for label in SEARCH.hit[: len(goals)].tolist():
        chain = [label]
        while SEARCH.parent[chain[-1]] >= 0:
            chain.append(int(SEARCH.parent[chain[-1]]))
        edges = [edge, *[int(SEARCH.edge[i]) for i in chain[::-1]]]
        for a, b in pairwise(edges):
            assert b in TOWN.succ[TOWN.succ_first[a] : TOWN.succ_first[a + 1]]
        way = TOWN.length[edge] - s + TOWN.length[edges[1:-1]].sum()
        assert SEARCH.length[label] == pytest.approx(way)


def test_turning_round_at_once_is_a_route_where_it_is_allowed():
    other = np.array([TOWN.opposite[8]])
    cost, length = found(TOWN, other, 8, 30.0, u_turn=5.0, per_metre=0.05)[int(other[0])]
    assert cost == 5.0
    assert length == pytest.approx(30.0 - TOWN.length[8])


def test_nothing_is_found_beyond_the_longest_route():
    far = np.array([int(np.argmax(TOWN.x[TOWN.first[:-1]] + TOWN.y[TOWN.first[:-1]]))])
    true = cheapest(TOWN, 0, 0.0, 0.02)[int(far[0])][1]
    assert found(TOWN, far, 0, 0.0, longest=true + 1.0)
    assert not found(TOWN, far, 0, 0.0, longest=0.5 * true)


def test_a_search_that_may_use_few_labels_gives_up():
    far = np.array([int(np.argmax(TOWN.x[TOWN.first[:-1]] + TOWN.y[TOWN.first[:-1]]))])
    assert not found(TOWN, far, 0, 0.0, most=5)


def test_edges_that_are_no_goals_are_told_from_goals():
    goals = np.array([4, 9, 512 + 4, 77])
    set_goals(SEARCH, goals, 4)
    assert [goal_of(SEARCH, goals, e) for e in (4, 9, 516, 77)] == [0, 1, 2, 3]
    assert goal_of(SEARCH, goals, 5) == -1


@given(seeds)
def test_later_searches_of_a_step_find_what_they_would_have_found_alone(seed: int):
    rng = np.random.default_rng(seed)
    v = int(rng.integers(len(TOWN.x)))
    middle = float(TOWN.x[v]), float(TOWN.y[v])
    ends = TOWN.first[1:] - 1
    goals = np.flatnonzero(np.hypot(TOWN.x[ends] - middle[0], TOWN.y[ends] - middle[1]) < 100.0)
    begins = [
        (int(e), float(rng.uniform(0.0, TOWN.length[e])))
        for e in rng.integers(len(TOWN.length), size=4)
    ]
    begins.append((begins[0][0], 0.5 * begins[0][1]))  # from the same edge
    begins += [(int(e), 1.0) for e in TOWN.succ[TOWN.succ_first[begins[0][0]] :][:2]]
    how = {"middle": middle, "radius": 120.0, "slack": float(rng.uniform(0.5, 6.0)), "u_turn": 2.0}
    alone = [found(TOWN, goals, e, s, **how) for e, s in begins]
    for k, (e, s) in enumerate(begins):
        ours = found(TOWN, goals, e, s, later=k > 0, **how)
        assert ours.keys() == alone[k].keys()
        for goal, (cost, _) in ours.items():
            assert cost == pytest.approx(alone[k][goal][0], abs=1e-5)
        for label in SEARCH.hit[: len(ours)].tolist():
            while (up := int(SEARCH.parent[label])) >= 0:
                last, on = int(SEARCH.edge[up]), int(SEARCH.edge[label])
                turns = range(TOWN.succ_first[last], TOWN.succ_first[last + 1])
                cheap = min(TOWN.succ_cost[t] for t in turns if TOWN.succ[t] == on)
                step = 0.02 * TOWN.hop[last, HOP_PRICE] + cheap
                assert SEARCH.cost[label] == pytest.approx(SEARCH.cost[up] + step, abs=1e-5)
                assert SEARCH.length[label] == pytest.approx(
                    SEARCH.length[up] + TOWN.hop[last, HOP_LENGTH], abs=1e-3
                )
                label = up
