"""Branching along the roads conserves probability, and goes where the roads go."""

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
    edge_weights,
    grid_town,
    living,
    network,
    weights,
)  # fmt: skip
from strategies import seeds
from whichroad.filter.along import advance_along
from whichroad.filter.hypotheses.branching import branch
from whichroad.filter.hypotheses.reduction import _merge_cost, reduce
from whichroad.filter.hypotheses.successors import speed_fit, successors
from whichroad.filter.motion import Noise
from whichroad.filter.state import (
    CLOCK,
    DISTANCE,
    NO_BOUND,
    OFF_ROAD,
    WHEELS,
    Belief,
    D,
    H,
    K,
    X,
    Y,
    new_path,
)
from whichroad.graph.network import TURN, Roads, records
from whichroad.settings import Settings

# eastwards into a crossing: ahead (edge 2), left (4), right (6), each with its way back
CROSS = network(
    [
        [[0.0, 0.0], [300.0, 0.0]],
        [[300.0, 0.0], [600.0, 0.0]],
        [[300.0, 0.0], [300.0, 300.0]],
        [[300.0, 0.0], [300.0, -300.0]],
    ]
)
TOWN = network(grid_town(4, 4, 90.0))

PRIORS = {2: 1.0, 4: 0.5, 6: 0.5, 1: 0.01}


def pass_on(belief: Belief, roads: Roads, arc: float = 1.0, *, prune=0.0) -> bool:
    ctx = context(roads, prune=prune)
    return branch(belief, new_path(1 << 12), ctx, arc, 0.0)


def go_along(belief: Belief, roads: Roads, metres: float, *, prune=0.0) -> bool:
    ctx = context(roads, prune=prune, edge_heading_sigma=0.08)
    noise = Noise(0.01 * abs(metres), 0.0, 0.0, 0.0, 0.0, 0.0)
    return advance_along(belief, new_path(1 << 12), ctx, metres, noise)


def merge(belief: Belief, *, prune=1e-4, limit=0.05, most=2) -> None:
    ctx = context(CROSS, prune=prune, merge=limit, components=most)
    reduce(belief, new_path(1 << 12), ctx)


def random_places(seed: int) -> list[On]:
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.ones(4))
    length = TOWN.edges.length
    edges = rng.choice(len(length), 4, replace=False)
    return [
        On(int(e), length[e] * rng.uniform(0.5, 1.1), float(w), sigma=rng.uniform(0.5, 40.0))
        for e, w in zip(edges, p, strict=True)
    ]


@given(seeds, st.sampled_from([-3.0, 0.0, 3.0]))
def test_branching_conserves_probability(seed: int, arc: float):
    belief = belief_on(TOWN, random_places(seed))
    pass_on(belief, TOWN, arc)
    assert len(living(belief)) >= 4
    assert weights(belief).sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(living(belief).weight, weights(belief), atol=1e-12)


@given(seeds, st.floats(0.0, 60.0))
def test_driving_along_roads_conserves_probability(seed: int, metres: float):
    belief = belief_on(TOWN, random_places(seed))
    go_along(belief, TOWN, metres)
    assert weights(belief).sum() == pytest.approx(1.0, abs=1e-12)


@given(seeds)
def test_pruned_branches_lose_less_than_the_floor_they_were_below(seed: int):
    belief = belief_on(TOWN, random_places(seed))
    pass_on(belief, TOWN, prune=1e-4)
    assert 1.0 - 4 * 64 * 1e-5 <= weights(belief).sum() <= 1.0 + 1e-12


@given(seeds)
def test_a_standing_vehicle_leaks_nothing(seed: int):
    """What lies beyond the end is passed on once, however often one looks again."""
    rng = np.random.default_rng(seed)
    belief = belief_on(CROSS, [On(0, rng.uniform(270, 300), sigma=rng.uniform(0.5, 30.0))])
    pass_on(belief, CROSS, 0.0)
    once = edge_weights(belief)
    for _ in range(20):
        pass_on(belief, CROSS, 0.0, prune=1e-4)
    assert edge_weights(belief) == pytest.approx(once, abs=1e-4)


def test_past_a_crossing_the_turn_priors_share_a_sharp_hypothesis():
    belief = belief_on(CROSS, [On(0, 310.0, sigma=0.5)])
    assert pass_on(belief, CROSS)
    shares = edge_weights(belief)
    total = sum(PRIORS.values())
    for edge, prior in PRIORS.items():
        assert shares[edge] == pytest.approx(prior / total, rel=1e-6)
    assert shares.get(0, 0.0) < 1e-10


def test_half_way_over_the_end_half_of_the_weight_stays():
    belief = belief_on(CROSS, [On(0, 300.0, sigma=4.0)])
    pass_on(belief, CROSS)
    assert edge_weights(belief)[0] == pytest.approx(0.5, abs=1e-12)


@pytest.mark.parametrize("sigma", [2.0, 8.0, 20.0])
def test_in_many_small_steps_as_much_passes_the_end_as_in_one(sigma: float):
    """What has passed is Φ((s − L)/σ), however finely the way was cut."""
    belief = belief_on(CROSS, [On(0, 250.0, sigma=sigma)])
    for _ in range(50):
        belief.hyp["mu"][0, X] += 1.2
        pass_on(belief, CROSS, prune=1e-6)
        merge(belief, prune=0.0, limit=1e9)
        assert belief.hyp.edge[0] == 0
    stayed = edge_weights(belief)[0]
    assert stayed == pytest.approx(0.5 * math.erfc(10.0 / sigma / math.sqrt(2.0)), abs=1e-3)


def test_without_a_road_ahead_what_passes_the_end_is_off_the_roads():
    roads = network([[[0.0, 0.0], [300.0, 0.0]]])
    for name in ("first_turn", "end_turn", "first_predecessor", "end_predecessor"):
        roads.edges[name] = 0
    belief = belief_on(roads, [On(0, 300.0, sigma=4.0)])
    pass_on(belief, roads)
    assert edge_weights(belief) == pytest.approx({0: 0.5, OFF_ROAD: 0.5})


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
def test_at_a_dead_end_who_is_fast_drives_on_and_who_is_slow_turns_round(mode: int):
    roads = network([[[0.0, 0.0], [300.0, 0.0]]])
    slow, fast = (at_speed(speed, mode, roads) for speed in (3.0, 14.0))
    for p in (slow, fast):
        assert sum(p.values()) == pytest.approx(1.0, abs=1e-6)
    assert slow[1] > 0.9
    assert slow[OFF_ROAD] > 0.02
    assert fast[OFF_ROAD] > 0.3


def test_a_vehicle_in_reverse_backs_into_the_edges_before_but_not_into_its_own_way_back():
    belief = belief_on(CROSS, [On(2, 1.0, sigma=1.0)])
    for _ in range(12):
        living(belief)["mu"][:, X] -= 0.5
        pass_on(belief, CROSS, -0.5)
        merge(belief)
    shares = edge_weights(belief)
    assert set(shares) == {2, 0, 5, 7}  # from the west, from the north, from the south
    assert shares[2] < 0.1
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("sigma", [3.0, 30.0, 120.0])
def test_the_mass_on_the_successors_is_the_gaussian_s_beyond_the_end(sigma: float):
    """Two streets in a row: their masses are those of the abscissa on each."""
    roads = network(
        [[[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], [140.0, 0.0]], [[140.0, 0.0], [400.0, 0.0]]]
    )
    turns = records(2, TURN)  # 0 → 2 → 4 and nothing else
    turns.edge, turns.prior = [2, 4], 1.0
    roads.edges.first_turn, roads.edges.end_turn = [0, 1, 1, 2, 2, 2], [1, 1, 2, 2, 2, 2]
    ctx = context(roads._replace(turns=turns))
    belief = belief_on(roads, [On(0, 90.0, sigma=sigma)])
    count, _ = successors(belief, ctx, 0, 90.0, sigma, 1.0, NO_BOUND)
    cdf = lambda s: 0.5 * math.erfc(-(s - 90.0) / sigma / math.sqrt(2.0))  # noqa: E731
    expected = {2: cdf(140.0) - cdf(100.0)}
    if 90.0 + 3.5 * sigma > 140.0:
        expected[4] = cdf(400.0) - cdf(140.0)
    found = ctx.work.successor[:count]
    masses = dict(zip(found.edge.tolist(), found.mass, strict=True))
    assert masses == pytest.approx(expected)


def at_speed(speed: float, mode: int, roads: Roads = CROSS) -> dict[int, float]:
    """P of the edges behind an end that is passed at a speed (m/s), odometer off by 4."""
    belief = belief_on(roads, [On(0, 310.0, sigma=0.5)])
    belief.state.mode[0] = mode
    belief.hyp["mu"][0, K] = speed if mode == CLOCK else 0.25
    belief.hyp["cov"][0, K, K] = 0.01
    belief.state.odometer_speed[0] = 4.0 * speed
    pass_on(belief, roads)
    return edge_weights(belief)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
def test_who_has_not_braked_drives_straight_on_and_who_has_will_rather_turn(mode: int):
    stands, slow, fast = (at_speed(speed, mode) for speed in (0.0, 4.0, 14.0))
    for p in (stands, slow, fast):
        assert sum(p.values()) == pytest.approx(1.0, abs=1e-6)
        assert p[4] == pytest.approx(p[6], rel=1e-6)  # left, right
    assert stands[4] / stands[2] == pytest.approx(PRIORS[4] / PRIORS[2], rel=1e-5)
    assert slow[4] / slow[2] > 1.5 * PRIORS[4] / PRIORS[2]
    assert fast[4] / fast[2] < 0.4 * PRIORS[4] / PRIORS[2]


@pytest.mark.parametrize("turn", [0.0, 0.4, 0.8, 1.6, 3.1])
def test_the_speed_in_a_turn_has_a_density_and_the_quantiles_of_real_drives(turn: float):
    """Median 5.5 m/s and 95 % quantile 10 m/s over the root of the turn, within a third."""
    speeds = np.arange(0.5, 40.0, 0.1)
    density = np.array([speed_fit(12.5, turn, (v, 0.3)) for v in speeds])
    if turn == 0.0:
        assert density[speeds < 10.0] == pytest.approx(0.05, rel=0.05)  # up to 20 m/s
        return
    below = 0.5 * density[0] + 0.1 * np.cumsum(density)
    within = speeds < 15.0 / math.sqrt(turn)  # beyond it, a bend that was drawn as a corner
    assert below[within][-1] == pytest.approx(1.0, abs=0.1)
    assert np.interp(0.5, below, speeds) * math.sqrt(turn) == pytest.approx(5.5, rel=0.3)
    assert np.interp(0.95, below, speeds) * math.sqrt(turn) == pytest.approx(10.0, rel=0.3)


def test_the_lane_is_drawn_anew_round_the_corner_and_kept_ahead():
    belief = belief_on(CROSS, [On(0, 310.0, sigma=0.5)])
    belief.hyp["mu"][0, D], belief.hyp["cov"][0, D, D] = 4.0, 0.04
    pass_on(belief, CROSS)
    lane = {int(hyp.edge): (hyp["mu"][D], hyp["cov"][D, D]) for hyp in living(belief)}
    assert lane[2] == pytest.approx((4.0, 0.04))
    assert lane[4] == pytest.approx((1.75, Settings().lane_sigma ** 2))


def test_driving_along_roads_turns_with_them_and_keeps_the_lane():
    """A corner is an arc of 15 m on the ground, and that much shorter."""
    beyond = 40.0 + 15.0 * (2.0 * math.tan(math.pi / 4) - math.pi / 2)
    belief = belief_on(CROSS, [On(0, 280.0, right=1.75, sigma=0.5)])
    go_along(belief, CROSS, 60.0)
    place = {int(hyp.edge): tuple(hyp["mu"][[X, Y, H]]) for hyp in living(belief)}
    assert place[2] == pytest.approx((340.0, -1.75, 0.0), abs=0.05)
    assert place[4] == pytest.approx((301.75, beyond, math.pi / 2), abs=0.05)
    assert place[6] == pytest.approx((298.25, -beyond, -math.pi / 2), abs=0.05)


@pytest.mark.parametrize("steps", [4, 20])
def test_a_node_is_passed_by_as_much_in_small_steps_as_at_once(steps: int):
    """Half of the Gaussian is past it in the end, and where it is does not depend on the steps."""
    once, slowly = (belief_on(CROSS, [On(0, 280.0, right=1.75, sigma=6.0)]) for _ in range(2))
    go_along(once, CROSS, 20.0)
    for _ in range(steps):
        go_along(slowly, CROSS, 20.0 / steps)
        merge(slowly, prune=0.0)
    assert edge_weights(slowly) == pytest.approx(edge_weights(once), abs=0.01)
    assert edge_weights(slowly)[0] == pytest.approx(0.5, abs=0.01)
    (was, cov_was), (now, cov_now) = (moments_by_edge(b)[2] for b in (once, slowly))
    assert now[X] == pytest.approx(was[X], abs=0.2)
    assert math.sqrt(cov_now[X, X]) == pytest.approx(math.sqrt(cov_was[X, X]), rel=0.03)


def test_what_is_observed_weighs_a_hypothesis_that_has_passed_something_on_by_what_is_left():
    """An observation that draws the Gaussian back by 4 m: more of it is before the bound."""
    belief = belief_on(CROSS, [On(0, 280.0, right=1.75, sigma=6.0)])
    belief.state[0].mode = CLOCK
    go_along(belief, CROSS, 20.0)
    before = edge_weights(belief)
    assert belief.hyp.bound[0] == pytest.approx(300.0)
    belief.hyp["mu"][0, X] -= 4.0
    belief.hyp["cov"][0, X, X] = 25.0
    pass_on(belief, CROSS, 0.0)
    cdf = lambda z: 0.5 * math.erfc(-z / math.sqrt(2.0))  # noqa: E731
    assert edge_weights(belief)[0] / before[0] == pytest.approx(cdf(4.0 / 5.0) / 0.5, rel=0.01)
    assert edge_weights(belief)[2] == pytest.approx(before[2])


@pytest.mark.parametrize("mode", [CLOCK, DISTANCE])
def test_two_that_are_merged_have_what_is_before_the_smaller_bound(mode: int):
    belief = belief_on(CROSS, [On(0, 298.0, 0.5, sigma=6.0), On(0, 296.0, 0.5, sigma=6.0)])
    belief.state[0].mode = mode
    belief.hyp.bound[:2] = 300.0, 320.0
    belief.hyp.p_not_passed[:2] = 0.6, 1.0
    merge(belief, limit=1.0, most=1)
    assert belief.state[0].count == 1
    assert belief.hyp.bound[0] == 300.0
    z = 3.0 / math.sqrt(36.0 + 1.0) / math.sqrt(2.0)
    assert belief.hyp.p_not_passed[0] == pytest.approx(0.5 * math.erfc(-z))


def moments_by_edge(belief: Belief) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    found = {}
    for edge in set(living(belief).edge.tolist()):
        on = living(belief).edge == edge
        some, w = living(belief)[on], weights(belief)[on]
        found[edge] = textbook.mixture_moments(w / w.sum(), some["mu"], some["cov"])
    return found


@given(seeds, st.integers(1, 4))
def test_reducing_conserves_the_weight_and_the_moments_of_every_road(seed: int, most: int):
    rng = np.random.default_rng(seed)
    edges = rng.integers(0, 3, 12) * 2
    places = [
        On(int(e), rng.uniform(50, 250), float(p), rng.normal(), rng.uniform(2.0, 30.0))
        for e, p in zip(edges, rng.dirichlet(np.ones(12)), strict=True)
    ]
    belief = belief_on(CROSS, places)
    shares, moments = edge_weights(belief), moments_by_edge(belief)
    merge(belief, prune=0.0, most=most)
    assert edge_weights(belief) == pytest.approx(shares, abs=1e-12)
    assert np.unique(living(belief).edge, return_counts=True)[1].max() <= most
    for edge, (mean, cov) in moments_by_edge(belief).items():
        np.testing.assert_allclose(mean, moments[edge][0], atol=1e-9)
        np.testing.assert_allclose(cov, moments[edge][1], atol=1e-8)


@given(st.floats(0.01, 1.0), st.floats(0.0, 1e3), st.floats(0.5, 50.0), st.floats(0.5, 50.0))
def test_merging_costs_nothing_for_twins_and_never_less(share, gap, sigma, other):
    places = [On(0, 100.0, share, sigma=sigma), On(0, 100.0 + gap, 1.0, sigma=other)]
    belief = belief_on(CROSS, places)
    assert _merge_cost(*living(belief), math.inf, 1.0, False) >= -1e-12
    twins = belief_on(CROSS, [places[0], places[0]])
    assert _merge_cost(*living(twins), math.inf, 1.0, False) == pytest.approx(0.0, abs=1e-12)


def test_two_arrivals_far_apart_on_one_road_stay_apart():
    belief = belief_on(CROSS, [On(0, 20.0, 0.6), On(0, 280.0, 0.4), On(2, 50.0, 1e-6)])
    merge(belief)
    assert living(belief).edge.tolist() == [0, 0]
    assert weights(belief) == pytest.approx([0.6, 0.4], abs=1e-5)
    assert weights(belief).sum() == pytest.approx(1.0, abs=1e-12)


def test_a_map_offset_is_part_of_where_on_the_road_a_vehicle_is():
    """The spread of the abscissa is that of p + m."""
    belief = belief_on(CROSS, [On(0, 300.0, sigma=3.0)])
    doubt_map(belief, 4.0)
    pass_on(belief, CROSS)
    assert belief.hyp.along_sigma[0] == pytest.approx(5.0)
