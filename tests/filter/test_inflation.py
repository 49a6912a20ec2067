"""A receiver alone: how much larger than reported its errors are taken to be."""

import math

import numpy as np
import pytest

from scenes import column, drive_along, epochs_of, gnss, localize, network, parallel_roads
from whichroad._compile import Records
from whichroad.filter.gnss.inflation import tail_of
from whichroad.filter.records import new_epochs
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS, new_belief
from whichroad.filter.summary.estimate import Output
from whichroad.settings import Settings, Vehicle, parameters

ROADS = network(parallel_roads(60.0, 5000.0))
DRIVE = drive_along([[200.0, -1.75], [4200.0, -1.75]])
EVERY = np.arange(0, len(DRIVE.time), round(1.0 / (DRIVE.time[1] - DRIVE.time[0])))
REPORTED = 3.0  # m
WIDE = Settings(gnss_inflation=2.5)


def fixes(under: float, seed: int, mode: int = CLOCK) -> Records:
    """A drive along the lower one of two roads; errors are `under` times those reported."""
    fix = gnss(DRIVE, sigma=REPORTED * under, seed=seed, constant=30.0)
    fix[:, 2:4] = REPORTED
    epochs = epochs_of(DRIVE, fix, EVERY)
    return epochs[EVERY].copy() if mode == CLOCK else epochs


def share_inside(output: Output) -> float:
    """Share of the epochs whose 95 % ellipse holds the vehicle."""
    at = slice(None) if len(output.rows.x) == len(EVERY) else EVERY
    ex, ey = output.rows.x[at] - DRIVE.x[EVERY], output.rows.y[at] - DRIVE.y[EVERY]
    xx, xy, yy = (column(output, name)[at] for name in ("xx", "xy", "yy"))
    nees = (yy * ex**2 - 2.0 * xy * ex * ey + xx * ey**2) / (xx * yy - xy**2)
    return float(np.mean(nees[30:] < 5.99))


def test_it_begins_inflated_and_only_roads_make_the_factor_smaller():
    last = {}
    for under in (1.0, 2.5):
        scale = [
            localize(ROADS, fixes(under, seed), settings=WIDE, mode=CLOCK).output.rows.gnss_scale
            for seed in range(12)
        ]
        for drive in scale:
            assert drive[0] == pytest.approx(WIDE.gnss_inflation)
            assert drive.max() <= WIDE.gnss_inflation + 1e-9
        last[under] = float(np.mean([drive[len(drive) // 2 :] for drive in scale]))
    assert last[1.0] < 1.6
    assert last[2.5] > last[1.0] + 0.5


def test_errors_twice_as_large_as_reported_are_inside_of_the_ellipse():
    """Twelve drives each; a receiver that is taken at its word leaves a third outside."""
    inside = {}
    for inflation in (1.0, 2.5):
        settings = Settings(gnss_inflation=inflation)
        inside[inflation] = np.mean(
            [
                share_inside(localize(ROADS, fixes(2.0, k), settings=settings, mode=CLOCK).output)
                for k in range(12)
            ]
        )
    assert inside[1.0] < 0.75
    assert inside[2.5] > 0.9


def test_with_wheels_it_says_nothing():
    settings = (Settings(gnss_inflation=1.0), Settings(gnss_inflation=10.0))
    epochs = fixes(1.0, 0, WHEELS)
    answers = [localize(ROADS, epochs, settings=s, mode=WHEELS).output for s in settings]
    np.testing.assert_array_equal(answers[0].rows.x, answers[1].rows.x)
    np.testing.assert_array_equal(answers[0].rows.gnss_scale, answers[1].rows.gnss_scale)


def test_an_odometer_alone_vouches_for_no_receiver():
    """Twelve drives; its errors across the road show in no distance."""
    inside = [
        share_inside(localize(ROADS, fixes(2.0, k, DISTANCE), mode=DISTANCE).output)
        for k in range(12)
    ]
    assert np.mean(inside) > 0.9


LINK = network([[[0.0, 0.0], [6000.0, 0.0]], [[0.0, 400.0], [6000.0, 400.0]]])


def test_an_odometer_that_took_a_street_the_map_lacks_is_found_at_the_fixes_behind_it():
    """600 m without fixes, from one road to the other."""
    truth = drive_along([[200.0, -1.75], [1500.0, -1.75], [1950.0, 398.25], [4000.0, 398.25]])
    for seed in range(5):
        fix = gnss(truth, sigma=REPORTED, seed=seed, constant=30.0)
        heard = (truth.y <= 0.0) | (truth.y >= 398.0)
        at = np.array([k for k in range(0, len(truth.time), 10) if heard[k]])
        epochs = epochs_of(truth, fix, at)
        epochs.speed[at] = np.gradient(truth.s, truth.time)[at]
        epochs.course[at] = truth.heading[at]
        epochs.speed_sigma[at], epochs.course_sigma[at] = 0.2, 0.02
        rows = localize(LINK, epochs, mode=DISTANCE).output.rows
        late = truth.s > truth.s[-1] - 1000.0
        away = np.hypot(rows.x - truth.x, rows.y - truth.y)[late]
        assert np.quantile(away, 0.9) < 15.0


def test_whoever_was_led_onto_the_wrong_road_finds_back():
    """For 40 s the fixes are on the other road, 60 m away: twenty times what is reported."""
    epochs = fixes(1.0, 1)
    epochs.fix[60:100, 1] += 60.0
    output = localize(ROADS, epochs, settings=WIDE, mode=CLOCK).output
    off = np.abs(output.rows.y - DRIVE.y[EVERY])
    assert off[95] > 30.0
    assert (off[140:] < 15.0).all()


def test_what_roads_showed_is_forgotten_where_the_receiver_gets_worse():
    """Half an hour under open sky, then a street canyon."""
    drive = drive_along([[200.0, -1.75], [19_800.0, -1.75]])
    every = np.arange(0, len(drive.time), round(1.0 / (drive.time[1] - drive.time[0])))
    fix = gnss(drive, sigma=REPORTED, seed=5, constant=30.0)
    worse = drive.time > 0.6 * drive.time[-1]
    fix[worse, :2] += 3.0 * (fix[worse, :2] - np.column_stack([drive.x, drive.y])[worse])
    fix[:, 2:4] = REPORTED
    epochs = epochs_of(drive, fix, every)[every].copy()
    roads = network(parallel_roads(60.0, 20_000.0))
    scale = localize(roads, epochs, settings=WIDE, mode=CLOCK).output.rows.gnss_scale
    before = scale[int(0.59 * len(scale))]
    assert before < 1.5
    assert scale[-1] > 1.3 * before
    assert math.isfinite(scale[-1])


def test_levels_of_a_receiver_alone_are_those_of_student():
    """The level is exceeded with the risk, by errors of the degrees of freedom learnt."""
    risk = Settings().protection_risk
    state, par = new_belief().state[0], parameters(WIDE, Vehicle(), CLOCK)[0]
    state.mode = CLOCK
    for seen, freedom in ((0.0, 16.0), (5.0, 26.0), (100.0, 216.0)):
        state.road_energy[1] = seen
        r = tail_of(state, par) * math.sqrt(-2.0 * math.log(risk))  # in sigmas
        assert (1.0 + r * r / freedom) ** (-0.5 * freedom) == pytest.approx(risk)


def test_levels_beside_wheels_are_of_student_for_a_minute():
    risk = Settings().protection_risk
    state, par = new_belief().state[0], parameters(Settings(), Vehicle(), WHEELS)[0]
    state.mode = WHEELS
    for learnt, freedom in ((0.0, 8.0), (60.0, 28.0), (600.0, 208.0)):
        state.learnt_time = learnt
        r = tail_of(state, par) * math.sqrt(-2.0 * math.log(risk))
        assert (1.0 + r * r / freedom) ** (-0.5 * freedom) == pytest.approx(risk)
    par.gnss_adapt_time = 1e9  # the receiver is believed
    assert tail_of(state, par) == 1.0


def test_a_level_is_wider_the_less_is_known_of_the_receiver():
    drive = fixes(1.0, 0)
    output = localize(ROADS, drive, settings=WIDE, mode=CLOCK).output
    xx, xy, yy = (column(output, name) for name in ("xx", "xy", "yy"))
    longest = 0.5 * (xx + yy + np.hypot(xx - yy, 2.0 * xy))
    ratio = output.rows.protection_level / np.sqrt(longest)
    gaussian = math.sqrt(-2.0 * math.log(WIDE.protection_risk))
    assert ratio[:20].mean() > 1.05 * ratio[-20:].mean() > 1.05 * gaussian


def test_braking_that_no_speed_tells_is_soon_followed():
    """From 20 to 4 m/s in five seconds, which fixes of 12 m tell late."""
    time = np.arange(100.0)
    speed = np.interp(time, [0.0, 60.0, 65.0, 100.0], [20.0, 20.0, 4.0, 4.0])
    x = 200.0 + np.cumsum(speed)
    epochs = new_epochs(100)
    epochs.time, epochs.has_fix = time, 1
    epochs.fix = np.column_stack([x, np.full(100, -1.75), np.full((100, 2), 12.0), np.zeros(100)])
    epochs.speed_sigma = epochs.course_sigma = np.inf
    told = localize(ROADS, epochs, mode=CLOCK).output.rows.x
    slow = Settings(acceleration_noise=1.5 / math.sqrt(2.8))
    late = localize(ROADS, epochs, settings=slow, mode=CLOCK).output.rows.x
    assert (told - x)[62:68].max() < 0.8 * (late - x)[62:68].max()


@pytest.mark.parametrize("scale", [1.0, 1.4, 1.9, 4.0])
def test_a_receiver_that_errs_by_twice_what_it_reports_has_longer_tails(scale: float):
    state, par = new_belief().state[0], parameters(WIDE, Vehicle(), CLOCK)[0]
    state.mode, state.road_energy[1], state.reported[1] = CLOCK, 20.0, 3.0
    state.gnss_factor = 1.0
    usual = tail_of(state, par)
    state.gnss_factor = scale**2
    longer = tail_of(state, par) / usual
    assert (longer > 1.4) if scale > 1.8 else longer == pytest.approx(1.0)
    state.reported[1] = 0.02  # by carrier phase
    assert tail_of(state, par) == pytest.approx(usual)
    state.mode = WHEELS
    with_wheels = tail_of(state, par)
    state.gnss_factor = 1.0
    assert tail_of(state, par) == with_wheels
