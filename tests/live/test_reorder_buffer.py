"""Observations by their own times: late ones change nothing, much too late ones are refused."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from laws.public import road_map
from whichroad import GeoFix, Localizer
from whichroad.live.checkpoint import Checkpoint
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.reorder_buffer import ReorderBuffer


def localizer(town, ride):
    return Localizer(town, vehicle=ride.vehicle)


def same(a, b):
    return (
        a.time == b.time
        and np.array_equal(a.cov, b.cov)
        and (a.pose, a.edge, a.p_road, a.status) == (b.pose, b.edge, b.p_road, b.status)
    )


def answer(town, ride, observations):
    one = localizer(town, ride)
    for observation in observations:
        one.take(observation)
    return one


def test_events_in_order_are_what_the_localizer_says(town, ride, observations):
    buffer = ReorderBuffer(localizer(town, ride))
    assert all(buffer.take(one) for one in observations[:300])
    assert same(buffer.localizer.estimate(), answer(town, ride, observations[:300]).estimate())
    assert buffer.rewinds == 0


def test_late_fixes_give_the_answer_of_the_sorted_observations(town, ride, observations):
    observations = [
        one if not isinstance(one, GeoFix) else shifted(one, 0.03) for one in observations[:600]
    ]
    observations.sort(key=lambda one: one.time)
    rng = np.random.default_rng(5)
    delay = [rng.uniform(0.1, 0.8) if isinstance(one, GeoFix) else 0.0 for one in observations]
    arrival = np.argsort([one.time + d for one, d in zip(observations, delay, strict=True)])
    buffer = ReorderBuffer(localizer(town, ride), window=1.0)
    buffer.take(observations[0])
    for i in arrival:
        if i:
            assert buffer.take(observations[i])
    assert buffer.rewinds > 50
    assert same(buffer.localizer.estimate(), answer(town, ride, observations).estimate())


def shifted(fix, seconds):
    fields = {name: getattr(fix, name) for name in fix.__slots__}
    return GeoFix(**{**fields, "time": fix.time + seconds})


def test_an_observation_beyond_the_window_is_refused_and_counted(town, ride, observations):
    buffer = ReorderBuffer(localizer(town, ride), window=0.5)
    for one in observations[:400]:
        buffer.take(one)
    before = buffer.localizer.estimate()
    assert not buffer.take(observations[300])
    assert buffer.skipped == {"late": 1}
    assert same(buffer.localizer.estimate(), before)


def test_what_there_is_to_go_back_to_does_not_grow(town, ride, observations):
    buffer = ReorderBuffer(localizer(town, ride), window=1.0)
    for one in observations:
        buffer.take(one)
    assert len(buffer._states) <= 22
    assert buffer.now - buffer._taken[0].time <= 1.3


def test_a_state_is_all_that_a_localizer_remembers(town, ride, observations):
    """A new attribute of the localizer must be kept too, or be named here as one that stays."""
    kept = {"_filter", "_odometer", "_rate", "_began", "_reading", "_far_fix", "_interval"}
    kept |= {"_past", "_statistics", "_gyro", "_sensing", "_clocks", "_before_wake"}
    kept |= {"_band", "_creeps", "_glitches", "_steps", "_tie"}
    stays = {"roads", "vehicle", "settings", "skipped", "_start", "lag", "_answers"}
    stays |= {"_lock"}
    views, forgotten = (
        {"_ahead"},
        {"_late", "_streams"},
    )  # readings refused before say nothing afterwards
    assert vars(localizer(town, ride)).keys() == kept | stays | views | forgotten


def test_a_localizer_has_fewer_attributes_than_python_reads_quickly(town, ride):
    """With 30 a reading of odometry took 0.4 µs longer."""
    assert len(vars(localizer(town, ride))) < 30


def test_a_localizer_taken_back_says_what_it_said(town, ride, observations):
    one = answer(town, ride, observations[:500])
    state = one.state()
    first = [one.update(observation) for observation in observations[500:700]]
    one.restore(state)
    for observation, before in zip(observations[500:700], first, strict=True):
        assert same(one.update(observation), before)


def test_damaged_files_are_no_state(town, ride, observations, tmp_path):
    file = tmp_path / "state"
    Checkpoint(file, answer(town, ride, observations[:100])).taken()()
    data, fresh = file.read_bytes(), Checkpoint(file, localizer(town, ride))
    assert fresh.resume(replay=True)[0] is not None
    cut = [data[:n] for n in (0, 5, 40, len(data) - 1)]
    turned = [
        data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        for place in range(0, len(data), 997)
    ]
    for damaged in cut + turned:
        file.write_bytes(damaged)
        when, why = fresh.resume(replay=True)
        assert when is None
        assert "damaged" in why


def test_a_state_of_another_map_is_left_alone(town, ride, observations, tmp_path):
    Checkpoint(tmp_path / "state", answer(town, ride, observations[:100])).taken()()
    other = Localizer(road_map([[[0.0, 0.0], [500.0, 0.0]]]))
    when, why = Checkpoint(tmp_path / "state", other).resume(replay=True)
    assert when is None
    assert "another map" in why


def test_a_state_of_another_vehicle_is_left_alone(town, ride, observations, tmp_path):
    Checkpoint(tmp_path / "state", answer(town, ride, observations[:100])).taken()()
    other = Localizer(town, vehicle=replace(ride.vehicle, track_width=2.0))
    when, why = Checkpoint(tmp_path / "state", other).resume(replay=True)
    assert when is None
    assert "another vehicle" in why


@pytest.mark.parametrize("age", [0.5, 5.0, 20.0])
def test_who_slept_is_where_it_would_be_and_less_sure(town, ride, observations, age):
    one = answer(town, ride, observations[:500])
    before = one.estimate()
    one.wake(before.time + age)
    after = one.estimate()
    assert after.time == before.time + age
    assert np.trace(after.cov[:2, :2]) > np.trace(before.cov[:2, :2]) + (0.5 * age) ** 2
    way = np.hypot(after.pose.x - before.pose.x, after.pose.y - before.pose.y)
    assert way <= abs(before.speed) * age + 5.0
    later = [o for o in observations if o.time > after.time]
    for observation in later[:300]:
        last = one.update(observation)
    truth = answer(town, ride, observations[: observations.index(later[299]) + 1]).estimate()
    apart = np.array([last.pose.x - truth.pose.x, last.pose.y - truth.pose.y])
    assert apart @ np.linalg.solve(last.cov[:2, :2] + truth.cov[:2, :2], apart) < 13.8


@pytest.mark.parametrize("age", [0.5, 5.0, 20.0])
def test_what_comes_after_who_slept_was_asked_is_taken_as_without_it(town, ride, observations, age):
    """Counters go on over a pause, and what measured 0 m since is no odometry."""
    plain, woken = (answer(town, ride, observations[:500]) for _ in range(2))
    begin = woken.estimate().time + age
    for share in (0.3, 0.7, 1.0):
        woken.wake(begin - (1.0 - share) * age)
    kept = woken.to_bytes()
    again = Localizer.from_bytes(kept, town)
    for observation in [o for o in observations if o.time > begin][:300]:
        expected = plain.update(observation)
        assert same(woken.update(observation), expected)
        assert same(again.update(observation), expected)


def test_the_first_observation_after_a_crash_is_taken_as_after_a_silence(town, ride, observations):
    plain = answer(town, ride, observations[:500])
    filter_loop = FilterLoop(answer(town, ride, observations[:500]))
    filter_loop.resume(plain.estimate().time, 5.0, -math.inf)
    for observation in observations[600:900]:
        filter_loop.observe([observation])
        assert same(filter_loop.estimate(), plain.update(observation))


def test_a_fix_older_than_the_first_wheels_is_taken(town, ride, observations):
    fix = next(one for one in observations if isinstance(one, GeoFix))
    wheels = [one for one in observations if one.time > fix.time and not isinstance(one, GeoFix)]
    buffer = ReorderBuffer(localizer(town, ride))
    for one in wheels[:3]:
        buffer.take(one)
    assert buffer.take(fix)
    assert buffer.skipped == {}
    assert same(buffer.localizer.estimate(), answer(town, ride, [fix, *wheels[:3]]).estimate())


def test_a_clock_far_from_the_others_is_refused_until_only_it_speaks(town, ride, observations):
    filter_loop = FilterLoop(localizer(town, ride))
    here, there = filter_loop.sensor("a", "gnss"), filter_loop.sensor("b", "gnss")
    fixes = [one for one in observations if isinstance(one, GeoFix)]
    for fix in fixes[:10]:
        filter_loop.take(here, [fix], time.perf_counter())
        filter_loop.take(there, [shifted(fix, 3600.0)], time.perf_counter())
        filter_loop.take(there, [shifted(fix, -3600.0)], time.perf_counter())
    assert (here.skipped, there.skipped) == (0, 20)
    assert filter_loop.buffer.skipped == {
        "clock ahead of the others": 10, "clock behind the others": 10
    }  # fmt: skip
    filter_loop._last_arrival -= 10.0
    for fix in fixes[10:15]:
        filter_loop.take(there, [shifted(fix, -3600.0)], time.perf_counter())
    assert filter_loop.estimate().time == fixes[14].time - 3600.0
    assert filter_loop.estimate().edge is not None
