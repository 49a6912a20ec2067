"""The service with a lag, and counters that go on counting after a crash."""

import json
import random
from collections import Counter

import pytest

from whichroad import GeoFix, Localizer, Vehicle
from whichroad.filter.state import new_path
from whichroad.live.checkpoint import Checkpoint
from whichroad.live.counter_stream import CounterStream
from whichroad.live.decode import CanStream
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.messages import EstimateMessage
from whichroad.live.reorder_buffer import ReorderBuffer
from whichroad.readers.can_frames import key

from .test_messages import follows
from .test_reorder_buffer import shifted

LAG = 5.0


def behind(town, ride, lag=LAG):
    return Localizer(town, vehicle=ride.vehicle, lag=lag)


def test_a_message_tells_what_is_known_by_now_of_the_moment_the_lag_ago(town, ride, observations):
    filter_loop = FilterLoop(behind(town, ride))
    first = observations[0].time
    for one in observations[:1500]:
        filter_loop.observe([one])
        if one.time - first > 0.8 * LAG:
            break
        filter_loop.publish()
        assert filter_loop.message["lagged"] is None
    filter_loop.observe(observations[:1500])
    filter_loop.publish()
    said, lagged = filter_loop.message, filter_loop.localizer.lagged()
    assert follows(json.loads(filter_loop.published), EstimateMessage)
    assert said["epoch_s"] - LAG - 0.5 < said["lagged"]["epoch_s"] <= said["epoch_s"] - LAG
    assert said["lagged"]["p_road"] == pytest.approx(lagged.p_road, abs=1e-6)
    assert said["lagged"]["pose"]["lat"] == pytest.approx(lagged.pose.lat, abs=1e-8)
    assert said["lagged"]["road"]["edge_id"] == lagged.edge
    assert said["decided_until"] == pytest.approx(filter_loop.localizer.decided_until, abs=1e-6)


def test_without_a_lag_nothing_is_told_of_the_past(town, ride, observations):
    filter_loop = FilterLoop(Localizer(town, vehicle=ride.vehicle))
    filter_loop.observe(observations[:500])
    filter_loop.publish()
    assert (filter_loop.message["lagged"], filter_loop.message["decided_until"]) == (None, None)


@pytest.mark.parametrize("room", [1 << 14, 2048 + 32])
def test_late_observations_are_looked_back_over_as_in_order(
    town, ride, observations, monkeypatch, room
):
    """Also where the tree of edges was tidied between: an epoch may need 2048 entries of it."""
    trees = []

    def tree(capacity):
        trees.append(new_path(capacity - (1 << 14) + room))
        return trees[-1]

    monkeypatch.setattr("whichroad.online.localizer.new_path", tree)
    monkeypatch.setattr("whichroad.lookback.path.new_path", tree)
    rng = random.Random(3)
    chosen = [shifted(one, 0.03) if isinstance(one, GeoFix) else one for one in observations[:1200]]
    chosen.sort(key=lambda one: one.time)
    arrival = {
        id(one): one.time + isinstance(one, GeoFix) * rng.uniform(0.1, 0.8) for one in chosen
    }
    sorted_, late = ReorderBuffer(behind(town, ride)), ReorderBuffer(behind(town, ride))
    for one in chosen:
        sorted_.take(one)
    late.take(chosen[0])
    for one in sorted(chosen[1:], key=lambda one: arrival[id(one)]):
        assert late.take(one)
    assert late.rewinds > 20
    assert (len(trees) > 2) == (room < 1 << 14)
    a, b = sorted_.localizer.lagged(), late.localizer.lagged()
    assert (a.edge, a.status) == (b.edge, b.status)
    assert b.p_road == pytest.approx(a.p_road, abs=1e-3)
    assert b.pose.x == pytest.approx(a.pose.x, abs=0.2)
    assert b.pose.y == pytest.approx(a.pose.y, abs=0.2)


def test_a_resumed_service_looks_back_again_after_the_lag(town, ride, observations, tmp_path):
    before = behind(town, ride)
    for one in observations[:1000]:
        before.take(one)
    Checkpoint(tmp_path / "state", before).taken()()
    after = behind(town, ride)
    when, _ = Checkpoint(tmp_path / "state", after).resume(replay=True)
    assert when == pytest.approx(observations[999].time)
    assert after.lagged() is None
    for one in observations[1000:2500]:
        after.take(one)
        before.take(one)
    assert after.lagged().edge == before.lagged().edge
    assert after.estimate().pose.x == pytest.approx(before.estimate().pose.x, abs=1e-6)


def test_a_state_with_another_lag_is_left_alone(town, ride, observations, tmp_path):
    for old, new in ((None, LAG), (LAG, None), (LAG, 2.0 * LAG)):
        before = behind(town, ride, old)
        for one in observations[:200]:
            before.take(one)
        Checkpoint(tmp_path / "state", before).taken()()
        when, why = Checkpoint(tmp_path / "state", behind(town, ride, new)).resume(replay=True)
        assert when is None
        assert "--lag" in why


DBC = """VERSION ""
BU_: A
BO_ 256 W: 8 A
 SG_ Left : 0|8@1+ (1,0) [0|0] "" A
 SG_ Right : 8|8@1+ (1,0) [0|0] "" A
"""


def counted(stream, first, last):
    """What a stream says of both wheels at 30 counts a tenth of a second, 8 bits each."""
    time, said = 1.7e9, []
    for i in range(first, last):
        said += stream.feed(key(256, False), time + 0.1 * i, bytes([30 * i % 256, 31 * i % 256]))
    return said


@pytest.fixture
def stream(tmp_path):
    (tmp_path / "wheels.dbc").write_text(DBC)
    signals = {"wheel_rl_ticks": "Left", "wheel_rr_ticks": "Right"}
    car = Vehicle(signals=signals, metres_per_tick_left=0.02, metres_per_tick_right=0.02)
    return lambda: CanStream(tmp_path / "wheels.dbc", car)


@pytest.mark.parametrize("asleep", [1, 7, 40, 200])
def test_counters_that_wrapped_while_the_service_slept_go_on(town, stream, tmp_path, asleep):
    """200 readings are 20 s, in which a counter of 8 bits wraps 23 times."""
    buses = {"can0": stream()}
    one = Localizer(town)
    x, y, _ = town.at(0, 1.0)
    one.take(GeoFix(1.7e9, *town.plane.to_geodetic(x, y)))
    counted(buses["can0"], 0, 100)
    Checkpoint(tmp_path / "state", one, buses).taken()()
    resumed, again = Checkpoint(tmp_path / "state", Localizer(town)), stream()
    assert resumed.resume(replay=True)[0] is not None
    again.resume(resumed.counted["can0"])
    said = counted(again, 100 + asleep, 130 + asleep)
    assert [round(one.left) for one in said] == [30 * i for i in range(100 + asleep, 130 + asleep)]
    assert [round(one.right) for one in said] == [31 * i for i in range(100 + asleep, 130 + asleep)]
    assert again.skipped == 0


def test_counts_of_another_clock_go_on_from_their_sum():
    before, skipped = CounterStream(8, 0.02), Counter()
    for i in range(20):
        total = before.take(1e9 + 0.1 * i, 30 * i % 256, False, skipped)
    after = CounterStream(8, 0.02)
    after.state = before.state
    assert after.take(5.0, 77.0, False, skipped) == total
    assert after.take(5.1, 107.0, False, skipped) == total + 30
    assert not skipped


def test_a_stream_that_nothing_came_from_has_nothing_to_remember(stream):
    fresh = stream()
    assert fresh.counted() == {}
    fresh.resume({"wheel_xx_ticks": [0.0] * 5})  # of another vehicle.toml
    assert counted(fresh, 0, 3)[0].left == 0
