"""The compiled simulator draws what its settings say, and what `simulate_drive` draws."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from whichroad.simulate import GOOD, SimulationSettings
from whichroad.simulate.map_error_field import draw_map_error
from whichroad.simulate.vectorised import (
    DIFFERENTIAL,
    SCALE,
    DriveBuffers,
    Line,
    Numbers,
    new_buffers,
    simulate_short,
)

QUIET = replace(
    GOOD,
    map_sigma=0.0,
    relative_sigma=0.0,
    street_sigma=0.0,
    lane_sigma=0.0,
    lane_change_rate=0.0,
    stop_probability=0.0,
    scale_sigma=0.0,
    differential_sigma=0.0,
    track_sigma=0.0,
    wheel_walk=0.0,
    gnss_bias_low=0.0,
    gnss_bias_high=0.0,
    gnss_white=0.0,
    gnss_speed_sigma=0.0,
)
N = 400  # drives: the 1e-4 quantiles of a variance are 0.75 and 1.30 of it


def line_of(x: np.ndarray, y: np.ndarray, limit: float = 14.0) -> Line:
    n = len(x)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    none = np.zeros(n, np.uint8)
    number = np.zeros(n, np.int32)
    lane, speed = np.full(n, 1.75), np.full(n, limit)
    return Line(along, x, y, lane, speed, number, number.copy(), none, none.copy(), none.copy())


def straight(metres: int = 600) -> Line:
    return line_of(np.arange(metres + 1.0), np.zeros(metres + 1))


def winding() -> Line:
    turn = np.cumsum(0.02 * np.sin(np.arange(600) / 40.0))
    return line_of(np.cumsum(np.cos(turn)), np.cumsum(np.sin(turn)))


@pytest.fixture(scope="module")
def buffers() -> DriveBuffers:
    return new_buffers(4000)


def drives(
    buffers: DriveBuffers,
    line: Line,
    how: SimulationSettings,
    count: int = N,
    odometry: bool = True,
) -> list[int]:
    """Epochs of each of some drives, one after another; look at `buffers` in between."""
    par = Numbers.of(how)
    for seed in range(count):
        yield simulate_short(line, buffers, par, odometry, seed)


def assert_variance(values: np.ndarray, expected: float) -> None:
    """Within the 1e-4 quantiles of chi-square; values are independent with mean zero."""
    ratio = (values**2).sum() / expected
    assert chi2.ppf(1e-4, values.size) < ratio < chi2.ppf(1 - 1e-4, values.size)


def fix_errors(buffers: DriveBuffers, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the fixes and their error in the plane."""
    at = np.flatnonzero(buffers.epochs.has_fix[:n])
    h = buffers.truth.heading[at]
    x = buffers.epochs.fix[at, 0] - GOOD.antenna_forward * np.cos(h) - buffers.truth.x[at]
    y = buffers.epochs.fix[at, 1] - GOOD.antenna_forward * np.sin(h) - buffers.truth.y[at]
    return at, np.column_stack([x, y])


def test_the_same_seed_is_the_same_drive(buffers):
    line, par = winding(), Numbers.of(GOOD)
    first = simulate_short(line, buffers, par, True, 5)
    kept = [a[:first].copy() for a in (buffers.epochs, *buffers.truth)]
    simulate_short(line, buffers, par, True, 6)
    assert simulate_short(line, buffers, par, True, 5) == first
    for a, b in zip(kept, (buffers.epochs, *buffers.truth), strict=True):
        np.testing.assert_array_equal(a, b[:first])


def test_without_errors_the_wheels_tell_the_true_motion(buffers):
    n = simulate_short(
        winding(), buffers, Numbers.of(replace(QUIET, metres_per_tick=1e-6)), True, 1
    )
    epochs, truth = buffers.epochs, buffers.truth
    heading = truth.heading[0] + np.concatenate([[0.0], np.cumsum(epochs.turn[1:n])])
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = truth.x[0] + np.cumsum(c * epochs.forward[1:n] - s * epochs.left[1:n])
    y = truth.y[0] + np.cumsum(s * epochs.forward[1:n] + c * epochs.left[1:n])
    # chords of the line's grid against arcs: far below what any sensor knows
    np.testing.assert_allclose(x, truth.x[1:n], atol=0.05)
    np.testing.assert_allclose(y, truth.y[1:n], atol=0.05)


def test_without_errors_fixes_are_the_antenna(buffers):
    n = simulate_short(winding(), buffers, Numbers.of(QUIET), True, 1)
    at, error = fix_errors(buffers, n)
    np.testing.assert_allclose(error, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.diff(buffers.epochs.time[at]), 1.0, atol=1e-9)
    moving = buffers.truth.speed[at] > 2.0
    np.testing.assert_allclose(
        buffers.epochs.speed[at][moving], buffers.truth.speed[at][moving], atol=0.05
    )


def test_speed_and_position_fit_and_a_car_can_do_it(buffers):
    line = winding()
    line.stop[300] = 1
    how = replace(GOOD, stop_probability=1.0)
    n = simulate_short(line, buffers, Numbers.of(how), True, 3)
    truth, dt = buffers.truth, 0.1
    step = np.hypot(np.diff(truth.x[:n]), np.diff(truth.y[:n]))
    # trapezia are off by half the jerk at corners of the speed: (a + b) dt² / 8
    mean = 0.5 * (truth.speed[1:n] + truth.speed[: n - 1]) * dt
    np.testing.assert_allclose(step, mean, atol=3.5 * dt**2 / 4 + 1e-3)
    gain = np.diff(truth.speed[:n]) / dt
    assert gain.max() < how.acceleration + 1e-6
    assert gain.min() > -how.braking - 1e-6
    assert (truth.speed[:n] <= 1.5 * 14.0).all()
    waits = np.flatnonzero((truth.speed[:n] == 0.0) & (truth.travelled[:n] > 100.0))
    assert len(waits) >= 10  # stopped at the junction for more than a second
    assert np.ptp(truth.travelled[waits[:10]]) == 0.0


def test_the_receivers_error_has_the_variance_that_was_asked(buffers):
    how = replace(GOOD, gnss_axis_ratio=1.0)
    last = []
    for n in drives(buffers, straight(300), how):
        last.append(fix_errors(buffers, n)[1][-1])
    assert_variance(np.array(last), how.gnss_bias_low**2 + how.gnss_white**2)


def test_the_slow_error_lasts_as_long_as_was_asked_and_stands_with_the_car(buffers):
    how = replace(GOOD, gnss_axis_ratio=1.0, gnss_white=0.0, first_wait=5.0)
    waited, moved = [], []
    for n in drives(buffers, straight(), how):
        at, error = fix_errors(buffers, n)
        waited.append(error[4] - error[0])
        go = int(np.argmax(buffers.truth.speed[at] > 1.0)) + 1
        moved.append(error[go + 20] - error[go])
    np.testing.assert_allclose(waited, 0.0, atol=1e-9)
    keep = np.exp(-20.0 / how.gnss_time)
    assert_variance(np.array(moved), 2.0 * how.gnss_bias_low**2 * (1.0 - keep))


def test_errors_have_the_reported_shape(buffers):
    how = replace(GOOD, gnss_reported_spread=0.0, gnss_axis_ratio=3.0)
    normal = []
    for n in drives(buffers, straight(200), how):
        at, error = fix_errors(buffers, n)
        fix = buffers.epochs.fix[at[-1]]
        c, s = np.cos(fix[4]), np.sin(fix[4])
        along = np.array([c * error[-1, 0] + s * error[-1, 1], c * error[-1, 1] - s * error[-1, 0]])
        normal.append(along / fix[2:4])
        assert fix[2] / fix[3] == pytest.approx(3.0)
        assert 0.5 * (fix[2] ** 2 + fix[3] ** 2) == pytest.approx(how.gnss_reported**2)
    true = (how.gnss_bias_low**2 + how.gnss_white**2) / how.gnss_reported**2
    assert_variance(np.array(normal)[:, 0], true)
    assert_variance(np.array(normal)[:, 1], true)


def test_wheels_are_as_wrong_as_was_asked(buffers):
    how = replace(GOOD, wheel_walk=0.0, map_sigma=0.0, relative_sigma=0.0)
    scale, differential, ratio, turn = [], [], [], []
    for n in drives(buffers, straight(), how):
        metres = buffers.truth.travelled[n - 1] - buffers.truth.travelled[0]
        scale.append(buffers.drawn[SCALE] - 1.0)
        differential.append(buffers.drawn[DIFFERENTIAL])
        ratio.append(metres / buffers.epochs.arc[:n].sum() - 1.0)
        true = buffers.truth.heading[n - 1] - buffers.truth.heading[0]
        turn.append((buffers.epochs.turn[:n].sum() - true) / metres)
    assert_variance(np.array(scale), how.scale_sigma**2)
    assert_variance(np.array(differential), how.differential_sigma**2)
    # two ticks in 600 m are 1.4e-4
    np.testing.assert_allclose(ratio, scale, atol=2e-4)
    expected = np.array(differential) / how.track_width  # a larger left wheel counts less
    np.testing.assert_allclose(turn, expected, atol=2 * 0.0404 / 1.5 / 600 + 2e-5)


def test_the_wheels_walk(buffers):
    how = replace(QUIET, wheel_walk=5e-3, metres_per_tick=1e-6)
    extra = []
    for n in drives(buffers, straight(), how):
        extra.append(buffers.epochs.turn[:n].sum() * how.track_width / np.sqrt(600.0))
    assert_variance(np.array(extra), 2 * how.wheel_walk**2)


def test_the_map_is_wrong_as_in_the_other_simulator(buffers):
    """Variance at a point, and of differences over 20, 60 and 300 m."""
    how = replace(GOOD, lane_change_rate=0.0)
    mine, other = [], []
    for n in drives(buffers, straight(), how, 600):
        truth = buffers.truth
        at = np.searchsorted(truth.travelled[:n], [100.0, 120.0, 160.0, 400.0])
        mine.append(truth.y[at] - truth.map_y[at])
    random = np.random.default_rng(1)
    for _ in range(600):
        there = draw_map_error(how, random).at(np.array([100.0, 120.0, 160.0, 400.0]), np.zeros(4))
        other.append(there[:, 1])
    a, b = np.array(mine), np.array(other)
    assert_variance(a[:, 0], how.map_sigma**2 + how.relative_sigma**2)
    for far in (1, 2, 3):
        size = [np.mean((v[:, far] - v[:, 0]) ** 2) for v in (a, b)]
        # a ratio of two variances of 600: its log has sigma 0.082 for normal draws, and
        # modes that differ from drive to drive give heavier tails than that
        assert abs(np.log(size[0] / size[1])) < 6 * 0.082


def test_cars_keep_their_lanes(buffers):
    """Street and driver: the offset varies as both do, and is near the lane's on average."""
    offsets = []
    how = replace(GOOD, lane_change_rate=0.0)
    for n in drives(buffers, straight(), how):
        k = int(np.searchsorted(buffers.truth.travelled[:n], 300.0))
        offsets.append(-buffers.truth.map_y[k] - 1.75)
    assert_variance(np.array(offsets), how.street_sigma**2 + how.lane_sigma**2)


def test_lanes_are_changed_as_often_as_was_asked_and_slowly(buffers):
    line = straight(2000)
    how = replace(QUIET, lane_change_rate=2e-4)
    visits = 0
    for n in drives(buffers, line, how, 200):
        right = -buffers.truth.map_y[:n]
        visits += right.min() < 0.0
        slope = np.abs(np.diff(right)) / np.maximum(np.diff(buffers.truth.travelled[:n]), 1e-3)
        assert slope.max() < 0.15  # two that overlap make twice the step
    # 200 drives of 0.4 visits: 1 - exp(-0.4) of them have one
    share = visits / 200
    assert abs(share - (1 - np.exp(-0.4))) < 4 * np.sqrt(0.33 * 0.67 / 200)


def test_no_fix_where_it_is_dark(buffers):
    line = straight()
    line.masked[200:400] = 1
    n = simulate_short(line, buffers, Numbers.of(GOOD), True, 1)
    at = np.flatnonzero(buffers.epochs.has_fix[:n])
    assert not line.masked[buffers.truth.place[at]].any()
    assert len(at) > 20


def test_without_odometry_only_fixes_remain(buffers):
    par = Numbers.of(GOOD)
    with_wheels = simulate_short(straight(), buffers, par, True, 4)
    at = np.flatnonzero(buffers.epochs.has_fix[:with_wheels])
    fixes, place = buffers.epochs.fix[at].copy(), buffers.truth.place[at].copy()
    n = simulate_short(straight(), buffers, par, False, 4)
    np.testing.assert_array_equal(buffers.epochs.fix[:n], fixes)
    np.testing.assert_array_equal(buffers.truth.place[:n], place)
    assert not buffers.epochs.odometry_valid[:n].any()
    assert not buffers.epochs.arc[:n].any()
