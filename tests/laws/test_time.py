"""Neither the date, nor where a counter begins, nor who speaks first changes the answer."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laws.drives import law, way_through
from laws.geodetic import CAR, degrees, drive, fixes, road_map
from scenes import columns, drive_along, gnss, grid_town
from strategies import seeds
from whichroad import Estimate, Localizer, match
from whichroad.epochs import build_timeline
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS
from whichroad.observations import Distance, Drive, GeoFix, Observation, WheelTicks
from whichroad.recorded import localize_recorded
from whichroad.tables.status import STATUS

MODES = pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
TICK = 2.0**-6  # m a count: sums of counts are exact in floating point
COUNTED = replace(CAR, metres_per_tick_left=TICK, metres_per_tick_right=TICK)
TOWN = road_map([degrees(line) for line in grid_town()])


def town_drive(seed: int, mode: int, *, blocks: int = 3) -> Drive:
    """Some 350 m through the town; readings every eighth of a second, whole counts."""
    rng = np.random.default_rng(seed)
    truth = drive_along(way_through(seed, blocks), interval=0.125, speed=9.7)
    fix = gnss(truth, sigma=rng.uniform(1.0, 6.0), seed=seed)
    log = drive(truth, fixes(truth, fix, np.arange(0, len(truth.time), 8)), mode)
    if mode == WHEELS:
        whole = {w: np.round(getattr(log.odometry, w) * 0.01 / TICK) for w in ("left", "right")}
        log = replace(log, odometry=replace(log.odometry, **whole))
    return log


def later(log: Drive, seconds: float) -> Drive:
    """The same drive at another time."""
    moved = {
        name: replace(part, time=part.time + seconds)
        for name in ("fixes", "odometry")
        if (part := getattr(log, name)) is not None
    }
    return replace(log, **moved)


def assert_same_points(log: Drive, other: Drive) -> None:
    """All columns but the time, bit for bit."""
    one, two = (match(d, TOWN, vehicle=COUNTED).to_arrow().drop(["time"]) for d in (log, other))
    assert two.equals(one)


@MODES
@given(seed=seeds, days=st.integers(-20_000, 40_000))
@law
def test_another_date_gives_the_same_answer_to_the_last_bit(mode: int, seed: int, days: int):
    """From 1915 to 2079; eighths of a second are exact there."""
    log = town_drive(seed, mode)
    assert_same_points(log, later(log, 86400.0 * days))


@given(seeds, st.integers(-(2**40), 2**40), st.integers(-(2**40), 2**40))
@law
def test_where_the_wheels_counters_begin_changes_nothing(seed: int, left: int, right: int):
    log = town_drive(seed, WHEELS)
    counts = replace(log.odometry, left=log.odometry.left + left, right=log.odometry.right + right)
    assert_same_points(log, replace(log, odometry=counts))


def table(log: Drive, order: list[int], wrap: int | None = None) -> pa.Table:
    """Fixes and wheel readings as rows of their own, in an order."""
    f, o = log.fixes, log.odometry
    names = ("time", "lat", "lon", "cov_ee_m2", "cov_en_m2", "cov_nn_m2")
    fixed = (f.time, f.lat_deg, f.lon_deg, f.cov_ee, f.cov_en, f.cov_nn)
    wheels = ("time", "wheel_rl_ticks", "wheel_rr_ticks")
    left, right = (o.left, o.right) if wrap is None else (o.left % wrap, o.right % wrap)
    rows = [dict(zip(names, row, strict=True)) for row in zip(*fixed, strict=True)]
    rows += [dict(zip(wheels, row, strict=True)) for row in zip(o.time, left, right, strict=True)]
    return pa.Table.from_pylist(
        [rows[i] for i in order] if order else rows,
        pa.schema([(n, pa.float64()) for n in (*names, *wheels[1:])]),
    )


@given(seeds, st.sampled_from([8, 12]))
@law
def test_counters_that_wrap_give_the_same_answer_as_those_that_do_not(seed: int, bits: int):
    log = later(town_drive(seed, WHEELS), 1.6e9)
    plain = match(table(log, []), TOWN, vehicle=COUNTED).to_arrow()
    wrapping = replace(COUNTED, counter_bits=bits)
    wrapped = match(table(log, [], 2**bits), TOWN, vehicle=wrapping).to_arrow()
    assert wrapped.equals(plain)


@given(seeds)
@law
def test_rows_of_one_moment_may_stand_in_any_order(seed: int):
    """Every fix has a wheel reading of its moment; in the table either comes first."""
    log = later(town_drive(seed, WHEELS), 1.6e9)
    rng = np.random.default_rng(seed)
    time = np.concatenate([log.fixes.time, log.odometry.time])
    one, other = (np.lexsort((rng.random(len(time)), time)).tolist() for _ in range(2))
    assert one != other
    a, b = (match(table(log, order), TOWN, vehicle=COUNTED).to_arrow() for order in (one, other))
    assert b.equals(a)


def readings(log: Drive) -> list[Observation]:
    """A drive's observations in time order, odometry before a fix of the same moment."""
    out: list[Observation] = []
    names = GeoFix.__slots__
    out += [
        GeoFix(*row) for row in zip(*(getattr(log.fixes, n).tolist() for n in names), strict=True)
    ]
    if log.odometry is not None:
        kind = WheelTicks if hasattr(log.odometry, "left") else Distance
        columns = [getattr(log.odometry, n).tolist() for n in type(log.odometry).__slots__]
        out += [kind(*row) for row in zip(*columns, strict=True)]
    return sorted(out, key=lambda r: (r.time, isinstance(r, GeoFix)))


SAID = "x y heading xx xy yy p_edge p_off_road s"


def told(estimate: Estimate) -> tuple[float, ...]:
    e = estimate
    return (e.pose.x, e.pose.y, e.pose.heading, e.cov[0, 0], e.cov[0, 1], e.cov[1, 1], e.p_road,
            e.p_off_road, e.abscissa)  # fmt: skip


def both(log: Drive) -> tuple[np.ndarray, np.ndarray]:
    """What is said on line and of the recorded drive, (n, 9) each; roads and status are equal."""
    online = Localizer(TOWN, vehicle=COUNTED)
    estimates = {r.time: online.update(r) for r in readings(log)}
    timeline = build_timeline(log, TOWN.plane, COUNTED)
    output = localize_recorded(TOWN, timeline, vehicle=COUNTED).output
    np.testing.assert_array_equal(list(estimates), timeline.epochs.time)
    assert [e.status for e in estimates.values()] == [STATUS[s] for s in output.rows.status]
    assert [-1 if e.edge is None else e.edge for e in estimates.values()] == np.maximum(
        output.rows.edge, -1
    ).tolist()
    return np.array([told(e) for e in estimates.values()]), columns(output, SAID)


@given(seeds)
@law
def test_on_line_a_receiver_alone_gives_the_recorded_answer_to_the_last_bit(seed: int):
    np.testing.assert_array_equal(*both(town_drive(seed, CLOCK, blocks=6)))


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@given(seed=seeds)
@law
def test_on_line_a_drive_in_the_dark_gives_the_recorded_answer(mode: int, seed: int):
    """One fix, then wheels: sums of readings on one side, differences of sums on the other."""
    log = town_drive(seed, mode)
    first = {n: getattr(log.fixes, n)[:1] for n in type(log.fixes).__slots__}
    online, recorded = both(replace(log, fixes=type(log.fixes)(**first)))
    np.testing.assert_allclose(online, recorded, rtol=1e-9, atol=1e-9)
