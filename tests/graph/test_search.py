"""The bounded search finds the cheapest routes, and all goals that are worth it."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles.cheapest import cheapest
from oracles.compiled import compiled
from scenes import grid_town, network
from strategies import seeds
from whichroad._compile import Records
from whichroad.graph import route_search as search
from whichroad.graph.index import CANDIDATE
from whichroad.graph.labels import LABELS, new_search
from whichroad.graph.network import EDGE, TURN, VERTEX, Roads, records
from whichroad.graph.route_costs import MAX_FACTOR, MIN_FACTOR, cost_factor, edge_costs, turn_costs
from whichroad.graph.route_search import Query, goal_of, set_goals

find_routes = compiled(search.find_routes)

TOWN = network(grid_town(6, 6, 90.0), one_way=(3, 11, 40))
EDGES, VERTICES = TOWN.edges, TOWN.vertices
EDGES.speed = np.random.default_rng(1).uniform(3.0, 30.0, len(EDGES))
edge_costs(EDGES, VERTICES)
COSTS, LENGTHS = EDGES.cost.tolist(), EDGES.route_length.tolist()
TURN_COSTS: dict[tuple[int, int], float] = {}  # from one edge to another, the least
for _edge, (_begin, _end) in enumerate(zip(EDGES.first_turn, EDGES.end_turn, strict=True)):
    for _turn in TOWN.turns[_begin:_end]:
        _way = _edge, int(_turn.edge)
        TURN_COSTS[_way] = min(TURN_COSTS.get(_way, math.inf), float(_turn.cost))
SEARCH = new_search()  # one for all: what a search leaves behind must not matter


def seek(edges: np.ndarray) -> None:
    """Make these edges the goals of a new step."""
    goals = records(len(edges), CANDIDATE)
    goals.edge = edges
    set_goals(SEARCH, goals, len(goals))


EVERYWHERE = Query(0.0, 0.0, 1e9, 0.02, math.inf, 1e9, math.inf, 1e9, LABELS, False)


def found(
    roads: Roads, goals: np.ndarray, edge: int, s: float, *, later: bool = False, **given: float
) -> dict[int, tuple[float, float]]:
    """Cost and length of the routes to goals.

    Args:
        roads: The map.
        goals: Edges.
        edge: Where the search begins.
        s: Abscissa there, m.
        later: Whether it is a later search of the same step.
        given: Fields of the query; without any the search has no limits.
    """
    if not later:
        seek(goals)
    hits = find_routes(roads, SEARCH, EVERYWHERE._replace(**given), edge, s)
    labels = SEARCH.label[SEARCH.hit[:hits]]
    return {int(a.edge): (float(a.cost), float(a.length)) for a in labels}


def turns_of(roads: Roads, edge: int) -> Records:
    return roads.turns[roads.edges.first_turn[edge] : roads.edges.end_turn[edge]]


def places(seed: int, count: int = 5) -> tuple[int, float, np.ndarray]:
    rng = np.random.default_rng(seed)
    edge = int(rng.integers(len(EDGES)))
    goals = rng.choice(len(EDGES), count, replace=False)
    return edge, float(rng.uniform(0.0, EDGES.length[edge])), goals


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
    v = VERTICES[EDGES.first_vertex[goals[0]]]
    near = found(TOWN, goals, edge, s, x=float(v.x), y=float(v.y), radius=5.0)
    assert near[int(goals[0])][0] == pytest.approx(cheapest(TOWN, edge, s, 0.02)[int(goals[0])][0])


@given(seeds)
def test_goals_that_cost_more_than_is_allowed_are_not_found_and_all_others_are(seed: int):
    edge, s, goals = places(seed)
    costs = cheapest(TOWN, edge, s, 0.02)
    true = {g: costs[g][0] for g in goals.tolist()}
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
        while SEARCH.label.parent[chain[-1]] >= 0:
            chain.append(int(SEARCH.label.parent[chain[-1]]))
        edges = [edge, *[int(SEARCH.label.edge[i]) for i in chain[::-1]]]
        for a, b in pairwise(edges):
            assert b in turns_of(TOWN, a).edge
        way = EDGES.length[edge] - s + EDGES.length[edges[1:-1]].sum()
        assert SEARCH.label.length[label] == pytest.approx(way)


def test_turning_round_at_once_is_a_route_where_it_is_allowed():
    other = np.array([EDGES.opposite[8]])
    cost, length = found(TOWN, other, 8, 30.0, u_turn=5.0, per_metre=0.05)[int(other[0])]
    assert cost == 5.0
    assert length == pytest.approx(30.0 - EDGES.length[8])


def test_nothing_is_found_beyond_the_longest_route():
    start = VERTICES[EDGES.first_vertex]
    far = np.array([int(np.argmax(start.x + start.y))])
    true = cheapest(TOWN, 0, 0.0, 0.02)[int(far[0])][1]
    assert found(TOWN, far, 0, 0.0, longest=true + 1.0)
    assert not found(TOWN, far, 0, 0.0, longest=0.5 * true)


def test_a_search_that_may_use_few_labels_gives_up():
    start = VERTICES[EDGES.first_vertex]
    far = np.array([int(np.argmax(start.x + start.y))])
    assert not found(TOWN, far, 0, 0.0, most=5)


def test_edges_that_are_no_goals_are_told_from_goals():
    goals = np.array([4, 9, 512 + 4, 77])
    seek(goals)
    assert [goal_of(SEARCH, e) for e in (4, 9, 516, 77)] == [0, 1, 2, 3]
    assert goal_of(SEARCH, 5) == -1


@given(seeds)
def test_later_searches_of_a_step_find_what_they_would_have_found_alone(seed: int):
    rng = np.random.default_rng(seed)
    v = VERTICES[int(rng.integers(len(VERTICES)))]
    x, y = float(v.x), float(v.y)
    goals = np.flatnonzero(np.hypot(EDGES.end_x - x, EDGES.end_y - y) < 100.0)
    begins = [
        (int(e), float(rng.uniform(0.0, EDGES.length[e]))) for e in rng.integers(len(EDGES), size=4)
    ]
    begins.append((begins[0][0], 0.5 * begins[0][1]))  # from the same edge
    begins += [(int(e), 1.0) for e in TOWN.turns.edge[EDGES.first_turn[begins[0][0]] :][:2]]
    how = {"x": x, "y": y, "radius": 120.0, "slack": float(rng.uniform(0.5, 6.0)), "u_turn": 2.0}
    alone = [found(TOWN, goals, e, s, **how) for e, s in begins]
    for k, (e, s) in enumerate(begins):
        ours = found(TOWN, goals, e, s, later=k > 0, **how)
        assert ours.keys() == alone[k].keys()
        for goal, (cost, _) in ours.items():
            assert cost == pytest.approx(alone[k][goal][0], abs=1e-5)
        parent, edges = SEARCH.label.parent, SEARCH.label.edge
        cost, length = SEARCH.label.cost, SEARCH.label.length
        for label in SEARCH.hit[: len(ours)].tolist():
            while (up := int(parent[label])) >= 0:
                last = int(edges[up])
                step = 0.02 * COSTS[last] + TURN_COSTS[last, int(edges[label])]
                assert cost[label] == pytest.approx(cost[up] + step, abs=1e-5)
                assert length[label] == pytest.approx(length[up] + LENGTHS[last], abs=1e-3)
                label = up


def test_what_the_search_reads_of_an_edge_says_the_same_as_the_map():
    end = VERTICES[EDGES.last_vertex]
    np.testing.assert_allclose(EDGES.end_x, end.x, rtol=1e-6)
    np.testing.assert_allclose(EDGES.end_y, end.y, rtol=1e-6)
    np.testing.assert_allclose(EDGES.route_length, EDGES.length, rtol=1e-6)
    np.testing.assert_allclose(EDGES.time, EDGES.length / EDGES.speed, rtol=1e-6)


@given(st.lists(st.floats(0.1, 60.0), min_size=2, max_size=8))
def test_slower_roads_cost_more_within_bounds(speeds: list[float]):
    edges = records(len(speeds), EDGE)
    edges.length, edges.speed = 100.0, np.sort(np.array(speeds, np.float32))
    edge_costs(edges, records(1, VERTEX))
    assert (np.diff(edges.cost) <= 0.0).all()
    assert (edges.cost >= 100.0 * MIN_FACTOR - 1e-3).all()
    assert (edges.cost <= 100.0 * MAX_FACTOR + 1e-3).all()


def test_the_likeliest_turn_costs_nothing_and_the_others_their_odds():
    for e in range(len(EDGES)):
        turns = turns_of(TOWN, e)
        prior = turns.prior.astype(float)
        assert turns.cost.min() == 0.0
        np.testing.assert_allclose(
            np.exp(-turns.cost.astype(float)), prior / prior.max(), rtol=1e-5
        )


def test_edges_that_lead_nowhere_have_no_turns():
    edges, turns = records(4, EDGE), records(2, TURN)
    edges.first_turn, edges.end_turn = [0, 0, 2, 2], [0, 2, 2, 2]
    turns.prior = 0.8, 0.2
    turn_costs(edges, turns)
    assert turns.cost.tolist() == pytest.approx([0.0, np.log(4.0)])


def test_a_road_of_a_speed_costs_as_its_edge_says():
    factors = [cost_factor(float(speed)) for speed in EDGES.speed]
    np.testing.assert_allclose(EDGES.cost / EDGES.length, factors, rtol=1e-6)
    assert min(factors) == MIN_FACTOR < 1.0 < max(factors)
