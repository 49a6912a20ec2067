"""Observation rows of fixes and roads: equal for all hypotheses, and none along the road."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles import textbook
from scenes import (
    On,
    belief_on,
    context,
    doubt_map,
    living,
    network,
    parallel_roads,
    straight_road,
    weights,
)  # fmt: skip
from strategies import UNITS, random_gaussian, seeds
from whichroad.filter.gnss.position import Axes, observe_position
from whichroad.filter.road import observe_map
from whichroad.filter.slow_states import age_map
from whichroad.filter.state import (
    BESIDE_SIGMA,
    GX,
    GY,
    MOTION,
    MY,
    NOTHING,
    OFF_ROAD,
    Belief,
    D,
    H,
    N,
    X,
    Y,
    new_belief,
    normalise,
)  # fmt: skip
from whichroad.graph.network import Roads
from whichroad.settings import Settings

SET = Settings()
CTX = context(network(straight_road()))


def see_fix(belief: Belief, x: float, y: float, major=3.0, minor=3.0, angle=0.0, gate=9.0) -> float:
    """One fix, a second after the last, its slow error scaled by its own ellipse."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    root = turn @ np.diag([major, minor]) @ turn.T
    normalise(belief)
    belief.state.bias_root[0] = root[[0, 0, 1], [0, 1, 1]]
    axes = Axes(c, s, (0.5 * major) ** 2, (0.5 * minor) ** 2)
    fix = np.array([x, y, major, minor, angle])
    return observe_position(belief, CTX, fix, axes, gate, False, 0.0)


def see_roads(belief: Belief, roads: Roads) -> None:
    belief.state[0].since_map = 5.0
    observe_map(belief, context(roads), True)


def random_belief(seed: int, n: int = 4) -> Belief:
    rng = np.random.default_rng(seed)
    belief = new_belief()
    for i in range(n):
        belief.hyp["mu"][i], belief.hyp["cov"][i] = random_gaussian(rng)
    belief.hyp.log_weight[:n] = np.log(rng.dirichlet(np.full(n, 2.0)))
    belief.hyp.edge[:n] = OFF_ROAD
    belief.state[0].count, belief.state[0].scale = n, 1.0
    normalise(belief)
    return belief


fixes = st.tuples(
    st.floats(-15.0, 15.0), st.floats(-15.0, 15.0), st.floats(0.5, 9.0), st.floats(0.5, 9.0),
    st.floats(-4.0, 4.0),
)  # fmt: skip


@given(seeds, fixes)
def test_a_fix_within_the_gate_is_the_textbook_s_update_on_position_and_error(seed, fix):
    belief = random_belief(seed, 1)
    mean, cov = belief.hyp["mu"][0].copy(), belief.hyp["cov"][0].copy()
    x, y, major, minor, angle = fix
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    s = turn @ np.diag([major, minor]) @ turn.T
    rows = np.zeros((2, N))
    rows[0, X] = rows[1, Y] = 1.0
    rows[:, [GX, GY]] = s
    expected = textbook.condition(mean, cov, rows, np.array([x, y]) - rows @ mean, 0.25 * s @ s)
    see_fix(belief, *fix, gate=1e6)
    np.testing.assert_allclose(belief.hyp["mu"][0] / UNITS, expected[0] / UNITS, atol=1e-8)
    square = np.outer(UNITS, UNITS)
    np.testing.assert_allclose(belief.hyp["cov"][0] / square, expected[1] / square, atol=1e-8)
    assert belief.hyp.log_weight[0] == pytest.approx(expected[2], abs=1e-7)


@given(seeds, fixes, st.sampled_from([-0.5, 0.5, 1.0]))
def test_an_ellipse_may_name_its_axes_in_either_order_and_direction(seed, fix, quarter):
    a, b = random_belief(seed), random_belief(seed)
    x, y, major, minor, angle = fix
    chi2 = see_fix(a, *fix)
    if quarter != 1.0:
        major, minor = minor, major
    assert see_fix(b, x, y, major, minor, angle + quarter * math.pi) == pytest.approx(chi2)
    if chi2 <= 9.0:  # beyond the gate each axis is weighed down by itself
        b, a = living(b), living(a)
        np.testing.assert_allclose(b.log_weight, a.log_weight, atol=1e-8)
        np.testing.assert_allclose(b["mu"] / UNITS, a["mu"] / UNITS, atol=1e-8)


@given(seeds, fixes, st.permutations(range(4)))
def test_hypotheses_may_stand_in_any_order(seed, fix, order):
    a, b = random_belief(seed), random_belief(seed)
    living(b)[:] = living(b)[order]
    see_fix(a, *fix)
    see_fix(b, *fix)
    b, a = living(b), living(a)[order]
    np.testing.assert_allclose(b.log_weight, a.log_weight, atol=1e-9)
    np.testing.assert_allclose(b["mu"], a["mu"], atol=1e-9)


def test_a_fix_two_hundred_metres_away_is_weighed_down_alike_for_all():
    """The better of two fits at the gate, so the odds move by less than the gate's own half."""
    roads = network(parallel_roads(12.0))
    belief = belief_on(roads, [On(0, 500.0, 0.5), On(2, 500.0, 0.5)])
    before = belief.hyp["mu"][:2].copy()
    odds = belief.hyp.log_weight[0] - belief.hyp.log_weight[1]
    chi2 = see_fix(belief, 500.0, 200.0)
    assert chi2 > 9.0
    moved = np.hypot(*(belief.hyp["mu"][:2, :2] - before[:, :2]).T)
    assert (moved < 3.0).all()  # less than one sigma of position
    shift = belief.hyp.log_weight[0] - belief.hyp.log_weight[1] - odds
    assert shift == pytest.approx(-4.5 * ((200.0 / 188.0) ** 2 - 1.0), rel=1e-6)


def test_after_a_fix_two_hundred_metres_away_good_fixes_are_taken_at_their_word():
    roads = network(straight_road())
    belief = belief_on(roads, [On(0, 500.0)])
    see_fix(belief, 500.0, 200.0)
    assert see_fix(belief, 500.0, 0.0) < 9.0
    assert math.hypot(belief.hyp["mu"][0, X] - 500.0, belief.hyp["mu"][0, Y]) < 3.0


@given(st.floats(-6.0, 6.0), st.floats(-0.2, 0.2), seeds)
def test_a_straight_road_is_a_lateral_and_a_heading_row_of_the_textbook(right, turned, seed):
    roads = network(straight_road())
    belief = belief_on(roads, [On(0, 2000.0, right=right)])
    doubt_map(belief, 4.1)
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(N, N)) * UNITS[:, None]
    belief.hyp["cov"][0] += root @ root.T / N
    belief.hyp["mu"][0, H] = turned
    mean, cov = belief.hyp["mu"][0].copy(), belief.hyp["cov"][0].copy()
    age_map(mean, cov, CTX.par[0], belief.state[0].map, 5.0, 1.75, SET.lane_sigma)
    rows = np.zeros((2, N))
    rows[0, [Y, MY, D]] = -1.0  # right is south: n = −y
    rows[1, H] = 1.0
    noise = np.diag([SET.relative_sigma, SET.edge_heading_sigma]) ** 2
    expected = textbook.condition(mean, cov, rows, -rows @ mean, noise)
    see_roads(belief, roads)
    np.testing.assert_allclose(belief.hyp["mu"][0] / UNITS, expected[0] / UNITS, atol=1e-8)
    square = np.outer(UNITS, UNITS)
    np.testing.assert_allclose(belief.hyp["cov"][0] / square, expected[1] / square, atol=1e-8)
    assert belief.hyp.log_weight[0] == pytest.approx(expected[2], abs=1e-7)


def test_a_straight_road_says_nothing_of_the_way_along_it():
    roads = network(straight_road())
    belief = belief_on(roads, [On(0, 500.0, right=3.0)])
    doubt_map(belief, 4.1)
    for k in range(200):
        variance = belief.hyp["cov"][0, X, X]
        see_roads(belief, roads)
        assert belief.hyp["cov"][0, X, X] >= variance * (1.0 - 1e-12), k
        assert belief.hyp["mu"][0, X] == 500.0


@pytest.mark.parametrize("cut", [995.0, 1000.0, 1100.0])
def test_a_node_on_one_of_two_parallel_roads_does_not_move_their_odds(cut: float):
    """A vehicle is told the same by both roads; one of them is drawn in two streets."""
    first, second = parallel_roads(10.0)
    halves = [np.array([[0.0, 0.0], [cut, 0.0]]), np.array([[cut, 0.0], [2000.0, 0.0]])]
    roads = network([*halves, second])
    edge, s = (0, 1000.0) if cut >= 1000.0 else (2, 1000.0 - cut)
    belief = belief_on(roads, [On(edge, s, 0.5, right=-2.0), On(4, 1000.0, 0.5, right=-2.0)])
    assert len(first) == 2
    see_roads(belief, roads)
    a, b = weights(belief)
    assert a == pytest.approx(b, rel=1e-9)


def test_all_roads_are_told_with_the_same_noise_whatever_their_shape():
    """A bend relaxes the rows of its straight neighbour as well."""
    bend = [[0.0, 50.0], [460.0, 50.0], [490.0, 55.0], [515.0, 70.0], [530.0, 90.0]]
    alone = network(straight_road())
    both = network([*straight_road(), np.array(bend)])
    kept = []
    for roads, places in ((alone, [On(0, 490.0)]), (both, [On(0, 490.0, 0.5), On(2, 490.0, 0.5)])):
        belief = belief_on(roads, places)
        see_roads(belief, roads)
        kept.append(belief.hyp["cov"][0, Y, Y])
    assert kept[1] > kept[0]


def test_weights_are_normalised_however_small_they_are():
    belief = random_belief(3)
    before = belief.state[0].log_evidence
    belief.hyp.log_weight[:4] = [-2000.0, -2001.0, -math.inf, -2002.0]
    normalise(belief)
    assert living(belief).weight.sum() == pytest.approx(1.0, abs=1e-15)
    assert belief.hyp.weight[2] == 0.0
    assert belief.state[0].log_evidence - before == pytest.approx(
        -2000.0 + math.log(1.0 + math.exp(-1.0) + math.exp(-2.0))
    )


def told_off_road(
    right: float, turned: float = 0.0, blames: int = NOTHING, misfit_ago: float = math.inf,
    odds: float = -6.0, rows: int = 1,
) -> list[float]:  # fmt: skip
    """By how much a vehicle off the roads is told less than one on a road that fits perfectly.

    After each of some rows of 5 m; its odds of free motion are those of long beside a road, else.
    """
    roads = network(straight_road())
    belief = belief_on(roads, [On(0, 500.0, 0.5), On(OFF_ROAD, 500.0, 0.5, right, 1.0)])
    belief.hyp["mu"][1, H], belief.hyp.blames[1] = turned, blames
    belief.hyp["beside"][1, :2] = odds - 4.0, 0.0
    belief.state[0].vetting.undecided_at = belief.state[0].time - misfit_ago
    doubt_map(belief, 1.0)
    told = []
    for _ in range(rows):
        see_roads(belief, roads)
        told.append(float(belief.hyp.log_weight[0] - belief.hyp.log_weight[1]))
    return told


def test_beside_a_mapped_road_an_unmapped_one_fits_as_well():
    """15 m beside it; on its lane a vehicle pays for fitting by chance, and for fitting so well."""
    assert told_off_road(right=1.75)[0] > 1.0
    assert abs(told_off_road(right=15.0)[0]) < 0.1
    assert abs(told_off_road(right=-15.0)[0]) < 0.1
    assert told_off_road(right=100.0)[0] > 1.0  # what is far away tells nothing of it


def test_a_road_beside_is_paid_for_once():
    """A free vehicle pays row by row, until all that is left is one on a road beside."""
    told = np.diff(told_off_road(right=15.0, odds=4.0, rows=40), prepend=0.0)
    assert told[0] > 0.3
    assert abs(told[20:]).max() < 0.1
    on_the_lane = told_off_road(right=1.75, odds=4.0, rows=40)[-1]
    assert on_the_lane - told.sum() > 1.0  # here it is beside only as far as the map may be off


def test_who_leaves_a_road_does_not_pay_for_following_it():
    [following] = told_off_road(right=3.0, odds=4.0)
    [leaving] = told_off_road(right=3.0, turned=0.8, odds=4.0)
    assert following - leaving == pytest.approx(5.0 * SET.off_road_cost, rel=0.1)


def after_rows(odds: float, rows: int = 30, alone_after: int = 30) -> np.recarray:
    """A vehicle off the roads 15 m beside one, that heads 0.05 rad off it, after rows of 5 m.

    Args:
        odds: Log-odds of free motion over a road beside.
        rows: How many.
        alone_after: Rows after which no hypothesis is on the road any more.
    """
    roads = network(straight_road())
    belief = belief_on(roads, [On(OFF_ROAD, 500.0, 0.5, 15.0), On(0, 500.0, 0.5)])
    belief.hyp["mu"][0, H], belief.hyp["cov"][0, H, H] = 0.05, 0.05**2
    belief.hyp["cov"][0, D, D] = BESIDE_SIGMA**2
    belief.hyp["beside"][0, 0] = odds - 4.0
    belief.state[0].vetting.undecided_at = -math.inf
    doubt_map(belief, 1.0)
    for k in range(rows):
        if k == alone_after:
            belief.state[0].count = 1
        see_roads(belief, roads)
    return belief.hyp[0]


def test_beside_a_road_a_vehicle_keeps_its_course_and_its_offset():
    """Long beside it the road's heading is the vehicle's; a free vehicle keeps its own."""
    beside, free = after_rows(-6.0), after_rows(100.0)
    assert beside["mu"][H] == pytest.approx(0.0, abs=0.01)
    assert beside["cov"][H, H] < 0.5 * free["cov"][H, H]
    assert beside["mu"][D] == pytest.approx(15.0, abs=0.5)
    across = beside["cov"][Y, Y] + beside["cov"][MY, MY] + 2.0 * beside["cov"][Y, MY]
    assert across == pytest.approx(beside["cov"][D, D], rel=0.2)
    assert free["mu"][H] == pytest.approx(0.05, abs=1e-3)


def test_beside_a_road_that_nobody_is_on_a_vehicle_is_still_asked():
    """The odds of free motion go on to fall, and the course is kept."""
    short, long = after_rows(4.0, 3, 3), after_rows(4.0, 20, 3)
    assert short["course"] == long["course"] == 0
    assert long["beside"][0] < short["beside"][0] - 5.0
    assert long["cov"][H, H] < short["cov"][H, H]


def test_who_was_off_a_line_is_not_beside_it_where_it_is_on_it_again():
    roads = network(straight_road())
    told = []
    for right in (15.0, 1.75):
        belief = belief_on(roads, [On(0, 500.0, 0.5), On(OFF_ROAD, 500.0, 0.5, 15.0, 1.0)])
        belief.hyp["beside"][1, 0] = -10.0
        belief.state[0].vetting.undecided_at = -math.inf
        doubt_map(belief, 1.0)
        see_roads(belief, roads)
        belief.hyp["mu"][1, Y] = -right
        before = belief.hyp.log_weight[1]
        see_roads(belief, roads)
        told.append(float(belief.hyp.log_weight[1] - before))
    assert told[0] - told[1] > 3.0


def test_a_vehicle_that_blames_its_motion_has_not_shown_that_it_left():
    assert told_off_road(right=15.0, blames=MOTION) == told_off_road(right=100.0)


def test_wheels_that_fixes_have_just_contradicted_do_not_show_who_left():
    far = told_off_road(right=100.0)
    assert told_off_road(right=15.0, misfit_ago=59.0) == far
    assert told_off_road(right=15.0, misfit_ago=61.0)[0] < 0.1 < far[0]
