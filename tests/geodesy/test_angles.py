"""Degrees and radians, bearings and headings: one turn, and back again."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.geodesy import angles, mercator, units

ANGLES = st.floats(-1e4, 1e4)


@given(ANGLES)
def test_degrees_and_radians_are_those_of_the_standard_library(angle):
    assert angles.radians(angle) == math.radians(angle)
    assert angles.degrees(angle) == math.degrees(angle)
    assert angles.radians(np.array([angle]))[0] == np.radians(angle)
    assert angles.degrees(np.array([angle]))[0] == np.degrees(angle)


@given(ANGLES)
def test_a_scalar_and_an_array_say_the_same(angle):
    one = np.array([angle])
    for function in (
        angles.wrap, angles.wrap_degrees, angles.wrap_bearing, angles.wrap_axis,
        units.mps_of_kmh, units.kmh_of_mps,
    ):  # fmt: skip
        assert function(one)[0] == pytest.approx(function(angle), abs=1e-9)
    for function in (angles.heading_of, angles.bearing_of, angles.axis_bearing_of):
        assert function(one, 0.1)[0] == pytest.approx(function(angle, 0.1), abs=1e-9)


@pytest.mark.parametrize("kind", [float, lambda x: np.array([x])])
@pytest.mark.parametrize("angle", [-1e-20, 0.0, 359.999, 360.0, -360.0, 720.0, -0.0, 180.0])
def test_a_bearing_is_less_than_a_turn_and_an_axis_less_than_half_of_one(angle, kind):
    assert 0.0 <= angles.wrap_bearing(kind(angle)) < 360.0
    assert 0.0 <= angles.wrap_axis(kind(angle)) < 180.0
    assert -180.0 <= angles.wrap_degrees(kind(angle)) < 180.0


@given(st.floats(0.0, 359.9), st.floats(-0.2, 0.2))
def test_a_bearing_becomes_a_heading_and_a_bearing_again(bearing, convergence):
    heading = angles.heading_of(bearing, convergence)
    found = angles.bearing_of(heading, convergence)
    assert angles.wrap_degrees(found - bearing) == pytest.approx(0.0, abs=1e-9)
    axis = angles.axis_bearing_of(heading, convergence)
    assert math.sin(math.radians(axis - bearing)) == pytest.approx(0.0, abs=1e-9)


def test_east_is_ninety_degrees_and_a_heading_of_nought():
    assert angles.heading_of(90.0, 0.0) == 0.0
    assert angles.bearing_of(0.0, 0.0) == 90.0
    assert angles.course_of(np.array([1.0, 0.0]), np.array([0.0, -1.0])).tolist() == [90.0, 180.0]


@given(st.floats(-math.pi + 1e-9, math.pi), st.integers(-5, 5))
def test_turns_are_taken_off_an_angle(angle, turns):
    assert angles.wrap(angle + 2.0 * math.pi * turns) == pytest.approx(angle, abs=1e-12)


def test_longitudes_have_no_jump_where_the_date_changes():
    assert angles.unwrap_degrees(np.array([179.0, -179.0])).tolist() == [179.0, 181.0]


def test_units_of_speed_are_those_of_the_standards():
    assert units.mps_of_kmh(36.0) == 10.0
    assert units.kmh_of_mps(10.0) == 36.0
    assert pytest.approx(1.852 / 3.6) == units.KNOT
    assert pytest.approx(1609.344 / 3600.0) == units.MPH
    assert pytest.approx(111_195.08, abs=0.01) == units.METRES_PER_DEGREE


@given(st.floats(-85.0, 85.0), st.floats(-180.0, 180.0))
def test_the_square_of_web_mercator_and_back(lat, lon):
    x, y = mercator.to_square(np.array([lat]), np.array([lon]))
    assert 0.0 <= x[0] <= 1.0
    assert mercator.latitude_of(y)[0] == pytest.approx(lat, abs=1e-9)
    assert mercator.longitude_of(x)[0] == pytest.approx(lon, abs=1e-9)
