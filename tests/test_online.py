"""The on-line filter: what it says is what the recorded drive gives, and it refuses openly."""

import copy
import math
import pickle
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pytest

from scenes import Town, Truth, columns, drive_along, gnss, network
from whichroad import recorded, workspace
from whichroad.epochs import build_timeline
from whichroad.errors import DriveError, MapError, ReadError, SettingError
from whichroad.filter.lookback.history import new_history
from whichroad.filter.state import Path, new_path
from whichroad.geodesy.plane import Plane
from whichroad.lookback import path, smoothing
from whichroad.observations import (
    Distance,
    Drive,
    Fixes,
    GeoFix,
    Observation,
    SpeedYaw,
    StartPose,
    WheelCounts,
    WheelSpeed,
    WheelTicks,
)
from whichroad.online import Estimate, Localizer, State, localizer, localizer_state
from whichroad.readers import drive_of_observations
from whichroad.readers.reported_fixes import NOT_A_COVARIANCE, Reported, make_fixes
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings, Vehicle, to_toml
from whichroad.tables.status import STATUS

FIELDS = Fixes.__slots__
PLANE = Plane(49.4, 8.7)
CAR = Vehicle(track_width=1.5, metres_per_tick_left=0.01, metres_per_tick_right=0.01)


def avenue() -> list[np.ndarray]:
    """A street of 100 m blocks along x, crossed at each corner by a street of 200 m."""
    ahead = [np.array([[x, 0.0], [x + 100.0, 0.0]]) for x in np.arange(0.0, 1500.0, 100.0)]
    across = [
        np.array([[x, 0.0], [x, side * 100.0]])
        for x in np.arange(100.0, 1500.0, 100.0)
        for side in (1.0, -1.0)
    ]
    return [*ahead, *across]


TOWN = Town(network(avenue(), curvature=PLANE.curvature), PLANE)
STRAIGHT = drive_along([[20.0, -1.75], [1400.0, -1.75]])


def wheels(truth: Truth) -> WheelCounts:
    half = 0.75 * (truth.heading - truth.heading[0])
    return WheelCounts(truth.time, 100.0 * (truth.s - half), 100.0 * (truth.s + half))


def fixes(truth: Truth, at: np.ndarray, delay: float = 0.0, sigma: float = 3.0) -> Fixes:
    """Fixes at epochs `at`, made and stamped `delay` seconds later, at constant speed."""
    rows = gnss(truth, sigma=sigma)[at]
    heading = truth.heading[at]
    x = rows[:, 0] + 10.0 * delay * np.cos(heading)
    y = rows[:, 1] + 10.0 * delay * np.sin(heading)
    n = len(at)
    course_sigma = np.full(n, np.inf)
    course_sigma[0] = 6.0
    return Fixes(
        truth.time[at] + delay, *PLANE.to_geodetic(x, y), np.full(n, 9.0), np.full(n, 2.0),
        np.full(n, 6.0), np.full(n, 10.0), np.full(n, np.inf), np.degrees(np.pi / 2 - heading),
        course_sigma, np.zeros(n, np.uint8),
    )  # fmt: skip


def ticks(log: WheelCounts) -> list[WheelTicks]:
    columns = (log.time.tolist(), log.left.tolist(), log.right.tolist())
    return [WheelTicks(*row) for row in zip(*columns, strict=True)]


def records(log: WheelCounts, gnss_log: Fixes) -> Iterator[Observation]:
    """All readings in time order, wheels first."""
    columns = [getattr(gnss_log, name).tolist() for name in FIELDS if name != "flags"]
    fixed = [GeoFix(*row) for row in zip(*columns, strict=True)]
    yield from sorted([*ticks(log), *fixed], key=lambda r: r.time)


def said(estimates: dict[float, Estimate]) -> np.ndarray:
    return np.array(
        [
            (e.pose.x, e.pose.y, e.pose.heading, e.cov[0, 0], e.cov[1, 1], e.p_road, e.p_off_road,
             e.abscissa)
            for e in estimates.values() if e.answered
        ]
    )  # fmt: skip


def both_ways(log: WheelCounts, gnss_log: Fixes) -> tuple[dict[float, Estimate], np.ndarray, list]:
    """On-line estimates by time, the recorded drive's values and its edges and status."""
    online = Localizer(TOWN, vehicle=CAR)
    estimates = {r.time: online.update(r) for r in records(log, gnss_log)}
    assert online.skipped == {}
    timeline = build_timeline(Drive("d", gnss_log, log), PLANE, CAR)
    output = localize_recorded(TOWN, timeline, vehicle=CAR).output
    assert len(timeline.epochs) == len(estimates)
    edges = [
        (int(e) if e >= 0 else None, STATUS[s])
        for e, s in zip(output.rows.edge, output.rows.status, strict=True)
    ]
    return estimates, columns(output, "x y heading xx yy p_edge p_off_road s"), edges


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

    monkeypatch.setattr(workspace, "_free", threading.local())
    monkeypatch.setattr(workspace, "new_path", small_tree)
    monkeypatch.setattr(path, "new_path", small_tree)
    cut = localize_recorded(TOWN, timeline, vehicle=CAR)
    assert len(trees) > 2
    for a, b in zip(cut.output, whole.output, strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(whole.chain.edge) > 10
    for a, b in zip(cut.chain, whole.chain, strict=True):
        np.testing.assert_array_equal(a, b)


def town_fix(x: float, y: float, time: float, **more: float) -> GeoFix:
    lat, lon = PLANE.to_geodetic(x, y)
    return GeoFix(time, lat, lon, 9.0, 0.0, 9.0, **more)


def driven_to(k: int) -> Localizer:
    """A localizer that has seen the straight drive up to epoch k, a fix each second."""
    online = Localizer(TOWN, vehicle=CAR)
    course = {"bearing_deg": 90.0, "sigma_bearing_deg": 6.0}
    for i, reading in enumerate(ticks(wheels(STRAIGHT))[: k + 1]):
        online.update(reading)
        if i % 10 == 0:
            online.update(town_fix(STRAIGHT.x[i], STRAIGHT.y[i], reading.time, **course))
    return online


def test_predicting_changes_nothing():
    online = driven_to(205)
    before = online.predict(float(STRAIGHT.time[205]))
    ahead = online.predict(float(STRAIGHT.time[205]) + 4.0)
    again = online.predict(float(STRAIGHT.time[205]))
    np.testing.assert_array_equal(said({0.0: again}), said({0.0: before}))
    assert ahead.pose.x - before.pose.x == pytest.approx(40.0, rel=0.05)
    assert ahead.cov[0, 0] > before.cov[0, 0]


@pytest.mark.parametrize("time", [-100.0, 0.0, 20.0])
def test_a_prediction_before_the_last_observation_is_the_estimate_at_it(time: float):
    online = driven_to(205)
    last = online.predict(online.estimate().time)
    assert last.time == online.estimate().time > 20.0
    assert repr(online.predict(time)) == repr(last)


@pytest.mark.parametrize(
    ("time", "message"),
    [
        (math.nan, "time is nan; seconds since 1970 were expected; as datetime.timestamp"),
        (math.inf, "time is inf; seconds"),
        (-math.inf, "time is -inf; seconds"),
        (1.78e12, r"time is 1.78e\+12; .*are these milliseconds"),
        ("noon", "time is 'noon'; seconds"),
        (datetime(2026, 6, 1), "time is datetime.datetime"),
        (1.78e9, "20,602 days after the last observation; at most a year"),
    ],
)
def test_a_time_that_cannot_be_is_refused_by_a_prediction(time, message: str):
    online = driven_to(205)
    before = online.to_bytes()
    with pytest.raises(ReadError, match=f"predict: .*{message}"):
        online.predict(time)
    assert online.to_bytes() == before


@pytest.mark.parametrize("days", [1.0, 30.0, 365.0])
def test_a_prediction_far_ahead_knows_that_it_knows_nothing(days: float):
    far = driven_to(205).predict(86400.0 * days)
    assert np.linalg.eigvalsh(far.cov).min() > 0.0
    assert 1e4 < far.protection_level < math.inf
    assert far.level_along_m > 1e4


def test_a_time_that_cannot_be_wakes_nobody():
    online = driven_to(205)
    before = online.to_bytes()
    with pytest.raises(ReadError, match="wake: time is nan"):
        online.wake(math.nan)
    assert online.to_bytes() == before


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


def test_a_fix_more_than_a_second_late_is_refused_and_counted():
    online = driven_to(100)
    before = online.predict(10.0)
    after = online.update(town_fix(50.0, -1.75, 8.5))
    np.testing.assert_array_equal(said({0.0: after}), said({0.0: before}))
    assert online.skipped == {"late": 1}


@pytest.mark.parametrize("by", [-8.0, 86400.0])
@pytest.mark.parametrize("sensors", ["wheels and fixes", "fixes"])
def test_a_clock_that_was_set_back_or_one_wrong_time_is_outlived(by: float, sensors: str):
    """All clocks go back by 8 s; or one fix is stamped a day later, and the others are not."""
    online = driven_to(100)
    begin = STRAIGHT.time[101]
    if by > 0.0:
        online.update(town_fix(STRAIGHT.x[100], -1.75, begin + by))
    for k in range(101, 200):
        time = STRAIGHT.time[k] + min(by, 0.0)
        if sensors != "fixes":
            online.update(SpeedYaw(time, 10.0, 0.0))
        if k % 10 == 0:
            estimate = online.update(town_fix(STRAIGHT.x[k], -1.75, time))
    assert online.skipped["clock set back: started anew"] == 1
    assert estimate.answered
    assert estimate.time == pytest.approx(time, abs=1.0)
    assert estimate.status in ("on_road", "ambiguous")


def test_an_old_reading_among_others_begins_nothing_anew():
    online = driven_to(100)
    for k in range(101, 150):
        online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k]))
        online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k] - 5.0))
    assert online.skipped == {"late": 49}


def test_readings_that_were_late_before_it_was_taken_back_begin_nothing_anew():
    online = driven_to(100)
    state = online.state()
    for k in (20, 30, 40):
        if k == 40:
            online.restore(state)
        online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k]))
    assert online.skipped == {"late": 3}


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"lat_deg": math.nan}, "impossible position"),
        ({"lat_deg": 91.0}, "impossible position"),
        ({"lon_deg": math.inf}, "impossible position"),
        ({"lat_deg": 0.0, "lon_deg": 0.0}, "impossible position"),
        ({"time": math.nan}, "no time"),
        ({"time": math.inf}, "no time"),
        ({"cov_ee": math.nan, "cov_nn": 1.0}, NOT_A_COVARIANCE),
        ({"cov_ee": 1.0, "cov_nn": 1.0, "cov_en": 2.0}, NOT_A_COVARIANCE),
        ({"speed": math.nan, "sigma_speed": 0.3}, "impossible speed (not used)"),
        ({"speed": math.nan, "sigma_speed": None}, "impossible speed (not used)"),
        ({"speed": -1.0, "sigma_speed": None}, "impossible speed (not used)"),
        ({"bearing_deg": math.nan, "sigma_bearing_deg": 3.0}, "impossible course (not used)"),
    ],
)
def test_a_fix_that_cannot_be_is_counted_and_spoils_nothing(wrong, reason: str):
    online, unaware = driven_to(100), driven_to(100)
    fix = town_fix(STRAIGHT.x[100], STRAIGHT.y[100], float(STRAIGHT.time[100]))
    online.update(replace(fix, **wrong))
    assert online.skipped == {reason: 1}
    a = online.predict(float(STRAIGHT.time[100]) + 1.0)
    assert a.status == "on_road"
    b = unaware.predict(a.time)
    assert math.hypot(a.pose.x - b.pose.x, a.pose.y - b.pose.y) < 3.0  # m, one sigma of a fix


@pytest.mark.parametrize(
    ("reading", "reason"),
    [
        (WheelSpeed(10.2, math.nan, 10.0), "wheel speed beyond 90 m/s"),
        (WheelSpeed(10.2, 1e9, 1e9), "wheel speed beyond 90 m/s"),
        (SpeedYaw(10.2, math.inf, 0.0), "speed beyond 90 m/s"),
        (SpeedYaw(10.2, 10.0, 1e9), "yaw rate beyond 10 rad/s"),
        (WheelTicks(10.2, math.nan, 0.0), "missing wheel count"),
        (Distance(10.2, math.inf), "no distance"),
    ],
)
def test_a_reading_of_wheels_that_cannot_be_is_counted_and_changes_nothing(reading, reason: str):
    online = driven_to(100)
    before = online.estimate()
    after = online.update(reading)
    np.testing.assert_array_equal(said({0.0: after}), said({0.0: before}))
    assert online.skipped == {reason: 1}


@pytest.mark.parametrize("counts", [0.0, -500.0])
def test_a_counter_that_began_anew_in_a_silence_does_not_take_the_vehicle_back(counts: float):
    online = driven_to(100)
    before = online.estimate()
    at = float(STRAIGHT.time[100]) + 5.0
    a = online.update(WheelTicks(at, counts, counts))
    assert online.skipped == {"odometry jumped (bridged)": 1}
    assert a.pose.x > before.pose.x + 20.0
    assert a.protection_level > before.protection_level + 10.0


def test_a_wheel_counter_that_jumps_on_line_is_bridged_at_the_speed_before_and_counted():
    online, unaware = driven_to(100), driven_to(100)
    at = float(STRAIGHT.time[100])
    log = wheels(STRAIGHT)
    a = online.update(WheelTicks(at, log.left[100] - 65536.0, log.right[100]))
    b = unaware.update(WheelTicks(at, log.left[100], log.right[100]))
    assert online.skipped == {"odometry jumped (bridged)": 1}
    np.testing.assert_allclose(said({0.0: a}), said({0.0: b}), atol=1e-6)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ((0.0, 49.4, 8.7), "a GeoFix, WheelTicks"),
        (None, "a GeoFix, WheelTicks"),
        (GeoFix(datetime(2026, 6, 1), 49.4, 8.7), "datetime.timestamp"),
        (GeoFix(1.78e12, 49.4, 8.7), "milliseconds"),
    ],
)
def test_what_is_no_observation_is_refused_with_what_was_expected(told, message: str):
    with pytest.raises(ReadError, match=message):
        Localizer(TOWN).update(told)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cov_ee": np.eye(2)}, r"GeoFix\(cov_ee='\[\[1. 0"),
        ({"cov_ee": 4.0, "cov_nn": "4"}, r"GeoFix\(cov_nn='4'\)"),
    ],
)
def test_a_field_that_is_no_number_is_refused_by_its_name(wrong, message: str):
    with pytest.raises(ReadError, match=message):
        Localizer(TOWN).update(GeoFix(0.0, 49.4, 8.7, **wrong))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"settings": {}}, "settings is a dict; whichroad.Settings"),
        ({"settings": {"map_sigma": 3.0}}, "settings is a dict; whichroad.Settings"),
        ({"vehicle": {"track_width": 1.5}}, "vehicle is a dict; whichroad.Vehicle"),
        ({"start": (49.4, 8.7)}, r"start is \(49.4, 8.7\); a StartPose or"),
        ({"start": (49.4, 8.7, "north")}, "start is .*north.*; a StartPose or"),
        ({"start": 90.0}, "start is 90.0; a StartPose or"),
    ],
)
def test_an_argument_of_another_kind_is_refused(given, message: str):
    with pytest.raises(SettingError, match=message):
        Localizer(TOWN, **given)


def test_the_car_may_be_the_path_of_its_file_and_overrides_settings(tmp_path):
    car, file = replace(CAR, noise={"gnss_time": 50.0}), tmp_path / "vehicle.toml"
    file.write_text(to_toml(car), "utf-8")
    online, usual = Localizer(TOWN, vehicle=file), Settings(map_sigma=3.0)
    assert online.vehicle == car
    assert online.settings == Settings(gnss_time=50.0)
    again = Localizer.from_bytes(online.to_bytes(), TOWN, vehicle=str(file), settings=usual)
    assert again.vehicle == car
    assert again.settings == Settings(gnss_time=50.0, map_sigma=3.0)
    with pytest.raises(ReadError, match=r"none\.toml: "):
        Localizer(TOWN, vehicle=tmp_path / "none.toml")


@pytest.mark.parametrize("lag", [None, 5.0])
def test_a_localizer_out_of_a_pickle_goes_on_as_if_nothing_had_been(lag: float | None):
    online = Localizer(TOWN, vehicle=CAR, lag=lag)
    at = np.arange(0, 600, 10)
    seen = list(records(wheels(STRAIGHT), fixes(STRAIGHT, at)))
    for one in seen[:300]:
        online.take(one)
    again = pickle.loads(pickle.dumps(online))
    for one in seen[300:600]:
        online.take(one)
        again.take(one)
    np.testing.assert_array_equal(said({0.0: online.estimate()}), said({0.0: again.estimate()}))
    if lag is not None:
        pair = online.lagged(), again.lagged()
        np.testing.assert_array_equal(*[said({0.0: estimate}) for estimate in pair])


def seen(first: int = 0, last: int = 600) -> list[Observation]:
    """Wheels and a fix each second."""
    return list(records(wheels(STRAIGHT), fixes(STRAIGHT, np.arange(0, 600, 10))))[first:last]


def test_a_copy_goes_on_alone():
    online = Localizer(TOWN, vehicle=CAR, lag=5.0)
    for one in seen(0, 300):
        online.take(one)
    before, double = repr(online.estimate()), copy.deepcopy(online)
    for one in seen(300):
        double.take(one)
    assert repr(online.estimate()) == before
    for one in seen(300):
        online.take(one)
    assert repr(online.estimate()) == repr(double.estimate())
    assert repr(online.lagged()) == repr(double.lagged())


@pytest.mark.parametrize("lag", [None, 5.0])
@pytest.mark.parametrize("until", [0, 1, 2, 3, 300])
def test_a_localizer_out_of_its_bytes_goes_on_to_the_bit(until: int, lag: float | None):
    settings, start = Settings(gnss_time=50.0), StartPose(*PLANE.to_geodetic(20.0, 0.0), 90.0)
    online = Localizer(TOWN, vehicle=CAR, settings=settings, start=start, lag=lag)
    online.update(WheelTicks(math.nan, 0.0, 0.0))
    for one in seen(0, until):
        online.take(one)
    again = Localizer.from_bytes(online.to_bytes(), TOWN)
    assert (again.vehicle, again.settings, again.lag) == (CAR, settings, lag)
    assert again.skipped == {"no time": 1}
    assert again.answered == online.answered == (until > 0)
    assert repr(again.estimate()) == repr(online.estimate())
    for one in seen(until):
        assert repr(again.update(one)) == repr(online.update(one))
    assert again.to_bytes() == online.to_bytes() or lag is not None  # its past began anew
    assert repr(again.lagged() if lag else None) == repr(online.lagged() if lag else None)


def test_a_localizer_of_fixes_alone_goes_on_to_the_bit():
    course = fixes(STRAIGHT, np.arange(0, 600, 10))
    told = [one for one in records(wheels(STRAIGHT), course) if isinstance(one, GeoFix)]
    online = Localizer(TOWN)
    for one in told[:30]:
        online.take(one)
    again = Localizer.from_bytes(online.to_bytes(), TOWN)
    assert repr(again.predict(told[30].time)) == repr(online.predict(told[30].time))
    for one in told[30:]:
        assert repr(again.update(one)) == repr(online.update(one))


def test_damaged_bytes_are_refused():
    data = driven_to(20).to_bytes()
    cut = [data[:n] for n in (0, 7, 25, len(data) - 1)]
    turned = [
        data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        for place in range(25, len(data), 97)
    ]
    for damaged in [*cut, *turned, data + b" "]:
        with pytest.raises(ReadError, match="damaged"):
            Localizer.from_bytes(damaged, TOWN)


@pytest.mark.parametrize("given", ["text", None, 5])
def test_what_is_no_bytes_is_refused_as_a_state(given):
    with pytest.raises(ReadError, match="the bytes that Localizer"):
        Localizer.from_bytes(given, TOWN)


def test_bytes_of_another_map_are_refused():
    other = Town(network(avenue()[:-1], curvature=PLANE.curvature), PLANE)
    with pytest.raises(MapError, match="it belongs to the map"):
        Localizer.from_bytes(driven_to(20).to_bytes(), other)


def test_bytes_of_another_version_are_refused(monkeypatch):
    data = driven_to(20).to_bytes()
    with pytest.raises(ReadError, match="another version"):
        Localizer.from_bytes(data.replace(b"localizer 1", b"localizer 0"), TOWN)
    monkeypatch.setattr(localizer_state, "_RECORDS", "records with other fields")
    with pytest.raises(ReadError, match="another version"):
        Localizer.from_bytes(data, TOWN)


def test_a_state_kept_with_another_lag_is_refused():
    state = driven_to(20).state()
    assert isinstance(state, State)
    with pytest.raises(SettingError, match="stored with lag=None"):
        Localizer(TOWN, vehicle=CAR, lag=5.0).restore(state)


@pytest.mark.parametrize(
    "ask", ["predict", "estimate", "to_bytes", "diagnosis", "sensor_states", "last_rows", "lagged"]
)
def test_who_asks_from_another_thread_disturbs_nothing(ask: str):
    """Kernels let other threads run: what they share must wait for them."""
    alone, online = (Localizer(TOWN, vehicle=CAR, lag=5.0) for _ in range(2))
    done, asked = threading.Event(), 0
    answers = {"predict": lambda: online.predict(online.estimate().time + 0.05)}

    def feed() -> None:
        for one in seen():
            online.take(one)
        done.set()

    thread = threading.Thread(target=feed)
    thread.start()
    while not done.is_set():
        found = answers.get(ask, lambda: getattr(online, ask))()
        asked += 1
        if callable(found):
            found = found()
        if isinstance(found, Estimate) and found.answered:
            assert np.linalg.eigvalsh(found.cov).min() > 0.0
    thread.join()
    assert asked
    for one in seen():
        alone.take(one)
    assert repr(online.estimate()) == repr(alone.estimate())
    assert repr(online.lagged()) == repr(alone.lagged())


def test_a_call_waits_for_the_call_of_another_thread():
    online, entered = driven_to(100), threading.Event()
    before = online.estimate().time

    def feed() -> None:
        entered.set()
        online.update(WheelTicks(before + 0.1, 2000.0, 2000.0))

    with online._lock:
        thread = threading.Thread(target=feed)
        thread.start()
        assert entered.wait(60.0)
        assert online.estimate().time == before
    thread.join(60.0)
    assert online.estimate().time == before + 0.1


def test_predicting_leaves_the_estimate_as_it_was():
    online = driven_to(205)
    before = repr(online.estimate())
    online.predict(30.0)
    assert repr(online.estimate()) == before


def test_an_estimate_stays_as_it_was_when_the_filter_goes_on():
    """Nothing of it was asked for before."""
    online, other = driven_to(205), driven_to(205)
    kept, now = online.estimate(), other.estimate()
    expected = repr(now), now.hypotheses, now.reason, now.map_pose, now.matched, now.speed
    for one in seen(400):
        online.take(one)
    online.predict(100.0)
    found = repr(kept), kept.hypotheses, kept.reason, kept.map_pose, kept.matched, kept.speed
    assert repr(found) == repr(expected)
    with pytest.raises(AttributeError):
        kept.time = 0.0


@pytest.mark.parametrize("steps", [1, 1 << 12])
def test_tables_of_the_past_that_grow_change_no_estimate(monkeypatch, steps: int):
    """The kernel is bound to its tables: it must go on with those that take their place."""
    monkeypatch.setattr(smoothing, "new_history", lambda _: new_history(steps))
    monkeypatch.setattr(localizer, "new_path", lambda _: new_path(2050))  # 2 entries are free
    online, alone = Localizer(TOWN, vehicle=CAR, lag=5.0), Localizer(TOWN, vehicle=CAR)
    history, tree = online._past.history, online._filter.path
    for one in seen():
        assert repr(online.update(one)) == repr(alone.update(one))
    assert online._filter.path is not tree
    assert (online._past.history is not history) == (steps == 1)
    assert online._filter.history is online._past.history
    monkeypatch.undo()
    roomy = Localizer(TOWN, vehicle=CAR, lag=5.0)
    for one in seen():
        roomy.take(one)
    assert repr(online.lagged()) == repr(roomy.lagged())
    assert online.decided_until == roomy.decided_until


def test_on_line_a_map_that_is_none_is_refused():
    with pytest.raises(MapError, match="NoneType was given; a RoadMap"):
        Localizer(None)


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


def test_a_recorded_drive_that_nothing_can_start_is_refused():
    timeline = build_timeline(Drive("d", None, wheels(STRAIGHT)), PLANE, CAR)
    with pytest.raises(DriveError, match="no usable GNSS fix"):
        localize_recorded(TOWN, timeline, vehicle=CAR)


def test_speed_is_what_the_wheels_say():
    online = driven_to(100)
    assert online.estimate().speed == pytest.approx(10.0, rel=0.03)
    assert math.isfinite(online.predict(11.0).pose.x)
