"""P of the way is P of a chain of edges: enumerated, and at crossings by hand."""

from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given

from scenes import On, belief_on, context, grid_town, network
from strategies import seeds
from whichroad._compile import Record
from whichroad.filter.state import OFF_ROAD
from whichroad.filter.summary.estimate import AMBIGUOUS, STOPPED, new_output, summarise
from whichroad.graph.network import Roads

CROSSING = network(
    [
        [[0.0, 0.0], [100.0, 0.0]],
        [[100.0, 0.0], [200.0, 0.0]],
        [[100.0, 0.0], [100.0, 100.0]],
        [[100.0, 0.0], [100.0, -100.0]],
    ]
)
TO, ON, BACK, ASIDE = 0, 2, 1, 4  # edges: towards the node, straight on, back from it, to a side
TOWN = network(grid_town(4, 4))
KNOWN = 1.0 - 7e-4  # P of what the hypotheses know


def estimate(roads: Roads, places: list[On]) -> Record:
    output = new_output(1, False)
    summarise(belief_on(roads, places), context(roads), output, 0, 0.0)
    return output.rows[0]


def test_passing_a_node_is_no_doubt_about_the_way():
    said = estimate(CROSSING, [On(TO, 99.0, 0.45), On(ON, 2.0, 0.55)])
    assert said.p_edge == pytest.approx(0.55 * KNOWN)
    assert said.p_way == pytest.approx(KNOWN)
    assert said.status != AMBIGUOUS


@pytest.mark.parametrize(("s", "p"), [(4.0, 1.0), (20.0, 0.8)])
def test_a_branch_counts_while_it_is_at_the_node_and_competes_behind_it(s: float, p: float):
    said = estimate(CROSSING, [On(TO, 99.0, 0.3), On(ON, 2.0, 0.5), On(ASIDE, s, 0.2)])
    assert said.p_way == pytest.approx(p * KNOWN)
    assert (said.status == AMBIGUOUS) == (p < 0.95)


def test_the_other_direction_is_another_way():
    said = estimate(CROSSING, [On(TO, 99.0, 0.5), On(BACK, 1.0, 0.5)])
    assert said.p_way == pytest.approx(0.5 * KNOWN)
    said = estimate(CROSSING, [On(TO, 50.0, 0.5), On(BACK, 50.0, 0.5)])
    assert said.p_way == pytest.approx(0.5 * KNOWN)


@pytest.mark.parametrize(
    ("standing", "one", "other", "status"),
    [(0.5, TO, BACK, AMBIGUOUS), (2.0, TO, BACK, STOPPED), (2.0, ON, ASIDE, AMBIGUOUS)],
)
def test_a_standing_vehicle_that_may_face_either_way_is_on_one_street(
    standing: float, one: int, other: int, status: int
):
    belief, output = (
        belief_on(CROSSING, [On(one, 50.0, 0.5), On(other, 50.0, 0.5)]),
        new_output(1, False),
    )
    belief.state[0].standing = standing
    summarise(belief, context(CROSSING), output, 0, 0.0)
    assert output.rows[0].status == status
    assert output.rows[0].p_way == pytest.approx(0.5 * KNOWN)


def test_off_road_is_on_no_way():
    said = estimate(CROSSING, [On(TO, 99.0, 0.2), On(ON, 2.0, 0.35), On(OFF_ROAD, 99.0, 0.45)])
    assert said.p_way == pytest.approx(0.55 * KNOWN)
    assert said.p_way + said.p_off_road == pytest.approx(1.0)
    said = estimate(CROSSING, [On(TO, 99.0, 0.2), On(ON, 2.0, 0.2), On(OFF_ROAD, 99.0, 0.6)])
    assert said.edge == OFF_ROAD
    assert said.p_way == said.p_edge == 0.0  # no road is named


def chained(roads: Roads, edges: tuple[int, ...]) -> bool:
    """Whether each edge follows the one before, and not by a U-turn."""
    e = roads.edges
    return all(e.to_node[a] == e.from_node[b] and b != a ^ 1 for a, b in pairwise(edges))


@given(seeds)
def test_it_is_the_largest_sum_over_all_chains_of_edges(seed: int):
    """In the middle of their edges, far from every node, no hypothesis is undecided."""
    random = np.random.default_rng(seed)
    streets = random.choice(len(TOWN.edges) // 2, 5, replace=False)
    edges = (2 * streets + random.integers(0, 2, 5)).tolist()
    shares = dict(zip(edges, random.dirichlet(np.ones(5)).tolist(), strict=True))
    middles = [On(e, 0.5 * float(TOWN.edges.length[e]), p) for e, p in shares.items()]
    said = estimate(TOWN, middles)
    largest = max(
        sum(shares[e] for e in chain)
        for n in range(1, 6)
        for chain in permutations(edges, n)
        if chained(TOWN, chain)
    )
    assert said.p_way == pytest.approx(largest * KNOWN, abs=5e-4)  # edges of P < 1e-4 are left out
    assert said.p_edge - 1e-12 <= said.p_way <= 1.0 - said.p_off_road + 1e-12
