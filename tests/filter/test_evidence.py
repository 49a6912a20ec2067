"""Evidence of further sensors: rows by finite differences, updates by the textbook, by class."""

import math

import numpy as np
import pytest

from oracles import textbook
from scenes import On, belief_on, context, network, parallel_roads, weights
from strategies import UNITS, random_gaussian
from whichroad.filter.evidence import evidence_kinds as kinds
from whichroad.filter.evidence import observe as evidence
from whichroad.filter.state import CLOCK, WHEELS, D, H, K, N, new_belief, new_work, normalise

ROADS = network(parallel_roads(30.0))
GATE = 9.0


def told(*rows: dict, first=None, start=None, classes=None) -> kinds.Evidence:
    """Rows by the names of their fields; the first sensor's, all of it new."""
    table = kinds.new_evidence(len(rows)).rows
    for k, fields in enumerate(rows):
        table[k].share = 1.0
        for name, value in fields.items():
            table[name][k] = value
    empty = kinds.new_evidence(0)
    return kinds.Evidence(
        table,
        empty.first if first is None else first,
        empty.start if start is None else start,
        empty.classes if classes is None else classes,
    )


def heard(belief, *rows: dict, mode: int = WHEELS, **about) -> None:
    """Observe these rows, and normalise."""
    ctx = context(ROADS, mode)
    ctx = ctx._replace(work=new_work(evidence=told(*rows, **about)))
    belief.state.mode = mode
    evidence.observe_evidence(belief, ctx, 0, len(rows))
    normalise(belief)


PLACE = {"x": 35.0, "y": -22.0, "arm": (1.2, -0.4)}
ROWS = {
    "heading": {"kind": kinds.HEADING, "value": 0.3},
    "heading with an error that stays": {"kind": kinds.HEADING, "value": 0.3, "bias": 0.01},
    "speed": {"kind": kinds.SPEED, "value": 9.0},
    "lateral": {"kind": kinds.LATERAL, "value": 0.5},
    "position": {"kind": kinds.POSITION, "axis": 0.4, **PLACE},
    "range": {"kind": kinds.RANGE, "value": 40.0, **PLACE},
    "range to the map": {"kind": kinds.RANGE, "value": 40.0, "on_map": 1, **PLACE},
    "range with an error that stays": {
        "kind": kinds.RANGE,
        "value": 40.0,
        "bias": 0.1,
        **PLACE,
    },
    "bearing with one": {
        "kind": kinds.BEARING,
        "value": -0.4,
        "relative": 1,
        "bias": 0.01,
        **PLACE,
    },
    "offset with one": {"kind": kinds.LATERAL, "value": 0.5, "bias": 0.1},
    "bearing": {"kind": kinds.BEARING, "value": -0.4, "relative": 1, **PLACE},
    "bearing from north": {"kind": kinds.BEARING, "value": -0.4, "on_map": 1, **PLACE},
}


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("fields", ROWS.values(), ids=ROWS)
def test_a_row_is_the_derivative_of_what_is_observed(fields: dict, axis: int):
    """The covariance is nothing, so that the second order is not there."""
    state, hyp = new_belief().state[0], new_belief().hyp[0]
    state.scale, state.mode, state.odometer_speed = 1.0, WHEELS, 8.0
    reading, row = told(fields).rows[0], np.zeros(N)
    at = np.array([1.0, 2.0, 0.2, 1.01, 0.0, 0.3, 0.5, -0.7, 0.0, 0.0, 0.0, 0.0])

    def innovation(mean: np.ndarray) -> np.ndarray:
        hyp.mu[:] = mean
        return np.array([evidence._fill_row(hyp, row, state, reading, axis)[0]])

    numeric = -textbook.jacobian(innovation, at, np.full(N, 1e-5))[0]
    innovation(at)
    np.testing.assert_allclose(row, numeric, atol=1e-8)


def test_a_position_is_the_textbooks_joint_update():
    belief = belief_on(ROADS, [On(0, 50.0)])
    rng = np.random.default_rng(4)
    mean, cov = random_gaussian(rng)
    belief.hyp[0].mu[:], belief.hyp[0].cov[:] = mean, cov
    c, s = math.cos(0.4), math.sin(0.4)
    rows = np.zeros((2, N))
    rows[:, :2] = [[c, s], [-s, c]]
    off = np.array([2.0, -1.0])
    noise = np.diag([4.0, 9.0])
    expected = textbook.condition(mean, cov, rows, rows[:, :2] @ off, noise)
    heard(belief, {"kind": kinds.POSITION, "x": mean[0] + off[0], "y": mean[1] + off[1],
                   "axis": 0.4, "variance": (4.0, 9.0)})  # fmt: skip
    np.testing.assert_allclose(belief.hyp[0].mu, expected[0], atol=1e-9 * np.max(UNITS))
    np.testing.assert_allclose(belief.hyp[0].cov, expected[1], atol=1e-9)
    assert belief.state.log_evidence[0] == pytest.approx(expected[2])


def test_a_share_of_a_reading_is_worth_that_share_of_its_information():
    one, other = belief_on(ROADS, [On(0, 50.0)]), belief_on(ROADS, [On(0, 50.0)])
    prior = one.hyp[0].cov[D, D]
    heard(one, {"kind": kinds.LATERAL, "value": 0.1, "variance": (0.25, 0.25), "share": 0.2})
    heard(other, {"kind": kinds.LATERAL, "value": 0.1, "variance": (1.25, 1.25)})
    assert one.hyp[0].cov[D, D] == other.hyp[0].cov[D, D] < prior
    assert one.hyp[0].mu[D] == other.hyp[0].mu[D]


def test_a_range_tells_roads_apart_and_one_that_fits_neither_tells_nothing():
    belief = belief_on(ROADS, [On(0, 50.0, 0.5), On(2, 50.0, 0.5)])
    x, y = belief.hyp[0].mu[:2]
    row = {"kind": kinds.RANGE, "x": x, "y": y - 40.0, "value": 40.0, "variance": (1.0, 1.0)}
    before = belief.hyp[0].mu.copy()
    heard(belief, row | {"value": 4000.0})
    np.testing.assert_allclose(weights(belief), [0.5, 0.5], atol=1e-3)
    np.testing.assert_allclose(belief.hyp[0].mu, before, atol=1e-2)
    heard(belief, row)
    assert weights(belief)[0] > 0.999


def test_a_sensor_that_never_fits_is_left_out_and_comes_back_when_it_fits():
    belief = belief_on(ROADS, [On(0, 50.0)])
    wrong = {"kind": kinds.HEADING, "value": belief.hyp[0].mu[H] + 2.0, "variance": (1e-3, 1e-3)}
    heard(belief, *[wrong] * 20)
    sensor = belief.state[0].sensors[0]
    assert (sensor.heard, sensor.misfits, sensor.refused) == (20.0, 20.0, 1)
    assert sensor.withheld >= 12.0
    heard(belief, *[wrong | {"value": belief.hyp[0].mu[H]}] * 20)
    assert belief.state[0].sensors[0].refused == 0


def test_a_sensor_that_has_just_been_wrong_is_doubted():
    """One misfit scores 2, the fit behind it takes 1 off: twice the variance."""
    one, other = belief_on(ROADS, [On(0, 50.0)]), belief_on(ROADS, [On(0, 50.0)])
    off = {"kind": kinds.LATERAL, "value": 1e6, "variance": (0.25, 0.25)}
    heard(one, off, off | {"value": one.hyp[0].mu[D] + 0.1})
    double = off | {"value": other.hyp[0].mu[D] + 0.1, "variance": (0.5, 0.5)}
    heard(other, double)
    assert one.hyp[0].cov[D, D] == pytest.approx(other.hyp[0].cov[D, D], rel=1e-6)


def test_a_speed_observes_the_odometers_scale_or_the_speed_itself():
    belief = belief_on(ROADS, [On(0, 50.0)])
    belief.state.odometer_speed = 10.0
    heard(belief, {"kind": kinds.SPEED, "value": 10.1, "variance": (1e-8, 1.0)})
    assert belief.hyp[0].mu[K] == pytest.approx(1.01, abs=1e-4)
    belief = belief_on(ROADS, [On(0, 50.0)])
    belief.hyp[0].mu[K], belief.hyp[0].cov[K, K] = 8.0, 4.0
    heard(belief, {"kind": kinds.SPEED, "value": 9.0, "variance": (1e-8, 1.0)}, mode=CLOCK)
    assert belief.hyp[0].mu[K] == pytest.approx(9.0, abs=1e-4)


def test_an_attribute_weighs_roads_by_their_class_where_the_vehicle_is_on_them():
    """Edge 0 is of class 0 in its second half; the others are of the last class."""
    edges = len(ROADS.edges)
    first = np.arange(edges + 1, dtype=np.int32) + (np.arange(edges + 1) > 0)
    half = 0.5 * ROADS.edges.length[0]
    start = np.zeros(edges + 1)
    start[1] = half
    classes = np.full((1, edges + 1), kinds.CLASSES - 1, np.uint8)
    classes[0, 1] = 0
    likelihoods = np.log([0.8] + [0.2] * (kinds.CLASSES - 1))
    row = {"kind": kinds.ATTRIBUTE, "log_likelihood": likelihoods}
    for along, share in ((half + 30.0, 0.8), (half, 0.5), (half - 30.0, 0.2)):
        belief = belief_on(ROADS, [On(0, along, 0.5), On(2, along, 0.5)])
        heard(belief, row, first=first, start=start, classes=classes)
        assert weights(belief)[0] == pytest.approx(share / (share + 0.2), abs=1e-3)
    belief = belief_on(ROADS, [On(0, half + 30.0, 0.5), On(-1, half, 0.5)])
    heard(belief, row, first=first, start=start, classes=classes)
    assert weights(belief)[0] == pytest.approx(0.8)
