"""Angles on the circle."""

import math

from hypothesis import example, given
from hypothesis import strategies as st

from strategies import angles
from whichroad.core.angles import wrap

just_beyond = math.nextafter(math.pi, 4.0)
just_below = math.nextafter(math.pi, 0.0)  # half a turn more rounds to a whole one


@given(angles)
@example(math.pi)
@example(-math.pi)
@example(just_beyond)
@example(-just_beyond)
@example(just_below)
@example(3.0 * math.pi)
@example(-1e-300)
def test_a_wrapped_angle_lies_in_the_half_open_turn_and_points_the_same_way(angle: float):
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert (
        math.hypot(math.cos(wrapped) - math.cos(angle), math.sin(wrapped) - math.sin(angle)) < 1e-13
    )


@given(angles)
@example(math.pi)
@example(just_beyond)
@example(-just_beyond)
@example(just_below)
def test_wrapping_twice_is_wrapping_once(angle: float):
    assert wrap(wrap(angle)) == wrap(angle)


@given(st.floats(-3.0, 3.0), st.integers(-20, 20))
def test_whole_turns_do_not_matter(angle: float, turns: int):
    assert math.isclose(wrap(angle + turns * 2.0 * math.pi), angle, abs_tol=1e-13)
