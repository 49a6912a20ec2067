"""Odometry that only counts up: who backs up is told from who drives on."""

import math
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.manoeuvres import How, one
from benchmarks.manoeuvres.cases import SCENES

from scenes import Truth, epochs_of, gnss, localize, network, straight_road
from whichroad._compile import Records
from whichroad.filter.hypotheses.no_sign import mirrored
from whichroad.filter.motion import Increment, arc_chord
from whichroad.filter.state import DISTANCE, WHEELS, new_epochs
from whichroad.filter.vetting.windows import BY_GYRO, BY_WHEELS

ROADS = network(straight_road(3000.0))


def along(*ways: float, rest: float = 4.0) -> Truth:
    """Legs of so many metres (negative: backwards) along a straight road, 10 epochs a second."""
    speeds: list[np.ndarray] = [np.zeros(round(10 * rest))]
    for way in ways:
        top = 10.0 if way > 0.0 else 2.0
        ramp = np.arange(1, 21) / 20.0
        cruise = max(round(10 * (abs(way) / top - 2.0)), 1)
        one_way = top * np.concatenate(
            [ramp, np.ones(cruise), ramp[::-1], np.zeros(round(10 * rest))]
        )
        speeds.append(math.copysign(1.0, way) * one_way)
    moved = 0.1 * np.concatenate(speeds)
    x = 500.0 + np.cumsum(moved)
    n = len(x)
    return Truth(0.1 * np.arange(n), x, np.full(n, -1.75), np.zeros(n), np.cumsum(np.abs(moved)))


def counted_up(truth: Truth) -> Records:
    """Wheels without a sign, and a fix every second."""
    at = np.arange(0, len(truth.time), 10)
    epochs = epochs_of(truth, gnss(truth, sigma=2.0, seed=1), at)
    epochs.forward = epochs.arc
    return epochs


def wrong_by(rows: Records, truth: Truth) -> np.ndarray:
    return np.hypot(rows.x - truth.x, rows.y - truth.y)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
def test_who_backs_up_is_where_fixes_say_and_within_the_level(mode: int):
    truth = along(400.0, -40.0, 200.0)
    rows = localize(ROADS, counted_up(truth), mode=mode).output.rows
    late = truth.time > 20.0
    assert (wrong_by(rows, truth) < rows.protection_level)[late].all()
    assert wrong_by(rows, truth)[late].max() < 12.0  # 80 m, when it counted as driving on
    assert (rows.edge[late] == rows.edge[200]).all()


@pytest.mark.parametrize(
    ("rate", "step", "speed", "mode"),
    [
        (50, 0.045, 1.0, WHEELS),
        (50, 0.045, 1.0, DISTANCE),
        (10, 1.0, 2.0, DISTANCE),
        (1, 0.0, 2.0, WHEELS),
        (1, 0.0, 2.0, DISTANCE),
    ],
)
def test_at_any_rate_and_by_coarse_counters(rate: int, step: float, speed: float, mode: int):
    rest, ramp = np.zeros(4 * rate), np.arange(1, 2 * rate + 1) / (2 * rate)
    legs = [rest]
    for way, top in ((400.0, 10.0), (-40.0, speed), (200.0, 10.0)):
        even = np.ones(round(rate * (abs(way) / top - 2.0)))
        legs += [math.copysign(top, way) * np.concatenate([ramp, even, ramp[::-1]]), rest]
    moved = np.concatenate(legs) / rate
    x, n = 500.0 + np.cumsum(moved), len(moved)
    way = np.cumsum(np.abs(moved))
    truth = Truth(np.arange(n) / rate, x, np.full(n, -1.75), np.zeros(n), way)
    epochs = epochs_of(truth, gnss(truth, sigma=2.0, seed=1), np.arange(0, n, rate))
    if step:
        epochs.arc = np.diff(np.floor(way / step) * step, prepend=0.0)
    epochs.forward = epochs.arc
    rows = localize(ROADS, epochs, mode=mode).output.rows
    late = truth.time > 20.0
    assert (wrong_by(rows, truth) < rows.protection_level)[late].all()
    assert wrong_by(rows, truth)[late].max() < 20.0  # 80 m, when it counted as driving on


def test_its_speed_is_negative_meanwhile():
    truth = along(400.0, -40.0, 200.0)
    rows = localize(ROADS, counted_up(truth)).output.rows
    backs = np.diff(truth.x, prepend=truth.x[0]) < -0.15
    assert np.mean(rows.speed[backs] < 0.0) > 0.7
    onwards = np.diff(truth.x, prepend=truth.x[0]) > 0.3
    assert (rows.speed[onwards] > 0.0).all()


def test_with_hindsight_too():
    truth = along(400.0, -40.0, 200.0)
    rows = localize(ROADS, counted_up(truth), lag="full").output.rows
    late = truth.time > 20.0
    assert (wrong_by(rows, truth) < rows.protection_level)[late].all()


def test_odometry_with_a_sign_has_one_from_the_first_time_that_it_counts_down():
    truth = along(400.0, -40.0, 200.0, -40.0, 200.0)
    epochs = counted_up(truth)
    signed = epochs.copy()
    signed.arc = signed.forward = np.diff(truth.x, prepend=truth.x[0])
    rows = localize(ROADS, signed).output.rows
    assert wrong_by(rows, truth)[200:].max() < 8.0
    assert rows.live[600:].max() < localize(ROADS, epochs).output.rows.live[600:].max()


def test_who_starts_forwards_without_fixes_is_not_thought_to_back_up():
    truth = along(400.0, 300.0, 300.0)
    epochs = counted_up(truth)
    epochs.has_fix[np.flatnonzero(truth.time > 40.0)] = 0
    rows = localize(ROADS, epochs).output.rows
    assert (rows.speed >= 0.0).all()
    assert rows.protection_level[-1] < 60.0


def test_who_rolls_on_slowly_and_never_stands_is_not_put_where_it_began():
    ramp = np.linspace(10.0, 0.15, 50)
    speed = np.concatenate([np.full(600, 10.0), ramp, np.full(40, 0.15), ramp[::-1]])
    x = 500.0 + np.cumsum(0.1 * speed)
    n = len(x)
    truth = Truth(0.1 * np.arange(n), x, np.full(n, -1.75), np.zeros(n), x - x[0])
    rows = localize(ROADS, counted_up(truth)).output.rows
    assert wrong_by(rows, truth)[200:].max() < 10.0
    assert (rows.cov[200:, 0] + rows.cov[200:, 3]).max() < 60.0


@pytest.mark.parametrize("by", [BY_WHEELS, BY_GYRO])
def test_mirrored_is_the_way_of_the_tail(by: int):
    """2 m of arc while the vehicle turns to the left by 0.3 rad, backwards."""
    epoch = new_epochs(1)[0]
    epoch.gyro = by
    counted = -0.3 if by == BY_WHEELS else 0.3  # as both wheels count up
    found = mirrored(Increment(2.0, counted, *arc_chord(2.0, counted), 2.0), epoch)
    assert (found.arc, found.turn) == (-2.0, pytest.approx(0.3))
    assert (found.forward, found.left) == pytest.approx(arc_chord(-2.0, 0.3))


@pytest.mark.parametrize(
    ("what", "suite"),
    [
        ("80 m", "wheels without a sign"),
        ("80 m", "yaw, speed without a sign"),
        ("80 m", "odometer and Doppler"),
        ("out of a drive", "yaw, speed without a sign"),
        ("out of a drive", "odometer"),
        ("three points", "yaw, speed without a sign"),
    ],
)
def test_manoeuvres_on_odometry_without_a_sign_are_answered_as_with_one(what: str, suite: str):
    case = next(c for c in SCENES["no sign"] if c.what == what)
    found = one("no sign", replace(case), suite, 1208, How())
    assert found.declared > 400
    assert found.wrong == found.pose.exceeded == 0
