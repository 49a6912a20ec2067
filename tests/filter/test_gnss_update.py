"""What a receiver is worth: the scale of its errors, its jumps, its faults, its speed."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from oracles import textbook
from oracles.compiled import compiled
from scenes import On, belief_on, context, living, network, straight_road
from strategies import UNITS, random_gaussian, seeds
from whichroad._compile import Matrix, Vector, kernel
from whichroad.filter.gaussian import condition
from whichroad.filter.gnss.bias import age_receiver
from whichroad.filter.gnss.noise import _average_energy, update_root
from whichroad.filter.gnss.position import Axes, innovations, observe_position, observe_rate
from whichroad.filter.slow_states import age_bias
from whichroad.filter.state import GX, GY, OFF_ROAD, Belief, Context, K, N, X, Y, normalise
from whichroad.settings import Settings

SET = Settings()
ROAD = network(straight_road())
TIME, GATE = SET.gnss_time, SET.gnss_gate
SECONDS = 600  # of a stream of fixes, one a second
CTX = context(ROAD)
FACTORS = ("gnss_factor", "innovation_factor", "windowed_factor", "bias_factor")
LEAST = 1.0 / (1.0 + SET.gnss_white_ratio**2)  # of variances
GAIN, BIAS_GAIN = (1.0 - math.exp(-1.0 / t) for t in (SET.gnss_adapt_time, 300.0))

ellipses = st.tuples(st.floats(1.0, 9.0), st.floats(1.0, 9.0), st.floats(-4.0, 4.0))


def average_energy(belief: Belief, ctx: Context, fix: np.ndarray, *numbers: float) -> None:
    """Average the energy of a fix's innovations, which are found first."""
    innovations(belief, ctx, fix, Axes(math.cos(fix[4]), math.sin(fix[4]), 0.0, 0.0))
    _average_energy(belief, ctx, fix, *numbers)


def turned(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def root_of(major: float, minor: float, angle: float) -> np.ndarray:
    """Symmetric root of an ellipse's covariance, (2, 2)."""
    return turned(angle) @ np.diag([major, minor]) @ turned(angle).T


def flat(root: np.ndarray) -> np.ndarray:
    """xx, xy, yy, as the kernels keep it."""
    return root[[0, 0, 1], [0, 1, 1]]


def receiver_on(places: list[On], scale: float = 1.0) -> Belief:
    """A belief whose receiver is `scale` times worse (in variance) than it says."""
    belief = belief_on(ROAD, places)
    for name in FACTORS:
        belief.state[name] = scale
    return belief


def factors(belief: Belief) -> list[float]:
    """The learnt factors on reported variances."""
    return [float(belief.state[name][0]) for name in FACTORS]


def random_receiver(seed: int, n: int, scale: float = 1.0) -> Belief:
    """Hypotheses off the roads that are correlated in every state."""
    rng = np.random.default_rng(seed)
    belief = receiver_on([On(OFF_ROAD, p=float(p)) for p in rng.dirichlet(np.ones(n))], scale)
    for i in range(n):
        belief.hyp["mu"][i], belief.hyp["cov"][i] = random_gaussian(rng)
    return belief


def axes_of(fix: np.ndarray, white: float = 0.5) -> Axes:
    """A fix in the axes of its ellipse; `white` is its white sigma over the reported one."""
    return Axes(math.cos(fix[4]), math.sin(fix[4]), *(white * fix[2:4]) ** 2)


def density(innovation: np.ndarray, variance: np.ndarray) -> float:
    """Of two independent normal numbers, but for a constant."""
    return float(np.exp(-0.5 * (innovation**2 / variance).sum()) / np.sqrt(variance.prod()))


@given(seeds, ellipses, st.floats(1.0, 9.0), st.floats(0.0, 1.0))
def test_the_factor_is_learnt_from_the_expected_energy_of_the_error(seed, ellipse, scale, drifted):
    """The equations of the kernel in matrices, averaged over two hypotheses by their worth."""
    belief = random_receiver(seed, 2, scale)
    belief.hyp.weight[:2] = 0.3, 0.7
    before = np.random.default_rng(seed).normal(0.0, 0.5, 2)
    belief.state.innovation_mean[0] = before
    fix = np.array([*np.random.default_rng(seed).normal(0.0, 9.0, 2), *ellipse])
    s, white = root_of(*ellipse) * math.sqrt(scale), 0.5 * math.sqrt(scale)
    axes = turned(ellipse[2]).T
    rows = np.zeros((2, N))
    rows[:, [X, Y]], rows[:, [GX, GY]] = axes, axes @ s
    slow = rows[:, [GX, GY]]
    noise = (white * np.array(ellipse[:2])) ** 2 + drifted * (slow**2).sum(axis=1)
    worth, parts, sides = [], [], []
    for hyp in living(belief):
        mean, cov = hyp["mu"], hyp["cov"]
        variance = np.diag(rows @ cov @ rows.T) + noise
        gamma = cov[np.ix_([GX, GY], [GX, GY])]
        share = np.minimum((np.diag(slow @ gamma @ slow.T) + noise) / variance, 1.0).mean()
        innovation = axes @ fix[:2] - rows @ mean
        side = innovation / np.sqrt(variance)
        drift = ((0.8 * before + 0.2 * side) ** 2).sum() * (1.0 + 0.8) / (1.0 - 0.8)
        error = (mean[[GX, GY]] ** 2).sum()
        energy = 1.0 if error > 36.0 else min(0.5 * (error + np.trace(gamma)), 9.0)
        seen = [1.0 + share * (min(x / 2.0, 9.0) - 1.0) for x in ((side**2).sum(), drift)]
        worth.append(hyp.weight * density(innovation, variance))
        parts.append([*seen, energy])
        sides.append(side)
    assume(sum(worth) > 1e-200)
    expected = scale * (1.0 + [0.1, 0.1, 0.02] * (np.average(parts, 0, worth) - 1.0))
    belief.state.bias_root[0] = flat(s)
    average_energy(belief, CTX, fix, white, drifted, 0.1, 0.02)
    total, *learnt = factors(belief)
    assert learnt == pytest.approx(expected, rel=1e-9)
    assert total == pytest.approx(max(*expected, LEAST), rel=1e-9)
    wander = 0.8 * before + 0.2 * np.average(sides, 0, worth)
    assert belief.state.innovation_mean[0] == pytest.approx(wander, rel=1e-9, abs=1e-12)


@given(st.floats(0.0, 2.0), st.floats(10.1, 1e4))
def test_quiet_fixes_teach_nothing_once_a_vehicle_has_stood_for_ten_seconds(away, stood):
    belief = receiver_on([On(0, 500.0)], 2.0)
    belief.state[0].standing = stood
    belief.state.bias_root[0] = 3.0, 0.0, 3.0
    before = factors(belief)
    fix = np.array([500.0 + away, 0.0, 3.0, 3.0, 0.0])
    average_energy(belief, CTX, fix, 0.5, 0.0, 0.1, 0.0)
    assert factors(belief) == before


@given(st.floats(6.1, 40.0), st.floats(-math.pi, math.pi))
def test_the_error_of_a_lost_receiver_is_not_taken_for_its_usual_bias(size, way):
    belief = receiver_on([On(0, 500.0)], 2.0)
    belief.hyp["mu"][0, [GX, GY]] = size * math.cos(way), size * math.sin(way)
    belief.state.bias_root[0] = 3.0, 0.0, 3.0
    fix = np.array([500.0, 0.0, 3.0, 3.0, 0.0])
    average_energy(belief, CTX, fix, 0.5, 0.0, 0.1, 0.1)
    assert belief.state[0].bias_factor == pytest.approx(2.0)


@kernel
def _observe_stream(
    belief: Belief, ctx: Context, fixes: Matrix, seen: Matrix, row: Vector, scale: Vector
) -> None:
    """Scale (of sigmas) over a stream of fixes, one a second.

    Args:
        belief: One hypothesis, off the roads.
        ctx: The constants.
        fixes: Along the axes of the plane, (n, 5).
        seen: The place as something else sees it to a metre, (n, 2), or nothing, (0, 2).
        row: Room for an observation row, (N,).
        scale: The result, (n,).
    """
    state = belief.state[0]
    mean, cov = belief.hyp[0].mu, belief.hyp[0].cov
    for k in range(len(fixes)):
        fix, white = fixes[k], 0.5 * math.sqrt(state.gnss_factor)
        state.moving = 1.0 if k > 0 else 0.0
        age_receiver(belief, ctx, TIME, True)
        update_root(belief, fix, state.gnss_factor, 1.0 if k > 0 else -1.0)
        innovations(belief, ctx, fix, Axes(1.0, 0.0, 0.0, 0.0))
        _average_energy(belief, ctx, fix, white, 0.0, GAIN, BIAS_GAIN)
        normalise(belief)
        axes = Axes(1.0, 0.0, (white * fix[2]) ** 2, (white * fix[3]) ** 2)
        observe_position(belief, ctx, fix, axes, GATE, True, 0.0)
        for axis in range(2 if len(seen) > 0 else 0):
            cov[axis, axis] += 0.1
            row[:] = 0.0
            row[axis] = 1.0
            condition(mean, cov, row, seen[k, axis] - mean[axis], 1.0, 1.0)
        scale[k] = math.sqrt(state.gnss_factor)


observe_stream = compiled(_observe_stream)  # of 115,000 fixes


def learnt(seed: int, under: float, anchored: bool) -> np.ndarray:
    """Scale (of sigmas) over a stream of fixes whose errors are `under` times the reported.

    The vehicle's motion is known; where it is anchored, so is its place, to a metre.
    """
    rng = np.random.default_rng(seed)
    keep, reported = math.exp(-1.0 / TIME), 3.0
    place, slow = rng.normal(0.0, 5.0, 2), rng.normal(0.0, 1.0, 2)
    drawn = rng.normal(size=(SECONDS, 6 if anchored else 4))
    fixes, scale = np.full((SECONDS, 5), reported), np.zeros(SECONDS)
    fixes[:, 4] = 0.0
    for fix, (slower, white) in zip(fixes, drawn[:, :4].reshape(-1, 2, 2), strict=True):
        slow = keep * slow + math.sqrt(1.0 - keep**2) * slower
        fix[:2] = place + under * reported * (slow + 0.5 * white)
    seen = place + drawn[:, 4:] if anchored else np.zeros((0, 2))
    belief = receiver_on([On(OFF_ROAD, sigma=5.0)])
    observe_stream(belief, CTX, fixes, seen, np.zeros(N), scale)
    return scale


@pytest.mark.parametrize("anchored", [True, False])
@pytest.mark.parametrize("under", [1.0, 1.5, 2.0, 3.0])
def test_a_receiver_that_under_reports_is_found_out_and_an_honest_one_is_believed(under, anchored):
    """From five time constants on, over 24 streams.

    The greater of two averages with standard deviations a = sqrt(η/2) = 0.11 and
    b = sqrt(T/2T') = 0.26 of λ² (of the error's energy, which is correlated over T = 40 s,
    over T' = 300 s) is greater than the truth by (a + b)/sqrt(2 π) = 0.15 at most, so that
    λ is by 7 %; the third, of innovations that stay on one side, lies between these two and
    is correlated with both.  With three standard errors of the mean of 24, 0.14/sqrt(24) each,
    16 %.
    """
    scale = np.array([learnt(seed, under, anchored)[200:] for seed in range(24)])
    assert under * (1.0 - 0.09) <= scale.mean() <= under * (1.0 + 0.16)


def test_a_receiver_that_is_better_than_it_says_is_taken_at_its_word():
    """Slow and white error together are then what it reports."""
    scale = learnt(0, 0.2, True)
    assert (scale >= math.sqrt(LEAST)).all()
    assert scale[200:] == pytest.approx(math.sqrt(LEAST))


@given(seeds, ellipses, st.floats(0.0, 1e4), st.floats(0.0, 1.0), st.floats(1.0, 400.0))
def test_whatever_a_fix_says_the_factor_stays_within_its_limits(seed, ellipse, away, gain, scale):
    belief = random_receiver(seed, 3, scale)
    belief.state.bias_root[0] = flat(root_of(*ellipse))
    for fix in (np.array([away, 0.0, *ellipse]), np.array([0.0, 0.0, *ellipse])):
        average_energy(belief, CTX, fix, 0.5, 0.0, gain, gain)
        assert LEAST <= belief.state[0].gnss_factor <= 20.0**2


def settled(ellipse: tuple[float, float, float]) -> Belief:
    """A vehicle whose fixes have told it the same place for a while."""
    belief = receiver_on([On(0, 500.0)])
    for _ in range(10):
        see(belief, (500.0, 0.0), ellipse)
    return belief


def see(belief: Belief, place: tuple[float, float], ellipse: tuple[float, float, float]) -> float:
    normalise(belief)
    return see_fix(belief, np.array([*place, *ellipse]), True)


def see_fix(belief: Belief, fix: np.ndarray, jumps: bool) -> float:
    """Observe a fix, the bias scaled by its own ellipse; returns its chi-square."""
    belief.state.bias_root[0] = flat(root_of(*fix[2:]))
    return observe_position(belief, CTX, fix, axes_of(fix), 9.0, jumps, 0.0)


@given(ellipses, st.floats(-math.pi, math.pi))
def test_a_jump_of_the_receiver_is_the_receivers_and_its_return_restores_all(ellipse, way):
    """200 m away and back: the place is kept, the slow error goes there and comes back."""
    belief = settled(ellipse)
    mean, cov = belief.hyp["mu"][0], belief.hyp["cov"][0]
    place, error = mean[:2].copy(), mean[[GX, GY]].copy()
    sigma = np.sqrt(np.diag(cov)[:2])
    jump = 200.0 * np.array([math.cos(way), math.sin(way)])
    for target in (jump, np.zeros(2)):
        at = (500.0 + target[0], target[1])
        assert see(belief, at, ellipse) > 9.0
        assert (np.abs(mean[:2] - place) < 0.1 * sigma).all()
        expected = error + np.linalg.solve(root_of(*ellipse), target)
        np.testing.assert_allclose(mean[[GX, GY]], expected, atol=0.5)
        assert see(belief, at, ellipse) < 9.0  # it is where it was said to be
        assert (np.abs(mean[:2] - place) < 0.1 * sigma).all()
    np.testing.assert_allclose(mean[[GX, GY]], error, atol=0.2)


@given(ellipses, st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
def test_within_the_gate_it_does_not_matter_who_would_be_blamed(ellipse, x, y):
    fix = np.array([500.0 + x, y, *ellipse])
    after = []
    for jumps in (True, False):
        belief = receiver_on([On(0, 500.0, 0.6), On(1, 3500.0, 0.4)])
        assume(see_fix(belief, fix, jumps) <= 9.0)
        after.append(living(belief))
    for name in ("mu", "cov", "log_weight"):
        np.testing.assert_array_equal(after[0][name], after[1][name])


@np.errstate(divide="ignore", invalid="ignore")  # as in compiled code
def grow_older(belief: Belief, time: float) -> None:
    belief.state[0].moving = time
    age_receiver(belief, CTX, TIME, True)


@given(seeds, st.floats(0.0, 3.0), st.floats(0.0, 300.0))
def test_a_small_error_wanders_as_receivers_errors_do_and_costs_nothing(seed, size, time):
    belief = random_receiver(seed, 1)
    hyp = belief.hyp[0]
    hyp["mu"][[GX, GY]] = size * math.cos(seed), size * math.sin(seed)
    mean, cov = hyp["mu"].copy(), hyp["cov"].copy()
    before = hyp.log_weight
    age_bias(mean, cov, math.exp(-time / TIME))
    grow_older(belief, time)
    np.testing.assert_allclose(hyp["mu"] / UNITS, mean / UNITS, atol=1e-12)
    np.testing.assert_allclose(hyp["cov"], cov, atol=1e-12)
    assert hyp.log_weight == before


@given(st.floats(7.0, 100.0), st.floats(-math.pi, math.pi), st.integers(1, 40))
def test_that_a_lost_receiver_is_still_lost_costs_a_share_for_each_second(size, way, seconds):
    """Of two hypotheses the one whose receiver is lost loses exp(-t/T), in whatever steps."""
    belief = receiver_on([On(0, 500.0, 0.5), On(1, 3500.0, 0.5)])
    mean, log_weight = belief.hyp["mu"][0], belief.hyp.log_weight
    mean[[GX, GY]] = size * math.cos(way), size * math.sin(way)
    for _ in range(seconds):
        if math.hypot(*mean[[GX, GY]]) <= 6.0:
            break
        grow_older(belief, 1.0)
    else:
        odds = log_weight[0] - log_weight[1]
        assert odds == pytest.approx(-seconds / SET.gnss_fault_time)


@given(st.floats(7.0, 100.0))
def test_a_lost_receiver_does_not_come_back_as_small_errors_do(size: float):
    """At thirty sigmas ten times more slowly: what it errs in a second is always the same."""
    belief = receiver_on([On(0, 500.0)])
    mean = belief.hyp["mu"][0]
    mean[GX] = size
    grow_older(belief, 1.0)
    assert size - mean[GX] == pytest.approx(3.0 / TIME, rel=0.01)


@given(seeds, st.floats(2.0, 40.0), st.floats(-2.0, 2.0))
def test_a_doppler_speed_is_the_textbook_s_update_on_the_odometer_s_scale(seed, speed, more):
    belief = random_receiver(seed, 1)
    hyp = belief.hyp[0]
    hyp["cov"] *= 1e-2
    mean, cov = hyp["mu"].copy(), hyp["cov"].copy()
    before = hyp.log_weight
    row = np.zeros((1, N))
    row[0, K] = speed
    seen = speed * mean[K] + more * 0.3
    exact = textbook.condition(mean, cov, row, seen - row @ mean, np.array([[0.09]]))
    observe_rate(belief, CTX, speed, seen, 0.09)
    np.testing.assert_allclose(hyp["mu"] / UNITS, exact[0] / UNITS, atol=1e-9)
    np.testing.assert_allclose(hyp["cov"], exact[1], atol=1e-9)
    assert hyp.log_weight - before == pytest.approx(exact[2], abs=1e-9)


def test_a_doppler_speed_that_the_best_hypothesis_does_not_explain_is_left_out_for_all():
    belief = receiver_on([On(0, 500.0, 0.7), On(1, 3500.0, 0.3)])
    belief.hyp["mu"][:2, K] = 1.0, 1.5  # the lighter one would explain it
    before = living(belief).copy()
    observe_rate(belief, CTX, 10.0, 15.0, 0.09)
    for name in ("mu", "cov", "log_weight"):
        np.testing.assert_array_equal(living(belief)[name], before[name])
