"""The plane against pyproj, and its laws."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import MapError
from whichroad.geodesy.plane import Plane

GEOD = pyproj.Geod(ellps="WGS84")
ORIGINS = [
    (0.0, 0.0),
    (49.4, 8.7),
    (-33.9, 151.2),
    (65.0, 179.95),  # the antimeridian runs through it
    (78.2, 15.6),
    (89.9, -40.0),
    (-77.8, 166.7),
]


def around(lat0, lon0, distance, count=60, seed=0):
    """Places at a distance from an origin, in all directions."""
    azimuth = np.random.default_rng(seed).uniform(0, 360, count)
    lon, lat, _ = GEOD.fwd(
        np.full(count, lon0), np.full(count, lat0), azimuth, np.full(count, distance)
    )
    return np.asarray(lat), np.asarray(lon)


@pytest.mark.parametrize(("lat0", "lon0"), ORIGINS)
@pytest.mark.parametrize("distance", [10.0, 1e4, 3e5, 2e6])
def test_the_plane_is_that_of_pyproj(lat0, lon0, distance):
    sterea = pyproj.Proj(f"+proj=sterea +lat_0={lat0} +lon_0={lon0} +ellps=WGS84")
    lat, lon = around(lat0, lon0, distance)
    x, y = Plane(lat0, lon0).from_geodetic(lat, lon)
    expected = sterea(lon, lat)
    np.testing.assert_allclose([x, y], expected, atol=1e-4)  # near a pole PROJ loses digits
    factors = sterea.get_factors(lon, lat)
    turn = (np.degrees(Plane(lat0, lon0).convergence(x, y)) - factors.meridian_convergence) % 360
    np.testing.assert_allclose(np.minimum(turn, 360 - turn), 0, atol=1e-6)


@pytest.mark.parametrize(("lat0", "lon0"), ORIGINS)
@pytest.mark.parametrize("distance", [1.0, 1e5, 2e6])
def test_there_and_back_again_is_below_a_millimetre(lat0, lon0, distance):
    plane = Plane(lat0, lon0)
    lat, lon = around(lat0, lon0, distance)
    back_lat, back_lon = plane.to_geodetic(*plane.from_geodetic(lat, lon))
    assert np.max(GEOD.inv(lon, lat, back_lon, back_lat)[2]) < 1e-3
    assert np.all((back_lon >= -180) & (back_lon < 180))


@pytest.mark.parametrize(("lat0", "lon0"), ORIGINS)
@pytest.mark.parametrize("distance", [0.0, 1e5, 5e5, 1e6])
def test_distances_within_5_km_of_a_vehicle_are_true_to_1e_4(lat0, lon0, distance):
    plane = Plane(lat0, lon0)
    lat, lon = around(lat0, lon0, distance)
    x, y = plane.from_geodetic(lat, lon)
    rng = np.random.default_rng(1)
    away = rng.uniform(10, 5000, len(lat))
    to_lon, to_lat, _ = GEOD.fwd(lon, lat, rng.uniform(0, 360, len(lat)), away)
    u, v = plane.from_geodetic(np.asarray(to_lat), np.asarray(to_lon))
    measured = np.hypot(u - x, v - y) / plane.scale(x, y)
    assert np.max(np.abs(measured / away - 1)) < 1e-4


@pytest.mark.parametrize(("lat0", "lon0"), ORIGINS)
def test_the_local_scale_is_true_to_1e_4_up_to_2000_km(lat0, lon0):
    plane = Plane(lat0, lon0)
    lat, lon = around(lat0, lon0, 2e6)
    to_lon, to_lat, _ = GEOD.fwd(lon, lat, np.linspace(0, 360, len(lat)), np.full(len(lat), 100.0))
    x, y = plane.from_geodetic(lat, lon)
    u, v = plane.from_geodetic(np.asarray(to_lat), np.asarray(to_lon))
    measured = np.hypot(u - x, v - y) / plane.scale((x + u) / 2, (y + v) / 2)
    assert np.max(np.abs(measured / 100 - 1)) < 1e-4


@pytest.mark.parametrize(("lat0", "lon0"), ORIGINS)
@pytest.mark.parametrize("distance", [0.0, 1e5, 1e6])
def test_a_bearing_is_the_direction_of_the_geodesic(lat0, lon0, distance):
    plane = Plane(lat0, lon0)
    lat, lon = around(lat0, lon0, distance)
    azimuth = np.linspace(-180, 180, len(lat))
    to_lon, to_lat, _ = GEOD.fwd(lon, lat, azimuth, np.full(len(lat), 10.0))
    x, y = plane.from_geodetic(lat, lon)
    u, v = plane.from_geodetic(np.asarray(to_lat), np.asarray(to_lon))
    off = (plane.bearing(np.arctan2(v - y, u - x), x, y) - azimuth + 180) % 360 - 180
    assert np.max(np.abs(off)) < 1e-3


@given(
    st.sampled_from(ORIGINS),
    st.floats(-720, 720),
    st.floats(-1e6, 1e6),
    st.floats(-1e6, 1e6),
)
def test_bearing_and_heading_undo_each_other(origin, bearing, x, y):
    plane = Plane(*origin)
    heading = plane.heading(bearing, x, y)
    assert -math.pi < heading <= math.pi
    again = plane.bearing(heading, x, y)
    assert 0 <= again < 360
    assert abs((again - bearing + 180) % 360 - 180) < 1e-9


@given(st.sampled_from(ORIGINS), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-3, 3))
def test_a_scalar_gives_what_an_array_gives(origin, x, y, heading):
    plane = Plane(*origin)
    xs, ys, headings = (np.array([value]) for value in (x, y, heading))
    lat, lon, bearing = plane.pose(x, y, heading)
    series = [float(a[0]) for a in plane.pose(xs, ys, headings)]  # the scalar iterates
    assert series == pytest.approx([lat, lon, bearing], rel=1e-15, abs=1e-13)
    back = plane.from_geodetic(np.array([lat]), np.array([lon]))
    assert plane.from_geodetic(lat, lon) == tuple(float(a[0]) for a in back)
    assert plane.convergence(x, y) == plane.convergence(xs, ys)[0]
    assert plane.scale(x, y) == plane.scale(xs, ys)[0]
    assert plane.heading(bearing, x, y) == plane.heading(np.array([bearing]), xs, ys)[0]


def test_the_origin_is_the_origin_and_north_is_up_there():
    plane = Plane(49.4, 8.7)
    assert plane.from_geodetic(49.4, 8.7) == pytest.approx((0, 0), abs=1e-8)
    assert plane.heading(90.0, 0.0, 0.0) == pytest.approx(0)
    assert plane.heading(0.0, 0.0, 0.0) == pytest.approx(math.pi / 2)


def test_the_antimeridian_is_a_place_like_any_other():
    plane = Plane(-17.0, 179.99)
    east, _ = plane.from_geodetic(-17.0, -179.995)
    west, _ = plane.from_geodetic(-17.0, 179.995)
    assert east - west == pytest.approx(GEOD.inv(179.995, -17.0, -179.995, -17.0)[2], rel=1e-4)


@pytest.mark.parametrize(
    ("lat", "lon"), [(90.0, 0.0), (-91.0, 0.0), (float("nan"), 0.0), (0.0, 1e9)]
)
def test_an_origin_that_is_none_is_refused(lat, lon):
    with pytest.raises(MapError, match="origin"):
        Plane(lat, lon)


def test_threads_that_share_a_plane_get_what_one_thread_gets():
    """Each thread has bound calls of its own."""
    plane = Plane(49.4, 8.7)
    places = [(float(x), float(x) / 3.0, 0.001 * x) for x in range(2000)]
    expected = [plane.pose(*place) for place in places]
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(lambda _: [plane.pose(*place) for place in places], range(8)):
            assert found == expected


def test_more_planes_than_are_kept_ready_give_the_same():
    planes = [Plane(40.0 + 0.1 * k, 8.7) for k in range(150)]
    first = [plane.from_geodetic(45.0, 9.0) for plane in planes]
    assert [plane.from_geodetic(45.0, 9.0) for plane in planes] == first
    assert len(set(first)) == len(first)
