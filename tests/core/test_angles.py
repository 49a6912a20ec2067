"""Angles on the circle."""

import math

from hypothesis import example, given
from hypothesis import strategies as st
from whichroad.core.angles import angle_of, wrap

from strategies import angles

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


lengths = st.floats(-1e3, 1e3)


@given(lengths, lengths, st.floats(-0.2, 0.2))
@example(0.0, 0.0, 0.0)
@example(-1.0, 0.0, -0.0)
@example(1.0, 0.0, 0.1)
def test_the_angle_of_a_vector_is_its_arc_tangent_to_the_last_bits(x: float, y: float, tilt: float):
    assert abs(angle_of(x, y) - math.atan2(y, x)) <= 1e-15
    assert abs(angle_of(x, tilt * x) - math.atan2(tilt * x, x)) <= 1e-15
