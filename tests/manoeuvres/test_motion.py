"""The drives of `benchmarks manoeuvres`: as a car drives, on the roads they are said to be on."""

import ast
from pathlib import Path

import benchmarks.manoeuvres
import numpy as np
import pytest
import shapely
from benchmarks.manoeuvres.cases import SCENES
from benchmarks.manoeuvres.motion import (
    ALONG,
    LANE,
    LATERAL,
    STEP,
    Motion,
    Stretch,
    drive,
    joined,
    path,
    standing,
)
from benchmarks.manoeuvres.streets import Plan, draw_map

import whichroad

CASES = [(name, k) for name in ("town", "u_turn", "yard", "side_street", "gaps", "reversing")
         for k in range(len(SCENES[name]))]  # fmt: skip


@pytest.fixture(params=CASES, ids=lambda c: f"{c[0]}-{c[1]}")
def plan(request) -> Plan:
    name, k = request.param
    return SCENES[name][k].draw(np.random.default_rng(5))


def straight(metres: float, **how) -> Motion:
    line = np.array([(0.0, 0.0), (metres, 0.0)])
    return drive(path([Stretch(0, line)], np.random.default_rng(1)), 10.0, **how)


def test_a_vehicle_lies_on_the_street_that_it_is_said_to_be_on(plan):
    m = plan.motion
    lines = np.array([shapely.LineString(line) for line in plan.lines])
    far = shapely.distance(lines[m.code // 2], shapely.points(m.x, m.y))
    assert far.max() < 7.5  # in a corner, or in a U-turn
    assert np.median(far) < LANE + 0.75


def test_it_drives_on_the_right_of_a_street(plan):
    m = plan.motion
    forth = np.gradient(m.rolled) > 0.05  # m in a step
    line = np.array([line[[0, -1]] for line in plan.lines])[m.code // 2]
    begin, end = line[:, 0], line[:, 1]
    along = (end - begin) / np.hypot(*(end - begin).T)[:, None]
    along *= np.where(m.code % 2, -1.0, 1.0)[:, None]
    right = (m.x - begin[:, 0]) * along[:, 1] - (m.y - begin[:, 1]) * along[:, 0]
    looks = np.cos(m.heading) * along[:, 0] + np.sin(m.heading) * along[:, 1]
    inside = forth & (looks > 0.999)
    assert inside.mean() > 0.3
    assert np.median(right[inside]) == pytest.approx(LANE, abs=0.3)


def test_no_speed_or_acceleration_is_beyond_what_it_can(plan):
    m = plan.motion
    speed = np.gradient(m.rolled, STEP)
    assert np.abs(speed).max() < 13.01
    assert np.abs(np.gradient(speed, STEP)).max() < 1.05 * ALONG
    assert np.abs(speed * np.gradient(m.heading, STEP)).max() < 1.15 * LATERAL


def test_its_wheels_do_not_slip_sideways_and_nothing_leaps(plan):
    m = plan.motion
    vx, vy = np.gradient(m.x, STEP), np.gradient(m.y, STEP)
    c, s = np.cos(m.heading), np.sin(m.heading)
    assert np.abs(c * vy - s * vx).max() < 0.25
    assert c * vx + s * vy == pytest.approx(np.gradient(m.rolled, STEP), abs=0.03)
    assert np.abs(np.diff(m.heading)).max() < 0.08
    assert np.diff(m.time) == pytest.approx(STEP)


def test_backwards_the_nose_looks_against_the_way():
    m = straight(100.0, backwards=True)
    assert (np.diff(m.x) >= -1e-9).all()
    assert np.cos(m.heading) == pytest.approx(-1.0, abs=1e-3)
    assert m.rolled[-1] == pytest.approx(-100.0, abs=0.1)
    assert m.travel[-1] == pytest.approx(100.0, abs=0.1)


def test_a_stop_lasts_as_long_as_it_says():
    plain, held = straight(400.0), straight(400.0, stops=[(200.0, 30.0)])
    there = (np.abs(held.travel - 200.0) < 0.3) & (held.speed < 0.01)
    assert there.sum() * STEP == pytest.approx(30.0, abs=2.0)
    assert held.travel[-1] == pytest.approx(plain.travel[-1])


def test_legs_follow_each_other_with_one_clock_and_one_count():
    first, second = straight(100.0), straight(50.0, backwards=True)
    both = joined(standing(first, 7.0), second)
    assert both.time[-1] == pytest.approx(first.time[-1] + 7.0 + STEP + second.time[-1])
    assert both.rolled[-1] == pytest.approx(50.0, abs=0.1)
    assert np.diff(both.time) == pytest.approx(STEP)


def test_a_reversing_vehicle_goes_back_as_far_as_its_name_says():
    for case, metres in zip(SCENES["reversing"], (80.0, 290.0, 0.0), strict=True):
        motion = case.draw(np.random.default_rng(3)).motion
        back = -np.diff(motion.rolled).clip(max=0.0).sum()
        assert back == pytest.approx(metres, abs=1.5)
        assert case.what == f"{metres:.0f} m"


def test_the_control_of_a_missing_street_is_the_same_drive_with_it():
    for name in ("yard", "side_street"):
        missing, mapped = (c.draw(np.random.default_rng(3)) for c in SCENES[name])
        assert np.array_equal(missing.motion.x, mapped.motion.x)
        grounds = [draw_map(p, np.random.default_rng(4)) for p in (missing, mapped)]
        unmapped = [np.flatnonzero(g.road_of_code < 0).tolist() for g in grounds]
        [gone] = missing.missing
        assert unmapped == [[2 * gone, 2 * gone + 1], []]
        assert gone in missing.motion.code // 2


def test_streets_with_gaps_are_drawn_up_to_3_m_short_of_their_junctions():
    cut, whole = (c.draw(np.random.default_rng(3)) for c in SCENES["gaps"])
    assert np.array_equal(cut.motion.x, whole.motion.x)
    short = np.abs(np.array(cut.lines) - np.array(whole.lines)).max(2)
    assert set(np.unique(short.round(6))) == {0.0, 0.6, 1.5, 3.0}


def test_a_map_is_off_as_a_whole_by_some_metres():
    plan = SCENES["u_turn"][0].draw(np.random.default_rng(3))
    off = []
    for seed in range(60):
        ground = draw_map(plan, np.random.default_rng(seed))
        box = ground.roads.edges_table().total_bounds.reshape(2, 2)
        drawn = ground.plane.metres(*box.T)
        true = np.vstack(plan.lines)
        assert drawn[1] - drawn[0] == pytest.approx(np.ptp(true, axis=0), abs=0.3)
        off.append(drawn[0] - true.min(0))
    assert np.std(off) == pytest.approx(1.5, rel=0.3)


def test_nothing_of_whichroad_is_used_but_its_public_names():
    for file in Path(benchmarks.manoeuvres.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("whichroad"):
                assert node.module == "whichroad", file
                assert {n.name for n in node.names} <= set(whichroad.__all__), file
            if isinstance(node, ast.Import):
                assert not any(n.name.startswith("whichroad.") for n in node.names), file
