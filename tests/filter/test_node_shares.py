"""P(edge) about a node: what of a Gaussian is before its edge is where it came from."""

from statistics import NormalDist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes import On, belief_on, context, living, network
from whichroad.filter.hypotheses.branching import branch
from whichroad.filter.hypotheses.successors import REACH
from whichroad.filter.state import CLOCK, NO_EDGE, WHEELS, Belief, new_path
from whichroad.filter.summary.estimate import new_output, summarise
from whichroad.filter.summary.node_shares import AFTER

# eastwards into a crossing: ahead (edge 2), left (4), right (6), each with its way back
CROSS = network(
    [
        [[0.0, 0.0], [300.0, 0.0]],
        [[300.0, 0.0], [600.0, 0.0]],
        [[300.0, 0.0], [300.0, 300.0]],
        [[300.0, 0.0], [300.0, -300.0]],
    ]
)


def p_of_edges(belief: Belief) -> dict[int, float]:
    """P of the edges that an estimate names."""
    output = new_output(1, False)
    summarise(belief, context(CROSS), output, 0, 0.0)
    row = output.rows[0]
    return {int(e): float(p) for e, p in zip(row.alt_edge, row.alt_p, strict=True) if e >= 0}


def share(distance: float) -> float:
    """The part of a Gaussian beyond a node that is given to that side, as far as it reaches."""
    return NormalDist().cdf(distance) if distance > -REACH else 0.0


def beyond(edge: int, s: float, sigma: float) -> Belief:
    """A vehicle without wheels that came over the crossing from edge 0, about s of an edge."""
    belief = belief_on(CROSS, [On(edge, s, 1.0, sigma=sigma)])
    belief.state[0].mode = CLOCK
    belief.hyp.before[0] = 0
    return belief


@given(st.sampled_from([2, 4, 6]), st.floats(-8.0, 8.0), st.floats(1.0, 6.0))
def test_the_part_before_the_node_is_on_the_edge_before(edge, s, sigma):
    belief = beyond(edge, s, sigma)
    p = p_of_edges(belief)
    known = 1.0 - float(context(CROSS).par[0].unknown)
    assert p.get(0, 0.0) == pytest.approx(known * share(-s / sigma), abs=2e-4)
    assert p.get(edge, 0.0) == pytest.approx(known * (1.0 - share(-s / sigma)), abs=2e-4)
    assert living(belief).weight.tolist() == [1.0]  # the belief is as it was


def test_the_part_before_the_node_has_its_place_near_the_end_of_a_hairpin():
    hairpin = network([[[0, 0], [100, 0], [100, 10], [0, 10]], [[0, 10], [-100, 10]]])
    belief = belief_on(hairpin, [On(2, -3.0, 1.0, sigma=3.0)])
    belief.state[0].mode = CLOCK
    belief.hyp.before[0] = 0
    output = new_output(1, True)
    summarise(belief, context(hairpin), output, 0, 0.0)
    row = output.rows[0]
    assert row.edge == row.alt_edge[0] == 0
    assert [row.s, output.alt_pose[0, 0, 6]] == pytest.approx([207.0, 207.0], abs=0.01)


def test_who_came_from_nowhere_is_on_its_edge():
    belief = beyond(2, -3.0, 3.0)
    belief.hyp.before[0] = NO_EDGE
    assert set(p_of_edges(belief)) == {2}


def test_who_turned_round_is_on_its_edge():
    belief = beyond(2, -3.0, 3.0)
    belief.hyp.before[0] = CROSS.edges.opposite[2]
    assert set(p_of_edges(belief)) == {2}


@given(st.floats(290.0, 308.0), st.floats(1.0, 6.0))
def test_with_wheels_both_sides_are_shared_out_in_hindsight_only(s, sigma):
    belief = belief_on(CROSS, [On(0, s, 1.0, sigma=sigma)])
    belief.state[0].mode = WHEELS
    belief.hyp.scratch[0, AFTER] = 4
    assert set(p_of_edges(belief)) == {0}
    belief.state[0].hindsight = 1
    p = p_of_edges(belief)
    known = 1.0 - float(context(CROSS).par[0].unknown)
    assert p.get(4, 0.0) == pytest.approx(known * share((s - 300.0) / sigma), abs=2e-4)
    assert sum(p.values()) == pytest.approx(known)


@pytest.mark.parametrize("mode", [CLOCK, WHEELS])
def test_children_know_from_where_they_came(mode):
    belief = belief_on(CROSS, [On(0, 301.0, 1.0, sigma=3.0)])
    belief.state[0].mode = mode
    branch(belief, new_path(1 << 12), context(CROSS), 1.0, 0.0)
    came = dict(zip(living(belief).edge.tolist(), living(belief).before.tolist(), strict=True))
    assert {0, 2, 4, 6} <= set(came)
    assert came.pop(0) == NO_EDGE
    assert set(came.values()) == {0}
