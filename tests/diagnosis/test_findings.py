"""Settings that do not fit the data are found out and named; those that fit are left in peace."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import whichroad
from whichroad.diagnosis.finding import Finding
from whichroad.diagnosis.findings import _chance, findings
from whichroad.diagnosis.sensors import sensor_findings
from whichroad.diagnosis.statistics import ConsistencyStatistics, Row
from whichroad.filter.state import new_belief
from whichroad.filter.vetting.windows import BY_GYRO, BY_WHEELS
from whichroad.observations import (
    Array,
    Drive,
    WheelCounts,
    WheelTicks,
    WithGyro,
    YawRates,
)
from whichroad.online import Localizer
from whichroad.readers.reported_fixes import as_records
from whichroad.settings import Settings, Vehicle
from whichroad.simulate import SimulationSettings, draw_town, simulate_drive

FITS = Settings()
CAR = Vehicle()
SECONDS = 9000


def gauss_markov(random: np.random.Generator, n: int, sigma: float, time: float) -> Array:
    """Two axes of an error that lasts, once a second, (n, 2)."""
    keep = math.exp(-1.0 / time)
    noise = random.normal(0.0, sigma * math.sqrt(1.0 - keep * keep), (n, 2))
    out = np.empty((n, 2))
    out[0] = random.normal(0.0, sigma, 2)
    for k in range(1, n):
        out[k] = keep * out[k - 1] + noise[k]
    return out


def drive(
    seed: int, *, sigma: float = 1.0, time: float = FITS.gnss_time, seconds: int = SECONDS,
    learnt: float | None = None, scale: float = 1.0, gain: float = 1.0, drift: float = 0.0,
    map_error: float = 2.0, rate: int = 1, late: float = 0.0, antenna: complex = 0j,
) -> Array:  # fmt: skip
    """Rows of a drive at 5 to 15 m/s through bends, wheels and the filter being exact.

    GNSS errors are `sigma` times what is reported and last `time`; the filter corrects the
    odometer by `scale`, its turns by `gain` and `drift` (rad/m).  Fixes are `late` (s), their
    `antenna` elsewhere (m ahead + i left).
    """
    random = np.random.default_rng(seed)
    n = rate * seconds
    when = np.arange(n) / rate
    heading = 1.5 * np.sin(when / 20.0)
    swing = np.diff(heading, prepend=heading[0])
    speed = 10.0 + 5.0 * np.sin(when / 13.0)
    arc = speed / rate / scale
    middle = heading - 0.5 * swing
    x = np.cumsum(speed / rate * np.cos(middle))
    y = np.cumsum(speed / rate * np.sin(middle))
    errors = np.repeat(gauss_markov(random, seconds, 3.0 * sigma, time), rate, axis=0)
    errors += random.normal(0.0, 3.0 * sigma * FITS.gnss_white_ratio, errors.shape)
    aside = antenna * np.exp(1j * heading) - late * speed * np.exp(1j * heading)
    row = Row(
        time=when, arc=arc, turn=(swing - drift * arc) / gain, speed=speed,
        heading=heading, scale=np.full(n, sigma if learnt is None else learnt), x=x, y=y,
        map_x=x + map_error, map_y=y - map_error, has_fix=np.arange(n) % rate == 0,
        fix_x=x + errors[:, 0] + aside.real, fix_y=y + errors[:, 1] + aside.imag,
        major=np.full(n, 3.0), minor=np.full(n, 3.0),
    )  # fmt: skip
    return np.column_stack(row)


def found(rows: Array, settings: Settings = FITS) -> dict[str, Finding]:
    """The findings by name."""
    statistics = ConsistencyStatistics(settings, CAR)
    statistics.take(rows)
    return {f.what: f for f in findings(statistics)}


@pytest.mark.parametrize("seed", range(10))
def test_settings_that_fit_are_left_in_peace(seed: int):
    assert found(drive(seed)) == {}


@pytest.mark.parametrize("seed", range(5))
def test_errors_larger_than_reported_are_named(seed: int):
    named = found(drive(seed, sigma=1.5))
    assert set(named) == {"gnss sigma"}
    assert named["gnss sigma"].level == "warning"
    assert named["gnss sigma"].statistic == pytest.approx(1.5, rel=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_grow_with_the_time_between_fixes_alone_may_be_the_wheels(seed: int):
    rows = drive(seed, learnt=1.5)
    more = gauss_markov(np.random.default_rng(100 + seed), SECONDS, 4.5, FITS.gnss_time)
    rows[:, [Row._fields.index(name) for name in ("fix_x", "fix_y")]] += more
    named = found(rows)
    assert set(named) == {"gnss sigma"}
    assert "either the wheels' heading drifts" in named["gnss sigma"].advice
    assert "less than gnss_time, and are as large as reported" in named["gnss sigma"].advice
    assert "wheels" not in found(drive(seed, sigma=1.5))["gnss sigma"].advice


def test_a_gyro_s_scale_is_named_beside_its_offset_and_a_track_width_with_what_to_set():
    vetting = new_belief().state[0].vetting
    vetting.wheel_size.scale.factor = vetting.wheel_size.scale.rate = 1.0
    vetting.turn_size.scale.factor = 1.37
    said = {}
    for steered in (BY_GYRO, BY_WHEELS):
        vetting.steered = steered
        said |= {one.what: one.advice for one in sensor_findings(vetting)}
    assert set(said) == {"gyro: scale", "wheels: track width"}
    assert "its offset has jumped" in said["gyro: scale"]
    assert "correct" not in said["gyro: scale"]
    assert "divide track_width by 1.370" in said["wheels: track width"]


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_last_longer_than_set_are_named_with_the_time_that_they_last(seed: int):
    named = found(drive(seed, time=3.0 * FITS.gnss_time))
    assert set(named) == {"gnss_time"}
    assert 1.7 < named["gnss_time"].statistic / FITS.gnss_time < 5.5


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_are_both_larger_and_slower_are_named_as_both(seed: int):
    named = found(drive(seed, sigma=1.5, time=3.0 * FITS.gnss_time))
    assert set(named) == {"gnss sigma", "gnss_time"}


def test_what_the_advice_sets_is_then_at_peace():
    rows = drive(3, time=3.0 * FITS.gnss_time)
    right = found(rows)["gnss_time"].statistic
    assert found(rows, replace(FITS, gnss_time=right)) == {}


@pytest.mark.parametrize("seed", range(3))
def test_errors_smaller_than_reported_are_an_information_only(seed: int):
    named = found(drive(seed, sigma=0.5, learnt=1.0))
    assert set(named) == {"gnss sigma"}
    assert named["gnss sigma"].level == "information"


def test_a_false_fix_now_and_then_is_not_the_sigma_s_fault():
    rows = drive(1)
    rows[np.arange(500, len(rows), 900), Row._fields.index("fix_x")] += 200.0
    assert found(rows) == {}


def test_a_false_odometer_is_named_and_nothing_is_said_of_fixes_judged_by_it():
    named = found(drive(1, scale=0.92, sigma=1.5))
    assert set(named) == {"wheels: scale"}
    assert named["wheels: scale"].statistic == pytest.approx(0.92, abs=1e-6)


def test_a_false_track_width_is_named_with_the_right_one():
    named = found(drive(1, gain=0.9))
    assert set(named) == {"wheels: track width"}
    assert f"{CAR.track_width / 0.9:.2f} m" in named["wheels: track width"].advice


def test_wheels_that_pull_aside_are_named():
    assert set(found(drive(1, drift=2e-3))) == {"wheels: left against right"}


@pytest.mark.parametrize("late", [-0.6, 0.4])
def test_clocks_that_do_not_agree_are_named_with_the_difference(late: float):
    named = found(drive(1, late=late, sigma=1.5))
    assert set(named) == {"clock"}
    assert named["clock"].statistic == pytest.approx(late, abs=0.1)
    assert f"add {-late:.1f} s" in named["clock"].advice


def test_an_antenna_that_is_elsewhere_is_named_with_its_place():
    named = found(drive(1, antenna=3.0 - 1.0j))
    assert set(named) == {"antenna"}
    assert named["antenna"].statistic == pytest.approx(math.hypot(3.0, 1.0), abs=0.5)
    assert re.search(r"m ahead and [\d.]+ m to the right of the middle", named["antenna"].advice)
    car = Vehicle(antenna_forward=3.0, antenna_left=-1.0)
    statistics = ConsistencyStatistics(FITS, car)
    statistics.take(drive(1, antenna=3.0 - 1.0j))
    assert findings(statistics) == ()


def fine(seed: int, antenna: complex, **more: float) -> Array:
    """A drive with a receiver that reports 3 cm."""
    rows = drive(seed, sigma=0.01, learnt=1.0, map_error=0.1, antenna=antenna, **more)
    rows[:, [Row._fields.index(name) for name in ("major", "minor")]] = 0.03
    return rows


@pytest.mark.parametrize("antenna", [0.6j, -0.6j, 0.7 + 0j, -0.7 + 0j, 0.4 - 0.4j])
def test_of_a_receiver_of_centimetres_some_decimetres_are_named(antenna: complex):
    named = found(fine(1, antenna))
    assert set(named) == {"antenna"}
    assert named["antenna"].statistic == pytest.approx(abs(antenna), abs=0.05)
    assert "what you measure" in named["antenna"].advice


@pytest.mark.parametrize("antenna", [0j, 0.3j, 0.45 + 0j, -0.45 + 0j])
def test_of_a_receiver_of_centimetres_an_antenna_about_right_is_not_named(antenna: complex):
    assert "antenna" not in found(fine(1, antenna))
    assert "antenna" not in found(drive(1, antenna=antenna))


def test_what_the_antenna_explains_is_no_reason_to_doubt_its_place():
    errors = gauss_markov(np.random.default_rng(3), SECONDS, 0.2, 20.0)
    sigmas = []
    for antenna in (0j, 0.7 + 0j):
        rows = fine(1, antenna)
        rows[:, [Row._fields.index(name) for name in ("fix_x", "fix_y")]] += errors
        statistics = ConsistencyStatistics(FITS, CAR)
        statistics.take(rows)
        sigmas.append(statistics.shift().sigma_antenna)
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.1)


def test_fixes_judge_no_antenna_where_nothing_else_measures_turns():
    """A heading that follows the fixes is late in turns, as if the antenna were ahead."""
    rows = drive(1, sigma=3.0, antenna=15.0 + 0.0j)
    rows[:, Row._fields.index("turn")] = 0.0
    assert found(rows) == {}


RTK = SimulationSettings(
    gnss_bias_low=0.015, gnss_bias_high=0.015, gnss_white=0.01, gnss_reported=0.02
)  # m
UNTOLD = "antenna: not told"


@pytest.mark.parametrize("antenna", [0.0, 1.0])
@pytest.mark.parametrize("sigma", [0.02, 2.7])
def test_exact_fixes_without_an_antenna_are_worth_a_note_where_there_is_odometry(
    town, sigma: float, antenna: float
):
    roads, _ = town
    settings = replace(RTK, antenna_forward=antenna)
    drive = simulate_drive(roads, seed=5, length_m=2000.0, scenario=settings).drive
    square = np.full(len(drive.fixes), sigma**2)
    fixes = replace(drive.fixes, cov_ee=square, cov_nn=square, cov_en=0.0 * square)
    drive, car = replace(drive, fixes=fixes), Vehicle(antenna_forward=antenna)
    notes = [UNTOLD] if sigma < 0.1 and not antenna else []
    localizer = whichroad.Localizer(roads, vehicle=car)
    log = drive.odometry
    wheels = [WheelTicks(*row) for row in zip(log.time, log.left, log.right, strict=True)]
    for one in sorted([*as_records(fixes), *wheels], key=lambda each: each.time):
        localizer.update(one)
    for found in (whichroad.match(drive, roads, vehicle=car).diagnosis, localizer.diagnosis):
        assert [one.what for one in found] == notes
        assert all(one.level == "information" for one in found)
        assert all("the middle of the rear axle" in one.advice for one in found)


SCATTER = "gnss: times"


@pytest.mark.parametrize("seed", [7, 8])
@pytest.mark.parametrize(("delay", "jitter"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.2)])
def test_exact_fixes_stamped_on_arrival_are_named_and_a_steady_delay_is_not(
    town, seed: int, delay: float, jitter: float
):
    roads, _ = town
    drive = simulate_drive(roads, seed=seed, length_m=3000.0, scenario=RTK).drive
    fixes, log = drive.fixes, drive.odometry
    square = np.full(len(fixes), 0.02**2)
    later = delay + np.random.default_rng(seed).uniform(0.0, jitter, len(fixes))
    fixes = replace(
        fixes, time=fixes.time + later, cov_ee=square, cov_nn=square, cov_en=0.0 * square
    )
    localizer = whichroad.Localizer(roads)
    wheels = [WheelTicks(*row) for row in zip(log.time, log.left, log.right, strict=True)]
    for one in sorted([*as_records(fixes), *wheels], key=lambda each: each.time):
        localizer.update(one)
    whole = whichroad.match(replace(drive, fixes=fixes), roads)
    for found in (whole.diagnosis, localizer.diagnosis):
        named = {one.what: one for one in found if one.what != UNTOLD}
        assert (SCATTER in named) if jitter else not named
        if jitter:
            assert named[SCATTER].level == "warning"
            assert named[SCATTER].statistic == pytest.approx(jitter / math.sqrt(12.0), rel=0.4)
            assert "stamped on arrival" in named[SCATTER].advice


def test_the_statistics_do_not_depend_on_how_often_they_are_asked_for():
    rows, whole, asked = drive(2, seconds=300, rate=5), *(
        ConsistencyStatistics(FITS, CAR) for _ in range(2)
    )  # fmt: skip
    fixed = Row._fields.index("has_fix")
    rows[:, fixed] = np.roll(rows[:, fixed], 2)  # no second of moving begins at a fix
    whole.take(rows)
    for row in rows:
        asked.take(row[None])
    assert asked.times() == pytest.approx(whole.times(), rel=1e-6)
    assert asked.shift()[:1] == pytest.approx(whole.shift()[:1], rel=1e-6)
    assert asked.times().sigma > 0.0


def test_wheels_that_slip_when_they_drive_do_not_name_the_times_of_exact_fixes():
    rows = drive(3, sigma=0.005, seconds=400)
    rows[:, [Row._fields.index(name) for name in ("major", "minor")]] = 0.02
    speed = rows[:, Row._fields.index("speed")]
    slip = np.where(np.gradient(speed) > 0.3, 1.1, 1.0)  # of the filter's speed, by its wheels
    slipped = rows.copy()
    slipped[:, Row._fields.index("speed")] *= slip
    assert SCATTER not in found(slipped)
    ahead = np.exp(1j * rows[:, Row._fields.index("heading")])
    late = np.random.default_rng(3).uniform(0.0, 0.2, len(rows)) * speed * ahead
    rows[:, Row._fields.index("fix_x")] -= late.real
    rows[:, Row._fields.index("fix_y")] -= late.imag
    assert SCATTER in found(rows)


def test_exact_fixes_alone_are_worth_no_note_on_the_antenna(town):
    roads, _ = town
    settings = replace(RTK, antenna_forward=0.0)
    drive = simulate_drive(roads, seed=5, length_m=2000.0, scenario=settings).drive
    localizer = whichroad.Localizer(roads)
    for one in as_records(drive.fixes):
        localizer.update(one)
    assert localizer.diagnosis == ()
    assert whichroad.match(replace(drive, odometry=None), roads).diagnosis == ()


def test_a_map_farther_off_than_set_is_named():
    assert set(found(drive(1, map_error=8.0))) == {"map_sigma"}


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> tuple[whichroad.RoadMap, Drive]:
    """A map, and a sound drive of 9 km on it."""
    file = tmp_path_factory.mktemp("town") / "map.osm"
    file.write_text(draw_town(), encoding="utf-8")
    roads = whichroad.RoadMap.from_osm(file)
    return roads, simulate_drive(roads, seed=3, length_m=9000.0).drive


def moved(drive: Drive, east_m: float, north_m: float) -> Drive:
    """All fixes of a drive moved."""
    fixes = drive.fixes
    assert fixes is not None
    metres = 111_320.0 * np.cos(np.radians(fixes.lat_deg))
    lat, lon = fixes.lat_deg + north_m / 111_320.0, fixes.lon_deg + east_m / metres
    return replace(drive, fixes=replace(fixes, lat_deg=lat, lon_deg=lon))


def test_a_map_that_is_off_as_a_whole_is_named_with_its_direction(town):
    """Fixes 20 m east of the roads: the map is west of the world."""
    roads, drive = town
    result = whichroad.match(moved(drive, 20.0, 0.0), roads)
    (named,) = result.diagnosis
    assert named.what == "map offset"
    assert named.statistic == pytest.approx(20.0, abs=8.0)
    assert re.search(r"the map lies \d+ m west of the fixes", named.advice)
    told = result.summary["map_error"]
    assert told["east_m"] == pytest.approx(-20.0, abs=3.0 * told["sigma_m"])


def test_after_a_short_way_it_is_hardly_known_how_far_the_map_is_off(town):
    roads, drive = town
    begun = simulate_drive(roads, seed=3, length_m=1000.0).drive
    short = whichroad.match(begun, roads).summary["map_error"]
    assert short["sigma_m"] > 0.5 * short["local_m"] > 1.0
    assert whichroad.match(drive, roads).summary["map_error"]["sigma_m"] < short["sigma_m"]


def counted(drive: Drive, tick: float) -> tuple[Drive, Vehicle]:
    """A drive whose wheels are counted by ticks of so many metres, and its car."""
    usual, wheels = Vehicle(), drive.odometry
    assert isinstance(wheels, WheelCounts)
    left = np.floor(wheels.left * usual.metres_per_tick_left / tick)
    right = np.floor(wheels.right * usual.metres_per_tick_right / tick)
    car = replace(usual, metres_per_tick_left=tick, metres_per_tick_right=tick)
    return replace(drive, odometry=WheelCounts(wheels.time, left, right)), car


@pytest.mark.parametrize(("tick", "degrees"), [(0.1, None), (0.2, "11"), (1.0, "54")])
def test_ticks_in_which_turns_are_lost_are_noted(town, tick: float, degrees: str | None):
    roads, _ = town
    coarse, car = counted(simulate_drive(roads, seed=3, length_m=1000.0).drive, tick)
    recorded = whichroad.match(coarse, roads, vehicle=car).diagnosis
    online = Localizer(roads, vehicle=car)
    log = coarse.odometry
    wheels = [WheelTicks(*row) for row in zip(log.time, log.left, log.right, strict=True)]
    for one in sorted([*as_records(coarse.fixes), *wheels], key=lambda each: each.time):
        online.take(one)
    for told in (recorded, online.diagnosis):
        noted = [one for one in told if one.what == "wheels: ticks"]
        assert [one.level for one in noted] == ["information"] * (degrees is not None)
        assert all(f"a turn to {degrees} degrees" in one.advice for one in noted)
    gyro = WithGyro(
        log, YawRates(log.time, np.gradient((log.right - log.left) * tick / 1.5, log.time))
    )
    beside = whichroad.match(replace(coarse, odometry=gyro), roads, vehicle=car).diagnosis
    assert not [one for one in beside if one.what == "wheels: ticks"]


def test_of_a_map_nothing_is_told_without_wheels(town):
    roads, drive = town
    assert "map_error" not in whichroad.match(replace(drive, odometry=None), roads).summary


@pytest.mark.parametrize("lost", [4000, 4001])
def test_a_heading_that_is_thought_to_be_another_spoils_nothing(lost: int):
    """For ten seconds the filter believes it drives the other way."""
    rows = drive(2)
    rows[lost : lost + 10, Row._fields.index("heading")] += math.pi
    assert found(rows) == {}


def test_too_short_a_drive_is_not_judged():
    assert found(drive(1, sigma=3.0, seconds=500)) == {}


@pytest.mark.parametrize("seed", range(5))
def test_a_quarter_of_an_hour_is_judged_with_more_patience(seed: int):
    assert found(drive(seed, seconds=900)) == {}
    assert "gnss sigma" in found(drive(seed, sigma=2.0, seconds=900))


def test_standing_says_nothing():
    moving = drive(1, seconds=2000)
    stands = np.repeat(moving[-1:], 20_000, axis=0)
    stands[:, 0] += np.arange(1, 20_001)
    stands[:, [1, 2, 3]] = 0.0
    statistics, alone = ConsistencyStatistics(FITS, CAR), ConsistencyStatistics(FITS, CAR)
    statistics.take(np.vstack([moving, stands]))
    alone.take(moving)
    np.testing.assert_allclose(statistics._pairs, alone._pairs)
    np.testing.assert_allclose(statistics._errors, alone._errors)


@pytest.mark.parametrize("cut", [1, 7, 500])
def test_piece_by_piece_it_finds_what_it_finds_at_once(cut: int):
    rows = drive(4, sigma=1.2, seconds=1500, drift=1e-4)
    once, pieces = ConsistencyStatistics(FITS, CAR), ConsistencyStatistics(FITS, CAR)
    once.take(rows)
    for first in range(0, len(rows), cut):
        pieces.take(rows[first : first + cut])
    np.testing.assert_allclose(pieces._pairs, once._pairs, rtol=1e-9)
    np.testing.assert_allclose(pieces._turning, once._turning, rtol=1e-9)
    np.testing.assert_allclose(pieces._errors, once._errors, rtol=1e-9)
    np.testing.assert_allclose(pieces._metres, once._metres, rtol=1e-9)


def test_ten_readings_a_second_say_what_one_says():
    slow, quick = ConsistencyStatistics(FITS, CAR), ConsistencyStatistics(FITS, CAR)
    slow.take(drive(5, seconds=3000))
    quick.take(drive(5, seconds=3000, rate=10))
    assert quick._pairs[:, 0] == pytest.approx(slow._pairs[:, 0], rel=0.02)
    assert quick.errors().size_if_right == pytest.approx(slow.errors().size_if_right, rel=0.2)


def test_what_is_remembered_does_not_grow():
    statistics = ConsistencyStatistics(FITS, CAR)
    rows = drive(1, seconds=4000)
    for first in range(0, len(rows), 100):
        statistics.take(rows[first : first + 100])
        assert len(statistics._recent.moving) <= 155


def test_a_finding_says_what_was_seen_what_was_expected_and_what_to_do():
    text = str(found(drive(1, time=400.0))["gnss_time"])
    assert text.startswith("gnss_time: ")
    assert "was expected; GNSS errors persist for " in text
    assert "set gnss_time" in text


def test_diagnose_takes_whatever_has_a_diagnosis():
    class Answer:
        diagnosis = (Finding("gnss sigma", "warning", 1.5, 0.7, 1.2, "look"),)

    assert whichroad.diagnose(Answer()) == list(Answer.diagnosis)


def test_how_long_errors_last_is_not_told_by_few_of_them():
    """In ten minutes 80 s may look like 30 or 1,000 by chance, and hardly in three hours."""
    short, long = ConsistencyStatistics(FITS, CAR), ConsistencyStatistics(FITS, CAR)
    for statistics, seconds in ((short, 650.0), (long, 10_800.0)):
        statistics._state[0] = 30.0 + seconds
        statistics._errors[0] = 1.0
    assert _chance(short, 0.4) > 2.6
    assert _chance(short, 13.5) > 13.5
    assert _chance(long, 1.0) < 1.6


def distorted(osm: str) -> str:
    """The town drawn 6 m off, to and fro within some 250 m: lines are turned by ten degrees."""

    def there(match: re.Match[str]) -> str:
        lat, lon = float(match[1]), float(match[2])
        x, y = 111_320.0 * lon * math.cos(math.radians(lat)), 111_320.0 * lat
        north = 6.0 * math.sin(2.0 * math.pi * x / 250.0)
        east = 6.0 * math.sin(2.0 * math.pi * y / 250.0 + 1.0)
        lon += east / (111_320.0 * math.cos(math.radians(lat)))
        return f'lat="{lat + north / 111_320.0:.7f}" lon="{lon:.7f}"'

    return re.sub(r'lat="([-\d.]+)" lon="([-\d.]+)"', there, osm)


def test_a_map_whose_lines_are_turned_is_named(town, tmp_path):
    roads, drive = town
    bent = tmp_path / "bent.osm"
    bent.write_text(distorted(draw_town()), encoding="utf-8")
    result = whichroad.match(drive, whichroad.RoadMap.from_osm(bent))
    assert [f.what for f in result.diagnosis] == ["map headings"]
    told = result.summary["map_error"]["heading_deg"]
    assert result.diagnosis[0].statistic == pytest.approx(told, abs=0.01)
    usual = math.degrees(FITS.edge_heading_sigma)
    assert told > 2.0 * usual
    assert whichroad.match(drive, roads).summary["map_error"]["heading_deg"] < 1.2 * usual
