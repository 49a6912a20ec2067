"""The whole filter: noise that adapts, receivers that stray, starts that were wrong."""

import math

import numpy as np
import pytest

from scenes import (
    Truth,
    brake,
    column,
    drive_along,
    epochs_of,
    gnss,
    grid_town,
    localize,
    network,
    parallel_roads,
    straight_road,
)
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS
from whichroad.filter.summary.estimate import Output
from whichroad.settings import Settings

PARALLEL = network(parallel_roads(12.0, 5000.0))
BESIDE = drive_along([[200.0, -1.75], [4200.0, -1.75]])
LONG = network(straight_road(9000.0))
AHEAD = drive_along([[500.0, -1.75], [4500.0, -1.75]])


def once_a_second(truth: Truth) -> np.ndarray:
    return np.arange(0, len(truth.time), round(1.0 / (truth.time[1] - truth.time[0])))


def away(output: Output, truth: Truth) -> np.ndarray:
    """Error of the place, m."""
    return np.hypot(output.rows.x - truth.x, output.rows.y - truth.y)


@pytest.mark.parametrize("interval", [0.02, 0.1, 1.0])
def test_a_turn_costs_the_same_doubt_however_often_the_gyro_is_read(interval: float):
    """Off the map, with no other noise of the heading: a corner costs the noise times itself."""
    nowhere = network([[[-5000.0, 5000.0], [-4000.0, 5000.0]]])
    quiet = {"heading_noise": 0.0, "drift_sigma": 0.0, "yaw_bias_noise": 0.0}
    settings = Settings(**quiet, off_road_return=0.0)
    corners = [[0.0, 0.0], [200.0, 0.0], [200.0, 200.0]]
    truth = drive_along(corners, radius=12.0, interval=interval)
    epochs = epochs_of(truth, gnss(truth), [0], course=0.1)
    variance = column(localize(nowhere, epochs, settings=settings).output, "hh")
    corner = (settings.turn_noise * math.pi / 2.0) ** 2
    assert variance[-1] - variance[0] == pytest.approx(corner, rel=1e-6)


def add_doppler(epochs: Records, truth: Truth) -> None:
    """The receiver measures its speed by Doppler as well, to 0.2 m/s."""
    epochs.speed, epochs.speed_sigma = np.gradient(truth.s, truth.time), 0.2


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("under", [1.0, 2.0])
def test_on_a_road_the_scale_of_fixes_is_found_in_three_minutes(mode: int, under: float):
    """Over 16 drives; the bounds are those of a single stream of fixes (tests of the receiver)."""
    scale = []
    for seed in range(16):
        fix = gnss(BESIDE, sigma=3.0 * under, seed=seed, constant=Settings().gnss_time)
        fix[:, 2:4] = 3.0
        epochs = epochs_of(BESIDE, fix, once_a_second(BESIDE), course=0.1)
        if mode == DISTANCE:
            add_doppler(epochs, BESIDE)
        scale.append(localize(PARALLEL, epochs, mode=mode).output.rows.gnss_scale[2000:])
    assert under * (1.0 - 0.09) <= np.mean(scale) <= under * (1.0 + 0.16)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
def test_levels_are_as_wide_in_hindsight_as_the_scale_is_uncertain(mode: int):
    """Beside wheels it is known soon; else from few errors, which are Student's then."""
    at = once_a_second(AHEAD)
    epochs = epochs_of(AHEAD, gnss(AHEAD, sigma=3.0), at, course=0.1)
    epochs = epochs[at].copy() if mode == CLOCK else epochs
    found = localize(LONG, epochs, mode=mode, lag="full").output
    xx, xy, yy = (column(found, name) for name in ("xx", "xy", "yy"))
    major = np.sqrt(0.5 * (xx + yy + np.hypot(xx - yy, 2.0 * xy)))
    times = found.rows.protection_level / (math.sqrt(2.0 * math.log(1e3)) * major)
    assert (np.median(times) > 1.05) == (mode != WHEELS)


def speeding_up(seconds: float) -> Truth:
    """A straight road at 3 m/s² up to 25 m/s, and at 3 m/s² back to 4 m/s, again and again."""
    time = np.arange(0.0, seconds, 0.1)
    speed = 4.0 + 3.0 * np.abs((time + 7.0) % 14.0 - 7.0)
    s = np.cumsum(0.1 * speed)
    none = np.zeros(len(time))
    return Truth(time, 500.0 + s, none - 1.75, none, s)


def test_what_speeds_tell_of_an_acceleration_is_no_error_of_the_receiver():
    """A second of acceleration puts the place off by 1.5 m; the scale came to 1.3 by that."""
    truth = speeding_up(300.0)
    at, scale = once_a_second(truth), []
    for seed in range(8):
        epochs = epochs_of(truth, gnss(truth, sigma=2.0, seed=seed), at, course=0.1)
        add_doppler(epochs, truth)
        epochs.course[at], epochs.course_sigma[at] = 0.0, 0.05
        found = localize(LONG, epochs[at].copy(), mode=CLOCK).output
        scale.append(found.rows.gnss_scale[60:])
    assert np.mean(scale) < 1.05


@pytest.mark.parametrize("mode", [DISTANCE, CLOCK])
def test_a_receiver_that_is_not_to_be_inflated_is_taken_at_its_word(mode: int):
    """What was guessed at the start is forgotten within three minutes."""
    fix = gnss(BESIDE, sigma=6.0, seed=0, constant=Settings().gnss_time)
    fix[:, 2:4] = 3.0
    every = once_a_second(BESIDE)
    epochs = epochs_of(BESIDE, fix, every, course=0.1)
    if mode == CLOCK:
        epochs = epochs[every].copy()
    settings = Settings(gnss_inflation=1.0)
    scale = localize(PARALLEL, epochs, settings=settings, mode=mode).output.rows.gnss_scale
    assert scale[len(scale) // 2 :] == pytest.approx(1.0, abs=0.01)


def stop(seed: int, under: float, mode: int) -> tuple[np.ndarray, int]:
    """Scale of fixes over a drive that stands for ten minutes, and the epoch it stops at.

    The fixes of the standing vehicle scatter by 2 m about an error that stays.
    """
    at, rng = 600, np.random.default_rng(seed)
    stood, rows = brake(BESIDE, at - 10, 6000, goes_on=True)
    fix = gnss(BESIDE, sigma=4.0 * under, seed=seed)[rows]
    fix[:, 2:4] = 4.0
    fix[at : at + 6000, :2] += rng.normal(0.0, 2.0, (6000, 2))
    epochs = epochs_of(stood, fix, once_a_second(stood), course=0.1)
    every = 1
    if mode == CLOCK:
        add_doppler(epochs, stood)
        every = 10
        epochs = epochs[::every].copy()
    return localize(PARALLEL, epochs, mode=mode).output.rows.gnss_scale, at // every


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
@pytest.mark.parametrize("seed", range(3))
def test_quiet_fixes_of_a_standing_vehicle_make_no_receiver_worse(seed: int, mode: int):
    """It learns for ten seconds more, as sharply as ever (a sigma of 0.14); then not at all."""
    scale, at = stop(seed, 1.0, mode)
    later = at + at // 60 * 12
    assert scale[at:later].max() <= max(scale[at], 1.0) + 3.0 * 0.14
    assert scale[later : 11 * at].max() <= scale[later]


@pytest.mark.parametrize("seed", range(3))
def test_quiet_fixes_of_a_standing_vehicle_make_no_receiver_better(seed: int):
    """Its error stays as it was: what is seen of it is the white part alone.

    Ten seconds and a fix of that are learnt from, and take exp(-11 / 40) of λ² at most.
    """
    scale, at = stop(seed, 2.0, WHEELS)
    assert scale[at] > 1.5
    assert scale[11 * at - 10] > math.exp(-0.5 * 11.0 / Settings().gnss_adapt_time) * scale[at]


ROUTE = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (3, 2), (4, 2), (4, 3), (4, 4)]
TOWN = network(grid_town())
DRIVE = drive_along([(i * 120 + 10 * np.sin(j), j * 120 + 8 * np.cos(i)) for i, j in ROUTE])
ASIDE = [70.0, 180.0]  # m, from the roads of one block to none of another


@pytest.mark.parametrize("seconds", [1, 5])
@pytest.mark.parametrize("seed", range(4))
def test_first_fixes_that_were_wrong_are_corrected_by_roads_and_later_fixes(seed, seconds):
    """The protection level knows of both from the first right fix on."""
    fix = gnss(DRIVE, seed=seed)
    fix[: 10 * seconds, :2] += ASIDE
    epochs = epochs_of(DRIVE, fix, once_a_second(DRIVE), course=0.1)
    output = localize(TOWN, epochs).output
    error = away(output, DRIVE)
    assert error[0] > 150.0
    assert (error[200:] < 15.0).all()
    assert (error[10 * seconds :] <= output.rows.protection_level[10 * seconds :]).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_car_that_was_carried_round_a_corner_is_found_again(seed: int):
    """Its wheels stood meanwhile; once it is off all roads the fixes begin to count again."""
    epochs = epochs_of(DRIVE, gnss(DRIVE, seed=seed), once_a_second(DRIVE), course=0.1)
    driven = np.r_[:150, 300 : len(DRIVE.time)]
    epochs, truth = epochs[driven].copy(), Truth(*(part[driven] for part in DRIVE))
    epochs.time[150:] -= 15.0
    error = away(localize(TOWN, epochs).output, truth)
    assert error[160:400].max() > 60.0
    assert (error[-150:] < 15.0).all()


@pytest.mark.parametrize("seed", range(4))
def test_a_receiver_that_is_away_for_half_a_minute_takes_nobody_with_it(seed: int):
    """190 m from where the roads and the wheels know the vehicle to be."""
    fix = gnss(DRIVE, seed=seed)
    fix[300:600, :2] += ASIDE
    epochs = epochs_of(DRIVE, fix, once_a_second(DRIVE), course=0.1)
    output = localize(TOWN, epochs).output
    error = away(output, DRIVE)
    assert (error[300:] < 15.0).all()
    assert (error <= output.rows.protection_level).all()


@pytest.mark.parametrize("seed", range(2))
def test_one_wrong_fix_does_not_outweigh_four_minutes_of_right_ones(seed: int):
    """150 m too far along a road that is the same everywhere: nothing but fixes tells."""
    fix = gnss(AHEAD, seed=seed)
    fix[:10, 0] += 150.0
    output = localize(LONG, epochs_of(AHEAD, fix, once_a_second(AHEAD), course=0.1)).output
    assert (away(output, AHEAD)[2400:] < 15.0).all()


@pytest.mark.parametrize("seed", range(2))
def test_a_receiver_that_has_lost_its_way_says_nothing_of_the_scale(seed: int):
    fix = gnss(AHEAD, seed=seed)
    fix[600:, 0] += 150.0
    output = localize(LONG, epochs_of(AHEAD, fix, once_a_second(AHEAD), course=0.1)).output
    assert output.rows.gnss_scale[600:].max() < 2.0
