"""Single nonsense readings of a rate are bridged; changes that stay, and rough rates, are not."""

from dataclasses import replace

import numpy as np
import pytest

import whichroad
from laws.public import CAR, geo_fixes, metres, road_map
from scenes import drive_along
from whichroad import SpeedYaw, WheelSpeed, YawRate
from whichroad.observations import SpeedYawRate, WheelCounts, WheelSpeeds, WithGyro, YawRates
from whichroad.sensors.glitches import GLITCH, Glitches, without_glitches

WAY = [[0.0, 0.0], [300.0, 0.0], [300.0, 300.0], [600.0, 300.0], [600.0, 600.0], [900.0, 600.0]]
LINES = [[WAY[k], WAY[k + 1]] for k in range(5)] + [[[300.0, 0.0], [900.0, 0.0]]]
TRUTH = drive_along(WAY)
TIME = np.arange(0.0, 60.0, 0.05)
SPEED = 10.0 + 3.0 * np.sin(TIME / 5.0)


def on_line(readings: list) -> tuple[list, dict[str, int]]:
    one, skipped, given = Glitches(), {}, []
    for reading in readings:
        given.append(one.without(given[-1] if given else None, reading, skipped))
    return given, skipped


@pytest.mark.parametrize("nonsense", [0.0, 70.8])
@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("wheel", ["left", "right"])
def test_a_nonsense_speed_is_the_one_before_it_on_line_and_recorded(nonsense, rows, wheel):
    wrong = {"left": SPEED.copy(), "right": SPEED.copy()}
    wrong[wheel][400 : 400 + rows] = nonsense
    sound = SPEED.copy()
    sound[400 : 400 + rows] = SPEED[399]
    log, counted = without_glitches(WheelSpeeds(TIME, wrong["left"], wrong["right"]))
    assert isinstance(log, WheelSpeeds)
    given, skipped = on_line(
        [WheelSpeed(*row) for row in zip(TIME, wrong["left"], wrong["right"], strict=True)]
    )
    assert counted == skipped == {GLITCH: rows}
    for column, name in ((log.left, "left"), (log.right, "right")):
        np.testing.assert_array_equal(column, sound)
        np.testing.assert_array_equal([getattr(one, name) for one in given], sound)


def test_a_nonsense_turn_rate_is_the_one_before_it_on_line_and_recorded():
    rate = 0.3 * np.sin(TIME / 3.0)
    wrong = rate.copy()
    wrong[700] = 5.72
    beside, count = without_glitches(
        WithGyro(WheelCounts(TIME, SPEED, SPEED), YawRates(TIME, wrong))
    )
    alone, _ = without_glitches(SpeedYawRate(TIME, SPEED, wrong))
    assert isinstance(beside, WithGyro)
    assert isinstance(alone, SpeedYawRate)
    assert count == {GLITCH: 1}
    assert beside.gyro.rate[700] == alone.yaw_rate[700] == rate[699]
    for readings in (
        [YawRate(*row) for row in zip(TIME, wrong, strict=True)],
        [SpeedYaw(*row) for row in zip(TIME, SPEED, wrong, strict=True)],
    ):
        given, skipped = on_line(readings)
        assert skipped == {GLITCH: 1}
        assert given[700].yaw_rate == rate[699]


@pytest.mark.parametrize("stays", [5, 10, 800])
def test_a_change_that_stays_is_believed_on_line_after_three_readings(stays: int):
    wrong = SPEED.copy()
    wrong[400 : 400 + stays] = 0.0
    _, counted = without_glitches(log := WheelSpeeds(TIME, wrong, wrong))
    assert not counted
    assert without_glitches(log)[0] is log
    given, _ = on_line([WheelSpeed(*row) for row in zip(TIME, wrong, wrong, strict=True)])
    assert [one.left for one in given[400:403]] == [SPEED[399]] * 3
    assert given[403].left == 0.0


@pytest.mark.parametrize("kind", ["hard braking", "noise", "coarse", "slow readings", "jumpy"])
def test_rough_rates_are_left_as_they_are(kind: str):
    rng, time, speed = np.random.default_rng(1), TIME, SPEED.copy()
    if kind == "hard braking":
        speed = np.maximum(20.0 - 11.0 * (TIME - 20.0).clip(0.0), 0.0)
    elif kind == "noise":
        speed += rng.normal(0.0, 0.5, len(speed))
    elif kind == "coarse":
        speed = 1.5 * np.round(speed / 1.5)
    elif kind == "jumpy":
        speed += rng.choice([-2.0, 2.0], len(speed))
    else:
        time, speed = TIME[:60] * 20.0, rng.uniform(0.0, 20.0, 60)
    _, counted = without_glitches(WheelSpeeds(time, speed, speed))
    _, skipped = on_line([WheelSpeed(*row) for row in zip(time, speed, speed, strict=True)])
    assert not counted
    assert sum(skipped.values()) <= (60 if kind == "jumpy" else 3)


def test_of_a_sensor_that_says_anything_readings_are_believed_so_that_it_is_found_out():
    rng = np.random.default_rng(1)
    given, skipped = on_line([WheelSpeed(t, *rng.uniform(0.0, 40.0, 2)) for t in TIME])
    assert sum(skipped.values()) < 20
    assert len({one.left for one in given}) > 1000


def test_an_outage_with_nonsense_readings_is_as_one_without_and_they_are_counted():
    n, rows = len(TRUTH.time), np.arange(len(TRUTH.time))
    fix = np.column_stack([TRUTH.x, TRUTH.y, np.full((n, 2), 2.0), np.zeros(n)])
    seen = geo_fixes(TRUTH, fix, rows[(rows % 10 == 0) & (rows < 200)])
    start, speed = seen[0].time, np.gradient(TRUTH.s, TRUTH.time)
    turn = 0.5 * CAR.track_width * np.gradient(TRUTH.heading, TRUTH.time)
    sound = [
        WheelSpeed(start + TRUTH.time[k], speed[k] - turn[k], speed[k] + turn[k]) for k in rows
    ]
    broken = [replace(one, left=0.0) if k % 60 == 35 else one for k, one in enumerate(sound)]
    count = sum(a != b and b.time > start for a, b in zip(sound, broken, strict=True))

    def order(wheels: list) -> list:
        return sorted([*seen, *wheels], key=lambda o: (o.time, isinstance(o, whichroad.GeoFix)))

    result = whichroad.match(order(broken), roads := road_map(LINES), vehicle=CAR)
    assert result.summary["skipped"] == {GLITCH: count}
    points = result.to_arrow()
    x, y = metres(points["lon"].to_numpy(), points["lat"].to_numpy())
    assert np.hypot(x[-1] - TRUTH.x[-1], y[-1] - TRUTH.y[-1]) < 8.0
    live, clean = (whichroad.Localizer(roads, vehicle=CAR) for _ in range(2))
    for k, (a, b) in enumerate(zip(order(broken), order(sound), strict=True)):
        if k == n // 2:  # in the middle of a reading that is bridged, or not
            live = whichroad.Localizer.from_bytes(live.to_bytes(), roads)
        one, other = live.update(a), clean.update(b)
    assert live.skipped == {GLITCH: count}
    assert one.edge == other.edge
    assert abs(one.protection_level - other.protection_level) < 1.0
