"""`benchmarks worlds` from SUMO to the score, on a town drawn at random."""

import numpy as np
import pytest
from benchmarks import Skipped
from benchmarks.worlds.drivers import off_line
from benchmarks.worlds.drives import World, make_world, run_drive
from benchmarks.worlds.nets import EXTRACTS, sumo_tool

try:
    sumo_tool("sumo")
except Skipped as reason:
    pytest.skip(str(reason), allow_module_level=True)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> World:
    folder = tmp_path_factory.mktemp("worlds")
    return make_world(6, [], folder, folder)  # no real data there: a drawn town


def test_a_drive_stays_beside_the_road_it_is_said_to_be_on(world):
    assert world.place not in EXTRACTS
    assert len(world.truths) > 5
    for truth in world.truths:
        away = off_line(truth, world.net)
        assert np.quantile(away, 0.99) < 12.0
        assert np.diff(truth.travel).min() > -0.05
        assert np.abs(np.gradient(truth.heading, truth.time)).max() < 2.5


def test_roads_follow_each_other_as_the_net_allows(world):
    for truth in world.truths:
        change = np.flatnonzero(np.diff(truth.code))
        for a, b in zip(truth.code[change].tolist(), truth.code[change + 1].tolist(), strict=True):
            joined = {*world.net.ends(a)} & {*world.net.ends(b)}
            assert joined or any(b in world.net.following.get(c, []) for c in
                                 world.net.following.get(a, []))  # fmt: skip


def test_every_true_road_is_on_a_sound_map(world):
    codes = np.array(sorted(world.net.code.values()))
    assert (world.chart.road_of_code[codes] >= 0).all()


def test_a_sound_drive_is_scored_and_mostly_right(world, tmp_path):
    runs = [run_drive(world, k, [], tmp_path) for k in range(4)]
    scored = [r.scored for r in runs if r is not None]
    assert len(scored) == 4
    decisions = [d for s in scored for d in s.decisions]
    assert len(decisions) > 20
    assert sum(d.declared for d in decisions) > 0.5 * len(decisions)
    assert sum(s.all.right for s in scored) > 0.9 * sum(s.all.roads for s in scored)
    assert all(not s.events and not s.under for s in scored)


def test_the_same_seed_gives_the_same_score(world, tmp_path):
    a, b = (run_drive(world, 0, None, tmp_path) for _ in range(2))
    assert a is not None
    assert b is not None
    assert a.scored.decisions == b.scored.decisions
    assert a.scored.all == b.scored.all


@pytest.mark.parametrize("sensors", ["wheels", "yaw"])
def test_on_line_a_sound_drive_is_answered_as_a_recorded_one(world, tmp_path, sensors):
    whole, on_line = (
        run_drive(world, 0, [], tmp_path, sensors=sensors, lag=lag) for lag in (None, "online")
    )
    assert whole is not None
    assert on_line is not None
    np.testing.assert_allclose(on_line.said.time, whole.said.time, atol=1e-5)
    assert np.median(np.hypot(*(on_line.said.error - whole.said.error).T)) < 0.1
    told = [[(d.declared, d.wrong) for d in r.scored.decisions] for r in (whole, on_line)]
    assert told[0] == told[1]
