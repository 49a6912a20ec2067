"""Odometry that reads 0 below a speed: found by its readings, and not where it reads down to 0."""

import json
from dataclasses import replace
from itertools import pairwise

import geopandas
import numpy as np
import pytest
from shapely import LineString

from whichroad import Localizer, RoadMap
from whichroad.observations import Odometer, WheelCounts, WheelSpeed, WheelSpeeds, WheelTicks
from whichroad.online.least_speed import heed_least_speed
from whichroad.sensors.dead_band import DeadBand, below, whole_dead_band
from whichroad.settings import Vehicle

FINE = 0.01  # s


def straight() -> RoadMap:
    """A road of a kilometre."""
    road = geopandas.GeoDataFrame(geometry=[LineString([(8.70, 49.4), (8.71, 49.4)])], crs=4326)
    return RoadMap.from_edges(road)


KMH = 1.0 / 3.6
CAR = Vehicle(metres_per_tick_left=0.1, metres_per_tick_right=0.1)


def drive(brakes: float, seed: int, stops: int = 10) -> np.ndarray:
    """Speeds every 10 ms of a drive with stops, m/s."""
    rng = np.random.default_rng(seed)
    parts = [np.zeros(200)]
    for _ in range(stops):
        up, down = brakes * rng.uniform(0.6, 1.2), brakes * rng.uniform(0.6, 1.6)
        top = rng.uniform(4.0, 15.0)
        parts += [np.arange(0.0, top, up * FINE), np.full(300, top)]
        parts += [np.arange(top, 0.0, -down * FINE), np.zeros(rng.integers(150, 1500))]
    return np.concatenate(parts)


def speeds(true: np.ndarray, hz: int, step: float = 0.0) -> WheelSpeeds:
    read = true[:: round(1.0 / hz / FINE)]
    read = np.round(read / step) * step if step else read
    return WheelSpeeds(np.arange(len(read)) / hz, read, read)


def counts(true: np.ndarray, hz: int, tick: float) -> Odometer:
    way = np.floor(np.cumsum(true) * FINE / tick)[:: round(1.0 / hz / FINE)] * tick
    return Odometer(np.arange(len(way)) / hz, way)


def found_in(log: Odometer) -> float:
    return whole_dead_band(log, (log.time, log.distance), 0.0)


def told_by_speeds(true: np.ndarray, hz: int, step: float = 0.0) -> float:
    log = speeds(true, hz, step)
    return whole_dead_band(log, (log.time, np.cumsum(log.left) / hz), 0.0)


@pytest.mark.parametrize("hz", [5, 10, 20, 50])
@pytest.mark.parametrize("band", [2.0 * KMH, 3.0 * KMH])
@pytest.mark.parametrize("step", [0.0, 0.0625 * KMH])
def test_it_is_found_by_speeds(hz: int, band: float, step: float):
    true = drive(1.5, 1)
    found = told_by_speeds(np.where(true < band, 0.0, true), hz, step)
    assert band - 0.05 <= found <= band + 0.2


@pytest.mark.parametrize("hz", [10, 20])
def test_it_is_found_by_fine_counters(hz: int):
    true = drive(1.5, 2)
    log = counts(np.where(true < 3.0 * KMH, 0.0, true), hz, 0.01)
    assert 3.0 * KMH - 0.05 <= found_in(log) <= 3.0 * KMH + 0.3


@pytest.mark.parametrize("hz", [1, 2, 5, 10, 20, 50])
@pytest.mark.parametrize("brakes", [0.8, 2.0, 4.0])
def test_sensors_that_read_down_to_0_have_none(hz: int, brakes: float):
    for seed in range(4):
        true = drive(brakes, seed)
        for step in (0.0, 0.1, KMH, 0.447, 1.0):
            assert told_by_speeds(true, hz, step) == 0.0
        for tick in (0.005, 0.02, 0.04, 0.1, 0.5):
            assert found_in(counts(true, hz, tick)) == 0.0


@pytest.mark.parametrize("jitter", [0.0, 0.01])  # s
@pytest.mark.parametrize("tick", [0.05, 0.1])
@pytest.mark.parametrize("hz", [10, 20])
def test_counters_in_steps_have_none_by_seconds_since_1970(hz: int, tick: float, jitter: float):
    """Seconds since 1970 are rounded, and may jitter: steps over them differ, ways do not."""
    rng = np.random.default_rng(7)
    for seed in range(4):
        log = counts(drive(1.5, seed), hz, tick)
        late = np.sort(log.time + rng.uniform(0.0, jitter, len(log.time)))
        assert found_in(Odometer(1780300800.0 + late, log.distance)) == 0.0


def test_fine_counters_show_it_by_seconds_since_1970():
    log = counts(np.where((true := drive(1.5, 2)) < 3.0 * KMH, 0.0, true), 10, 0.01)
    assert 3.0 * KMH - 0.05 <= found_in(Odometer(1780300800.0 + log.time, log.distance)) <= 1.14


def test_cut_and_seldom_speeds_have_none():
    true = drive(1.5, 3)
    assert told_by_speeds(np.floor(true / KMH) * KMH, 10) == 0.0
    assert told_by_speeds(np.where(true < 2.0 * KMH, 0.0, true), 2) == 0.0


def test_a_slower_reading_disproves_it():
    band = DeadBand()
    true = drive(1.5, 4)
    read = np.where(true < 2.0 * KMH, 0.0, true)[::5]
    for k, speed in enumerate(read.tolist()):
        band.watch(0.05 * k, speed, False)
    assert band.found > 0.0
    band.watch(0.05 * len(read), 0.1, False)
    assert band.found == 0.0


def test_on_line_it_is_found_as_in_a_recording_and_kept():
    true = drive(1.5, 5)
    log = speeds(np.where(true < 2.0 * KMH, 0.0, true), 20)
    band, after, before = DeadBand(), [], None
    for k, (t, v) in enumerate(zip(log.time.tolist(), log.left.tolist(), strict=True)):
        reading = WheelSpeed(t, v, v)
        if before is not None:
            arc = 0.025 * (v + before.left)
            after.append((v == 0.0 and before.left == 0.0, band.take(before, reading, arc)))
        if k == len(log.time) // 2:
            kept = json.loads(json.dumps(band.kept()))
            band = DeadBand()
            band.restore(kept)
        before = reading
    assert band.found == whole_dead_band(log, (log.time, np.cumsum(log.left) / 20.0), 0.0)
    zeros, creeps = np.array(after).T
    assert (creeps[len(creeps) // 2 :] == zeros[len(zeros) // 2 :]).all()
    assert not creeps[:100].any()


def test_who_has_read_a_slow_speed_is_asked_no_more():
    """The search is over then: most sensors read down to 0."""
    band, true = DeadBand(), drive(1.5, 6)
    log = speeds(true, 20)
    readings = [
        WheelSpeed(t, v, v) for t, v in zip(log.time.tolist(), log.left.tolist(), strict=True)
    ]
    taken = []
    for before, after in pairwise(readings):
        assert not band.take(before, after, 0.025 * (before.left + after.left))
        taken.append(band.kept())
    first = int(np.flatnonzero((log.left[1:] > 0.0) & (log.left[1:] < 0.4))[0])
    assert taken[first] == taken[-1]


def test_pauses_between_ticks_are_no_zeros():
    """At 0.6 m/s a tick of 0.1 m comes every 0.17 s: readings between tell no standstill."""
    time = np.arange(0.0, 20.0, 0.05)
    way = np.floor(0.6 * np.minimum(time, 10.0) / 0.1) * 0.1
    creeps = below(time, way, 2.0 * KMH, True)
    drives = (time > 0.3) & (time < 10.0)
    assert not creeps[drives].any()
    assert creeps[time > 10.6].all()
    band, told = DeadBand(2.0 * KMH), []
    ticks = [WheelTicks(t, n, n) for t, n in zip(time.tolist(), (way / 0.1).tolist(), strict=True)]
    for a, b in pairwise(ticks):
        told.append(band.take(a, b, 0.1 * (b.left - a.left)))
    assert not np.array(told)[drives[1:]].any()
    assert np.array(told)[time[1:] > 10.6].all()


def test_what_the_vehicle_tells_holds():
    log = WheelCounts(np.arange(3.0), np.zeros(3), np.zeros(3))
    assert whole_dead_band(log, (log.time, np.zeros(3)), 0.7) == 0.7


@pytest.mark.parametrize("seed", range(20))
def test_speeds_that_are_read_again_and_again_are_no_sign(seed: int):
    """A sensor that measures once a second, read at 20 Hz, seldom shows a slow speed."""
    true = drive(3.0, seed, stops=6)
    held = np.repeat(true[::100], 100)[: len(true)]
    assert told_by_speeds(held, 20) == 0.0


def test_another_vehicle_holds_for_a_state_and_a_speed_that_is_withdrawn_moves_nothing():
    localizer = Localizer(straight(), vehicle=CAR)
    localizer.update(WheelTicks(0.0, 0, 0))
    data = localizer.to_bytes()
    again = Localizer.from_bytes(data, straight(), vehicle=replace(CAR, least_speed=0.6))
    slow = again._filter.belief.state[0].vetting.slow
    assert slow.least == 0.6
    back = Localizer.from_bytes(again.to_bytes(), straight(), vehicle=CAR)
    assert back._filter.belief.state[0].vetting.slow.least == 0.0
    tables = again._filter.tables()
    again._band.told = 0.0
    heed_least_speed(again._filter, again._band.least, 0.6)
    slow.least = 0.6
    for before, after in zip(tables, again._filter.tables(), strict=True):
        assert np.asarray(before).tobytes() == np.asarray(after).tobytes()
