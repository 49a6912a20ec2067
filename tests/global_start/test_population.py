"""The parts of the search from the map: prior, steps, the population."""

import math

import numpy as np
import pytest

from scenes import (
    On,
    Town,
    belief_on,
    context,
    drive_along,
    grid_town,
    living,
    network,
    straight_road,
    weights,
)  # fmt: skip
from whichroad.filter.hypotheses.population import branch_all, match_moments, merge_neighbours
from whichroad.filter.motion import arc_chord
from whichroad.filter.state import Belief, H, X, Y, new_belief, new_epochs, new_path, normalise
from whichroad.global_start import prior_components
from whichroad.global_start.steps import steps
from whichroad.settings import Settings

from .wheels import PLANE, wheels_of


def test_the_prior_is_proportional_to_length_however_a_road_is_cut():
    """Ten edges of 100 m are one of 1,000 m; each direction has a half."""
    whole = Town(network(straight_road(1000.0)), PLANE)
    cut = Town(network([[[x, 0.0], [x + 100.0, 0.0]] for x in range(0, 1000, 100)]), PLANE)
    for town in (whole, cut):
        pieces = prior_components(town, Settings(), None)
        p = np.exp(pieces.log_weight)
        assert p.sum() == pytest.approx(1.0, abs=1e-12)
        west = pieces.x < 500.0
        assert p[west].sum() == pytest.approx(0.5, abs=0.05)
        forward = pieces.edge % 2 == 0
        assert p[forward].sum() == pytest.approx(0.5, abs=1e-12)
        at = np.linspace(50.0, 950.0, 200)
        density = (p / pieces.sigma) @ np.exp(
            -0.5 * ((at - pieces.x[:, None]) / pieces.sigma[:, None]) ** 2
        )
        assert density.std() < 0.1 * density.mean()


def test_joined_epochs_lead_where_the_epochs_did():
    truth = drive_along([[0.0, 0.0], [80.0, 0.0], [80.0, 90.0]])
    epochs = wheels_of(truth).epochs
    x = y = heading = arc = 0.0
    last = 0
    for step in steps(epochs, lambda: 5.0):
        c, s = math.cos(heading), math.sin(heading)
        x, y = x + c * step.forward - s * step.left, y + s * step.forward + c * step.left
        heading, arc, last = heading + step.turn, arc + step.arc, step.epoch
    assert last == len(epochs) - 1
    assert arc == pytest.approx(truth.s[-1] - truth.s[0])
    assert heading == pytest.approx(truth.heading[-1] - truth.heading[0])
    c, s = math.cos(truth.heading[0]), math.sin(truth.heading[0])
    dx, dy = truth.x[-1] - truth.x[0], truth.y[-1] - truth.y[0]
    assert np.hypot(c * dx + s * dy - x, c * dy - s * dx - y) < 0.2


def test_an_epoch_of_many_metres_is_cut_into_arcs_of_the_same_circle():
    epochs = new_epochs(2)
    epochs.arc[1], epochs.turn[1] = 30.0, 1.2
    epochs.forward[1], epochs.left[1] = arc_chord(30.0, 1.2)
    parts = list(steps(epochs, lambda: 5.0))
    assert len(parts) == 5
    assert [p.whole for p in parts] == [False] * 4 + [True]
    assert sum(p.turn for p in parts) == pytest.approx(1.2)
    assert sum(p.arc for p in parts) == pytest.approx(30.0)


def test_steps_end_before_the_first_fix():
    epochs = new_epochs(10)
    epochs.arc[:] = 2.0
    epochs.has_fix[6] = 1
    assert [s.epoch for s in steps(epochs, lambda: 0.0)] == [1, 2, 3, 4, 5]
    assert [s.epoch for s in steps(epochs, lambda: 5.0)] == [3, 5]


ROADS = network(straight_road(1000.0))


def population_on(places: list[On], room: int = 200) -> Belief:
    """A normalised population of hypotheses on a straight road."""
    belief = belief_on(ROADS, places)
    population = new_belief(capacity=room)
    population.hyp[: len(places)] = living(belief)
    population.state[:] = belief.state
    return population


def test_a_light_hypothesis_far_from_a_heavy_one_on_its_edge_is_kept():
    """Merged by their weights, as Runnalls' cost would have it, it was lost for good."""
    population = population_on([On(0, 100.0, 0.999), On(0, 200.0, 0.001), On(0, 101.0, 1e-9)])
    kept = new_belief(capacity=10)
    merge_neighbours(population, kept, new_path(64), np.array([0, 2, 1]), 0.05)
    assert living(kept).weight == pytest.approx([0.999, 0.001])
    assert kept.hyp.along[1] == 200.0


def test_merging_neighbours_conserves_weights_and_the_mean():
    places = [On(0, 100.0 + 0.5 * i, 0.02 * (i + 1)) for i in range(9)] + [On(1, 50.0, 0.1)]
    population = population_on(places)
    kept = new_belief(capacity=20)
    merge_neighbours(population, kept, new_path(64), np.arange(10), 0.05)
    few, all_ = living(kept), living(population)
    assert len(few) < 10
    assert few.weight.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(few.weight @ few["mu"], all_.weight @ all_["mu"], atol=1e-9)


def test_the_summary_of_a_population_has_the_moments_of_all():
    population = population_on([On(0, 80.0 * i, 0.1, sigma=5.0) for i in range(10)])
    part = new_belief()
    match_moments(population, part, np.arange(10)[::-1].copy(), 3)
    normalise(part)
    few = living(part)
    p, mean, cov = few.weight, few["mu"], few["cov"]
    assert p == pytest.approx([0.1, 0.1, 0.1, 0.7])
    x = living(population)["mu"][:, X]
    assert p @ mean[:, X] == pytest.approx(x.mean())
    variance = p @ (cov[:, X, X] + (mean[:, X] - x.mean()) ** 2)
    assert variance == pytest.approx(25.0 + x.var())
    assert p @ cov[:, Y, Y] == pytest.approx(25.0)


def test_branching_a_population_loses_no_weight_where_there_is_room():
    """Two hundred hypotheses near the ends of their edges."""
    roads = network(grid_town())
    some = belief_on(roads, [On(i % 60, 110.0, 1.0 / 200.0) for i in range(100)])
    population = new_belief(capacity=200)
    population.hyp[:100] = population.hyp[100:] = living(some)
    population.state[:] = some.state
    population.state[0].count = 200
    ctx, part = context(roads, prune=1e-9), new_belief()
    passed = new_belief(capacity=2000)
    assert branch_all(population, passed, part, new_path(1 << 12), ctx, 5.0)
    assert passed.state[0].count > 300
    assert weights(passed).sum() == pytest.approx(1.0)
    assert np.isfinite(living(passed)["mu"][:, H]).all()
    small = new_belief(capacity=250)
    assert not branch_all(population, small, part, new_path(1 << 12), ctx, 5.0)
