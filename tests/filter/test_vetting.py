"""Which sensors are believed: on a drive through bends, each fault by its own name and no other."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from scenes.quick import quick
from whichroad._compile import Record
from whichroad.diagnosis.sensors import sensor_findings
from whichroad.filter.motion import arc_chord
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS, new_belief, new_epochs
from whichroad.filter.vetting.motion_sources import (
    ARC,
    COURSE,
    SOURCES,
    SPEED,
    TURN,
    is_borne_out,
    is_possible,
)
from whichroad.filter.vetting.vet import mode_of, refuse_standing, vet

RATE = 4  # epochs a second; a fix with every fourth
BEGIN = 1_780_300_800.0
AT = 60 * RATE  # epoch of 60 s


class Drive:
    """Two minutes through bends of 60 degrees, in sensors that can be spoilt."""

    def __init__(
        self, seed: int = 1, seconds: int = 120, speed: float = 12.0, later: float = 1.0
    ) -> None:
        random = np.random.default_rng(seed)
        n = seconds * RATE
        self.time = np.arange(n) / RATE
        self.speed = speed * np.minimum(1.0, self.time / 8.0)
        self.speed *= np.interp(self.time, [100.0, 104.0], [1.0, later])
        phase = (self.time % 20.0) - 10.0
        self.rate = np.where(
            np.abs(phase) < 3.0, 0.18 * np.sign(np.sin(self.time / 20.0 * np.pi)), 0
        )
        self.columns = True  # whether the receiver tells speed and course
        self.every, self.sigma = 1, 3.0  # s between fixes, and m that they report
        self.valid = np.ones(n, bool)
        self.seen = np.ones(n, bool)  # whether the receiver sees the sky
        self.measure(random)

    def measure(self, random: np.random.Generator) -> None:
        """What the sensors say of speeds and rates."""
        n = len(self.time)
        heading = np.cumsum(self.rate) / RATE
        self.x = np.cumsum(self.speed * np.cos(heading)) / RATE
        self.y = np.cumsum(self.speed * np.sin(heading)) / RATE
        slow = np.cumsum(random.normal(0.0, 0.1, (n, 2)), axis=0) * 0.5
        self.fix = np.column_stack([self.x, self.y]) + slow + random.normal(0.0, 0.7, (n, 2))
        self.told_speed = self.speed + random.normal(0.0, 0.1, n)
        self.course = heading + random.normal(0.0, 0.03, n)
        self.odometer, self.turn = self.speed.copy(), self.rate.copy()

    def vetted(self, sensors: int = WHEELS) -> Record:
        """What is believed at the end."""
        *_, vetting = self.while_vetted(sensors)
        return vetting

    def while_vetted(self, sensors: int = WHEELS) -> Iterator[Record]:
        """What is believed after each epoch, in one record."""
        [vetting] = quick(new_belief().state.vetting)
        epochs = quick(new_epochs(len(self.time)))
        for k in range(len(self.time)):
            epoch = epochs[k]
            epoch.time = BEGIN + self.time[k]
            epoch.arc, epoch.turn = self.odometer[k] / RATE, self.turn[k] / RATE
            epoch.forward, epoch.left = arc_chord(epoch.arc, epoch.turn)
            epoch.odometry_valid = self.valid[k] and sensors != CLOCK
            epoch.has_fix = k % (self.every * RATE) == 0 and self.seen[k]
            epoch.fix[:] = [*self.fix[k], self.sigma, self.sigma, 0.0]
            epoch.speed, epoch.course = self.told_speed[k], self.course[k]
            told = self.columns and self.speed[k] > 1.0
            epoch.speed_sigma = 0.2 if self.columns else np.inf
            epoch.course_sigma = 0.05 if told else np.inf
            vet(vetting, epoch, 1.0 / RATE if k else 0.0, sensors, 1.0)
            yield vetting


def withheld(vetting: Record) -> set[int]:
    """Sources that are not believed at the end."""
    return {source for source in range(SOURCES) if vetting.refused[source]}


def names(vetting: Record) -> list[str]:
    """What a diagnosis says of it."""
    return [finding.what for finding in sensor_findings(vetting)]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("columns", [True, False])
def test_sound_sensors_are_believed(seed: int, columns: bool):
    drive = Drive(seed)
    drive.columns = columns
    vetting = drive.vetted()
    assert withheld(vetting) == set()
    assert vetting.seconds.sum() == 0.0
    assert mode_of(vetting, WHEELS) == WHEELS
    assert names(vetting) == []


@pytest.mark.parametrize("seed", range(4))
def test_who_drives_in_a_small_circle_from_a_stop_on_has_sound_wheels(seed: int):
    """Its fixes stay about one place as well."""
    drive = Drive(seed, seconds=180)
    drive.columns = False
    at = 60 * RATE
    drive.speed[at : at + 40] = 0.0
    drive.speed[at + 40 :] = 2.5
    drive.rate[at : at + 40] = 0.0
    drive.rate[at + 40 :] = 0.5  # of 5 m
    drive.measure(np.random.default_rng(seed))
    assert withheld(drive.vetted()) == set()


@pytest.mark.parametrize("columns", [True, False])
def test_counters_that_stand_still_while_fixes_move_on_are_withheld(columns: bool):
    drive = Drive()
    drive.columns = columns
    drive.odometer[AT:] = drive.turn[AT:] = 0.0
    vetting = drive.vetted()
    assert mode_of(vetting, WHEELS) == CLOCK
    assert names(vetting)[0] == "odometry: stands still"


@pytest.mark.parametrize("stood", [0, AT])
def test_a_speed_that_is_not_believed_vouches_for_no_counters_that_stand(stood: int):
    """It is always 0, which was found out while the counters still counted, or never."""
    drive = Drive(seconds=240)
    drive.told_speed[:] = 0.0
    drive.odometer[stood:] = drive.turn[stood:] = 0.0
    vetting = drive.vetted()
    if stood > 0:
        assert withheld(vetting) >= {ARC, SPEED}
        assert mode_of(vetting, WHEELS) == CLOCK
        return
    assert withheld(vetting) == set()  # two that stand beside fixes that run
    assert vetting.outrun > 200.0
    refuse_standing(vetting)
    assert withheld(vetting) == {ARC, SPEED}


def test_a_counter_that_is_always_0_vouches_for_no_speed_that_is():
    drive = Drive()
    drive.told_speed[:] = 0.0
    drive.odometer *= 0.5
    drive.turn += 2.0 * drive.odometer / 1.5
    vetting = drive.vetted()
    assert vetting.refused[SPEED] == 1
    assert mode_of(vetting, WHEELS) == CLOCK


def test_fixes_that_run_away_from_a_vehicle_that_stands_are_not_believed_for_a_minute():
    """Its counters and its receiver's speed stand, and did not before."""
    drive = Drive(seconds=160)
    brakes = np.interp(drive.time, [120.0, 124.0], [1.0, 0.0])
    for log in (drive.odometer, drive.turn, drive.told_speed):
        log *= brakes
    vetting = drive.vetted()
    assert 20.0 < vetting.outrun < 40.0
    refuse_standing(vetting)
    assert vetting.refused[SPEED] == 0


def test_a_stop_that_no_brake_makes_is_withheld_at_once():
    drive = Drive()
    drive.odometer[AT:] = drive.turn[AT:] = 0.0
    for log in (drive.time, drive.fix):
        assert len(log) > AT
    drive.time = drive.time[: AT + 3]
    assert mode_of(drive.vetted(), WHEELS) == CLOCK


def test_one_wheel_that_stands_is_what_no_car_does():
    drive = Drive()
    drive.columns = False
    drive.odometer[AT:] *= 0.5
    drive.turn[AT:] += 2.0 * drive.odometer[AT:] / 1.5
    vetting = drive.vetted()
    assert mode_of(vetting, WHEELS) == CLOCK
    assert vetting.seconds[SOURCES] > 50.0


@pytest.mark.parametrize("columns", [True, False])
@pytest.mark.parametrize(
    ("factor", "name"),
    [(-1.0, "odometry: sign of turns"), (180.0 / np.pi, "odometry: unit of turns")],
)
def test_turns_of_the_other_sign_or_unit_are_withheld(columns: bool, factor: float, name: str):
    drive = Drive(seconds=180)
    drive.columns = columns
    drive.turn *= factor
    vetting = drive.vetted()
    assert mode_of(vetting, WHEELS) in (DISTANCE, CLOCK)  # no car turns as fast as degrees say
    named = names(vetting)
    assert named[0] in (name, "odometry: impossible")
    assert factor > 0.0 or named == [name]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("columns", [True, False])
def test_turns_that_never_agreed_are_withheld_in_the_first_bend(columns: bool, seed: int):
    drive = Drive(seed)
    drive.columns = columns
    drive.turn *= -1.0
    assert drive.vetted().since[TURN] < BEGIN + 20.0


@pytest.mark.parametrize("sensors", [WHEELS, CLOCK])
@pytest.mark.parametrize(
    ("factor", "word"), [(3.6, "km/h"), (1.944, "knots"), (2.237, "mph"), (0.0, "stood at 0")]
)
def test_a_speed_in_another_unit_is_named(sensors: int, factor: float, word: str):
    drive = Drive()
    drive.told_speed *= factor
    vetting = drive.vetted(sensors)
    assert withheld(vetting) == {SPEED}
    (finding,) = sensor_findings(vetting)
    assert finding.what == "gnss speed"
    assert word in finding.advice


@pytest.mark.parametrize("sensors", [WHEELS, CLOCK])
def test_a_speed_that_never_changes_is_not_believed_where_it_happens_to_be_right(sensors: int):
    """It is 3 m/s, and from 100 s on the vehicle is as fast; one that has changed is believed."""
    drive = Drive(seconds=200, later=0.25)
    drive.told_speed[:] = 3.0
    assert withheld(drive.vetted(sensors)) == {SPEED}
    drive = Drive(seconds=200, later=0.25)
    drive.told_speed[: 90 * RATE] = 25.0
    vetting = drive.vetted(sensors)
    assert vetting.seconds[SPEED] > 60.0
    assert withheld(vetting) == set()


@pytest.mark.parametrize("sensors", [WHEELS, CLOCK])
def test_a_speed_that_stays_the_same_while_fixes_become_slower_is_withheld(sensors: int):
    """It is 10 m/s, and the vehicle drives at 12 and then at 7: neither is far from that."""
    drive = Drive(seconds=160, later=0.6)
    drive.told_speed[:] = 10.0
    assert withheld(drive.vetted(sensors)) == {SPEED}
    drive.told_speed[:] = np.round(drive.speed)
    assert withheld(drive.vetted(sensors)) == set()


@pytest.mark.parametrize("columns", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_turns_that_are_always_0_are_withheld_in_the_first_bend(columns: bool, seed: int):
    drive = Drive(seed, seconds=180)
    drive.columns = columns
    drive.turn[:] = 0.0
    vetting = drive.vetted()
    assert vetting.since[TURN] < BEGIN + 20.0
    assert mode_of(vetting, WHEELS) == DISTANCE
    assert "odometry: no turns" in names(vetting)


@pytest.mark.parametrize("factor", [3.0, 0.3])
def test_distances_that_have_never_agreed_with_the_fixes_are_withheld(factor: float):
    """No speed of the receiver is there to decide; what had agreed before is not withheld."""
    drive = Drive()
    drive.columns = False
    drive.odometer *= factor
    vetting = drive.vetted()
    assert vetting.since[ARC] < BEGIN + 20.0
    assert names(vetting) == ["odometry: distance"]
    drive.odometer[:AT] /= factor
    assert withheld(drive.vetted()) == set()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("every", [10, 20])
def test_sound_odometry_beside_sparse_fixes_is_believed(every: int, seed: int):
    drive = Drive(seed, seconds=600)
    drive.every = every
    vetting = drive.vetted()
    assert withheld(vetting) == set()
    assert vetting.compared == 1
    assert names(vetting) == []


@pytest.mark.parametrize("every", [10, 30])
def test_counters_that_stand_are_withheld_after_three_sparse_fixes(every: int):
    drive = Drive(seconds=300)
    drive.every = every
    drive.odometer[:] = drive.turn[:] = 0.0
    vetting = drive.vetted()
    assert vetting.since[ARC] <= BEGIN + 3.0 * every
    assert mode_of(vetting, WHEELS) == CLOCK
    assert names(vetting) == ["odometry: stands still"]


def test_loops_between_fixes_a_minute_apart_cost_the_odometry_nothing():
    """It drives 700 m in each minute, and is 100 m from where it was."""
    drive = Drive(seconds=480)
    drive.columns, drive.every = False, 60
    drive.fix = np.column_stack([drive.time / 60.0 * 100.0, np.zeros(len(drive.time))])
    assert withheld(drive.vetted()) == set()


def test_sparse_fixes_that_are_far_away_cost_a_standing_vehicle_nothing():
    drive = Drive(seconds=300, speed=0.0)
    drive.every = 10
    for far in (8, 10, 15):
        drive.fix[far * 10 * RATE] += 300.0
    assert withheld(drive.vetted()) == set()


@pytest.mark.parametrize("factor", [-1.0, 0.0])
def test_turns_that_are_wrong_are_withheld_beside_sparse_fixes(factor: float):
    drive = Drive(seconds=600)
    drive.every = 10
    drive.turn *= factor
    assert mode_of(drive.vetted(), WHEELS) == DISTANCE


@pytest.mark.parametrize("sensors", [WHEELS, CLOCK])
def test_a_reversed_course_is_named(sensors: int):
    drive = Drive()
    drive.course += np.pi
    vetting = drive.vetted(sensors)
    assert withheld(vetting) == {COURSE}
    (finding,) = sensor_findings(vetting)
    assert "180 degrees off" in finding.advice or "179 degrees off" in finding.advice


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_rounds_of_a_small_roundabout_cost_a_speed_nothing(seed: int):
    """Five times round within 30 s, at 7 m/s: the chord over some seconds says little."""
    drive = Drive(seed)
    round_ = slice(AT, AT + 30 * RATE)
    drive.speed[round_], drive.rate[round_] = 7.0, 1.05
    drive.measure(np.random.default_rng(seed))
    for vetting in drive.while_vetted(CLOCK):
        assert withheld(vetting) == set()


@pytest.mark.parametrize("every", [3, 4, 6])
@pytest.mark.parametrize("sensors", [CLOCK, WHEELS])
def test_a_single_wrong_fix_of_few_costs_speeds_and_courses_nothing(every: int, sensors: int):
    """The way there and the way back are as far off as the fix."""
    for off in (60.0, 150.0, -300.0):
        drive = Drive()
        drive.every = every
        drive.fix[AT] += off, 0.5 * off
        for vetting in drive.while_vetted(sensors):
            assert withheld(vetting) == set()


@pytest.mark.parametrize("every", [3, 4, 6])
def test_a_reversed_course_is_withheld_after_three_sparse_legs(every: int):
    drive = Drive()
    drive.every = every
    drive.course[AT:] += np.pi
    refused = [bool(vetting.refused[COURSE]) for vetting in drive.while_vetted(CLOCK)]
    assert not any(refused[:AT])
    assert refused[AT + 3 * every * RATE]


def test_a_course_that_never_changes_is_withheld():
    drive = Drive()
    drive.course[:] = np.pi / 2.0
    assert withheld(drive.vetted()) == {COURSE}


def test_courses_that_turn_with_the_fixes_are_borne_out():
    assert is_borne_out(Drive().vetted())


@pytest.mark.parametrize("factor", [0.0, np.pi / 180.0])
def test_a_course_that_fits_only_where_the_drive_begins_is_never_used(factor: float):
    """Always 0, or taken for radians of degrees: the drive begins in its direction."""
    drive = Drive()
    drive.course *= factor
    for k, vetting in enumerate(drive.while_vetted()):
        if k > 4 * RATE:
            assert vetting.windows.count > 1
            assert not is_borne_out(vetting)


def test_courses_of_fixes_too_sparse_to_be_compared_are_used():
    drive = Drive()
    drive.time *= 20.0  # a fix every 20 s
    assert is_borne_out(drive.vetted(CLOCK))


def test_one_impossible_speed_is_passed_over():
    drive = Drive()
    drive.told_speed[AT] = 171.0
    vetting = drive.vetted(CLOCK)
    assert withheld(vetting) == set()
    assert vetting.windows.speed == pytest.approx(12.0, abs=1.0)


@pytest.mark.parametrize("every", [1, 5])
@pytest.mark.parametrize("seed", range(3))
def test_coarse_fixes_cost_the_odometry_nothing(seed: int, every: int):
    """Their sigma of 40 m is told, and true."""
    drive = Drive(seed)
    drive.columns, drive.every, drive.sigma = False, every, 40.0
    random = np.random.default_rng(seed)
    drive.fix = np.column_stack([drive.x, drive.y]) + random.normal(0.0, 40.0, drive.fix.shape)
    vetting = drive.vetted()
    assert withheld(vetting) == set()
    assert vetting.seconds.sum() == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_who_drives_back_where_it_came_from_turns_as_its_odometry_does(seed: int):
    """Backwards, or having turned on the spot: neither turn has a sign."""
    drive = Drive(seed)
    drive.columns = False
    back = slice(AT, None)
    drive.odometer[back] *= -1.0
    drive.turn[:] = 0.0
    straight = np.cumsum(drive.odometer) / RATE
    drive.fix = np.column_stack([straight, np.zeros(len(straight))])
    drive.fix += np.random.default_rng(seed).normal(0.0, 0.7, drive.fix.shape)
    assert TURN not in withheld(drive.vetted())


def test_a_receiver_that_jumps_costs_the_odometry_nothing():
    drive = Drive()
    drive.columns = False
    drive.fix[AT:] += [60.0, -40.0]
    vetting = drive.vetted()
    assert withheld(vetting) == set()
    assert vetting.windows.jumped_at == BEGIN + 60.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rounds", [1, 2])
def test_a_loop_without_fixes_before_a_stand_costs_the_odometry_nothing(seed: int, rounds: int):
    """The vehicle stands where its fixes were lost; its odometer has counted the way between."""
    drive = Drive(seed, seconds=180)
    gap = slice(AT, AT + 70 * RATE)
    drive.seen[gap] = False
    drive.speed *= np.interp(drive.time, [125.0, 129.0], [1.0, 0.0])
    way = drive.speed[gap].sum() / RATE
    drive.rate[gap.start :] = rounds * 2.0 * np.pi * drive.speed[gap.start :] / way
    drive.measure(np.random.default_rng(seed))
    vetting = drive.vetted()
    assert withheld(vetting) == set()
    assert vetting.seconds.sum() == 0.0


def test_a_distance_that_was_right_on_the_whole_is_not_named_by_its_ratio():
    [vetting] = quick(new_belief().state.vetting)
    vetting.seconds[ARC], vetting.since[ARC] = 26.0, BEGIN
    vetting.reported[ARC], vetting.seen[ARC] = 98.0, 100.0
    [finding] = sensor_findings(vetting)
    assert finding.what == "odometry: distance"
    assert not finding.low <= finding.statistic <= finding.high
    assert "metres_per_tick" not in finding.advice


def test_fixes_that_wander_about_a_standing_car_cost_the_odometry_nothing():
    drive = Drive()
    drive.columns = False
    drive.odometer[AT:] = drive.turn[AT:] = 0.0
    drive.odometer[AT - 16 : AT] *= np.linspace(1.0, 0.0, 16)
    still = drive.fix[AT].copy()
    drift = np.linspace(0.0, 60.0, len(drive.time) - AT)
    drive.fix[AT:] = still + np.column_stack([drift, 0.3 * drift])
    assert withheld(drive.vetted()) == set()


def test_odometry_that_is_silent_no_longer_moves_the_vehicle():
    drive = Drive()
    drive.valid[-10:] = False
    assert mode_of(drive.vetted(), WHEELS) == CLOCK


def of_wheels(speed: float, rate: float, seconds: float) -> Record:
    """What is kept of a car of some speed that turns at a rate from 5 s on."""
    [vetting] = quick(new_belief().state.vetting)
    epochs = quick(new_epochs(round(10.0 * (5.0 + seconds))))
    for k in range(len(epochs)):
        epoch = epochs[k]
        turn = rate if k >= 50 else 0.0
        epoch.time, epoch.arc, epoch.turn = BEGIN + 0.1 * k, 0.1 * speed, 0.1 * turn
        epoch.forward, epoch.left = arc_chord(epoch.arc, epoch.turn)
        epoch.odometry_valid = 1
        epoch.speed_sigma = epoch.course_sigma = np.inf
        vet(vetting, epoch, 0.1 if k else 0.0, WHEELS, 1.0)
    return vetting


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("speed", [0.8, 1.25, 1.4])
def test_a_slow_vehicle_does_not_circle_about_a_counter_that_stands(speed: float, side: float):
    """What can turn on the spot turns about a wheel by half a turn, not on and on."""
    rate = side * speed / 0.75  # about a wheel 0.75 m beside the middle
    half = of_wheels(speed, rate, math.pi / abs(rate))
    assert half.impossible_at == -math.inf
    on = of_wheels(speed, rate, 10.0)
    assert on.impossible_at == pytest.approx(BEGIN + 14.9, abs=0.5)
    assert not is_possible(on)


def test_odometry_that_is_not_believed_raises_no_doubt():
    """A dead counter does what no car can do all the time, and moves nothing meanwhile."""
    vetting = of_wheels(14.0, 4.0, 8.0)
    assert vetting.impossible_at > BEGIN + 12.0
    assert vetting.suspect_at < BEGIN + 7.0
