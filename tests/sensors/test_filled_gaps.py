"""Fixes that only repeat a place, as later ones prove."""

import numpy as np

from whichroad.sensors.filled_gaps import filled_gaps

SIGMA = 3.0


def filled(x: list[float], first=(0,), every: float = 1.0) -> list[int]:
    """Rows along a line that are found to repeat an earlier place."""
    place = np.column_stack([x, np.zeros(len(x))])
    time = every * np.arange(len(x))
    return np.flatnonzero(filled_gaps(time, place, np.full(len(x), SIGMA), first)).tolist()


def test_a_place_is_repeated_where_no_vehicle_comes_from_it_to_the_next():
    assert filled([0.0, 20.0, 40.0, 40.0, 40.0, 40.0, 120.0, 140.0]) == [3, 4, 5]


def test_a_vehicle_may_stand_and_drive_off_and_its_receiver_may_hold_the_place():
    assert filled([0.0, 20.0, 40.0, 40.0, 40.0, 40.0, 42.0, 46.0]) == []
    assert filled([0.0, 20.0, 40.0, 40.0, 40.0, 40.0, 65.0, 75.0]) == []


def test_seldom_fixes_leave_time_to_drive_off():
    assert filled([0.0, 20.0, 40.0, 40.0, 40.0, 40.0, 120.0, 140.0], every=10.0) == []


def test_one_wrong_fix_behind_a_stand_proves_nothing():
    assert filled([0.0, 20.0, 40.0, 40.0, 40.0, 240.0, 41.0, 42.0]) == []


def test_drives_one_behind_the_other_have_nothing_to_do_with_each_other():
    """The first ends in a stand, and the second begins where it was, and jumps."""
    line = [0.0, 40.0, 40.0, 40.0, 40.0, 500.0, 520.0]
    assert filled(line) == [2, 3, 4]
    assert filled(line, first=(0, 5)) == []
    assert filled(line, first=(0, 4)) == []


def test_a_drive_that_ends_in_repeats_or_is_short_is_left_alone():
    assert filled([0.0, 20.0, 40.0, 40.0, 40.0]) == []
    assert filled([0.0, 0.0]) == []


def held(jitter: float = 0.2, jump: float = 400.0, seconds: int = 30) -> list[float]:
    """At 15 m/s, a place that is held with a jitter, a jump, and on at 15 m/s."""
    go = 15.0 * np.arange(8)
    stay = go[-1] + jitter * np.sin(np.arange(seconds) * 2.0)
    return [*go, *stay, *(stay[-1] + jump + go)]


def test_a_place_that_is_held_with_a_jitter_is_repeated():
    assert filled(held()) == list(range(8, 38))
    assert filled([*held(), *held()], first=(0, 46)) == [*range(8, 38), *range(54, 84)]


def test_rows_within_a_jitter_are_sound_where_the_step_behind_is_driving():
    assert filled(held(jump=30.0)) == []
    assert filled(held(jump=80.0), every=5.0) == []
    assert filled(held(jump=400.0), every=15.0) == []  # a pause between rows
    assert filled(held(jitter=3.0)) == []
    assert filled(held(seconds=12)) == []
    stands = [x for x in held() if x < 106.0]
    assert filled([*stands, *stands[-30:]]) == []


def test_a_vehicle_that_stands_before_and_after_a_jump_is_not_moved_by_it():
    place = 0.2 * np.sin(np.arange(30.0))
    assert filled([*place, *(100.0 + place)]) == []
