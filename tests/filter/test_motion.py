"""How a Gaussian moves: Jacobians by finite differences, arcs by composition."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles.textbook import jacobian
from strategies import UNITS, Gaussian, gaussians, random_gaussian, seeds
from whichroad.filter.hypotheses.lane_offset import change_lane, redraw_lane
from whichroad.filter.motion import (
    Increment,
    Noise,
    arc_chord,
    driven_unseen,
    extrapolated,
    increment_of,
    predict_plane,
    predict_road,
    turn_by_road,
    wheel_noise,
)
from whichroad.filter.slow_states import age_bias, age_map, decay
from whichroad.filter.state import (
    GX,
    GY,
    MX,
    MY,
    B,
    D,
    H,
    K,
    N,
    U,
    V,
    X,
    Y,
    new_belief,
    new_epochs,
    new_parameters,
)
from whichroad.graph.geometry import wrap

QUIET = Noise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

arcs = st.floats(-8.0, 8.0)
turns = st.floats(-0.6, 0.6)


def move(g: Gaussian, arc: float, turn: float, scale: float = 1.0, noise: Noise = QUIET) -> None:
    predict_plane(g.mean, g.cov, Increment(arc, turn, *arc_chord(arc, turn), arc), scale, noise)


def moved_mean(mean: np.ndarray, arc: float, turn: float, scale: float = 1.0) -> np.ndarray:
    g = Gaussian(mean.copy(), np.eye(N))
    move(g, arc, turn, scale)
    g.mean[H] = mean[H] + wrap(g.mean[H] - mean[H])  # not wrapped, to be differentiated
    return g.mean


def quadratic(f: np.ndarray, p: np.ndarray) -> np.ndarray:
    return f @ p @ f.T / np.outer(UNITS, UNITS)


@given(gaussians, arcs, turns)
def test_moving_by_wheels_carries_the_covariance_by_the_jacobian(g: Gaussian, arc, turn):
    f = jacobian(lambda m: moved_mean(m, arc, turn), g.mean, 1e-4 * UNITS)
    expected = quadratic(f, g.cov)
    move(g, arc, turn)
    ours = g.cov / np.outer(UNITS, UNITS)
    np.testing.assert_allclose(ours, expected, atol=1e-7, rtol=1e-7)
    np.testing.assert_allclose(ours, ours.T, atol=1e-13)


@given(gaussians, arcs, turns)
def test_two_half_arcs_are_one_arc(g: Gaussian, arc, turn):
    g.mean[B] = 0.0  # with drift the half turns are taken at first order
    halves = g.copy()
    move(g, arc, turn)
    move(halves, arc / 2.0, turn / 2.0)
    move(halves, arc / 2.0, turn / 2.0)
    apart = halves.mean - g.mean
    apart[H] = wrap(apart[H])
    np.testing.assert_allclose(apart / UNITS, 0.0, atol=1e-12)


@given(gaussians, arcs, turns, st.integers(1, 6))
def test_the_pieces_of_an_epoch_lie_on_its_arc(g: Gaussian, arc, turn, pieces):
    g.mean[B] = 0.0
    epoch = new_epochs(1)[0]
    epoch.arc, epoch.turn = arc, turn
    epoch.forward, epoch.left = arc_chord(arc, turn)
    cut = g.copy()
    move(g, arc, turn)
    piece = increment_of(epoch, pieces, 0.0)
    for _ in range(pieces):
        predict_plane(cut.mean, cut.cov, piece, 1.0, QUIET)
    apart = cut.mean - g.mean
    apart[H] = wrap(apart[H])
    np.testing.assert_allclose(apart / UNITS, 0.0, atol=1e-12)


@given(st.lists(st.floats(0.0, 5.0), min_size=1, max_size=6))
def test_extrapolated_motion_is_as_uncertain_in_many_epochs_as_in_one(metres: list[float]):
    par = new_parameters()[0]
    par.along_noise, par.lateral_noise, par.heading_noise, par.yaw_bias_noise = 0.1, 0.2, 0.3, 0.4
    total, before = np.zeros(6), 0.0
    for m in metres:
        total += extrapolated(wheel_noise(par, m, 0.0), before, m)
        before += m
    whole = extrapolated(wheel_noise(par, before, 0.0), 0.0, before)
    np.testing.assert_allclose(total, whole, atol=1e-15)


@given(st.lists(st.floats(0.01, 5.0), min_size=1, max_size=6), st.floats(0.0, 20.0))
def test_a_vehicle_that_goes_on_unseen_is_as_unsure_in_many_epochs_as_in_one(seconds, silent):
    none = wheel_noise(new_parameters()[0], 0.0, 0.0)
    total, end = np.zeros(6), silent
    for dt in seconds:
        end += dt
        total += driven_unseen(none, end, dt)
    np.testing.assert_allclose(total, driven_unseen(none, end, end - silent), rtol=1e-9, atol=1e-9)
    sigma = math.sqrt(driven_unseen(none, 5.0, 5.0).along)
    assert 0.4 < sigma / (0.5 * 1.2 * 5.0**2) < 1.0  # from rest, of what 1.2 m/s² drive in 5 s


@given(gaussians, st.floats(0.5, 6.0), turns)
def test_drift_bends_the_path_as_a_finely_cut_one_to_first_order(g: Gaussian, arc, turn):
    """What is left out is of second order in the turn that drifts in: b δs."""
    drift = g.mean[B] * arc
    fine = g.copy()
    move(g, arc, turn)
    for _ in range(64):
        move(fine, arc / 64, turn / 64)
    assert wrap(g.mean[H] - fine.mean[H]) == pytest.approx(0.0, abs=1e-12)
    apart = math.hypot(*(g.mean[:2] - fine.mean[:2]))
    assert apart <= arc * (drift**2 + abs(drift * turn)) + 1e-9


@given(st.floats(-math.pi, math.pi), st.floats(-20.0, 20.0), st.floats(0.9, 1.1))
def test_a_straight_drive_is_the_arc_along_the_heading(heading, arc, kappa):
    mean = np.zeros(N)
    mean[H], mean[K] = heading, kappa
    moved = moved_mean(mean, arc, 0.0)
    assert moved[X] == pytest.approx(kappa * arc * math.cos(heading), abs=1e-12)
    assert moved[Y] == pytest.approx(kappa * arc * math.sin(heading), abs=1e-12)
    assert moved[H] == mean[H]


@given(st.floats(1.0, 30.0), st.floats(-3.0, 3.0).filter(lambda t: abs(t) > 1e-9))
def test_the_chord_joins_two_points_of_a_circle(arc, turn):
    radius = arc / turn
    forward, left = arc_chord(arc, turn)
    assert forward == pytest.approx(radius * math.sin(turn), rel=1e-6, abs=1e-9)
    assert left == pytest.approx(2.0 * radius * math.sin(turn / 2.0) ** 2, rel=1e-6, abs=1e-9)


@given(gaussians, arcs, turns, st.floats(0.9, 1.1))
def test_the_plane_s_scale_stretches_the_way_but_not_its_covariance(g: Gaussian, arc, turn, scale):
    flat = g.copy()
    start = g.mean[[X, Y]].copy()
    move(g, arc, turn, scale)
    move(flat, arc, turn)
    np.testing.assert_allclose(
        g.mean[[X, Y]] - start, scale * (flat.mean[[X, Y]] - start), atol=1e-9
    )
    np.testing.assert_array_equal(g.cov, flat.cov)


@given(gaussians)
def test_noise_along_and_across_turns_with_the_heading(g: Gaussian):
    quiet = g.copy()
    move(g, 0.0, 0.0, noise=Noise(4.0, 1.0, 0.01, 0.02, 0.03, 0.0))
    move(quiet, 0.0, 0.0)
    c, s = math.cos(g.mean[H]), math.sin(g.mean[H])
    turn = np.array([[c, -s], [s, c]])
    added = g.cov - quiet.cov
    np.testing.assert_allclose(added[:2, :2], turn @ np.diag([4.0, 1.0]) @ turn.T, atol=1e-9)
    assert np.diag(added)[[H, K, B]] == pytest.approx([0.01, 0.02, 0.03])


def on_circle(s: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Point and tangent at abscissa s of a circle that begins eastwards at the origin."""
    a = s / radius
    return radius * np.array([math.sin(a), 1.0 - math.cos(a)]), np.array([math.cos(a), math.sin(a)])


@given(seeds, st.floats(20.0, 300.0), st.floats(-20.0, 20.0), st.sampled_from([-1.0, 1.0]))
def test_moving_along_a_bend_carries_the_covariance_by_the_jacobian(seed, radius, odometer, side):
    """On a circle, p = c(s) + n d − m; the linearisation is about its centre line, d = 0."""
    radius *= side
    g = random_gaussian(np.random.default_rng(seed))
    g.mean[D] = 0.0
    s0 = 30.0
    c0, t0 = on_circle(s0, radius)
    m = g.mean[[MX, MY]]
    g.mean[[X, Y]] = c0 - m

    def moved(state: np.ndarray) -> np.ndarray:
        q = state[[X, Y]] + state[[MX, MY]]
        along = (q - c0) @ t0
        across = (q - c0) @ np.array([t0[1], -t0[0]])
        c, t = on_circle(s0 + along + odometer * state[K], radius)
        p = c + np.array([t[1], -t[0]]) * across - state[[MX, MY]]
        out = state.copy()
        out[[X, Y]] = p  # the heading is the caller's affair
        return out

    f = jacobian(moved, g.mean, 1e-4 * UNITS)
    s1 = s0 + odometer * g.mean[K]
    _, t1 = on_circle(s1, radius)
    turn = wrap(math.atan2(t1[1], t1[0]) - math.atan2(t0[1], t0[0]))
    expected = quadratic(f, g.cov)
    predict_road(g.cov, odometer, turn, *t1, QUIET)
    ours = g.cov / np.outer(UNITS, UNITS)
    np.testing.assert_allclose(ours, expected, atol=1e-5, rtol=1e-5)


@given(gaussians, st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_a_slow_state_in_its_stationary_spread_keeps_it(g: Gaussian, target, keep):
    g.mean[D], g.cov[D, :], g.cov[:, D] = target, 0.0, 0.0
    g.cov[D, D] = 3.24
    decay(g.mean, g.cov, D, target, keep, 3.24)
    assert g.mean[D] == pytest.approx(target)
    assert g.cov[D, D] == pytest.approx(3.24)


ERROR = new_belief().state[0].map  # as believed before anything was learnt
OFF = new_belief().state[0].map  # of a map that is 20 m off
OFF.whole[:] = 12.0, -16.0
OFF.factor = 1.5


def age(g: Gaussian, amount: float) -> None:
    par = new_parameters()[0]
    par.lane_sigma, par.lane_length, par.map_length, par.map_sigma = 0.6, 150.0, 1000.0, 4.1
    age_map(g.mean, g.cov, par, OFF, amount, 1.75, 1.8)
    age_bias(g.mean, g.cov, math.exp(-amount / 60.0))


@given(gaussians, st.floats(0.1, 500.0), st.floats(0.05, 0.95))
def test_ageing_in_two_steps_is_ageing_in_one(g: Gaussian, amount, part):
    once, twice = g.copy(), g.copy()
    age(once, amount)
    for a in (part * amount, (1.0 - part) * amount):
        age(twice, a)
    np.testing.assert_allclose(twice.mean / UNITS, once.mean / UNITS, atol=1e-12)
    square = np.outer(UNITS, UNITS)
    np.testing.assert_allclose(twice.cov / square, once.cov / square, atol=1e-12)
    untouched = [X, Y, H, K, B]
    np.testing.assert_array_equal(
        once.cov[np.ix_(untouched, untouched)], g.cov[np.ix_(untouched, untouched)]
    )


@given(gaussians)
def test_a_map_that_is_off_as_a_whole_is_so_on_the_streets_ahead(g: Gaussian):
    age(g, 1e5)
    np.testing.assert_allclose(g.mean[[MX, MY]], OFF.whole)
    np.testing.assert_allclose(np.diag(g.cov)[[MX, MY]], 1.5 * 4.1**2)


@given(gaussians, st.floats(0.6, 4.0))
def test_a_vehicle_wanders_as_much_a_metre_on_a_wide_road_as_on_a_narrow_one(g: Gaussian, sigma):
    par = new_parameters()[0]
    par.lane_sigma, par.lane_length, par.map_length = 0.6, 150.0, 1000.0
    g.cov[D, D] = sigma**2
    age_map(g.mean, g.cov, par, ERROR, 0.1, 1.75, sigma)
    assert g.cov[D, D] == pytest.approx(sigma**2)  # its stationary variance
    g.cov[D, :] = g.cov[:, D] = 0.0
    age_map(g.mean, g.cov, par, ERROR, 0.1, 1.75, sigma)
    assert g.cov[D, D] == pytest.approx(2.0 * 0.6**2 * 0.1 / 150.0, rel=2e-3)


@given(gaussians)
def test_the_lane_is_carried_on_straight_ahead_and_drawn_anew_round_a_corner(g: Gaussian):
    ahead, corner = g.copy(), g.copy()
    redraw_lane(ahead.mean, ahead.cov, 0.0, 1.75, 1.75, 1.8)
    np.testing.assert_allclose(ahead.mean, g.mean)
    np.testing.assert_allclose(ahead.cov, g.cov)
    redraw_lane(corner.mean, corner.cov, math.pi / 2.0, 1.75, 3.5, 1.8)
    assert corner.mean[D] == pytest.approx(3.5)
    assert corner.cov[D, D] == pytest.approx(1.8**2)
    np.testing.assert_allclose(np.delete(corner.cov[D], D), 0.0, atol=1e-12)


@given(gaussians, st.floats(-3.0, 3.0), st.floats(0.0, 2.0), st.floats(-2.0, 2.0))
def test_a_vehicle_that_follows_its_road_moves_across_it_with_its_lane(g, direction, turn, shift):
    """P + n (d' − d), with d' = d̄' + c (d − d̄) + w, w ~ (1 − c²) σ² + (d̄' − d̄)²: by hand."""
    tangent = (math.cos(direction), math.sin(direction))
    n = np.array([tangent[1], -tangent[0]])
    kept = float(np.interp(turn, [0.2, 0.3], [1.0, 0.0]))
    f, q = np.eye(N), np.zeros((N, N))
    f[D, D] = kept
    f[[X, Y], D] = n * (kept - 1.0)
    w = np.zeros(N)
    w[[X, Y, D]] = *n, 1.0
    q = ((1.0 - kept**2) * 1.8**2 + shift**2) * np.outer(w, w)
    expected = g.mean.copy()
    new = 1.75 + shift + kept * (g.mean[D] - 1.75)
    expected[[X, Y]] += n * (new - g.mean[D])
    expected[D] = new
    cov = f @ g.cov @ f.T + q
    change_lane(g.mean, g.cov, turn, (1.75, 1.75 + shift, 1.8), tangent, 1.0)
    np.testing.assert_allclose(g.mean, expected, atol=1e-9)
    np.testing.assert_allclose(g.cov, cov, atol=1e-9)


@given(gaussians, st.floats(-2.0, 2.0), st.floats(0.0, 0.1))
def test_a_known_heading_turns_with_the_road_as_far_as_was_driven(g: Gaussian, turn, variance):
    """The turn is in proportion to κ, the speed or scale."""
    f = np.eye(N)
    f[H, K] = turn / g.mean[K] if abs(g.mean[K]) > 0.5 else 0.0
    expected = f @ g.cov @ f.T
    expected[H, H] += variance
    heading = wrap(g.mean[H] + turn)
    turn_by_road(g.mean, g.cov, turn, variance)
    assert g.mean[H] == pytest.approx(heading)
    np.testing.assert_allclose(g.cov, expected, atol=1e-9)


def test_the_states_stand_in_their_documented_order():
    assert list(range(N)) == [X, Y, H, K, B, D, MX, MY, GX, GY, U, V]
