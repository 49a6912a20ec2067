"""Wheels and a gyro beside each other: one of them is wrong or silent, and the other takes over."""

from collections.abc import Callable

import numpy as np
import pytest

import whichroad
from laws.public import CAR, geo_fixes, metres, road_map
from scenes import drive_along
from whichroad.filter.vetting.windows import BY_GYRO, BY_WHEELS, UNTURNED
from whichroad.sensors.takeover import GYRO, WHEELS, Takeover

WAY = [[0.0, 0.0], [300.0, 0.0], [300.0, 300.0], [600.0, 300.0], [600.0, 600.0], [900.0, 600.0]]
LINES = [[WAY[k], WAY[k + 1]] for k in range(5)] + [[[300.0, 0.0], [900.0, 0.0]]]
TRUTH = drive_along(WAY)
Reading = tuple[float, float, float, float | None]  # time, arc, turn by wheels, by the gyro


def observed(
    wheels: Callable[[np.ndarray], np.ndarray], gyro: Callable[[np.ndarray], np.ndarray]
) -> list:
    """Fixes, and the turn rates of the truth as wheels and a gyro have them; NaN: silent."""
    n = len(TRUTH.time)
    fix = np.column_stack([TRUTH.x, TRUTH.y, np.full((n, 2), 2.0), np.zeros(n)])
    rows = np.arange(n)
    seen = geo_fixes(TRUTH, fix, rows[rows % 10 == 0])
    start, half = seen[0].time, 0.5 * CAR.track_width
    speed, rate = (np.gradient(x, TRUTH.time) for x in (TRUTH.s, TRUTH.heading))
    by_wheels, by_gyro = wheels(rate), gyro(rate)
    for k in rows:
        if np.isfinite(by_gyro[k]):
            seen.append(whichroad.YawRate(start + TRUTH.time[k], by_gyro[k]))
        if np.isfinite(by_wheels[k]):
            left, right = (speed[k] + side * half * by_wheels[k] for side in (-1.0, 1.0))
            seen.append(whichroad.WheelSpeed(start + TRUTH.time[k], left, right))
    return sorted(seen, key=lambda o: (o.time, isinstance(o, whichroad.GeoFix)))


def sound(rate: np.ndarray) -> np.ndarray:
    return rate


def silent(rate: np.ndarray) -> np.ndarray:
    return np.where((TRUTH.time > 20.0) & (TRUTH.time < 60.0), np.nan, rate)


FAULTS = {
    "wheels: sign of turns": (np.negative, sound),
    "gyro: sign of turns": (sound, np.negative),
    "gyro: stands still": (sound, np.zeros_like),
    "gyro: unit of turns": (sound, lambda rate: np.clip(20.0 * rate, -9.0, 9.0)),
    "gyro: silent": (sound, silent),
    "wheels: silent": (silent, sound),
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_sound_one_carries_the_turn_and_the_fault_is_named(name: str):
    result = whichroad.match(observed(*FAULTS[name]), road_map(LINES), vehicle=CAR)
    assert name in [finding.what for finding in result.diagnosis]
    points = result.to_arrow()
    x, y = metres(points["lon"].to_numpy(), points["lat"].to_numpy())
    assert np.hypot(x[-1] - TRUTH.x[-1], y[-1] - TRUTH.y[-1]) < 6.0
    assert not result.summary["skipped"]


def test_where_both_are_sound_answers_are_those_of_the_wheels_and_nothing_is_named():
    both = whichroad.match(observed(sound, sound), road_map(LINES), vehicle=CAR)
    alone = observed(sound, lambda rate: np.full_like(rate, np.nan))
    wheels = whichroad.match(alone, road_map(LINES), vehicle=CAR)
    assert both.diagnosis == wheels.diagnosis
    for name in ("lat", "lon"):
        a, b = (one.to_arrow()[name].to_numpy() for one in (both, wheels))
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("name", ["wheels: sign of turns", "wheels: silent"])
def test_on_line_it_is_the_same_and_goes_on_from_what_was_kept(name: str):
    roads = road_map(LINES)
    online = whichroad.Localizer(roads, vehicle=CAR)
    for k, reading in enumerate(observed(*FAULTS[name])):
        said = online.update(reading)
        if k == 700:
            online = whichroad.Localizer.from_bytes(online.to_bytes(), roads)
    x, y = metres(np.array([said.pose.lon]), np.array([said.pose.lat]))
    assert np.hypot(x[0] - TRUTH.x[-1], y[0] - TRUTH.y[-1]) < 6.0
    assert name in [finding.what for finding in online.diagnosis]
    assert not online.skipped


def taken(readings: list[Reading]) -> tuple[Takeover, list[tuple[float, float, int]]]:
    """What a takeover makes of readings, without a fix."""
    takeover = Takeover(1.5)
    return takeover, [takeover.moved(*one) for one in readings]


def test_a_wheel_that_stands_is_noticed_at_once_without_a_fix():
    # the left wheel stands from 5 s on: half the way, and a turn of 0.67 rad/m
    steps = [(0.1 * k, *((1.0, 0.0) if k < 50 else (0.5, 1.0 / 1.5)), 0.0) for k in range(1, 100)]
    takeover, said = taken(steps)
    np.testing.assert_allclose([one[:2] for one in said], [(1.0, 0.0)] * 99, atol=1e-9)
    assert said[20][2] == BY_WHEELS
    assert said[-1][2] == BY_GYRO
    assert takeover.wrong == [True, False]


@pytest.mark.parametrize(
    ("arc", "wheels", "gyro"),
    [
        pytest.param(0.2, 0.135, 0.126, id="as narrow as no car turns, by both"),
        pytest.param(2.63, 0.054, 0.007, id="a count of one wheel more, on a motorway"),
    ],
)
def test_what_counts_are_rounded_by_makes_no_wheels_wrong(arc: float, wheels: float, gyro: float):
    turns = {0: 1.0, 1: 1.0, 20: -1.0, 21: -1.0}
    sides = [turns.get(k % 40, 0.0) for k in range(400)]
    steps = [(0.1 * k, arc, one * wheels, one * gyro) for k, one in enumerate(sides)]
    takeover, said = taken(steps)
    assert takeover.wrong == [False, False]
    assert takeover.seconds == [0.0, 0.0]
    assert {by for _, _, by in said} == {BY_WHEELS}


def test_without_a_fix_neither_outvotes_the_other_and_the_road_turns():
    noise = np.random.default_rng(1).normal(0.0, 1e-3, 200)
    steps = [(0.1 * k, 1.0, 0.02 if k > 100 else 0.0, float(noise[k])) for k in range(1, 200)]
    takeover, said = taken(steps)
    assert said[90][2] == BY_WHEELS
    assert said[-1][2] == UNTURNED
    assert takeover.wrong == [False, False]


def test_a_gyro_that_is_stuck_loses_against_wheels_that_turn():
    steps = [(0.1 * k, 1.0, 0.02 if k > 100 else 0.0, 0.0) for k in range(1, 200)]
    takeover, said = taken(steps)
    assert said[-1][2] == BY_WHEELS
    assert (takeover.wrong[WHEELS], takeover.wrong[GYRO]) == (False, True)


def counted_while_silent() -> list:
    """Fixes for 18 s, a gyro throughout, and counters that nobody hears from 20 s to 85 s."""
    seen = [
        one
        for one in observed(lambda rate: np.full_like(rate, np.nan), sound)
        if not isinstance(one, whichroad.GeoFix) or one.time - SEEN_AT < 18.0
    ]
    turn = 0.5 * CAR.track_width * np.unwrap(TRUTH.heading)
    for k in np.flatnonzero((TRUTH.time < 20.0) | (TRUTH.time > 85.0)):
        left, right = (
            (TRUTH.s[k] + side * turn[k]) / scale
            for side, scale in ((-1.0, CAR.metres_per_tick_left), (1.0, CAR.metres_per_tick_right))
        )
        seen.append(whichroad.WheelTicks(SEEN_AT + TRUTH.time[k], left, right))
    return sorted(seen, key=lambda o: (o.time, isinstance(o, whichroad.GeoFix)))


SEEN_AT = observed(sound, sound)[0].time


@pytest.mark.parametrize("how", ["recorded", "on line"])
def test_counters_tell_after_a_silence_how_far_the_gyro_has_turned_the_vehicle(how: str):
    roads, seen = road_map(LINES), counted_while_silent()
    if how == "recorded":
        points = whichroad.match(seen, roads, vehicle=CAR).to_arrow()
        lon, lat, p = (points[name].to_numpy()[-1:] for name in ("lon", "lat", "p_road"))
    else:
        online = whichroad.Localizer(roads, vehicle=CAR)
        for reading in seen:
            said = online.update(reading)
        lon, lat, p = (np.array([v]) for v in (said.pose.lon, said.pose.lat, said.p_road))
    x, y = metres(lon, lat)
    assert np.hypot(x[0] - TRUTH.x[-1], y[0] - TRUTH.y[-1]) < 15.0
    assert p[0] > 0.8  # 0.1 at most after a pause of all sensors


def last_of(takeover: Takeover, readings: list[Reading], fixes: bool) -> list[tuple]:
    """What is taken of readings, with a fix every second of the way along x, or without any."""
    taken, metres_east = [], 0.0
    for k, reading in enumerate(readings):
        metres_east += reading[1]
        if fixes and k % 10 == 0:
            takeover.fixed(0.0, metres_east / 111_195.0, 1.0)
        taken.append(takeover.moved(*reading))
    return taken


def straight(begin: float, seconds: float, speed: float, bias: float) -> list[Reading]:
    """Wheels whose tyres are 0.4 % apart beside a gyro with a bias, rad/s, straight on."""
    arc, noise = 0.1 * speed, np.random.default_rng(1).normal(0.0, 2e-4, round(10 * seconds))
    apart = 0.004 / CAR.track_width
    return [
        (begin + 0.1 * k, arc, apart * arc, 0.1 * bias + turn) for k, turn in enumerate(noise, 1)
    ]


@pytest.mark.parametrize("bias", [-0.003, 0.003])
def test_worn_tyres_beside_a_usual_gyro_are_no_dispute_on_a_motorway_without_fixes(bias: float):
    takeover = Takeover(CAR.track_width)
    last_of(takeover, straight(0.0, 60.0, 30.0, bias), fixes=True)
    other = Takeover(CAR.track_width)
    other.restore(takeover.kept())
    for one in (takeover, other):
        taken = last_of(one, straight(60.0, 60.0, 40.0, bias), fixes=False)
        assert {by for _, _, by in taken} == {BY_WHEELS}


@pytest.mark.parametrize(("step", "by"), [(0.02, BY_WHEELS), (0.1, UNTURNED)])
def test_a_bias_that_stops_have_told_is_none_of_tyres_and_a_step_of_it_is_a_dispute(step, by):
    takeover = Takeover(CAR.track_width)
    for k in range(4):  # in town, with stops
        last_of(takeover, straight(20.0 * k, 12.0, 8.0, 0.03), fixes=True)
        last_of(takeover, straight(20.0 * k + 12.0, 8.0, 0.0, 0.03), fixes=True)
    taken = last_of(takeover, straight(80.0, 30.0, 36.0, 0.03), fixes=False)
    assert {one[2] for one in taken} == {BY_WHEELS}
    taken = last_of(takeover, straight(110.0, 30.0, 36.0, 0.03 + step), fixes=False)
    assert taken[-1][2] == by


def stood(rates: list[tuple[float, float]], begin: float = 30.0) -> list[Reading]:
    """Readings of wheels that stand beside a gyro: its rates, rad/s, each for some seconds."""
    rate = np.concatenate([np.full(round(10 * seconds), one) for one, seconds in rates])
    rate += np.random.default_rng(1).normal(0.0, 2e-3, len(rate))
    return [(begin + 0.1 * k, 0.0, 0.0, 0.1 * one) for k, one in enumerate(rate, 1)]


@pytest.mark.parametrize("bias", [0.0, 0.0087, -0.03])
@pytest.mark.parametrize("turn", [-np.pi, 0.5 * np.pi])
def test_who_is_turned_as_a_whole_while_the_wheels_stand_is_turned_by_the_gyro(bias, turn):
    takeover = Takeover(CAR.track_width)
    last_of(takeover, straight(0.0, 30.0, 8.0, bias), fixes=True)
    readings = stood([(bias, 5.0), (bias + turn / 20.0, 20.0), (bias, 5.0)])
    taken = last_of(takeover, readings[:150], fixes=False)
    other = Takeover(CAR.track_width)
    other.restore(takeover.kept())
    for one in (takeover, other):
        rest = last_of(one, readings[150:], fixes=False)
        assert abs(sum(t for _, t, _ in taken + rest) - turn) < 0.05
        assert max(abs(t) for _, t, _ in taken + rest) < 0.15  # as vehicles can turn
        on = last_of(one, straight(60.0, 20.0, 8.0, bias), fixes=False)
        assert {by for _, _, by in on} == {BY_WHEELS}
        assert not any(one.wrong)


@pytest.mark.parametrize("rates", [
    [(0.1, 30.0)],  # broken before,
    [(0.0, 5.0), (0.1, 60.0)],  # meanwhile
    [(0.0, 5.0), (0.06, 2.0), (0.0, 5.0)],  # and little
    [(0.02, 60.0)],
])  # fmt: skip
def test_a_gyro_that_breaks_turns_no_parked_car(rates: list[tuple[float, float]]):
    takeover = Takeover(CAR.track_width)
    last_of(takeover, straight(0.0, 30.0, 8.0, 0.0), fixes=True)
    taken = last_of(takeover, readings := stood(rates), fixes=False)
    taken += last_of(takeover, straight(readings[-1][0], 3.0, 8.0, rates[-1][0]), fixes=False)
    assert sum(t for _, t, _ in taken) == pytest.approx(24.0 * 0.004 / CAR.track_width, abs=1e-6)
