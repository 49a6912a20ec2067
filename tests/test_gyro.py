"""A gyro beside an odometer: its turns are used, its bias is learnt at rest."""

import numpy as np
import pytest

import whichroad
from laws.public import CAR, geo_fixes, metres, road_map
from scenes import drive_along
from scenes.drives import Truth, brake, gnss
from whichroad.epochs import build_timeline
from whichroad.filter.state import WHEELS
from whichroad.filter.vetting.windows import BY_GYRO, UNTURNED
from whichroad.geodesy.plane import Plane
from whichroad.observations import Drive, Odometer, WithGyro, YawRates
from whichroad.sensors.gyro_turns import turns_at

WAY = [[0.0, 0.0], [400.0, 0.0], [400.0, 300.0], [800.0, 300.0], [800.0, 700.0]]
TRUTH, _ = brake(drive_along(WAY), 200, 300, goes_on=True)
BIAS = np.radians(0.5)  # rad/s
DARK = (25.0, 60.0)  # s, masked: the stand and two corners lie in it


def observed(bias: float, *, gyro_every: int = 1, odometer_every: int = 5) -> list:
    """Fixes, an odometer and a gyro."""
    n = len(TRUTH.time)
    fix = np.column_stack([TRUTH.x, TRUTH.y, np.full((n, 2), 2.0), np.zeros(n)])
    rows = np.arange(n)
    seen = geo_fixes(TRUTH, fix, rows[rows % 10 == 0])
    start = seen[0].time
    rate = np.gradient(TRUTH.heading, TRUTH.time) + bias
    seen += [whichroad.YawRate(start + TRUTH.time[k], rate[k]) for k in rows[::gyro_every]]
    seen += [whichroad.Distance(start + TRUTH.time[k], TRUTH.s[k]) for k in rows[::odometer_every]]
    return sorted(seen, key=lambda o: (o.time, isinstance(o, whichroad.GeoFix)))


LINES = [[WAY[k], WAY[k + 1]] for k in range(4)] + [[[400.0, 0.0], [900.0, 0.0]]]


def error(result: whichroad.Result) -> float:
    """Largest error towards the end of the dark part, m."""
    points = result.to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6
    since = seconds - seconds[0]
    dark = (since > DARK[1] - 10.0) & (since < DARK[1])
    expected = np.column_stack([np.interp(since, TRUTH.time, v) for v in (TRUTH.x, TRUTH.y)])
    x, y = metres(points["lon"].to_numpy(), points["lat"].to_numpy())
    return float(np.hypot(x - expected[:, 0], y - expected[:, 1])[dark].max())


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("bias", [0.0, BIAS])
def test_a_bias_does_no_harm_once_the_vehicle_has_stood(bias: float, lag: str | None):
    result = whichroad.match(observed(bias), road_map(LINES), vehicle=CAR, mask=[DARK], lag=lag)
    assert error(result) < 6.0
    assert not result.summary["skipped"]


def test_on_line_and_recorded_drives_agree():
    roads = road_map(LINES)
    online = whichroad.Localizer(roads, vehicle=CAR)
    for k, reading in enumerate(observed(BIAS, odometer_every=1)):
        said = online.update(reading)
        if k == 900:
            online = whichroad.Localizer.from_bytes(online.to_bytes(), roads)
    recorded = whichroad.match(observed(BIAS, odometer_every=1), roads, vehicle=CAR).to_arrow()
    assert online.skipped == {}
    assert (said.pose.lat, said.pose.lon) == pytest.approx(
        (recorded["lat"][-1].as_py(), recorded["lon"][-1].as_py()), abs=3e-6
    )


def test_a_yaw_rate_beside_another_one_is_counted_and_not_used():
    online = whichroad.Localizer(road_map(LINES), vehicle=CAR)
    online.take(whichroad.SpeedYaw(1.6e9, 0.0, 0.0))
    online.take(whichroad.YawRate(1.6e9 + 0.1, 0.2))
    assert list(online.skipped.values()) == [1]


def test_an_odometer_with_a_gyro_moves_as_wheels_do_where_both_are_known():
    distance = Odometer(np.array([0.0, 1.0, 2.0, 9.0]), np.array([100.0, 108.0, 112.0, 120.0]))
    gyro = YawRates(np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.4]), np.array([0.2, 0.3, 0.4, 0.2, 0, 0]))
    timeline = build_timeline(Drive("d", odometry=WithGyro(distance, gyro)), Plane(49.4, 8.7), CAR)
    assert timeline.mode == WHEELS
    assert timeline.epochs.gyro.tolist() == [BY_GYRO, BY_GYRO, BY_GYRO, UNTURNED]  # none at 9 s
    np.testing.assert_allclose(timeline.epochs.time, [0.0, 1.0, 2.0, 9.0])
    np.testing.assert_allclose(timeline.epochs.arc, [0.0, 8.0, 4.0, 8.0])
    np.testing.assert_allclose(timeline.epochs.turn, [0.0, 0.3, 0.2, 0.0])
    _, near = turns_at(np.array([2.8, 3.0]), gyro)
    assert near.tolist() == [True, False]


STAIRS = [[0.0, 0.0]]
for k in range(14):
    STAIRS.append([STAIRS[-1][0] + 250.0 * (k % 2 == 0), STAIRS[-1][1] + 180.0 * (k % 2)])
STOPS = (300, 700, 1400, 2100)


def at_lights(offset: float) -> tuple[list, Truth]:
    """Fixes without speed, and a speed with a yaw rate that errs by the metre (rad/m)."""
    truth = drive_along(STAIRS)
    for k, stop in enumerate(STOPS):
        truth, _ = brake(truth, stop + 100 * k, 100, goes_on=True)
    seen = geo_fixes(truth, gnss(truth, sigma=2.0, seed=5), np.arange(0, len(truth.time), 10))
    start = seen[0].time
    speed = np.gradient(truth.s, truth.time)
    rate = np.gradient(truth.heading, truth.time) + 0.004 + offset * speed
    seen += [
        whichroad.SpeedYaw(start + truth.time[k], speed[k], rate[k]) for k in range(len(speed))
    ]
    return sorted(seen, key=lambda o: o.time), truth


def road_of(corners: list) -> list:
    """A road of many edges, with a street that branches off at each corner."""
    lines = [corners[k : k + 2] for k in range(len(corners) - 1)]
    for k in range(1, len(corners) - 1):
        (ax, ay), (bx, by) = corners[k - 1], corners[k]
        lines.append([[bx, by], [bx + 0.5 * (bx - ax), by + 0.5 * (by - ay)]])
    return lines


@pytest.mark.parametrize("offset", [0.0, 0.0006, -0.001, 0.003])
def test_an_error_by_the_metre_is_learnt_beside_rests_that_do_not_show_it(offset: float):
    readings, truth = at_lights(offset)
    online = whichroad.Localizer(road_map(road_of(STAIRS)), vehicle=CAR)
    errors, levels = [], []
    start = readings[0].time
    for reading in readings:
        said = online.update(reading)
        if not said.answered:
            continue
        x, y = metres(np.array([said.pose.lon]), np.array([said.pose.lat]))
        row = round((said.time - start) / 0.1)
        errors.append(np.hypot(x[0] - truth.x[row], y[0] - truth.y[row]))
        levels.append(said.protection_level)
    assert np.all(np.array(errors) < np.array(levels))
    named = {one.what: one.statistic for one in online.diagnosis}
    if offset == 0.0:
        assert not named
    else:
        assert set(named) == {"gyro: offset"}
        assert named["gyro: offset"] == pytest.approx(offset, abs=2e-4)
    assert np.median(errors[len(errors) // 2 :]) < 3.0
