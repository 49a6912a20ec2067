"""The on-line filter: what it says is what the recorded drive gives."""

import math
import pickle
from collections import deque
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from online.avenue import (
    CAR,
    FIELDS,
    PLANE,
    STRAIGHT,
    TOWN,
    both_ways,
    driven_to,
    fixes,
    records,
    said,
    ticks,
    town_fix,
    wheels,
)
from scenes import Town, network
from whichroad import recorded, workspace
from whichroad.epochs import build_timeline
from whichroad.filter.state import Path, new_path
from whichroad.geodesy.plane import Plane
from whichroad.lookback import path
from whichroad.observations import (
    Drive,
    Fixes,
    GeoFix,
    StartPose,
    WheelCounts,
    WheelTicks,
)
from whichroad.online import Estimate, Localizer
from whichroad.readers import drive_of_observations
from whichroad.readers.reported_fixes import Reported, make_fixes
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings


@pytest.mark.parametrize("delay", [0.05, 0.03])
def test_on_line_says_what_the_recorded_drive_gives(delay: float):
    """Fixes between wheel readings: every epoch is one record, the speed is constant."""
    at = np.arange(10, len(STRAIGHT.time), 10)
    first = fixes(STRAIGHT, np.array([0]))
    rest = fixes(STRAIGHT, at, delay)
    together = Fixes(*(np.concatenate([getattr(f, n) for f in (first, rest)]) for n in FIELDS))
    estimates, values, edges = both_ways(wheels(STRAIGHT), together)
    np.testing.assert_allclose(said(estimates), values, atol=1e-9)
    assert [(e.edge, e.status) for e in estimates.values()] == edges


@pytest.mark.parametrize(("bits", "low"), [(8, 0), (12, 0), (12, -2048), (16, 0)])
def test_counters_that_wrap_say_on_line_what_those_that_do_not_say(bits: int, low: int):
    """A gap of 4 s holds several turns of the shortest counter; half-way it is stored."""
    car = replace(CAR, counter_bits=bits)
    at = np.arange(10, len(STRAIGHT.time), 10)
    log = wheels(STRAIGHT)
    log = WheelCounts(log.time, np.floor(log.left) + 200.0, np.floor(log.right) + 3.0)
    plain, wrapped, unwrapped = (Localizer(TOWN, vehicle=one) for one in (CAR, car, car))
    for k, reading in enumerate(records(log, fixes(STRAIGHT, at))):
        if 400 < k < 440 and isinstance(reading, WheelTicks):
            continue
        if k == 700:
            wrapped = Localizer.from_bytes(wrapped.to_bytes(), TOWN)
        raw = reading
        if isinstance(reading, WheelTicks):
            raw = WheelTicks(
                reading.time,
                *((count - low) % 2**bits + low for count in (reading.left, reading.right)),
            )
        expected = plain.update(reading)
        for estimate in (wrapped.update(raw), unwrapped.update(reading)):
            assert repr(estimate) == repr(expected)
    assert plain.skipped == wrapped.skipped == unwrapped.skipped == {}


def test_on_line_a_first_fix_between_two_wheel_readings_starts_there():
    """Half of the arc between the readings lies before the start."""
    at = np.arange(10, len(STRAIGHT.time), 10)
    estimates, values, _ = both_ways(wheels(STRAIGHT), fixes(STRAIGHT, at, 0.05))
    started = values[:, 3] > 0
    assert [e.answered for e in estimates.values()] == started.tolist()
    np.testing.assert_allclose(said(estimates), values[started], atol=1e-9)


def test_of_a_fix_and_a_wheel_reading_of_one_moment_either_may_come_first():
    """On one road, between two looks at the map, at constant speed."""
    road = Town(network([[[0.0, 0.0], [1500.0, 0.0]]], curvature=PLANE.curvature), PLANE)
    at = np.concatenate([[0], np.arange(13, 1000, 10)])
    drive = list(records(wheels(STRAIGHT), fixes(STRAIGHT, at)))
    other_way = sorted(drive[2:], key=lambda r: (r.time, isinstance(r, WheelTicks)))
    a, b = Localizer(road, vehicle=CAR), Localizer(road, vehicle=CAR)
    first = {r.time: a.update(r) for r in drive}
    second = {r.time: b.update(r) for r in [*drive[:2], *other_way]}
    np.testing.assert_allclose(said(second), said(first), atol=1e-9)


def test_a_long_drive_is_cut_into_chunks_and_its_tree_of_routes_pruned_without_a_trace(monkeypatch):
    at = np.arange(0, len(STRAIGHT.time), 10)
    timeline = build_timeline(Drive("d", fixes(STRAIGHT, at), wheels(STRAIGHT)), PLANE, CAR)
    whole = localize_recorded(TOWN, timeline, vehicle=CAR)
    monkeypatch.setattr(recorded, "_CHUNK", 137)
    trees = []

    def small_tree(_: int) -> Path:
        """52 entries, then the kernel asks for more room."""
        trees.append(new_path(2100))
        return trees[-1]

    monkeypatch.setattr(workspace, "_free", deque())
    monkeypatch.setattr(workspace, "new_path", small_tree)
    monkeypatch.setattr(path, "new_path", small_tree)
    cut = localize_recorded(TOWN, timeline, vehicle=CAR)
    assert len(trees) > 2
    for a, b in zip(cut.output, whole.output, strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(whole.chain.edge) > 10
    for a, b in zip(cut.chain, whole.chain, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_hypotheses_are_a_distribution_and_the_road_s_share_is_theirs():
    estimate = driven_to(300).predict(30.0)
    assert sum(h.p for h in estimate.hypotheses) == pytest.approx(1.0, abs=1e-12)
    on = sum(h.p for h in estimate.hypotheses if h.edge == estimate.edge)
    assert estimate.p_road == pytest.approx(on, abs=1e-12)
    off = sum(h.p for h in estimate.hypotheses if h.edge is None)
    assert estimate.p_off_road == pytest.approx(off, abs=1e-12)
    assert sorted((h.p for h in estimate.hypotheses), reverse=True) == [
        h.p for h in estimate.hypotheses
    ]
    np.testing.assert_allclose(estimate.cov, estimate.cov.T)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ({"speed": 10.0}, (10.0, 0.3, 0.0, math.inf)),
        ({"speed": 0.0}, (0.0, 0.3, 0.0, math.inf)),
        ({"speed": 10.0, "sigma_speed": math.inf}, (10.0, math.inf, 0.0, math.inf)),
        ({"speed": 10.0, "sigma_speed": 0.1}, (10.0, 0.1, 0.0, math.inf)),
        ({"speed": 10.0, "bearing_deg": 90.0}, (10.0, 0.3, 90.0, math.degrees(math.atan(0.03)))),
        ({"speed": 0.5, "bearing_deg": 90.0}, (0.5, 0.3, 90.0, math.inf)),
        ({"bearing_deg": 90.0}, (0.0, math.inf, 90.0, math.inf)),
        ({"bearing_deg": 90.0, "sigma_bearing_deg": 2.0}, (0.0, math.inf, 90.0, 2.0)),
        ({"speed": 10.0, "bearing_deg": -1.0}, (10.0, 0.3, -1.0, math.inf)),
        ({}, (0.0, math.inf, 0.0, math.inf)),
    ],
)
def test_a_speed_or_course_without_a_sigma_gets_that_of_tables(given, meant):
    fix = GeoFix(0.0, 49.4, 8.7, **given)
    assert (fix.speed, fix.sigma_speed, fix.bearing_deg, fix.sigma_bearing_deg) == meant
    assert pickle.loads(pickle.dumps(fix)) == replace(fix) == fix


def test_these_sigmas_are_to_the_bit_those_of_a_recorded_drive():
    one = np.ones(1)
    told = Reported(one, 49.4 * one, 8.7 * one, speed=12.0 * one, bearing_deg=80.0 * one)
    read = make_fixes(told, Settings(), {})
    fix = GeoFix(1.0, 49.4, 8.7, speed=12.0, bearing_deg=80.0)
    drive = drive_of_observations([fix])
    for name in ("speed", "sigma_speed", "bearing_deg", "sigma_bearing_deg"):
        assert getattr(fix, name) == getattr(read, name)[0] == getattr(drive.fixes, name)[0]


def test_a_speed_without_a_sigma_moves_a_vehicle_that_nothing_else_does():
    """As one with the sigma of tables does."""

    def after(**more: float) -> Estimate:
        online = Localizer(TOWN)
        for k in range(0, 300, 10):
            estimate = online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k], **more))
        return estimate

    assert repr(after(speed=10.0)) == repr(after(speed=10.0, sigma_speed=0.3))
    ignored = after(speed=10.0, sigma_speed=math.inf)
    assert repr(ignored) == repr(after())
    assert after(speed=10.0).cov[0, 0] < ignored.cov[0, 0]


def test_a_fix_half_a_second_late_says_what_it_would_have_said_in_time():
    late, in_time = driven_to(105), driven_to(105)
    now = float(STRAIGHT.time[105])
    a = late.update(town_fix(STRAIGHT.x[100], STRAIGHT.y[100] + 2.0, STRAIGHT.time[100] + 1e-3))
    b = in_time.update(town_fix(STRAIGHT.x[105], STRAIGHT.y[105] + 2.0, now))
    assert a.time == now
    assert a.pose.x == pytest.approx(b.pose.x, abs=0.1)
    assert a.pose.y == pytest.approx(b.pose.y, abs=0.1)


def test_before_the_first_fix_the_localizer_is_lost():
    estimate = Localizer(TOWN, vehicle=CAR).update(WheelTicks(0.0, 0.0, 0.0))
    assert estimate.status == "lost"
    assert estimate.edge is None
    assert estimate.hypotheses == ()


@pytest.mark.parametrize("ask", ["update", "predict", "estimate"])
def test_before_the_first_fix_there_is_no_pose_and_no_covariance(ask: str):
    online = Localizer(TOWN, vehicle=CAR, lag=5.0)
    first = online.update(WheelTicks(0.0, 0.0, 0.0))
    estimate = {"update": lambda: first, "predict": lambda: online.predict(3.0),
                "estimate": online.estimate}[ask]()  # fmt: skip
    assert not estimate.answered
    for name in ("pose", "cov", "map_pose", "map_cov", "matched", "speed"):
        assert getattr(estimate, name) is None
    assert estimate.protection_level == np.inf
    assert "pose=None, cov=None" in repr(estimate)
    assert online.lagged() is None
    known = online.update(town_fix(150.0, -1.75, 1.0))
    assert known.answered
    assert known.cov.shape == (3, 3)
    assert np.linalg.eigvalsh(known.cov).min() > 0.0
    assert known.pose.x == pytest.approx(150.0, abs=10.0)


def test_the_covariance_of_east_and_north_is_that_of_the_plane_turned():
    """Along any bearing it is what the plane's is along the heading of that bearing."""
    estimate = driven_to(100).estimate()
    far = SimpleNamespace(plane=Plane(49.4, 8.2))  # the same answer 36 km off a map's middle
    beside = Estimate(
        estimate.time, estimate._record, estimate._hypotheses, far, (0.0, 0.0), 0.0
    )  # fmt: skip
    for one in (estimate, beside):
        x, y = one.pose.x, one.pose.y
        for heading in (0.0, 0.7, 2.0):
            bearing = math.radians(one._roads.plane.bearing(heading, x, y))
            along = np.array([math.cos(heading), math.sin(heading), 1.0])
            east_north = np.array([math.sin(bearing), math.cos(bearing), 1.0])
            assert east_north @ one.cov_enu @ east_north == pytest.approx(along @ one.cov @ along)
    assert Localizer(TOWN).estimate().cov_enu is None


def test_a_start_pose_stands_in_for_the_first_fix():
    lat, lon = PLANE.to_geodetic(150.0, -1.75)
    online = Localizer(TOWN, vehicle=CAR, start=StartPose(lat, lon, 90.0, 2.0, 5.0))
    for reading in ticks(wheels(STRAIGHT))[:101]:
        estimate = online.update(reading)
    assert estimate.pose.x == pytest.approx(250.0, abs=3.0 * 2.0)
    assert estimate.edge == 4  # the third block, eastwards
    assert estimate.p_road > 0.9
    assert estimate.pose.bearing_deg == pytest.approx(90.0, abs=3.0)


def test_speed_is_what_the_wheels_say():
    online = driven_to(100)
    assert online.estimate().speed == pytest.approx(10.0, rel=0.03)
    assert math.isfinite(online.predict(11.0).pose.x)
