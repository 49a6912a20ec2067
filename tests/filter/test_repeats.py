"""Fixes that repeat a place, of vehicles that move and of those that stand."""

import numpy as np
import pytest

from whichroad._compile import Records
from whichroad.filter.records import new_epochs
from whichroad.filter.state import new_belief
from whichroad.filter.vetting.repeats import is_repeated

SIGMA = 2.0


def seen(
    x: list[float], every: float = 1.0, speed: float | None = None, arc: float = 0.0
) -> list[bool]:
    """What is repeated of fixes at x, with a reported speed or an odometer."""
    epochs: Records = new_epochs(len(x))
    repeats = new_belief().state[0].vetting.repeats
    epochs.has_fix = 1
    epochs.fix[:, 0], epochs.fix[:, 1], epochs.fix[:, 2] = x, 7.0, SIGMA
    epochs.time = 100.0 + every * np.arange(len(x))
    epochs.speed_sigma = np.inf if speed is None else 0.2
    epochs.speed = 0.0 if speed is None else speed
    epochs.arc = arc
    return [is_repeated(repeats, epoch, every, arc > 0.0) for epoch in epochs]


def test_a_place_that_fast_vehicles_cannot_stay_at_is_repeated():
    assert seen([0, 15, 30, 30, 30, 75]) == [False, False, False, True, True, False]


def test_a_vehicle_that_brakes_may_stay_where_it_is():
    assert not any(seen([0, 9, 15, 18, 19, 19, 19, 19, 19, 19]))


def test_one_wrong_place_before_a_stop_is_no_speed():
    assert not any(seen([0, 0.5, 0.2, 15.0, 15.0, 15.0, 15.0]))


@pytest.mark.parametrize(("speed", "repeated"), [(10.0, True), (0.0, False)])
def test_reports_say_whether_the_vehicle_has_left(speed: float, repeated: bool):
    assert seen([0.0, 0.01, 0.01, 0.01], speed=speed)[2:] == [repeated, repeated]


def test_an_odometer_says_whether_the_vehicle_has_left():
    assert seen([0, 8, 8, 8, 32], arc=8.0) == [False, False, True, True, False]
    assert not any(seen([0, 0.5, 0.5, 0.5, 0.5], arc=0.5))


def test_steps_of_an_odometer_at_a_stop_are_no_way():
    """It counts in steps of 5 m, and has just counted one."""
    epochs: Records = new_epochs(4)
    repeats = new_belief().state[0].vetting.repeats
    epochs.has_fix = 1
    epochs.fix[:, 0], epochs.fix[:, 2] = [0.0, 4.0, 4.0, 4.0], SIGMA
    epochs.time, epochs.speed_sigma, epochs.arc = 100.0 + np.arange(4), np.inf, [5.0, 0.0, 5.0, 0.0]
    assert not any(is_repeated(repeats, epoch, 1.0, True) for epoch in epochs)


def test_an_odometer_is_believed_before_a_receiver_that_says_the_vehicle_stands():
    assert seen([0, 8, 8, 8, 32], arc=8.0, speed=0.0) == [False, False, True, True, False]


def test_places_that_were_left_once_are_left_again_as_long():
    """A place every third second, at 6 m/s: once the first jump has shown it, the rest is known."""
    found = seen([18.0 * (k // 3) for k in range(15)])
    assert found[9:] == [False, True, True] * 2


def test_a_long_stop_of_a_receiver_that_repeats_places_is_a_stop():
    driven = [18.0 * (k // 3) for k in range(12)]
    assert not any(seen([*driven, *[driven[-1] + 18.0] * 30])[-20:])


def test_a_stop_whose_place_is_held_while_the_vehicle_drives_off_poisons_no_later_one():
    """The receiver lets the first place go 12 m late, as those of buses do."""
    first = [0.0, 6.0, 11.0, 14.0, 15.5, *[15.5] * 9, 27.5, 32.0, 37.0, 43.0]
    later = [48.0, 51.5, 53.0, 54.0, *[54.0] * 8]
    assert not any(seen([*first, *later]))


def test_stops_after_a_filled_gap_are_believed_again():
    """A gap of 4 s at 12 m/s makes the next stop doubtful, and the third one no longer."""
    filled = [12.0 * k for k in range(6)] + [60.0] * 4 + [120.0, 132.0, 144.0]
    stops = [[x, x + 9.0, x + 14.0, x + 17.0, x + 18.0, *[x + 18.0] * 9] for x in (150, 175, 200)]
    found = seen([*filled, *stops[0], *stops[1], *stops[2]])
    assert any(found[len(filled) :][: len(stops[0])])
    assert not any(found[-len(stops[2]) :])


STANDS = [0.2 * np.sin(2.0 * k) for k in range(14)]  # its places are others while it stands


def test_a_receiver_that_never_held_a_place_measures_none_that_repeats():
    found = seen([*STANDS, 1.0, 3.0, 6.0, 6.0, 6.0, 6.0])
    assert not any(found[:-3])
    assert all(found[-3:])


def test_a_receiver_that_has_held_a_place_at_a_stop_may_hold_the_next_one():
    found = seen([*STANDS, 0.5, 0.5, 0.5, 1.0, 3.0, 6.0, 7.0, 7.0, 7.0])
    assert found[15]  # the first time it is not known
    assert not any(found[-3:])


@pytest.mark.parametrize(("after", "told"), [(25.0, True), (0.5, False)])
def test_what_may_be_a_stop_is_told_only_where_the_vehicle_had_left(after: float, told: bool):
    epochs: Records = new_epochs(18)
    repeats = new_belief().state[0].vetting.repeats
    epochs.has_fix = 1
    epochs.fix[:, 0] = [*STANDS, 0.3, 0.3, 0.3, after]
    epochs.fix[:, 1], epochs.fix[:, 2] = 7.0, SIGMA
    epochs.time, epochs.speed_sigma = 100.0 + np.arange(18), np.inf
    found = [is_repeated(repeats, epoch, 1.0, False) for epoch in epochs]
    assert found[-4:] == [False, True, True, False]
    assert (repeats.seconds > 0.0) == told


def test_a_report_of_no_speed_is_doubted_where_the_vehicle_was_too_fast_to_stop():
    def told(before: float) -> list[bool]:
        epochs: Records = new_epochs(6)
        repeats = new_belief().state[0].vetting.repeats
        epochs.has_fix = 1
        epochs.fix[:, 0] = [0.0, before, 2.0 * before, *[3.0 * before] * 3]
        epochs.fix[:, 1], epochs.fix[:, 2] = 7.0, SIGMA
        epochs.time = 100.0 + np.arange(6)
        epochs.speed, epochs.speed_sigma = [before] * 3 + [0.0] * 3, 0.2
        return [is_repeated(repeats, epoch, 1.0, False) for epoch in epochs]

    assert told(9.0) == [False] * 4 + [True] * 2
    assert not any(told(5.0))
