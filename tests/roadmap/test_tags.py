"""What the words of maps mean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.roadmap import tags


@pytest.mark.parametrize(
    ("word", "kmh"),
    [
        ("50", 50),
        ("30 mph", 48.28032),
        ("30mph", 48.28032),
        ("10 knots", 18.52),
        ("7.5", 7.5),
        ("walk", 7),
        ("DE:urban", 50),
        ("DE:rural", 100),
        ("FR:rural", 90),
        ("DE:zone:30", 30),
        ("DE:zone30", 30),
        ("IT:30", 30),
        ("50;30", 50),
        ("none", 0),
        ("signals", 0),
        ("", 0),
        (None, 0),
        (60, 60),
        (float("nan"), 0),
        (-5, 0),
    ],
)
def test_speed_limits_are_read_in_kmh(word, kmh):
    assert tags.speed_limit_kmh(word) == pytest.approx(kmh)


@pytest.mark.parametrize(
    ("word", "metres"),
    [("3.5", 3.5), ("3.5 m", 3.5), ("10 ft", 3.048), ("wide", 0), ("2 lanes", 2)],
)
def test_widths_are_read_in_metres(word, metres):
    assert tags.number(word) == pytest.approx(metres)


@pytest.mark.parametrize(
    ("word", "along"),
    [
        (True, 1), (False, 0), ("TRUE", 1), ("yes", 1), ("1", 1), (1, 1), (1.0, 1), ("F", 1),
        ("FT", 1), ("T", -1), ("TF", -1), (-1, -1), ("-1", -1), ("B", 0), ("no", 0), (0, 0),
        ("", 0), ("None", 0), (float("nan"), 0), (None, 0), ("perhaps", None),
    ],
)  # fmt: skip
def test_one_way_words_of_tables_are_understood(word, along):
    assert tags.oneway_word(word) == along


@pytest.mark.parametrize(
    ("value", "said"),
    [("yes", True), ("viaduct", True), ("T", True), (1, True), (True, True), ("no", False),
     ("F", False), (0, False), (None, False), (float("nan"), False), ("", False)],
)  # fmt: skip
def test_flags_are_set_unless_they_say_no(value, said):
    assert tags.truth(value) is said


@given(st.one_of(st.none(), st.text(), st.floats(), st.integers(), st.booleans()))
def test_no_word_is_too_strange(word):
    assert tags.speed_limit_kmh(word) >= 0
    assert tags.number(word) >= 0
    assert tags.truth(word) in (True, False)
    assert tags.oneway_word(word) in (1, 0, -1, None)
    assert isinstance(tags.whole(word), int)
    values = {"oneway": str(word), "access": str(word), "junction": str(word)}
    assert tags.oneway(values) in (1, 0, -1)
    assert tags.access(values) in (tags.OPEN, tags.LIMITED, tags.CLOSED)


@pytest.mark.parametrize("lanes", [1, 2, 3, 4, 5])
def test_which_lane_is_driven_in_spreads_as_the_lanes_lie(lanes: int):
    """Each lane of 3.3 m is as probable as another."""
    spread = float(np.std(3.3 * np.arange(lanes)))
    assert tags.lane_sigma("primary", False, lanes) == pytest.approx(spread)
    assert tags.lane_sigma("primary", True, 2 * lanes) == pytest.approx(spread)


@pytest.mark.parametrize(
    ("highway", "lanes"),
    [("motorway", 2), ("trunk", 2), ("", 2), ("motorway_link", 1), ("primary", 1), ("service", 1)],
)
@pytest.mark.parametrize("both_ways", [True, False])
def test_without_a_number_of_lanes_the_class_tells_it(highway, lanes, both_ways):
    told = tags.lane_sigma(highway, False, lanes)
    assert tags.lane_sigma(highway, both_ways, 0.0) == pytest.approx(told)


@given(st.floats(0.1, 300.0), st.floats(0.1, 300.0), st.booleans())
def test_more_lanes_never_spread_less_and_absurd_ones_no_more_than_twelve(one, other, both_ways):
    spread = [tags.lane_sigma("primary", both_ways, n) for n in sorted((one, other))]
    assert 0.0 <= spread[0] <= spread[1] <= tags.lane_sigma("primary", both_ways, 12.0)
