"""The time of what is published: it never goes back, and never into the future."""

import json
import math
import random
from dataclasses import replace
from itertools import pairwise

import pytest

from whichroad import GeoFix, Localizer, WheelTicks
from whichroad.live.checkpoint import Checkpoint
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.health import Health
from whichroad.live.nmea_output import sentences
from whichroad.live.recording import Recorder
from whichroad.readers.nmea import NmeaParser
from whichroad.tables.schema import read_arrow

TICK = 0.05  # s


class World:
    """A clock, observations that arrive late and in another order, and what is published."""

    def __init__(self, town, ride, observations, *, jitter=0.3, seed=0, keep=None, lag=None):
        self.rng = random.Random(seed)
        self.town, self.ride, self.lag, self.folder = town, ride, lag, keep
        self.begin = observations[0].time
        late = [(one.time + self.rng.uniform(0.0, jitter), one) for one in observations]
        self.coming = sorted(late, key=lambda pair: pair[0])
        self.now = self.begin
        self.newest = -math.inf
        self.sent = []  # message, newest observation until then, clock
        self.loop = None
        self.start()

    def start(self, state=None, asleep=0.0, published=-math.inf):
        """A new process."""
        localizer = Localizer(self.town, vehicle=self.ride.vehicle, lag=self.lag)
        recorder = Recorder(self.folder, self.town, {}) if self.folder else None
        self.loop = FilterLoop(localizer, recorder=recorder, clock=lambda: self.now)
        self.loop.sinks.append(self.hear)
        if recorder:
            self.loop.recorded = recorder.until
        if state is not None:
            localizer.restore(state)
            self.loop.resume(state.time, asleep, published)

    def hear(self, text, message):
        """A message was published."""
        self.sent.append((json.loads(text), self.newest, self.now))

    def run(self, seconds, deaf=False):
        """Let time pass; who is deaf takes nothing."""
        end = self.now + seconds
        tick = self.now
        while (following := self.coming[0][0] if self.coming else math.inf) < end or tick < end:
            if following <= tick:
                self.now, one = self.coming.pop(0)
                if not deaf:
                    self.newest = max(self.newest, one.time)
                    kind = "gnss" if isinstance(one, GeoFix) else "wheels"
                    self.loop.take(self.loop.sensor(kind, kind), [one], self.now)
            else:
                self.now = tick
                tick += TICK
                if not deaf:
                    self.loop.tick()
        self.now = end

    def crash(self, since, asleep):
        """End without a word, having stored the state some time before; start again later."""
        state, published = self.loop.localizer.state(), self.loop.until
        self.run(since)
        if self.loop.recorder:
            self.loop.recorder.close()
        self.run(asleep, deaf=True)
        self.start(state, since + asleep, published)


def epochs(world):
    return [message["epoch_s"] for message, _, _ in world.sent]


def holds(world, horizon):
    """The law: never back, never beyond the newest observation by more, never in the future."""
    times = epochs(world)
    assert all(a <= b for a, b in pairwise(times))
    for message, newest, now in world.sent:
        assert message["epoch_s"] <= newest + horizon + 1e-5
        assert message["epoch_s"] <= now + 1e-5
    return times


def of(observations, kind, every=0.0):
    """Observations of a kind, with so many seconds between them at least."""
    chosen, last = [], -math.inf
    for one in observations:
        if isinstance(one, kind) and one.time - last >= every - 1e-6:
            chosen.append(one)
            last = one.time
    return chosen


@pytest.mark.parametrize("seed", range(12))
def test_time_never_goes_back_and_nothing_is_in_the_future_over_crashes(
    town, ride, observations, tmp_path, seed
):
    rng = random.Random(seed)
    which = [observations, of(observations, GeoFix, 1.0), of(observations, GeoFix)][seed % 3]
    world = World(town, ride, which, seed=seed, keep=tmp_path / "rec")
    for _ in range(4):
        world.run(rng.uniform(3.0, 8.0))
        seen = len(world.sent)
        world.crash(rng.uniform(0.0, 0.5), rng.uniform(0.7, 6.0))
        assert len(world.sent) >= seen
    world.run(5.0)
    world.loop.recorder.close()
    times = holds(world, 6.5)
    assert times[-1] > world.begin + 20.0
    table, whole = read_arrow((tmp_path / "rec" / "points.arrow").read_bytes())
    recorded = [time.timestamp() for time in table["time"].to_pylist()]
    assert whole
    assert len(recorded) > 20
    assert all(a < b for a, b in pairwise(recorded))
    assert recorded[-1] <= world.now


def test_after_a_crash_nothing_is_published_before_the_first_observation(town, ride, observations):
    world = World(town, ride, observations)
    world.run(10.0)
    world.coming = [pair for pair in world.coming if pair[0] > world.now + 20.0]
    world.crash(0.3, 1.0)
    seen = len(world.sent)
    world.run(18.0)
    assert len(world.sent) == seen
    world.run(4.0)
    assert len(world.sent) > seen + 20
    first = world.sent[seen]
    assert first[0]["epoch_s"] <= first[2]
    assert first[0]["answered"]
    holds(world, 1.0)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_a_receiver_of_one_fix_a_second_is_not_silent_between_them(
    town, ride, observations, jitter
):
    world = World(town, ride, of(observations, GeoFix, 1.0), jitter=jitter)
    world.run(40.0)
    assert not any(message["dead_reckoning"] for message, _, _ in world.sent)
    assert all(message["sensors"][0]["state"] == "ok" for message, _, _ in world.sent)
    holds(world, 1.0 + jitter)
    times = epochs(world)
    assert max(b - a for a, b in pairwise(times[20:])) < 0.7
    assert b"".join(sentences(m) for m, _, _ in world.sent[20:]).count(b",E*") == 0


def test_when_all_are_silent_the_prediction_ends_after_what_their_rate_explains(
    town, ride, observations
):
    cases = ((GeoFix, 1.0, 5.5), (WheelTicks, 0.0, 1.0), ((GeoFix, WheelTicks), 0.0, 5.5))
    for kind, every, horizon in cases:
        world = World(town, ride, of(observations, kind, every), jitter=0.0)
        world.run(20.0)
        last, world.coming = world.newest, []
        world.run(30.0)
        message = world.sent[-1][0]
        assert message["dead_reckoning"]
        assert not message["sensors"][0]["ok"]
        assert last + 0.9 <= message["epoch_s"] <= last + horizon
        holds(world, horizon)


@pytest.mark.parametrize(("kinds", "every"), [(GeoFix, 1.0), ((GeoFix, WheelTicks), 0.0)])
def test_an_estimate_that_no_sensor_carries_on_is_stale_and_its_ages_go_on(
    town, ride, observations, kinds, every
):
    world = World(town, ride, of(observations, kinds, every), jitter=0.0)
    world.run(20.0)
    assert not any(message["stale"] for message, _, _ in world.sent)
    last, world.coming, rest = world.newest, [], world.coming
    seen = len(world.sent)
    world.run(16.0)
    for message, _, now in world.sent[seen:]:
        assert message["age_s"] == pytest.approx(max(now - message["epoch_s"], 0.0), abs=0.11)
        assert message["fix"]["age_s"] == pytest.approx(now - message["fix"]["epoch_s"], abs=0.11)
        assert message["heard"][0]["age_s"] == pytest.approx(message["fix"]["age_s"], abs=0.01)
        assert message["stale"] is (message["age_s"] > 1.0)
        if now > last + 5.5 + 1.2:
            assert (message["stale"], message["status"]) == (True, "lost")
            assert (message["protection_m"], message["level_along_m"]) == (None, None)
            assert b",V," in sentences(message)
            assert b",,,,,0," in sentences(message)
    assert message["reason"].startswith("no sensor delivers: the pose is of 1")
    world.coming = [pair for pair in rest if pair[0] > world.now]
    world.run(3.0)
    assert not world.sent[-1][0]["stale"]
    assert world.sent[-1][0]["age_s"] < 1.0


def test_late_fixes_within_the_window_never_move_time_back(town, ride, observations):
    world = World(town, ride, observations, jitter=0.0)
    world.coming = sorted(
        (one.time + (0.8 if isinstance(one, GeoFix) else 0.0), k, one)
        for k, (_, one) in enumerate(world.coming)
    )
    world.coming = [(at, one) for at, _, one in world.coming]
    world.run(30.0)
    assert world.loop.buffer.rewinds > 20
    assert not world.loop.buffer.skipped
    holds(world, 0.1)
    fixes = [message["fix"]["epoch_s"] for message, _, _ in world.sent if message["fix"]]
    assert all(a <= b for a, b in pairwise(fixes))


def test_masked_fixes_let_time_go_on(town, ride, observations):
    world = World(town, ride, of(observations, GeoFix, 1.0), jitter=0.2)
    world.run(10.0)
    world.loop.mask(True)
    world.run(20.0)
    times = holds(world, 1.5)
    assert times[-1] > world.now - 1.5
    assert world.sent[-1][0]["ellipse"]["major_m"] > world.sent[60][0]["ellipse"]["major_m"]
    assert not world.loop.buffer.skipped
    world.loop.mask(False)
    world.run(5.0)
    holds(world, 1.5)


def test_before_the_first_observation_a_button_publishes_nothing(town, ride):
    filter_loop = FilterLoop(Localizer(town, vehicle=ride.vehicle))
    filter_loop.mask(True)
    filter_loop.mask(False)
    filter_loop.tick()
    assert filter_loop.published == b""


def test_reordered_observations_after_a_crash_are_those_of_the_sorted_ones(
    town, ride, observations
):
    before = Localizer(town, vehicle=ride.vehicle)
    for one in observations[:600]:
        before.take(one)
    state, rest = before.state(), observations[640:680]
    answers = []
    for order in (rest, [rest[3], rest[1], rest[0], rest[2], *rest[4:]]):
        loop = FilterLoop(Localizer(town, vehicle=ride.vehicle))
        loop.localizer.restore(state)
        loop.resume(state.time, 1.0, -math.inf)
        for one in order:
            loop.observe([one])
        answers.append(loop.estimate())
        assert not loop.buffer.skipped
    assert answers[0].time == answers[1].time
    assert answers[0].pose == answers[1].pose
    assert answers[0].p_road == answers[1].p_road


def test_a_checkpoint_says_what_was_published(town, ride, observations, tmp_path):
    one = Localizer(town, vehicle=ride.vehicle)
    for observation in observations[:300]:
        one.take(observation)
    Checkpoint(tmp_path / "state", one).taken(published=one.estimate().time + 0.2)()
    again = Checkpoint(tmp_path / "state", Localizer(town, vehicle=ride.vehicle))
    when, _ = again.resume(replay=False)
    assert when == one.estimate().time
    assert again.published == one.estimate().time + 0.2


def test_what_was_published_before_a_crash_is_not_published_again_as_older(
    town, ride, observations
):
    """A receiver that sends again what it had sent is heard, and nothing is said until now."""
    one = Localizer(town, vehicle=ride.vehicle)
    for observation in observations[:600]:
        one.take(observation)
    loop, messages = FilterLoop(Localizer(town, vehicle=ride.vehicle)), []
    loop.sinks.append(lambda text, message: messages.append(message["epoch_s"]))
    loop.localizer.restore(one.state())
    published = observations[599].time + 3.0
    loop.resume(observations[599].time, 0.0, published)
    for observation in observations[600:1400]:
        loop.observe([observation])
        loop.publish()
    assert messages[0] >= published
    assert len(messages) > 100


def test_an_input_is_silent_after_five_of_its_usual_intervals():
    for every in (0.01, 0.1, 1.0, 10.0):
        health, now = Health("a", "gnss"), 100.0
        for _ in range(60):
            now += every
            health.heard(1, now)
        assert health.interval == pytest.approx(every, rel=0.2)
        assert health.state(now + 0.95 * max(1.0, 4.0 * every)) == "ok"
        assert health.state(now + 1.3 * max(1.0, 5.0 * every)) == "silent"
        assert health.rate(now) == pytest.approx(1.0 / every, rel=0.2)
        now += 200.0 * every
        health.heard(1, now)
        assert health.interval == pytest.approx(every, rel=0.2)


def test_the_sentences_that_go_out_are_not_ahead_of_the_message_and_never_go_back(
    town, ride, observations
):
    odd = [
        replace(one, time=one.time + 0.0088) if isinstance(one, GeoFix) else one
        for one in observations
    ]
    world = World(town, ride, odd, seed=5)
    world.run(20.0)
    parser, said = NmeaParser(today=world.now), []
    for message, _, _ in world.sent:
        for fix in parser.feed(sentences(message)) + parser.pause():
            assert message["epoch_s"] - 0.011 < fix.time <= message["epoch_s"] + 1e-6
            said.append(fix)
    assert len(said) > 50
    assert all(a.time <= b.time for a, b in pairwise(said))


def test_what_is_looked_back_at_does_not_go_back_either(town, ride, observations):
    world = World(town, ride, observations, seed=6, lag=5.0)
    for _ in range(2):
        world.run(15.0)
        world.crash(0.3, 2.0)
    world.run(10.0)
    holds(world, 6.5)
    looked = [message["lagged"]["epoch_s"] for message, _, _ in world.sent if message["lagged"]]
    assert len(looked) > 30
    assert all(a <= b for a, b in pairwise(looked))
