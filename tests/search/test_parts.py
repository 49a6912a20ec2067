"""The parts of the search from the map: pieces, steps, the population."""

import math

import numpy as np
import pytest
from whichroad.core.belief import H, X, Y, new_belief, new_route, normalise
from whichroad.core.epoch import new_epochs
from whichroad.core.motion import arc_chord
from whichroad.core.population import collect, copy_row, hand_over_all, new_population, sum_up
from whichroad.core.switching import new_work
from whichroad.search import pieces_of
from whichroad.search.wheels import steps

from scenes import On, Town, belief_on, drive_along, grid_town, network, straight_road
from whichroad.settings import Settings

from .wheels import PLANE, wheels_of


def test_a_prior_is_length_however_a_road_is_cut():
    """Ten edges of 100 m are one of 1,000 m; each direction has a half."""
    whole = Town(network(straight_road(1000.0)), PLANE)
    cut = Town(network([[[x, 0.0], [x + 100.0, 0.0]] for x in range(0, 1000, 100)]), PLANE)
    for town in (whole, cut):
        pieces = pieces_of(town, Settings(), None)
        p = np.exp(pieces.log_weight)
        assert p.sum() == pytest.approx(1.0, abs=1e-12)
        west = pieces.x < 500.0
        assert p[west].sum() == pytest.approx(0.5, abs=0.05)
        forward = pieces.edge % 2 == 0
        assert p[forward].sum() == pytest.approx(0.5, abs=1e-12)
        at = np.linspace(50.0, 950.0, 200)
        density = (p / pieces.spread) @ np.exp(
            -0.5 * ((at - pieces.x[:, None]) / pieces.spread[:, None]) ** 2
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
    assert last == len(epochs.time) - 1
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


def population_on(places: list[On], room: int = 200):
    belief = belief_on(ROADS, places)
    population = new_population(room, belief.clock)
    for i in range(len(places)):
        copy_row(belief, i, population, i)
    population.size[0] = len(places)
    return population


def test_a_light_hypothesis_far_from_a_heavy_one_on_its_edge_is_kept():
    """Merged by their weights, as Runnalls' cost would have it, it was lost for good."""
    population = population_on([On(0, 100.0, 0.999), On(0, 200.0, 0.001), On(0, 101.0, 1e-9)])
    kept = new_population(10, population.clock)
    order = np.array([0, 2, 1])
    collect(population, kept, new_route(64), order, 0.05, 1.0)
    assert kept.size[0] == 2
    assert kept.probability[:2] == pytest.approx([0.999, 0.001])
    assert kept.abscissa[1] == 200.0


def test_collecting_keeps_weights_and_the_mean():
    places = [On(0, 100.0 + 0.5 * i, 0.02 * (i + 1)) for i in range(9)] + [On(1, 50.0, 0.1)]
    population = population_on(places)
    kept = new_population(20, population.clock)
    collect(population, kept, new_route(64), np.arange(10), 0.05, 1.0)
    m = int(kept.size[0])
    assert m < 10
    assert kept.probability[:m].sum() == pytest.approx(1.0)
    before = population.probability[:10] @ population.mean[:10]
    np.testing.assert_allclose(kept.probability[:m] @ kept.mean[:m], before, atol=1e-9)


def test_what_is_summed_up_has_the_moments_of_all():
    places = [On(0, 80.0 * i, 0.1, sigma=5.0) for i in range(10)]
    population = population_on(places)
    part = new_belief()
    order = np.arange(10)[::-1].copy()
    sum_up(population, part, order, 3, 1.0)
    assert part.size[0] == 4
    normalise(part)
    p, mean = part.probability[:4], part.mean[:4]
    assert p == pytest.approx([0.1, 0.1, 0.1, 0.7])
    x = population.mean[:10, X]
    assert p @ mean[:, X] == pytest.approx(x.mean())
    variance = p @ (part.cov[:4, X, X] + (mean[:, X] - x.mean()) ** 2)
    assert variance == pytest.approx(25.0 + x.var())
    assert p @ part.cov[:4, Y, Y] == pytest.approx(25.0)


def test_a_population_is_handed_over_whole():
    """Two hundred hypotheses near the ends of their edges: no weight is lost."""
    roads = network(grid_town())
    places = [On(i % 60, 110.0, 1.0 / 200.0) for i in range(200)]
    source = belief_on(roads, places[:100])
    population = new_population(200, source.clock)
    for i in range(200):
        copy_row(source, i % 100, population, i)
    population.size[0] = 200
    population.log_weight[:200], population.probability[:200] = np.log(0.005), 0.005
    passed = new_population(2000, source.clock)
    room = hand_over_all(
        population, passed, new_belief(), roads, new_route(1 << 12), new_work(), 1.0, 5.0, 1.0,
        0.75, 1e-9,
    )  # fmt: skip
    m = int(passed.size[0])
    assert room
    assert m > 300
    assert np.exp(passed.log_weight[:m]).sum() == pytest.approx(1.0)
    small = new_population(250, source.clock)
    assert not hand_over_all(
        population, small, new_belief(), roads, new_route(1 << 12), new_work(), 1.0, 5.0, 1.0,
        0.75, 1e-9,
    )  # fmt: skip
    assert np.isfinite(passed.mean[:m, H]).all()
