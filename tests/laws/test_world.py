"""Moving, turning, mirroring or renumbering the world does the same to the answer."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given

from laws.drives import law, sensed, way_through
from laws.geodetic import answer, degrees, drive, fixes, road_map
from scenes import (
    Truth,
    column,
    columns,
    drive_along,
    gnss,
    grid_town,
    localize,
    network,
)
from strategies import seeds
from whichroad.filter.state import (
    CLOCK,
    DISTANCE,
    WHEELS,
)
from whichroad.filter.summary.estimate import Output
from whichroad.settings import Settings

TOWN = grid_town()
MODES = pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])

# Rounding alone: 1e-16 of coordinates of 5 km and of variances of 1000 m², over some hundred
# updates, is 1e-10.
EXACT = 1e-9


def random_drive(seed: int) -> tuple[Truth, np.ndarray, np.ndarray]:
    """Some 700 m through the town, fixes with slanting ellipses, and when they come."""
    rng = np.random.default_rng(seed)
    truth = drive_along(way_through(seed, 6))
    fix = gnss(truth, sigma=rng.uniform(1.0, 6.0), seed=seed)
    fix[:, 3] *= rng.uniform(0.4, 1.0)
    fix[:, 4] = rng.uniform(-3.0, 3.0)
    return truth, fix, np.arange(0, len(truth.time), 10)


def moved(truth: Truth, fix: np.ndarray, turn: np.ndarray, shift: np.ndarray):
    """A drive in the world after x → turn x + shift; `turn` may be a mirror."""
    angle = math.atan2(turn[1, 0], turn[0, 0])
    hand = np.sign(np.linalg.det(turn))
    x, y = (np.column_stack([truth.x, truth.y]) @ turn.T + shift).T
    there = truth._replace(x=x, y=y, heading=hand * truth.heading + angle)
    seen = fix.copy()
    seen[:, :2] = fix[:, :2] @ turn.T + shift
    seen[:, 4] = hand * fix[:, 4] + angle
    return there, seen


def assert_moved(there: Output, here: Output, turn: np.ndarray, shift: np.ndarray, within: float):
    """What is said there is what is said here, moved."""
    close = {"rtol": within, "atol": within}
    np.testing.assert_allclose(
        columns(there, "x y"), columns(here, "x y") @ turn.T + shift, **close
    )
    heading = np.exp(1j * column(here, "heading"))
    if np.linalg.det(turn) < 0.0:
        heading = heading.conj()
    turned = heading * complex(turn[0, 0], turn[1, 0])
    np.testing.assert_allclose(np.exp(1j * column(there, "heading")), turned, **close)
    here_cov, there_cov = (columns(o, "xx xy xy yy").reshape(-1, 2, 2) for o in (here, there))
    np.testing.assert_allclose(there_cov, turn @ here_cov @ turn.T, **close)
    for name in ("p_edge", "p_off_road"):
        np.testing.assert_allclose(there.rows[name], here.rows[name], **close)
    sure = here.rows.p_edge > 0.5  # else two edges may be equally probable
    np.testing.assert_array_equal(there.rows.edge[sure], here.rows.edge[sure])
    np.testing.assert_allclose(there.rows.s[sure], here.rows.s[sure], **close)


@MODES
@given(seed=seeds)
@law
def test_the_world_moved_and_turned_moves_and_turns_the_answer(mode: int, seed: int):
    truth, fix, at = random_drive(seed)
    rng = np.random.default_rng(seed)
    a = rng.uniform(-math.pi, math.pi)
    turn = np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]])
    shift = rng.uniform(-5000.0, 5000.0, 2)
    here = localize(network(TOWN), sensed(truth, fix, at, mode), mode=mode).output
    there = localize(
        network([line @ turn.T + shift for line in TOWN]),
        sensed(*moved(truth, fix, turn, shift), at, mode),
        mode=mode,
    ).output
    assert_moved(there, here, turn, shift, EXACT)


@MODES
@given(seed=seeds)
@law
def test_the_world_mirrored_and_driven_on_the_other_side_mirrors_the_answer(mode: int, seed: int):
    truth, fix, at = random_drive(seed)
    a = np.random.default_rng(seed).uniform(-math.pi, math.pi)
    mirror = np.array([[math.cos(a), math.sin(a)], [math.sin(a), -math.cos(a)]])
    shift = np.zeros(2)
    here = localize(network(TOWN), sensed(truth, fix, at, mode), mode=mode).output
    there = localize(
        network([line @ mirror.T for line in TOWN]),
        sensed(*moved(truth, fix, mirror, shift), at, mode), mode=mode, side="left",
    ).output  # fmt: skip
    assert_moved(there, here, mirror, shift, EXACT)


@MODES
@given(seed=seeds)
@law
def test_streets_in_any_order_and_drawn_either_way_give_the_same_answer(mode: int, seed: int):
    rng = np.random.default_rng(seed)
    truth, fix, at = random_drive(seed)
    epochs = sensed(truth, fix, at, mode)
    order = rng.permutation(len(TOWN))
    back = rng.random(len(TOWN)) < 0.5
    streets = [TOWN[i][::-1] if back[i] else TOWN[i] for i in order]
    here = localize(network(TOWN), epochs, mode=mode).output
    there = localize(network(streets), epochs, mode=mode).output
    place = np.argsort(order)
    old = here.rows.edge.copy()
    edge = np.where(old >= 0, 2 * place[old // 2] + old % 2, old)
    here.rows.edge = np.where((old >= 0) & back[old // 2], edge ^ 1, edge)
    assert_moved(there, here, np.eye(2), np.zeros(2), EXACT)


@MODES
@given(seed=seeds)
@law
def test_rows_of_the_table_in_any_order_and_drawn_either_way_give_the_same_answer(mode, seed):
    rng = np.random.default_rng(seed)
    truth, fix, at = random_drive(seed)
    log = drive(truth, fixes(truth, fix, at), mode)
    lines = [degrees(line) for line in TOWN]
    mixed = [lines[i][:: rng.choice([-1, 1])] for i in rng.permutation(len(lines))]
    here, there = answer(log, road_map(lines)), answer(log, road_map(mixed))
    for a, b in zip(here[3:8], there[3:8], strict=True):
        np.testing.assert_allclose(b, a, rtol=EXACT, atol=EXACT)
    for a, b in zip(here[:2], there[:2], strict=True):  # degrees: 1e-9 m, and their own rounding
        np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-13)


@given(seeds)
@law
def test_the_earth_has_no_special_meridian(seed: int):
    """Nor a date line: the town lies on it after a turn by 171.3°.

    The plane's origin is rounded to 1e-6°, the same one before and after; longitudes of
    180° are rounded at 3e-14°, 2 nm, which a hundred updates leave below a micrometre.
    """
    truth, fix, at = random_drive(seed)
    log = drive(truth, fixes(truth, fix, at), WHEELS)
    lines = [degrees(line) for line in TOWN]
    here = answer(log, road_map(lines))
    for east in (90.0, 171.3):
        seen = replace(log.fixes, lon_deg=log.fixes.lon_deg + east)
        roads = road_map([line + np.array([east, 0.0]) for line in lines])
        there = answer(replace(log, fixes=seen), roads)
        np.testing.assert_allclose(there.lat, here.lat, rtol=0.0, atol=1e-11)
        gap = (there.lon - here.lon - east + 180.0) % 360.0 - 180.0
        np.testing.assert_allclose(gap, 0.0, atol=1e-11)
        for a, b in zip(here[3:8], there[3:8], strict=True):
            np.testing.assert_allclose(b, a, rtol=0.0, atol=1e-6)


def out_of_town(seed: int) -> tuple[Truth, np.ndarray, np.ndarray]:
    """Out of the town along one street, through the fields, and back along another."""
    rng = np.random.default_rng(seed)
    out, back = ([[i * 120.0 + 10.0 * math.sin(j), j * 120.0 + 8.0 * math.cos(i)]
                  for j in rows] for i, rows in ((1, (2, 3, 4)), (3, (4, 3, 2))))  # fmt: skip
    fields = np.array([[110.0, 600.0], [240.0, 720.0], [350.0, 600.0]])
    fields += rng.uniform(-30.0, 30.0, (3, 2))
    truth = drive_along(np.vstack([out, fields, back]))
    fix = gnss(truth, sigma=rng.uniform(1.0, 3.0), seed=seed)
    return truth, fix, np.arange(0, len(truth.time), 10)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
@example(seed=3)  # starts anew in the fields, far from every road, in eight directions
@given(seed=seeds)
@law
def test_turning_the_world_turns_who_leaves_the_roads_and_comes_back(mode: int, seed: int):
    """In the fields hypotheses off the roads are born, merge, and return to roads."""
    truth, fix, at = out_of_town(seed)
    a = np.random.default_rng(seed).uniform(-math.pi, math.pi)
    turn = np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]])
    here, there = (
        localize(
            network([line @ how.T for line in TOWN]),
            sensed(*moved(truth, fix, how, np.zeros(2)), at, mode), mode=mode,
            settings=Settings(off_road_leave=1e-3),
        ).output
        for how in (np.eye(2), turn)
    )  # fmt: skip
    off = column(here, "p_off_road")
    assert off.max() > 0.9
    assert off[-1] < 0.5
    assert_moved(there, here, turn, np.zeros(2), EXACT)
