"""Sensors and faults of `benchmarks worlds`: each fault does what it says, and no more."""

import numpy as np
import pytest
from benchmarks import Skipped
from benchmarks.worlds import names
from benchmarks.worlds.drivers import WHEELBASE, Truth, drivable, rear_axle
from benchmarks.worlds.faults import BY_NAME, FAULTS, SUITES, Event, draw_events, during, suite_of
from benchmarks.worlds.receivers import absent, receive, replayed, smooth
from benchmarks.worlds.told import sound, withhold
from benchmarks.worlds.wheels import PER_TICK, TRACK, count_wheels, measure_distance, measure_yaw


@pytest.fixture
def truth() -> Truth:
    """200 s: 50 s at rest, then a circle of 100 m radius to the left at 10 m/s."""
    time = np.arange(0.0, 200.0, 0.1)
    travel = 10.0 * (time - 50.0).clip(0.0)
    angle = travel / 100.0
    x, y = 100.0 * np.sin(angle), 100.0 * (1.0 - np.cos(angle))
    return Truth(time, x, y, angle, travel, np.zeros(len(time), int))


def fixes_of(truth, tmp_path, *events, suite="gnss", seed=1):
    return receive(truth, list(events), suite, tmp_path, np.random.default_rng(seed))


def errors(truth, fixes) -> np.ndarray:
    heading = np.interp(fixes.time, truth.time, truth.heading)
    x = np.interp(fixes.time, truth.time, truth.x) + 1.1 * np.cos(heading)
    y = np.interp(fixes.time, truth.time, truth.y) + 1.1 * np.sin(heading)
    return np.column_stack([fixes.x - x, fixes.y - y])


def test_a_sound_receivers_errors_have_the_size_it_reports(truth, tmp_path):
    chi = []
    for seed in range(60):
        fixes = fixes_of(truth, tmp_path, seed=seed)
        chi.append(np.mean(errors(truth, fixes) ** 2 / fixes.cov[:, [0, 2]]))
    # slow errors: 60 drives of 200 s are some 100 independent values
    assert np.mean(chi) == pytest.approx(1.0, abs=0.35)


def test_a_smooth_error_has_unit_variance_and_is_smooth():
    time = np.arange(0.0, 200_000.0, 1.0)
    path = smooth(time, 100.0, np.random.default_rng(2))
    assert path.std(0) == pytest.approx([1.0, 1.0], abs=0.1)
    assert np.abs(np.diff(path, axis=0)).max() < 0.2


def test_an_outage_has_no_fixes_and_those_around_it_stay(truth, tmp_path):
    sound = fixes_of(truth, tmp_path)
    cut = fixes_of(truth, tmp_path, Event("outage", 80.0, 120.0))
    assert not ((cut.time > 80.0) & (cut.time < 120.0)).any()
    outside = (sound.time < 80.0) | (sound.time > 120.0)
    assert np.array_equal(cut.x, sound.x[outside])


@pytest.mark.parametrize("name", ["canyon", "jump"])
def test_a_passing_fault_is_large_while_it_lasts_and_absent_before(name, truth, tmp_path):
    fixes = fixes_of(truth, tmp_path, Event(name, 80.0, 160.0))
    size = np.hypot(*errors(truth, fixes).T)
    inside = (fixes.time > 80.5) & (fixes.time < 160.0)
    assert size[inside].max() > 12.0
    assert size[fixes.time < 72.0].max() < 10.0


def test_a_lagging_receiver_is_behind_in_a_bend(truth, tmp_path):
    sound, late = fixes_of(truth, tmp_path), fixes_of(truth, tmp_path, Event("lag", 0.0, 200.0))
    moving = sound.time > 80.0

    def from_middle(f):
        return np.hypot(f.x[moving], f.y[moving] - 100.0).mean()

    assert from_middle(late) > from_middle(sound) + 0.5


def test_fixes_drift_only_while_the_car_stands(truth, tmp_path):
    drifting = fixes_of(truth, tmp_path, Event("standstill", 0.0, 200.0))
    sound = fixes_of(truth, tmp_path)
    away = np.hypot(drifting.x - sound.x, drifting.y - sound.y)
    at_rest = away[sound.time < 50.0].max()
    assert 5.0 < at_rest < 60.0
    assert away[sound.time > 90.0].max() < 0.1


def test_what_is_replayed_names_the_data_that_it_needs(truth, tmp_path):
    assert absent(tmp_path) == {"nagoya", "kubicka", "comma"}
    with pytest.raises(Skipped, match="comma_truth"):
        fixes_of(truth, tmp_path, Event("comma", 0.0, 200.0))


@pytest.mark.data
@pytest.mark.parametrize("name", ["nagoya", "kubicka", "comma"])
def test_replayed_errors_are_of_a_receivers_size_and_change_slowly(name, data_folder):
    for error, cov in replayed(name, data_folder):
        size = np.hypot(*error.T)
        assert 0.1 < np.median(size) < 20.0
        assert size.max() < 215.0
        assert np.median(np.hypot(*np.diff(error, axis=0).T)) < 3.0
        assert (cov[:, 0] * cov[:, 2] > cov[:, 1] ** 2).all()


def test_speed_and_course_are_wrong_as_their_faults_say(truth, tmp_path):
    sound = fixes_of(truth, tmp_path)
    kmh = fixes_of(truth, tmp_path, Event("speed_kmh", 0.0, 200.0))
    assert kmh.speed == pytest.approx(3.6 * sound.speed)
    back = fixes_of(truth, tmp_path, Event("course_reversed", 0.0, 200.0))
    known = np.isfinite(sound.bearing_deg)
    turned = (back.bearing_deg[known] - sound.bearing_deg[known]) % 360.0
    assert turned == pytest.approx(180.0)
    spike = fixes_of(truth, tmp_path, Event("speed_spike", 100.0, 100.1))
    assert (np.abs(spike.speed - sound.speed) > 20.0).sum() == 1


def test_sound_wheels_roll_the_distance_and_turn_the_angle(truth):
    wheels = count_wheels(truth, [], np.random.default_rng(4))
    left, right = ((wheels[n][-1] - wheels[n][0]) * PER_TICK for n in ("left", "right"))
    assert 0.5 * (left + right) == pytest.approx(truth.travel[-1], rel=0.03)
    assert right - left == pytest.approx(TRACK * truth.heading[-1], rel=0.25)
    at_rest = truth.time < 49.0
    assert len(np.unique(wheels["left"][at_rest])) == 1


def test_a_stuck_counter_stands_and_the_other_goes_on(truth):
    wheels = count_wheels(truth, [Event("stuck", 100.0, 130.0)], np.random.default_rng(5))
    inside = (truth.time > 100.1) & (truth.time < 129.9)
    moved = [np.ptp(wheels[n][inside]) > 0 for n in ("left", "right")]
    assert sorted(moved) == [False, True]


def test_repeated_counts_catch_up(truth):
    sound = count_wheels(truth, [], np.random.default_rng(6))
    held = count_wheels(truth, [Event("repeats", 100.0, 105.0)], np.random.default_rng(6))
    inside = (truth.time >= 100.0) & (truth.time <= 105.0)
    assert len(np.unique(held["left"][inside])) == 1
    after = truth.time > 105.1
    assert np.array_equal(held["left"][after], sound["left"][after])


def test_a_gap_of_the_bus_has_no_rows(truth):
    wheels = count_wheels(truth, [Event("bus_gap", 100.0, 110.0)], np.random.default_rng(7))
    assert np.diff(wheels["time"]).max() == pytest.approx(10.1, abs=0.11)


def test_swapped_wheels_turn_the_other_way(truth):
    sound = count_wheels(truth, [], np.random.default_rng(8))
    swapped = count_wheels(truth, [Event("swapped", 0.0, 200.0)], np.random.default_rng(8))
    assert np.array_equal(sound["left"], swapped["right"])


def test_a_sound_gyro_turns_with_the_car_and_a_faulty_one_does_not(truth):
    yaw = measure_yaw(truth, [], np.random.default_rng(9))["yaw"]
    assert yaw.sum() * 0.1 == pytest.approx(truth.heading[-1], abs=0.25)
    biased = measure_yaw(truth, [Event("gyro_bias", 0.0, 200.0)], np.random.default_rng(9))["yaw"]
    assert abs(biased[:400].mean()) > 5e-4
    other = measure_yaw(truth, [Event("yaw_sign", 0.0, 200.0)], np.random.default_rng(9))["yaw"]
    assert other == pytest.approx(-yaw)


def test_a_rear_axle_follows_a_straight_bumper_straight_and_cuts_a_circle():
    front = np.column_stack([np.arange(0.0, 50.0), np.zeros(50)])
    x, y, heading, travel = rear_axle(front, 0.0)
    assert x == pytest.approx(front[:, 0] - WHEELBASE)
    assert np.abs([y, heading]).max() == 0.0
    assert travel[-1] == pytest.approx(49.0)
    angle = np.arange(0.0, 12.0, 0.01)
    circle = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    x, y, _, travel = rear_axle(circle, np.pi / 2)
    radius = np.sqrt(20.0**2 - WHEELBASE**2)
    assert np.hypot(x, y)[-1] == pytest.approx(radius, rel=1e-3)
    late = slice(600, None)
    assert np.ptp(travel[late]) == pytest.approx(radius * np.ptp(angle[late]), rel=1e-3)


def test_a_driven_corner_is_slow_and_round_and_a_stop_stays_a_stop():
    east = np.column_stack([np.arange(0.0, 60.0, 1.5), np.zeros(40)])
    north = np.column_stack([np.full(40, 60.0), np.arange(0.0, 60.0, 1.5)])
    front = np.vstack([east, north, np.repeat(north[-1:], 100, 0)])
    drive = drivable(front, 0.0)
    sideways = np.abs(drive.speed * np.gradient(drive.heading, drive.time))
    assert sideways.max() < 6.0
    assert drive.time[-1] > 0.1 * len(front) + 1.0
    assert np.ptp(drive.travel[-90:]) < 0.01


def test_a_fault_by_its_name_is_in_every_drive_that_can_have_it_and_alone():
    for name, fault in FAULTS.items():
        suite = suite_of([name] if fault.part != "map" else [], np.random.default_rng(1))
        events = [
            e
            for part in ("receiver", "odometry", "map")
            for e in draw_events([name], part, suite, 600.0, np.random.default_rng(2))
        ]
        assert {e.name for e in events} == {name}
        assert len(events) == fault.times
        assert all(0.0 <= e.begin < e.end <= 600.0 for e in events)


def test_all_faults_together_come_at_their_rates():
    random, n = np.random.default_rng(3), 4000
    seen = dict.fromkeys(FAULTS, 0)
    for _ in range(n):
        for part in ("receiver", "odometry", "map"):
            for name in {e.name for e in draw_events(None, part, "", 600.0, random)}:
                seen[name] += 1
    for name, fault in FAULTS.items():
        sigma = (fault.share * (1.0 - fault.share) / n) ** 0.5
        assert seen[name] / n == pytest.approx(fault.share, abs=4.5 * sigma)


def test_no_faults_are_none():
    assert draw_events([], "receiver", "wheels", 600.0, np.random.default_rng(0)) == []
    assert not during(np.arange(5.0), [], "canyon").any()


def test_faults_name_sensors_that_exist():
    assert sum(SUITES.values()) == pytest.approx(1.0)
    for fault in FAULTS.values():
        assert set(fault.suites.split()) <= {*SUITES, *BY_NAME}


def test_an_odometer_counts_the_way_in_steps_of_ten_centimetres(truth):
    columns = measure_distance(truth, [], np.random.default_rng(2))
    driven = columns["odometer"][-1] - columns["odometer"][0]
    assert driven == pytest.approx(truth.travel[-1] - truth.travel[0], rel=0.03)
    assert (np.diff(columns["odometer"]) >= 0.0).all()
    gap = [Event("bus_gap", 50.0, 60.0)]
    kept = measure_distance(truth, gap, np.random.default_rng(2))["time"]
    assert not ((kept > 50.0) & (kept < 60.0)).any()


def test_classes_of_faults_are_read_and_what_is_none_is_refused():
    assert names("each", {"comma"}) == ["none", "all", *(n for n in FAULTS if n != "comma")]
    assert names("canyon,lag+sigma,none", set()) == ["canyon", "lag+sigma", "none"]
    with pytest.raises(SystemExit, match="'fog' is no fault"):
        names("canyon+fog", set())


def test_told_of_a_fault_nothing_is_heard_of_what_fails_and_the_rest_stays(truth, tmp_path):
    events = [Event("jump", 80.0, 100.0), Event("dropped", 120.0, 150.0)]
    fixes = fixes_of(truth, tmp_path, *events, suite="wheels")
    wheels = count_wheels(truth, sound(events), np.random.default_rng(1))
    heard, odometry = withhold(fixes, wheels, events)
    assert not ((heard.time >= 80.0) & (heard.time <= 100.0)).any()
    assert len(heard.time) == np.count_nonzero((fixes.time < 79.9) | (fixes.time > 100.1))
    outside = (wheels["time"] < 119.9) | (wheels["time"] > 150.1)
    assert np.array_equal(odometry["left"], wheels["left"][outside])
    whole = [Event("swapped", 0.0, 200.0)]
    assert withhold(fixes, wheels, whole)[1] == {}


def test_told_of_a_bogus_speed_the_position_is_heard_and_the_speed_is_not(truth, tmp_path):
    events = [Event("speed_kmh", 0.0, 200.0)]
    fixes = fixes_of(truth, tmp_path, *events)
    heard, _ = withhold(fixes, {}, events)
    assert np.array_equal(heard.x, fixes.x)
    assert np.isnan(heard.speed).all()
    assert np.array_equal(heard.bearing_deg, fixes.bearing_deg, equal_nan=True)


def test_tables_that_are_filled_wrongly_say_what_they_are_named_for(truth):
    def counted(measure, *names):
        events = [Event(name, 0.0, 200.0) for name in names]
        return measure(truth, events, np.random.default_rng(3))

    right = counted(count_wheels)
    for name, factor in (("zeros", 0.0), ("backwards", -1.0), ("odometry_kmh", 3.6)):
        wrong = counted(count_wheels, name)
        assert np.array_equal(wrong["left"], factor * right["left"])
        assert np.array_equal(wrong["time"], right["time"])
    same = counted(count_wheels, "no_turn")
    assert np.array_equal(same["left"], right["right"])
    yaw = counted(measure_yaw, "no_turn")
    assert not yaw["yaw"].any()
    assert np.array_equal(yaw["speed"], counted(measure_yaw)["speed"])
    assert counted(measure_yaw, "backwards")["yaw"].any()


def test_a_receiver_may_be_late_or_say_one_speed(truth, tmp_path):
    right = fixes_of(truth, tmp_path)
    late = fixes_of(truth, tmp_path, Event("late", 0.0, 200.0))
    assert np.allclose(late.time, right.time + 1.0)
    assert np.array_equal(late.x, right.x)
    assert (fixes_of(truth, tmp_path, Event("speed_10", 0.0, 200.0)).speed == 10.0).all()


@pytest.mark.parametrize(("name", "seconds"), [("odometry_late", 1.0), ("odometry_18", 18.0)])
def test_odometry_may_be_late(truth, name, seconds):
    right = measure_yaw(truth, [], np.random.default_rng(1))
    late = measure_yaw(truth, [Event(name, 0.0, 200.0)], np.random.default_rng(1))
    assert np.allclose(late["time"], right["time"] + seconds)
    assert np.array_equal(late["speed"], right["speed"])
