"""Sensors whose clocks differ, in the order in which readings come."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from statistics import median

import numpy as np
import pytest

from online.avenue import CAR, PLANE, STRAIGHT, TOWN, ticks, town_fix, wheels
from whichroad.observations import (
    Distance,
    GeoFix,
    Observation,
    SpeedYaw,
    WheelTicks,
    YawRate,
)  # fmt: skip
from whichroad.online import Localizer, set_back


def driven(behind: float) -> Localizer:
    """After 20 s of wheels and fixes at 10 Hz as they come; wheels are stamped too early."""
    online = Localizer(TOWN, vehicle=CAR)
    for k, reading in enumerate(ticks(wheels(STRAIGHT))[:200]):
        lat, lon = PLANE.to_geodetic(STRAIGHT.x[k], -1.75)
        online.update(GeoFix(reading.time, lat, lon, 4e-4, 0.0, 4e-4))
        online.update(replace(reading, time=reading.time + 0.03 - behind))
    return online


def test_odometry_that_is_behind_all_fixes_is_named_within_ten_seconds():
    online = driven(0.15)
    assert online.skipped["late"] > 150
    (named,) = [found for found in online.diagnosis if found.what == "odometry: clock"]
    assert named.level == "warning"
    assert 0.1 < named.statistic < 0.15
    assert "refused" in named.advice


def test_odometry_in_time_is_not_named():
    online = driven(0.0)
    assert online.skipped == {}
    assert "odometry: clock" not in [found.what for found in online.diagnosis]


def test_one_late_reading_before_the_wheels_fall_silent_names_no_clock():
    online = Localizer(TOWN, vehicle=CAR)
    for k, reading in enumerate(ticks(wheels(STRAIGHT))[:300]):
        lat, lon = PLANE.to_geodetic(STRAIGHT.x[k], -1.75)
        online.update(GeoFix(reading.time, lat, lon, 4e-4, 0.0, 4e-4))
        if k <= 100:
            online.update(replace(reading, time=reading.time + (0.03 if k < 100 else -0.15)))
    assert online.skipped["late"] == 1
    assert "odometry: clock" not in [found.what for found in online.diagnosis]


def drive(
    ahead: dict[type, float], seconds: float = 120.0, until: float = 1e9, late: float = 0.0
) -> tuple[Localizer, list[float], float | None]:
    """A drive whose clocks of some kinds are ahead from 20 s until a time, as readings come.

    Fixes are at 1 Hz and come so late at most, in bursts.  Returns the localizer, the metres
    by which it was off at the last fixes, and after how many seconds it named a clock.
    """
    rng, time = np.random.default_rng(3), STRAIGHT.time + 1e9
    online, off, named = Localizer(TOWN, vehicle=CAR), [], None
    readings: list[tuple[float, Observation]] = [
        (t, replace(reading, time=t))
        for t, reading in zip(time.tolist(), ticks(wheels(STRAIGHT)), strict=True)
    ]
    for k in range(0, len(time), 10):
        fix = town_fix(STRAIGHT.x[k], -1.75, time[k], bearing_deg=90.0)
        readings.append((fix.time + late * rng.random(), fix))
    for arrival, reading in sorted(readings, key=lambda pair: pair[0]):
        passed, true = arrival - time[0], reading.time
        if passed > seconds:
            break
        if 20.0 < passed < until:
            reading = replace(reading, time=true + ahead.get(type(reading), 0.0))
        said = online.update(reading)
        clocks = [found for found in online.diagnosis if found.what.endswith(": clock")]
        if clocks and named is None:
            named = passed - 20.0
        if isinstance(reading, GeoFix) and said.pose is not None:
            off.append(abs(said.pose.x - float(np.interp(true, time, STRAIGHT.x))))
    return online, off[-10:], named


def test_odometry_of_which_one_reading_a_second_is_in_time_is_named():
    online, _, named = drive({GeoFix: 1.0}, 60.0)
    assert online.skipped["late"] > 300
    assert named is not None
    assert 5.0 <= named < 8.0
    [found] = [found for found in online.diagnosis if found.what == "odometry: clock"]
    assert found.statistic == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(
    "ahead", [{GeoFix: -3600.0}, {WheelTicks: 3600.0}, {GeoFix: -3.0}, {WheelTicks: 3.0}]
)
def test_fixes_that_are_behind_the_odometry_are_named(ahead: dict[type, float]):
    online, _, named = drive(ahead, 40.0)
    assert named is not None
    assert 5.0 <= named < 10.0
    [found] = [found for found in online.diagnosis if found.what == "gnss: clock"]
    assert found.statistic == pytest.approx(abs(sum(ahead.values())), abs=1.0)
    assert "fixes are" in found.advice
    assert "correct the clock" in found.advice


@pytest.mark.parametrize("ahead", [{GeoFix: -3600.0}, {WheelTicks: 3600.0}])
def test_fixes_are_taken_again_though_the_odometry_is_an_hour_ahead(ahead: dict[type, float]):
    online, off, _ = drive(ahead, 80.0)
    assert online.skipped["clock ahead of the fixes: started anew at their time"] == 1
    assert online.skipped["late"] < 40
    assert max(off) < 10.0
    [found] = [found for found in online.diagnosis if found.what.endswith(": clock")]
    assert found.what == "odometry: clock"
    assert found.statistic == pytest.approx(-3600.0, abs=1.0)


@pytest.mark.parametrize("ahead", [{GeoFix: -3600.0}, {WheelTicks: 3600.0}])
def test_odometry_is_taken_again_once_its_clock_is_right(ahead: dict[type, float]):
    online, off, _ = drive(ahead, 120.0, until=90.0)
    before = dict(drive(ahead, 100.0, until=90.0)[0].skipped)
    assert online.skipped == before
    assert max(off) < 10.0
    assert not [found for found in online.diagnosis if found.what.endswith(": clock")]


def test_old_fixes_that_come_at_once_begin_nothing_anew():
    online = drive({}, 60.0)[0]
    for k in range(300):
        online.update(town_fix(20.0, -1.75, 1e9 - 4000.0 + k))
        reading = ticks(wheels(STRAIGHT))[601 + k]
        online.update(replace(reading, time=reading.time + 1e9))
    assert online.skipped == {"late": 300}


def batched(until: float) -> Localizer:
    """60 s of fixes as they come, and of wheels once a second, as far as a time of the drive."""
    online, time = Localizer(TOWN, vehicle=CAR), STRAIGHT.time
    held: list[WheelTicks] = []
    for k, reading in enumerate(ticks(wheels(STRAIGHT))[:600]):
        held.append(reading)
        if k % 10 == 0:
            online.update(town_fix(STRAIGHT.x[k], -1.75, time[k], bearing_deg=90.0))
        if k % 10 == 3 or time[k] > until:
            for one in held:
                online.update(one)
            held = []
    return online


def test_wheels_that_come_in_batches_behind_the_fixes_are_noted():
    online = batched(60.0)
    assert online.skipped["late"] > 300
    kinds = ("odometry: late", "odometry: clock")
    (noted,) = [found for found in online.diagnosis if found.what in kinds]
    assert (noted.what, noted.level) == ("odometry: late", "information")
    assert noted.statistic > 0.3
    assert "sort all by their times" in noted.advice


def test_a_few_late_batches_are_not_noted_and_what_was_is_forgotten():
    assert not [found for found in batched(3.0).diagnosis if found.what == "odometry: late"]
    online = batched(30.0)
    assert [found for found in online.diagnosis if found.what == "odometry: late"]
    for reading in ticks(wheels(STRAIGHT))[600:1200]:
        online.update(reading)
    assert not [found for found in online.diagnosis if found.what == "odometry: late"]


@pytest.mark.parametrize("late", [0.1, 1.0])
def test_fixes_of_ordinary_latency_name_no_clock(late: float):
    online, _, named = drive({}, 120.0, late=late)
    assert named is None
    assert online.skipped == {}


def test_a_gyro_an_hour_ahead_does_not_move_the_time_of_all_others():
    online = Localizer(TOWN, vehicle=CAR)
    for k, wheel in enumerate(ticks(wheels(STRAIGHT))[:500]):
        time = wheel.time + 1e9
        online.update(YawRate(time + 0.01 + (3600.0 if k > 200 else 0.0), 0.001))
        online.update(replace(wheel, time=time))
        if k % 10 == 0:
            online.update(town_fix(STRAIGHT.x[k], -1.75, time))
    assert online.skipped == {}
    assert online.estimate().time == pytest.approx(time)


NOW = 1.7e9  # s since 1970
TIMES = (STRAIGHT.time + NOW).tolist()
TICKS = [replace(one, time=t) for one, t in zip(ticks(wheels(STRAIGHT)), TIMES, strict=True)]
SPEEDS = [
    SpeedYaw(t, v, 0.0)
    for t, v in zip(TIMES, np.gradient(STRAIGHT.s, STRAIGHT.time).tolist(), strict=True)
]


def fix(k: int, time: float | None = None) -> GeoFix:
    """Of the drive at an epoch, stamped as it was, or otherwise."""
    return town_fix(STRAIGHT.x[k], -1.75, TIMES[k] if time is None else time, bearing_deg=90.0)


def stepped(by: float, kinds: tuple[type, ...], rate: str = "ticks") -> tuple[Localizer, list]:
    """40 s of a drive; after 20.05 s the clocks of some kinds go back.  All estimates."""
    online, said = Localizer(TOWN, vehicle=CAR), []
    for k in range(400):
        pair: list[Observation] = [TICKS[k] if rate == "ticks" else SPEEDS[k]]
        if k % 10 == 5:
            pair.append(fix(k))
        for observation in pair:
            if k > 200 and isinstance(observation, kinds):
                observation = replace(observation, time=observation.time + by)
            said.append((TIMES[k], observation.time, online.update(observation)))
    return online, said


@pytest.mark.parametrize("rate", ["ticks", "speeds"])
@pytest.mark.parametrize("by", [-0.53, -1.02, -2.04, -5.01])
def test_a_clock_of_all_sensors_that_steps_back_loses_no_way(by: float, rate: str):
    online, said = stepped(by, (GeoFix, WheelTicks, SpeedYaw), rate)
    sound = stepped(0.0, (), rate)[1]
    assert online.skipped.get("late", 0) <= 4
    assert set(online.skipped) <= {"late"}
    for (time, own, here), (_, _, there) in zip(said, sound, strict=True):
        if time > NOW + 20.6:
            assert here.time == pytest.approx(own, abs=1e-6)
            assert abs(here.pose.x - there.pose.x) < 0.3
            assert here.protection_level < 1.1 * there.protection_level
    [found] = [found for found in online.diagnosis if found.what == "clock: set back"]
    assert found.statistic == pytest.approx(-by, abs=0.02)
    ahead = online.predict(own + 1.0)
    assert ahead.time == pytest.approx(own + 1.0, abs=1e-6)
    assert online.estimate().time == pytest.approx(own, abs=1e-6)


@pytest.mark.parametrize("by", [-0.5, -2.0])
def test_a_clock_of_odometry_alone_that_steps_back_is_followed(by: float):
    online, said = stepped(by, (WheelTicks,))
    sound = stepped(0.0, ())[1]
    assert online.skipped.get("late", 0) <= 4
    assert abs(said[-1][2].pose.x - sound[-1][2].pose.x) < 0.3
    assert said[-1][2].time == pytest.approx(sound[-1][2].time, abs=0.02)
    assert "clock: set back" in [found.what for found in online.diagnosis]


def test_a_clock_that_was_set_back_stays_known_over_bytes():
    online, said = stepped(-2.0, (GeoFix, WheelTicks))
    again = Localizer.from_bytes(online.to_bytes(), TOWN)
    k, own = 400, said[-1][1]
    later = replace(TICKS[k], time=TIMES[k] - 2.0)
    assert again.update(later).time == pytest.approx(later.time, abs=1e-6)
    assert later.time > own
    assert again.skipped == online.skipped
    assert "clock: set back" in [found.what for found in again.diagnosis]


@pytest.mark.parametrize("wrong", ["repeated", "overtaken", "one ahead"])
def test_batches_that_come_twice_or_too_late_set_no_clock_back(wrong: str):
    online, readings = Localizer(TOWN, vehicle=CAR), TICKS[:300]
    order = {
        "repeated": [*range(200), *range(180, 200), *range(200, 300)],
        "overtaken": [*range(180), *range(200, 220), *range(180, 200), *range(220, 300)],
        "one ahead": [*range(180), 200, *range(180, 300)],
    }[wrong]
    for k in order:
        online.update(readings[k])
        if k % 10 == 5:
            online.update(fix(k))
    assert "clock: set back" not in [found.what for found in online.diagnosis]
    assert online.estimate().time == readings[-1].time
    assert online.skipped["late"] > 18


@pytest.mark.parametrize("rate", ["ticks", "speeds"])
@pytest.mark.parametrize("by", [1.03, 2.03])
def test_a_clock_of_odometry_alone_that_steps_ahead_refuses_no_fix_for_long(by: float, rate: str):
    online, said = stepped(by, (WheelTicks, SpeedYaw), rate)
    sound = stepped(0.0, (), rate)[1]
    assert online.skipped.get("late", 0) <= 2
    [found] = [found for found in online.diagnosis if found.what == "gnss: clock"]
    assert found.statistic == pytest.approx(by, abs=0.05)
    assert "correct the clock" in found.advice
    for (time, _, here), (_, _, there) in zip(said[-20:], sound[-20:], strict=True):
        assert here.time == pytest.approx(time, abs=0.05)
        assert abs(here.pose.x - there.pose.x) < here.protection_level
        assert abs(here.pose.x - there.pose.x) < (0.5 if rate == "ticks" else 4.0)


@pytest.mark.parametrize("every", [2, 10])
@pytest.mark.parametrize("heard", [True, False])
def test_wheels_that_are_silent_for_two_seconds_step_no_clock_ahead(heard: bool, every: int):
    """Whether fixes come meanwhile, or all of them come behind the first wheels in one burst."""
    online, held = Localizer(TOWN, vehicle=CAR), []
    for k, reading in enumerate(TICKS[:400]):
        if not 200 < k < 220:
            online.update(reading)
        if k % every == every // 2:
            held.append(fix(k))
        if heard or not 200 < k < 221:
            for one in held:
                online.update(one)
            held = []
    assert not [found for found in online.diagnosis if found.what.startswith(("gnss", "clock"))]
    assert online.estimate().time == reading.time


def named(online: Localizer) -> list[str]:
    """The clocks that it names, but for readings that are only late."""
    names = [found.what for found in online.diagnosis]
    return [what for what in names if what.startswith("clock") or what.endswith(": clock")]


def heard(
    wheels: Iterable[Observation], late: Callable[[int, float], float], every: int = 10
) -> Localizer:
    """Odometry in its order, and fixes, which come when `late` says by their epoch and time."""
    come = [(one.time, one) for one in wheels]
    come += [(late(k, TIMES[k]), fix(k)) for k in range(5, 400, every)]
    online = Localizer(TOWN, vehicle=CAR)
    for _, reading in sorted(come, key=lambda pair: pair[0]):
        online.update(reading)
    return online


@pytest.mark.parametrize("before", [0.0, 7200.0])
@pytest.mark.parametrize("kinds", [(WheelTicks,), (WheelTicks, GeoFix)])
def test_no_time_but_a_latency_tells_whether_fixes_stepped_too(kinds: tuple, before: float):
    """A first fix, and one after a clock that was set back by hours, are not that late."""
    online = Localizer(TOWN, vehicle=CAR)
    for k in range(400):
        for one in (fix(k), TICKS[k]) if k % 10 == 0 else (TICKS[k],):
            by = before if k < 5 else -2.04 if k > 250 and isinstance(one, kinds) else 0.0
            said = online.update(replace(one, time=one.time + by))
    assert online.skipped.get("clock set back: started anew", 0) == (before > 0.0)
    assert named(online) == ["clock: set back"]
    own = TIMES[399] - (2.04 if GeoFix in kinds else 0.0)
    assert said.time == pytest.approx(own, abs=0.05)
    assert abs(said.pose.x - STRAIGHT.x[399]) < 3.0


@pytest.mark.parametrize("every", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("stall", [50, 80])
def test_fixes_that_are_worked_off_after_a_stall_step_no_clock_ahead(stall: int, every: float):
    wheels = [one for k, one in enumerate(TICKS[:400]) if not 200 < k < 200 + stall]
    begin = TIMES[200 + stall] + 0.01

    def late(k: int, time: float) -> float:
        return time if k < 200 else max(time, begin + every * ((k - 205) // 10))

    online = heard(wheels, late)
    assert named(online) == []
    assert online.skipped["late"] < 15
    assert online.estimate().time == TIMES[399]


@pytest.mark.parametrize("seed", [4, 5])
def test_fixes_of_ordinary_latency_beside_dropouts_step_no_clock_ahead(seed: int):
    rng, out = np.random.default_rng(seed), set()
    for first in rng.integers(10, 380, 12).tolist():
        out |= set(range(first, first + int(rng.integers(5, 9))))
    wheels = [one for k, one in enumerate(TICKS[:400]) if k not in out]
    online = heard(wheels, lambda k, time: time + float(rng.uniform(0.1, 0.95)))
    assert named(online) == []
    assert online.skipped == {}


@pytest.mark.parametrize("wheels_drop", [(30, 36), (30, 39)])
def test_fixes_that_are_nearly_a_second_late_step_no_clock_ahead(wheels_drop: tuple[int, int]):
    wheels = [one for k, one in enumerate(TICKS[:400]) if not wheels_drop[0] < k < wheels_drop[1]]
    online = heard(wheels, lambda k, time: time + 0.9)
    assert named(online) == []
    assert online.skipped == {}


@pytest.mark.parametrize("other", [0.0, 0.03, 0.3])
def test_two_sources_in_batches_set_no_clock_back(other: float):
    online = Localizer(TOWN, vehicle=CAR)
    for k in range(0, 400, 10):
        for one in SPEEDS[k : k + 10]:
            online.update(one)
        for one in SPEEDS[k : k + 10]:
            online.update(SpeedYaw(one.time - other, one.speed + 0.05, 0.0))
        said = online.update(fix(k + 9))
    assert named(online) == []
    assert said.time == TIMES[399]


@pytest.mark.parametrize("late", [0.5, 1.0])
def test_a_slower_source_that_goes_on_alone_sets_no_clock_back(late: float):
    online = Localizer(TOWN, vehicle=CAR)
    come = [(one.time, one) for one in SPEEDS[:400]]
    come += [(t + late + 1e-4, replace(one, time=t + 0.03)) for t, one in come]
    online.update(fix(0))
    for _, one in sorted(come, key=lambda pair: pair[0]):
        online.update(one)
    assert named(online) in ([], ["odometry: clock"])


@pytest.mark.parametrize("readings", ["ticks", "speeds", "distances"])
@pytest.mark.parametrize("by", [1e-6, -1e-6])
def test_batches_that_come_again_with_other_stamps_set_no_clock_back(readings: str, by: float):
    distances = [Distance(t, s) for t, s in zip(TIMES, STRAIGHT.s.tolist(), strict=True)]
    log = {"ticks": TICKS, "speeds": SPEEDS, "distances": distances}[readings]
    online = Localizer(TOWN, vehicle=CAR)
    for k in range(0, 400, 10):
        for one in log[k : k + 10]:
            online.update(one)
        if k in (200, 300):
            for one in log[k : k + 10]:
                online.update(replace(one, time=one.time + by))
        online.update(fix(k + 9))
    assert named(online) == []
    assert online.estimate().time == TIMES[399]


def test_fixes_follow_two_steps_back_of_which_they_heard_none():
    online = Localizer(TOWN, vehicle=CAR)
    for k in range(1100):
        by = -2.03 * (k > 200) - 3.02 * (k > 850)
        said = online.update(replace(TICKS[k], time=TIMES[k] + by))
        if k % 10 == 5 and not 150 < k < 900:
            said = online.update(fix(k, TIMES[k] + by))
    assert online.skipped["late"] <= 8
    assert said.time == pytest.approx(TIMES[1099] - 5.05, abs=1e-6)
    assert named(online) == ["clock: set back"]


def test_odometry_that_stepped_ahead_and_back_again_is_named_no_longer():
    online = Localizer(TOWN, vehicle=CAR)
    for k in range(600):
        online.update(replace(TICKS[k], time=TIMES[k] + 2.03 * (200 < k < 400)))
        if k % 10 == 5:
            online.update(fix(k))
        if k == 390:
            assert named(online) == ["gnss: clock"]
    assert named(online) == ["clock: set back"]


def test_the_usual_interval_is_not_reckoned_at_each_reading(monkeypatch: pytest.MonkeyPatch):
    calls = []
    monkeypatch.setattr(set_back, "median", lambda times: calls.append(0) or median(times))
    online = Localizer(TOWN, vehicle=CAR)
    for k in range(0, 1000, 10):
        online.update(replace(TICKS[k], time=NOW + 0.11 * k))
    assert 3 <= len(calls) <= 6


def test_a_localizer_of_a_subclass_begins_anew():
    class Named(Localizer):
        def __init__(self, name: str) -> None:
            super().__init__(TOWN, vehicle=CAR)
            self.name = name

    online = Named("one")
    for k in range(100):
        for one in (TICKS[k], fix(k)):
            online.update(replace(one, time=TIMES[k] + 7200.0 * (k < 50)))
    assert online.skipped["clock set back: started anew"] == 1
    assert online.name == "one"
