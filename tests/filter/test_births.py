"""Cold starts, leaving the roads and coming back: probability goes by length, not by pieces."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles import textbook
from scenes import (
    On,
    belief_on,
    context,
    edge_weights,
    living,
    network,
    parallel_roads,
    untouched,
    weights,
)
from strategies import UNITS
from whichroad.filter.along import advance_along
from whichroad.filter.hypotheses.births import (
    Start,
    cold_start,
    exchange_off_road,
    turn_round,
    turn_with_heading,
)
from whichroad.filter.hypotheses.branching import branch
from whichroad.filter.motion import Noise
from whichroad.filter.state import (
    CAPACITY,
    CLOCK,
    DISTANCE,
    GX,
    GY,
    KEPT,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    D,
    H,
    K,
    Path,
    X,
    Y,
    new_belief,
    new_path,
    normalise,
)
from whichroad.graph.network import Roads
from whichroad.settings import Settings

SET = Settings()
START = Start(1.0, 0.5, 0.0, math.inf, 1.0, 0.012, 0.0, SET.drift_sigma, True)


def start(
    belief: Belief, roads: Roads, fix: list[float], *, total: float = 1.0,
    lever: tuple[float, float] = (0.0, 0.0), **known: float,
) -> None:  # fmt: skip
    """A cold start from a fix; what is `known` replaces the usual fields of its start."""
    belief.state[0].scale = 1.0
    ctx = context(roads, lever=lever)
    cold_start(belief, new_path(8), ctx, np.array(fix), START._replace(**known), total)


def started(roads: Roads, fix: list[float], **given: float) -> Belief:
    """A new belief that starts from a fix, its weights normalised."""
    belief = new_belief()
    start(belief, roads, fix, **given)
    normalise(belief)
    return belief


def exchange(belief: Belief, roads: Roads, travelled: float) -> None:
    belief.state[0].since_exit = travelled
    exchange_off_road(belief, context(roads))


@given(
    st.floats(1.0, 12.0), st.floats(1.0, 12.0), st.floats(-4.0, 4.0), st.floats(-3.0, 3.0),
    st.sampled_from([1.0, 2.0, 5.0]),
)  # fmt: skip
def test_the_first_state_is_what_a_flat_prior_becomes_by_the_fix(
    major, minor, angle, heading, slow
):
    """Position and GNSS error γ, conditioned on z = p + R a + S γ + white, S = slow · reported."""
    lever = np.array([1.2, -0.4])
    belief = started(
        network(parallel_roads(12.0)), [1000.0, 500.0, major, minor, angle],
        heading=heading, heading_sigma=0.05, lever=tuple(lever), bias=slow,
    )  # fmt: skip
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    s = turn @ np.diag([major, minor]) @ turn.T
    c, q = math.cos(heading), math.sin(heading)
    arm = np.array([[c, -q], [q, c]]) @ lever
    prior = np.diag([1e12, 1e12, 1.0, 1.0])
    rows = np.hstack([np.eye(2), slow * s])
    mean, cov, _ = textbook.condition(
        np.zeros(4), prior, rows, np.array([1000.0, 500.0]) - arm, 0.25 * s @ s
    )
    kept = [X, Y, GX, GY]
    first = belief.hyp[0]
    np.testing.assert_allclose(first.mu[kept], mean, atol=1e-3)
    np.testing.assert_allclose(first.cov[np.ix_(kept, kept)], cov, atol=1e-2)
    np.testing.assert_allclose(first.cov, first.cov.T)
    assert np.linalg.eigvalsh(first.cov / np.outer(UNITS, UNITS)).min() > -1e-12
    assert first.mu[[H, K]] == pytest.approx([heading, 1.0])


@given(st.floats(1e-3, 0.5), st.floats(0.0, 40.0), st.floats(0.1, 3.0))
def test_a_start_added_to_a_belief_takes_its_share_from_all_alike(total, y, sigma):
    """The old hypotheses keep their order, their states and 1 - total; the new are a start."""
    roads = network(parallel_roads(40.0))
    places = [On(0, 900.0, 0.5), On(OFF_ROAD, 700.0, 0.2), On(2, 900.0, 0.3)]
    belief, old = belief_on(roads, places), belief_on(roads, places)
    belief.hyp.path_entry[:3] = 5, 6, 7
    fix = [1000.0, y, 3.0, 3.0, 0.0]
    start(belief, roads, fix, total=total, heading_sigma=sigma)
    assert untouched(belief)
    before, new = living(belief)[:3], living(belief)[3:]
    assert before.edge.tolist() == [0, OFF_ROAD, 2]
    np.testing.assert_array_equal(before.mu, living(old).mu)
    np.testing.assert_array_equal(before.cov, living(old).cov)
    assert weights(belief)[:3] == pytest.approx(np.array([0.5, 0.2, 0.3]) * (1.0 - total))
    assert weights(belief)[3:].sum() == pytest.approx(total)
    assert new.new_edge.all()
    assert (new.path_entry == 5).all()  # they come from the best of the old ones
    alone = new_belief()
    start(alone, roads, fix, heading_sigma=sigma)
    for name in ("edge", "mu", "cov"):
        np.testing.assert_array_equal(living(alone)[name], new[name])
    assert weights(belief)[3:] == pytest.approx(total * weights(alone))


def test_a_start_of_probability_one_replaces_what_was_believed():
    roads = network(parallel_roads(12.0))
    belief = belief_on(roads, [On(0, 300.0, 0.5), On(2, 300.0, 0.5)])
    start(belief, roads, [1000.0, 5.0, 3.0, 3.0, 0.0], heading_sigma=0.1)
    assert weights(belief).sum() == pytest.approx(1.0)
    assert living(belief).mu[:, X] == pytest.approx(1000.0)


@pytest.mark.parametrize("sigma", [0.1, math.inf])
def test_a_start_depends_on_nothing_that_its_rows_held_before(sigma: float):
    """Rows beyond the last hypothesis are free: what a dead one left there is not read."""
    roads = network(parallel_roads(12.0))
    new, used = new_belief(), new_belief()
    used.hyp.view(np.uint8)[:] = 1
    fix = [1000.0, 5.0, 3.0, 3.0, 0.0]
    for belief in (new, used):
        start(belief, roads, fix, heading_sigma=sigma)
    assert living(new).edge.min() == OFF_ROAD
    for name in set(living(new).dtype.names) - {"scratch", "weight"}:
        np.testing.assert_array_equal(living(used)[name], living(new)[name], name)


def test_on_a_road_of_many_lanes_a_vehicle_starts_in_any_of_them():
    roads = network(parallel_roads(12.0))
    roads.edges.lane_sigma[:2] = 1.65
    first = living(started(roads, [1000.0, 5.0, 3.0, 3.0, 0.0]))[:4]
    sigmas = dict(zip(first.edge.tolist(), np.sqrt(first.cov[:, D, D]), strict=True))
    alone = SET.lane_sigma
    wide = math.hypot(alone, 1.65)
    assert sigmas == pytest.approx({0: wide, 1: wide, 2: alone, 3: alone})


@pytest.mark.parametrize("travelled", [4.0, 8.0, 40.0])
def test_leaving_the_roads_and_coming_back_conserves_probability(travelled: float):
    roads = network(parallel_roads(12.0))
    belief = belief_on(roads, [On(0, 1000.0, 0.5), On(2, 1000.0, 0.1), On(OFF_ROAD, 990.0, 0.4)])
    exchange(belief, roads, travelled)
    assert living(belief).edge.tolist().count(OFF_ROAD) == 3
    assert weights(belief).sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("mode", [CLOCK, DISTANCE])
def test_turning_round_between_junctions_conserves_probability(mode: int):
    roads = network(parallel_roads(12.0))
    belief = belief_on(roads, [On(0, 1000.0, 0.7), On(2, 1000.0, 0.3)])
    living(belief).mu[:, K] = 1.0
    assert turn_round(belief, context(roads, mode, u_turn_rate=0.1), 1.0)
    shares = edge_weights(belief)
    assert set(shares) == {0, 1, 2, 3}
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)


def test_a_vehicle_athwart_its_road_may_be_turning_and_keeps_its_probability():
    roads = network(parallel_roads(12.0))
    belief = belief_on(roads, [On(0, 1000.0, 0.7), On(2, 1000.0, 0.3)])
    belief.hyp[0].mu[H] = 1.6
    turn_with_heading(belief, context(roads))
    shares = edge_weights(belief)
    assert set(shares) == {0, 1, 2}
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)


def test_a_vehicle_off_the_roads_comes_back_to_those_that_run_its_way():
    roads = network(parallel_roads(12.0))
    belief = belief_on(roads, [On(OFF_ROAD, 1000.0, 1.0, right=-6.0)])
    exchange(belief, roads, 10.0)
    shares = edge_weights(belief)
    assert set(shares) == {OFF_ROAD, 0, 2}
    assert shares[0] == pytest.approx(shares[2])
    back = living(belief)[living(belief).edge >= 0]
    assert back.mu[:, D] == pytest.approx(1.75)


def test_a_vehicle_beside_a_road_comes_back_to_another_one_only():
    roads = network(parallel_roads(12.0))
    places = [On(OFF_ROAD, 1000.0, 0.9, right=-6.0), On(0, 1000.0, 0.1)]
    belief = belief_on(roads, places)
    living(belief).beside[0, :2] = -10.0, 1.0
    exchange(belief, roads, 10.0)
    shares = edge_weights(belief)
    assert shares[0] < 0.1001
    assert shares[2] > 0.01


# 24 streets of 100 m that meet at the origin
STAR = network(
    [[[0.0, 0.0], [100.0 * math.cos(a), 100.0 * math.sin(a)]] for a in np.arange(24) * math.pi / 12]
)


ALONG = Noise(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)

Kernel = Callable[[Belief, Path, Context], object]
KERNELS: dict[str, tuple[int, Kernel]] = {
    "forwards": (WHEELS, lambda belief, path, ctx: branch(belief, path, ctx, 1.0, 0.0)),
    "in reverse": (WHEELS, lambda belief, path, ctx: branch(belief, path, ctx, -1.0, 0.0)),
    "along the road": (
        DISTANCE, lambda belief, path, ctx: advance_along(belief, path, ctx, 5.0, ALONG)
    ),
    "off the roads and back": (WHEELS, lambda belief, path, ctx: exchange_off_road(belief, ctx)),
    "turning round": (CLOCK, lambda belief, path, ctx: turn_round(belief, ctx, 1.0)),
    "athwart": (WHEELS, lambda belief, path, ctx: turn_with_heading(belief, ctx)),
}  # fmt: skip


@pytest.mark.parametrize("size", [40, 96, 97, 140, 151, 159, 160])
@pytest.mark.parametrize("way", KERNELS)
def test_however_full_the_belief_is_nothing_is_lost_nor_written_beyond_it(way: str, size: int):
    belief = crowd(size)
    belief.state[0].since_exit = 5.0
    mode, kernel = KERNELS[way]
    kernel(belief, new_path(1 << 12), context(STAR, mode, u_turn_rate=0.1))
    assert untouched(belief)
    assert belief.state[0].count <= CAPACITY
    assert weights(belief).sum() == pytest.approx(1.0, abs=1e-3)


def crowd(size: int) -> Belief:
    """Some thirty heavy hypotheses about a star of streets, the others light."""
    p = np.full(size, 1e-9)
    p[:30] = (1.0 - p[30:].sum()) / 30
    places = [
        On(OFF_ROAD if i % 7 == 0 else i % 48, 1.0 if i % 2 == 0 else 99.0, float(w), sigma=4.0)
        for i, w in enumerate(p)
    ]
    belief = belief_on(STAR, places)
    belief.hyp.mu[:size:5, H] += 1.5
    return belief


@pytest.mark.parametrize("size", [40, KEPT, 96, 140, 151, 153, CAPACITY])
def test_a_start_finds_room_in_a_belief_however_full(size: int):
    belief = crowd(size)
    start(belief, STAR, [1.0, 1.0, 4.0, 4.0, 0.0], total=0.02)
    assert untouched(belief)
    assert belief.state[0].count <= CAPACITY
    assert weights(belief).sum() == pytest.approx(1.0, abs=1e-3)
