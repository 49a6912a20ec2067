"""F and Q of a link of the smoother are those of the filter.

F of the filter is the derivative of its mean over all epochs of the link, by central differences;
its Q is the covariance that a state without a variance has afterwards.
"""

from typing import NamedTuple

import numpy as np
import pytest

from scenes import network
from scenes.links import Link, Motion, Moved, motion
from strategies import random_gaussian
from whichroad.filter.hypotheses.lane_offset import change_lane, kept_lane
from whichroad.filter.lookback.link_motion import LINK_MODEL
from whichroad.filter.lookback.link_road import move_with_lane
from whichroad.filter.state import CLOCK, DISTANCE, GX, GY, WHEELS, D, H, N, X, Y

STRAIGHT = [[0.0, 0.0], [1000.0, 0.0]]
BENT, SMOOTH = (  # radius 500 m, vertices 10 m apart; 1 m, so that its chord turns evenly
    [[x, 1e-3 * (x - 250.0) ** 2] for x in np.linspace(0.0, 600.0, n)] for n in (61, 601)
)
CURVATURE = 1e-7  # 1/m²; the plane's scale is 1.009 where the link begins
#               X     Y     H     K      B     D    MX   MY   GX   GY
START = [300.0, -1.75, 0.02, 1.0, 1e-4, 1.75, 0.5, -0.3, 0.1, -0.2, 0.0, 0.0]
SIGMAS = np.array([1.0, 1.0, 0.02, 0.01, 3e-4, *[1.0] * 7])
RATE, DRIFT, SPARE = 3, 4, 10

HALF = np.arange(10) < 5


class Case(NamedTuple):
    """A link."""

    mode: int
    motion: Motion
    off_road: bool = False
    course: bool = False
    line: object = STRAIGHT
    curvature: float = 0.0


def both(case: Case) -> tuple[Moved, Moved, np.ndarray]:
    """The link by the filter, by the smoother, and sigmas of the state."""
    mean = np.array(START)
    if case.mode == CLOCK:
        mean[RATE] = 9.0  # m/s
    if case.mode != WHEELS:
        mean[DRIFT] = 0.0  # no heading drift without a heading sensor
    if case.line is not STRAIGHT:
        mean[:3] = 300.0, 2.5 - 1.75, 0.1
    scale = 1.0 + case.curvature * float(mean[0] ** 2 + mean[1] ** 2)
    link = Link(
        network([case.line], curvature=case.curvature), case.motion, case.mode, mean,
        off_road=case.off_road, course=case.course, scale=scale,
    )  # fmt: skip
    sigmas = SIGMAS.copy()
    if case.mode == CLOCK:
        sigmas[RATE] = 1.0
    step = 0.05 * sigmas
    if case.mode != WHEELS:
        sigmas[DRIFT] = 0.0
    sigmas[SPARE:] = 0.0
    return link.filtered(step), link.retraced(step), sigmas


AT_10_HZ, AT_1_HZ = (10, 0.1, 1.0), (1, 1.0, 10.0)
CASES = {
    "wheels": Case(WHEELS, motion(*AT_10_HZ)),
    "wheels in a turn": Case(WHEELS, motion(*AT_10_HZ, 0.05)),
    "wheels once a second": Case(WHEELS, motion(*AT_1_HZ)),
    "wheels in a wide plane": Case(WHEELS, motion(*AT_10_HZ, 0.05), curvature=CURVATURE),
    "silent wheels": Case(WHEELS, motion(*AT_10_HZ, valid=False)),
    "silent wheels in a turn": Case(WHEELS, motion(*AT_10_HZ, 0.05, valid=False)),
    "silent wheels, one epoch": Case(WHEELS, motion(*AT_1_HZ, valid=False)),
    "wheels that fall silent": Case(WHEELS, motion(*AT_10_HZ, valid=HALF)),
    "distance": Case(DISTANCE, motion(*AT_10_HZ)),
    "distance in a bend": Case(DISTANCE, motion(*AT_10_HZ), line=BENT),
    "distance off the roads": Case(DISTANCE, motion(*AT_10_HZ), off_road=True),
    "distance in a wide plane": Case(DISTANCE, motion(*AT_10_HZ), curvature=CURVATURE),
    "silent odometer": Case(DISTANCE, motion(*AT_10_HZ, valid=False)),
    "time": Case(CLOCK, motion(10, 0.1, 0.0, valid=False)),
    "time in one step": Case(CLOCK, motion(1, 1.0, 0.0, valid=False)),
    "time in a bend": Case(CLOCK, motion(10, 0.1, 0.0, valid=False), line=BENT),
    "distance, a course heard": Case(DISTANCE, motion(*AT_10_HZ), course=True),
    "distance in a bend, a course heard": Case(DISTANCE, motion(*AT_10_HZ), line=BENT, course=True),
    "time, a course heard": Case(CLOCK, motion(10, 0.1, 0.0, valid=False), course=True),
    "time in a bend, a course heard": Case(
        CLOCK, motion(10, 0.1, 0.0, valid=False), line=SMOOTH, course=True
    ),
    "time in one step, a course heard": Case(
        CLOCK, motion(1, 1.0, 0.0, valid=False), line=SMOOTH, course=True
    ),
    "time off the roads": Case(CLOCK, motion(10, 0.1, 0.0, valid=False), off_road=True),
}


EACH = pytest.mark.parametrize("name", CASES)


@EACH
def test_the_mean_of_a_link_is_the_filter_s(name: str):
    filtered, retraced, _ = both(CASES[name])
    assert np.abs((retraced.mean - filtered.mean) / SIGMAS).max() <= 0.02


@EACH
def test_f_of_a_link_is_the_product_of_the_filter_s(name: str):
    """To 1 % in units of the states' sigmas."""
    filtered, retraced, sigmas = both(CASES[name])
    off = (retraced.f - filtered.f) * sigmas[None, :] / SIGMAS[:, None]
    assert np.abs(off).max() <= 0.01


@EACH
def test_q_of_a_link_is_what_the_filter_adds_over_it(name: str):
    """To 5 % of the standard deviations added."""
    filtered, retraced, _ = both(CASES[name])
    sigma = np.sqrt(np.diag(filtered.q)) + 1e-6 * SIGMAS
    off = (retraced.q - filtered.q) / np.outer(sigma, sigma)
    assert np.abs(off).max() <= 0.05


def test_what_the_error_of_a_receiver_was_given_is_process_noise():
    link = Link(network([STRAIGHT]), motion(*AT_10_HZ), WHEELS, np.array(START))
    more = link.retraced(0.05 * SIGMAS, freed=4.0).q - link.retraced(0.05 * SIGMAS).q
    expected = np.zeros_like(more)
    expected[GX, GX] = expected[GY, GY] = 4.0
    np.testing.assert_allclose(more, expected, atol=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.24, 0.5])
def test_who_comes_to_a_road_of_other_lanes_is_moved_across_it_as_by_the_filter(turn: float):
    """Mean, F and Q of the lane offset and of the place."""
    old, new, sigma, heading = 0.0, 1.75, 0.6, 0.7
    g = random_gaussian(np.random.default_rng(3))
    kept = kept_lane(turn)
    model = np.zeros(1, LINK_MODEL).view(np.recarray)[0]
    model.scale, model.then_mean[:], model.mu[:] = 1.0, g.mean, g.mean
    model.mu[H] = heading
    model.f[:] = np.eye(N)
    model.f[D, D] = kept
    model.q[D] = (1.0 - kept * kept) * sigma * sigma
    move_with_lane(model, kept, (old, new, sigma))
    q = np.diag(model.q) + model.cov + model.cov.T
    cov = model.f @ g.cov @ model.f.T + q
    tangent = np.cos(heading), np.sin(heading)
    change_lane(g.mean, g.cov, turn, (old, new, sigma), tangent, 1.0)
    np.testing.assert_allclose(model.mu[[X, Y]], g.mean[[X, Y]], atol=1e-9)
    np.testing.assert_allclose(cov, g.cov, atol=1e-9)
