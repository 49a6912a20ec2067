"""Counts and times as messages write them."""

import math

import pytest

from whichroad.wording import by_reason, counted, moment


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 fixes"), (1, "1 fix"), (2, "2 fixes"), (1200, "1,200 fixes")]
)
def test_a_count_has_its_noun_in_the_right_number(number: int, text: str):
    assert counted(number, "fix", "fixes") == text


def test_a_regular_plural_needs_no_word_of_its_own():
    assert [counted(n, "epoch") for n in (1, 3)] == ["1 epoch", "3 epochs"]


def test_reasons_are_followed_by_their_counts():
    assert by_reason({"line cut short": 2, "bad number": 1000}) == (
        "line cut short: 2, bad number: 1,000"
    )
    assert by_reason({}) == ""


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (1774737000.0, "2026-03-28T22:30:00Z"),
        (12.4, "12 s"),
        (-3.0, "-3 s"),
        (1e308, "1e+308 s"),
        (math.inf, "inf s"),
    ],
)
def test_a_time_is_a_date_where_the_clock_has_one(seconds: float, text: str):
    assert moment(seconds) == text
