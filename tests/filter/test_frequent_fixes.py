"""Fixes ten times a second: none of them fits badly, but a second of them may."""

import numpy as np

from scenes import On, belief_on, context, network, straight_road
from whichroad.filter.gnss.frequent_fixes import second_misfits
from whichroad.filter.gnss.position import Axes, innovations, observe_given
from whichroad.filter.state import GX, Belief, normalise

ROAD = network(straight_road())
CTX = context(ROAD)
GATE, SIGMA, STEP = 9.0, 3.0, 0.1
AXES = Axes(1.0, 0.0, (0.5 * SIGMA) ** 2 / STEP, (0.5 * SIGMA) ** 2 / STEP)


def standing() -> Belief:
    """A vehicle at 500 m, known to a metre, and its receiver."""
    belief = belief_on(ROAD, [On(0, 500.0, sigma=1.0)])
    belief.state.bias_root[0] = SIGMA, 0.0, SIGMA
    normalise(belief)
    return belief


def fixes_until_told(creep: float, white: float, seconds: float, step: float = STEP) -> int:
    """Fixes that creep away (m/s), and how many came until they jumped together; 0: never."""
    belief, random = standing(), np.random.default_rng(1)
    for k in range(round(seconds / STEP)):
        fix = np.array([500.0 + creep * k * STEP, 0.0, SIGMA, SIGMA, 0.0])
        fix[:2] += white * random.normal(size=2)
        innovations(belief, CTX, fix, AXES)
        if second_misfits(belief, AXES, GATE, step):
            return k + 1
        innovations(belief, CTX, fix, AXES)
        assert observe_given(belief, CTX, fix, AXES, GATE, True, 0.0) < GATE
        normalise(belief)
    return 0


def test_a_receiver_that_creeps_away_is_told_though_each_fix_fits():
    assert 0 < fixes_until_told(10.0, 0.0, 6.0) < 40


def test_white_noise_is_not():
    assert fixes_until_told(0.0, 0.5 * SIGMA, 60.0) == 0


def test_fixes_a_second_apart_are_asked_by_themselves():
    assert fixes_until_told(4.0, 0.0, 1.0, step=1.0) == 0


def test_what_they_differ_by_is_the_receivers_error():
    belief = standing()
    before = float(belief.hyp[0]["cov"][GX, GX])
    fix = np.array([530.0, 0.0, SIGMA, SIGMA, 0.0])
    innovations(belief, CTX, fix, AXES)
    told = [second_misfits(belief, AXES, GATE, STEP) for _ in range(20)]
    assert any(told)
    assert belief.hyp[0]["cov"][GX, GX] > before
