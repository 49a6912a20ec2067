"""The life-cycle log, the life-times, and wheels alone."""

from dataclasses import replace

import numpy as np
import pytest

from whichroad.experiments.lifetime_log import log_hypotheses
from whichroad.experiments.runs import ALIVE, Run, lifetimes
from whichroad.experiments.scene_maps import along, draw_map
from whichroad.experiments.scenes import SCENES, STEADY, fixed_sigma
from whichroad.experiments.wheels_alone import wheels_alone_error
from whichroad.lineage import WHY
from whichroad.simulate import simulate_drive


@pytest.fixture(scope="module", params=["paper", "default"])
def log(request):
    scene = SCENES["fork"]
    return request.param, log_hypotheses(scene, scene.drive(scene.roads, 1), request.param)


def test_every_hypothesis_comes_from_one_before_it_and_dies_for_a_reason(log):
    _, told = log
    for h in told.hypotheses:
        assert h.parent < h.number
        assert h.why in WHY
        assert len(h.p) == h.last - h.created + 1
        assert (h.why == "alive") == (h.last == len(told.since) - 1)


def test_the_dead_merge_into_one_of_their_own_edge(log):
    _, told = log
    for h in told.hypotheses:
        if h.why == "merged":
            other = told.hypotheses[h.into]
            assert other.edge == h.edge
            assert other.created <= h.last + 1 <= other.last


def test_the_paper_drops_what_is_beyond_its_radius_and_nothing_else(log):
    model, told = log
    if model == "paper":
        assert {h.why for h in told.hypotheses} <= {"alive", "out of reach"}
    else:
        assert {"outweighed", "left behind"} <= {h.why for h in told.hypotheses}


def test_three_roads_count_at_once_behind_the_two_forks():
    scene = SCENES["fork"]
    most = 0
    for seed in range(3):
        told = log_hypotheses(scene, scene.drive(scene.roads, seed), "default")
        weight = {}
        for h in told.hypotheses:
            if h.street in "234":
                p = weight.setdefault(h.street, np.zeros(len(told.since)))
                p[h.created : h.last + 1] += h.p
        most = max(most, sum(p >= ALIVE for p in weight.values()).max())
    assert most == 3


def made(wrong: dict[str, list[float]]) -> Run:
    """A ride at 10 m/s, an epoch a second, from 20 m before the decision on."""
    n = len(next(iter(wrong.values())))
    since = np.arange(float(n))
    p = {street: np.array(values) for street, values in wrong.items()}
    none = np.zeros(n)
    return Run(
        0, 10.0 * since - 20.0, since, none, p, none, none, None, none.astype(bool)
    )  # fmt: skip


def test_a_life_runs_from_where_a_road_begins_to_count_to_where_it_ceases():
    (lifetime,) = lifetimes(
        SCENES["junction"], made({"3": [0.0, 0.02, 0.3, 0.001, 0.05, 0.0, 0.0]})
    )
    assert (lifetime.seconds, lifetime.metres, lifetime.created_m, lifetime.ended) == (
        4.0,
        40.0,
        -10.0,
        True,
    )


def test_a_road_that_counts_at_the_drives_end_has_not_ended():
    (lifetime,) = lifetimes(SCENES["junction"], made({"3": [0.0, 0.0, 0.3]}))
    assert not lifetime.ended


def test_perfect_wheels_alone_find_the_end_of_the_mask():
    """What is left is the rounding of the counters, 4 cm each."""
    exact = replace(
        STEADY, scale_sigma=0.0, differential_sigma=0.0, track_sigma=0.0, wheel_walk=0.0,
        metres_per_tick=1e-5,
    )  # fmt: skip
    roads = SCENES["outage"].roads
    route = along(roads, ["cd", "de", "ef", "fg"])
    drive = simulate_drive(roads, seed=1, route=route, scenario=exact, outages_m=[(100.0, 700.0)])
    assert wheels_alone_error(drive) < 0.1


def test_the_fixed_covariance_is_the_average_of_the_fixes_own():
    scene = SCENES["gst"]
    drive = scene.drive(scene.roads, 0)
    own, fixed = drive.drive.fixes, fixed_sigma(drive).drive.fixes
    assert np.ptp(own.cov_ee) > 100.0
    assert np.ptp(fixed.cov_ee) == 0.0
    assert fixed.cov_ee[0] == pytest.approx(np.mean(own.cov_ee + own.cov_nn) / 2.0)
    assert (own.lat_deg == fixed.lat_deg).all()


def test_streets_that_meet_are_followed_in_the_direction_of_the_route():
    roads = draw_map({"a": [(0, 0), (100, 0)], "b": [(100, 90), (100, 0)], "c": [(100, 0), (9, 9)]})
    one, other = along(roads, ["a", "b"])
    assert roads.arrays.edges.to_node[one] == roads.arrays.edges.from_node[other]
