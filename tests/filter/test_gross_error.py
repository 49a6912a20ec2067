"""A fine receiver that is far from the likeliest place: its place is offered, and told."""

import math

import numpy as np
import pytest

from scenes import On, belief_on, context, network, straight_road
from strategies import random_gaussian
from whichroad.filter.gnss.gross_error import _move_to_fix, heed_gross_error, takes_back
from whichroad.filter.gnss.position import Axes, innovations
from whichroad.filter.gnss.separation import cover_gross_error
from whichroad.filter.state import CLOCK, GX, GY, MOTION, RECEIVER, Belief, N, X, Y, normalise
from whichroad.filter.summary.estimate import new_output

ROAD = network(straight_road())
CTX = context(ROAD)
SIGMA, OFF = 0.02, 60.0  # m; sigmas
AXES = Axes(1.0, 0.0, 1e-4, 1e-4)
FAULT_TIME = float(CTX.par[0].gnss_fault_time)


def believing(error: float) -> Belief:
    """A vehicle whose receiver is taken to err by so many sigmas to the east."""
    belief = belief_on(ROAD, [On(0, 500.0, sigma=0.05)])
    state, hyp = belief.state[0], belief.hyp[0]
    state.bias_root[:] = SIGMA, 0.0, SIGMA
    state.scale = 1.0
    hyp.mu[GX] = error
    hyp.cov[GX, GX] = hyp.cov[GY, GY] = 1.0
    normalise(belief)
    return belief


def met(belief: Belief, dx: float, time: float) -> bool:
    x, y = belief.hyp[0].mu[X], belief.hyp[0].mu[Y]
    innovations(belief, CTX, np.array([x + dx, y, SIGMA, SIGMA, 0.0]), AXES)
    return bool(takes_back(belief, AXES, time))


def test_a_place_at_the_fixes_is_the_old_one_and_the_error_together():
    """The place is p' = p + S γ − S γ', with γ' a usual error."""
    belief = believing(0.0)
    hyp, root = belief.hyp[0], np.array([[0.3, 0.1], [0.1, 0.2]])
    belief.state[0].bias_root[:] = root[0, 0], root[0, 1], root[1, 1]
    mean, cov = random_gaussian(np.random.default_rng(1))
    hyp.mu[:], hyp.cov[:] = mean, cov
    forget = np.eye(N)
    forget[[X, Y], GX], forget[[X, Y], GY] = root[:, 0], root[:, 1]
    forget[[GX, GY]] = 0.0
    anew = np.zeros((N, 2))
    anew[[X, Y]], anew[[GX, GY]] = -root, np.eye(2)
    _move_to_fix(hyp, belief.state[0])
    np.testing.assert_allclose(hyp.mu, forget @ mean, atol=1e-12)
    np.testing.assert_allclose(hyp.cov, forget @ cov @ forget.T + anew @ anew.T, atol=1e-12)


def test_a_jump_back_takes_back_a_jump_that_was_believed_and_no_other():
    belief = believing(0.0)
    assert not met(belief, 1.0, 100.0)
    assert not met(belief, 1.0, 110.0)
    assert met(belief, -1.1, 130.0)
    assert not met(belief, 1.1, 1000.0)  # too long ago
    blaming = believing(-OFF)
    met(blaming, 1.0, 100.0)
    assert not met(blaming, -1.0, 130.0)


def test_the_longer_an_error_lasts_the_more_the_fixes_are_believed():
    belief = believing(OFF)
    assert not met(belief, 1.0, 100.0)
    for time in (101.0, 110.0):
        heed_gross_error(belief, CTX, time)
    gross = belief.state[0].separation.gross
    assert gross.p == pytest.approx(1.0 / (1.0 + 9.0 * math.exp(-10.0 / FAULT_TIME)))
    assert belief.state[0].count == 1
    heed_gross_error(belief, CTX, 121.0)
    assert belief.state[0].count == 2
    at_fix = belief.hyp[1]
    assert (belief.hyp[0].blames, at_fix.blames) == (RECEIVER, MOTION)
    assert at_fix.mu[X] - belief.hyp[0].mu[X] == pytest.approx(OFF * SIGMA)
    assert math.exp(at_fix.log_weight - belief.hyp[0].log_weight) == pytest.approx(
        gross.p / (1.0 - gross.p)
    )
    normalise(belief)
    heed_gross_error(belief, CTX, 150.0)
    assert belief.state[0].count == 2  # one lives there already


def test_an_error_of_a_few_sigmas_or_of_a_coarse_receiver_is_none():
    usual, coarse = believing(4.0), believing(OFF)
    coarse.state[0].bias_root[:] = 3.0, 0.0, 3.0
    for belief in (usual, coarse):
        heed_gross_error(belief, CTX, 1000.0)
        assert belief.state[0].separation.gross.p == 0.0


def test_of_any_receiver_the_fixes_are_believed_sooner_or_later_where_no_turns_are_measured():
    """The map's line may have turned elsewhere than the vehicle."""
    belief = believing(OFF)
    belief.state[0].bias_root[:] = 3.0, 0.0, 3.0
    belief.state[0].mode = CLOCK
    for time in (100.0, 110.0):
        heed_gross_error(belief, CTX, time)
    p = belief.state[0].separation.gross.p
    assert p == pytest.approx(1.0 / (1.0 + 9.0 * math.exp(-10.0 / FAULT_TIME)))


@pytest.mark.parametrize("error", [0.0, OFF])
def test_in_hindsight_the_place_of_fixes_is_covered_unless_the_vehicle_is_there(error: float):
    """Smoothed, the receiver's error is that of then, in metres."""
    belief = believing(OFF)
    heed_gross_error(belief, CTX, 110.0)
    state, top = belief.state[0], belief.hyp[0]
    state.hindsight, top.mu[GX], state.bias_root[:] = 1, error, 0.0
    row = new_output(1, False).rows[0]
    row.x, row.y, row.heading, row.protection_level = top.mu[X], top.mu[Y], 0.0, 0.5
    cover_gross_error(state, top, row, 1e-3)
    assert (row.protection_level > OFF * SIGMA) == (error > 0.0)
