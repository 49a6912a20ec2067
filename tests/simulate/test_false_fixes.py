"""Laws of receivers that are pulled aside or jump, and of maps that are drawn by hand."""

from dataclasses import replace

import numpy as np
import pytest

from whichroad.simulate import GOOD, Jump, MapBuilder, Pull, simulate_drive
from whichroad.simulate.lateral_profile import draw_path
from whichroad.simulate.map_error_field import draw_map_error
from whichroad.simulate.route_choice import random_route
from whichroad.simulate.speed_profile import draw_speed_profile


def more_error(roads, pull, seed=4):
    """The drive, and by how much the pull moved its fixes: (m, 2) east and north."""
    plain, false = (
        simulate_drive(roads, seed=seed, length_m=3000.0, pulls=pulls) for pulls in ((), (pull,))
    )
    return false, false.fix_error - plain.fix_error


def driven(drive):
    """Metres driven at the fixes."""
    return drive.fix_truth.travelled - drive.fix_truth.travelled[0]


def test_a_pull_grows_stays_and_wears_off(hand_made):
    drive, moved = more_error(hand_made, Pull(500.0, 12.0, 10.0, 0.0, 800.0, 200.0))
    s, size = driven(drive), np.hypot(*moved.T)
    time = drive.fix_truth.time
    assert size[s <= 500.0] == pytest.approx(0.0, abs=1e-9)
    grows = (s > 500.0) & (s < 700.0)
    assert size[grows] == pytest.approx(12.0 * (s[grows] - 500.0) / 200.0, abs=1e-9)
    assert size[(s > 700.0) & (s < 1300.0)] == pytest.approx(12.0, abs=1e-9)
    since = time - np.interp(1300.0, s, time)
    wears = (since > 0.0) & (since < 30.0)
    assert size[wears] == pytest.approx(12.0 * np.exp(-since[wears] / 10.0), abs=1e-9)
    assert size[since >= 30.0] == pytest.approx(0.0, abs=1e-9)


def test_a_pull_is_to_the_right_of_the_way(hand_made):
    drive, moved = more_error(hand_made, Pull(-1.0, 12.0, np.inf, 0.0))
    turn = hand_made.plane.convergence(drive.fix_truth.x, drive.fix_truth.y)
    heading = drive.fix_truth.heading - turn
    right = np.column_stack([np.sin(heading), -np.cos(heading)])
    assert moved == pytest.approx(12.0 * right, abs=1e-6)  # from the first fix on


def test_a_jump_moves_the_fixes_of_its_time_and_nothing_else(hand_made):
    drive, moved = more_error(hand_made, Jump(900.0, 150.0, -80.0, 60.0))
    time = drive.fix_truth.time
    since = time - np.interp(900.0, driven(drive), time)
    during = (since >= 0.0) & (since < 60.0)
    assert moved == pytest.approx(np.outer(during, [150.0, -80.0]), abs=1e-9)
    assert (drive.false_fix == during).all()
    plain = simulate_drive(hand_made, seed=4, length_m=3000.0)
    assert (drive.drive.fixes.cov_ee == plain.drive.fixes.cov_ee).all()
    assert (drive.drive.odometry.left == plain.drive.odometry.left).all()


def test_a_sketch_compiles_to_the_streets_that_were_drawn():
    builder = MapBuilder()
    for name, x, y in (("west", -300.0, 0.0), ("middle", 0.0, 0.0), ("east", 400.0, 30.0)):
        builder.node(name, x, y)
    builder.way(["west", "middle"], "tertiary", name="Here", maxspeed="50")
    builder.way(["middle", "east"], "residential", name="There", oneway="yes")
    roads = builder.compiled()
    names = np.array(roads.column("name"))
    assert sorted(names.tolist()) == ["Here", "Here", "There", "There"]
    length = {name: roads.arrays.edges.length[names == name] for name in ("Here", "There")}
    assert length["Here"] == pytest.approx(300.0, rel=1e-4)
    assert length["There"] == pytest.approx(np.hypot(400.0, 30.0), rel=1e-4)
    assert (roads.arrays.edges.rule[names == "There"] > 0).sum() == 1


@pytest.mark.parametrize("beside", [1, 2, 3])
def test_a_stop_beside_the_end_takes_a_finite_time(hand_made, beside):
    """A stop on the grid point before the last once took for ever."""
    settings = replace(GOOD, stop_probability=1.0)
    random = np.random.default_rng(3)
    roads = hand_made.arrays
    edges = random_route(roads, 1500.0, random)
    path = draw_path(roads, edges, draw_map_error(settings, random), settings, random)
    waits = draw_speed_profile(
        roads, path, 0, len(path.along) - 1, settings, np.random.default_rng(1)
    )
    stop = int(np.flatnonzero(waits.depart - waits.arrive > 0)[1])
    profile = draw_speed_profile(roads, path, 0, stop + beside, settings, np.random.default_rng(1))
    assert np.isfinite(profile.depart).all()
    assert (np.diff(profile.arrive) > 0).all()
