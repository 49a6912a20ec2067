"""A full set of further sensors, and the set less each: answers are as good as they say."""

import numpy as np
import pytest
from benchmarks import evidence
from benchmarks.added_sensors import SENSORS
from benchmarks.scenes.drives import world
from benchmarks.town import CHI2_95

from whichroad.settings import Settings
from whichroad.simulate import drivable


@pytest.fixture(scope="module", autouse=True)
def small_world():
    before = dict(world)
    evidence.prepare(None, None)
    world["allowed"] = drivable(world["roads"].arrays, np.random.default_rng(0))
    yield
    world.clear()
    world.update(before)


@pytest.fixture(scope="module")
def rows():
    """Four drives of 2 km."""
    found = []
    for seed in range(4):
        drive = evidence._drive(seed, 2000.0)
        told = {
            name: make(world["roads"], drive, np.random.default_rng([seed, k]))
            for k, (name, make) in enumerate(SENSORS.items())
        }
        found.append((drive, told))
    return found


@pytest.mark.parametrize("removed", ["none", *SENSORS])
def test_without_a_sensor_the_rest_is_consistent(rows, removed: str):
    """Bounds are those of four drives, whose errors last for kilometres."""
    nees, squared = [], []
    for drive, told in rows:
        for names in (set(told) - {removed}, set()):
            kept = [told[name] for name in names]
            timeline, found, impossible = evidence.localize(drive, kept, Settings())
            assert impossible == 0
            errors = evidence._Errors(drive, timeline, found, False)
            assert not [one for one in found.diagnosis if one.what.startswith("sensor")]
            squared.append((errors.error[errors.moving] ** 2).mean())
            if names:
                nees.append(errors.nees[errors.moving])
    assert np.mean([(n < CHI2_95).mean() for n in nees]) > 0.85
    assert 0.3 < np.mean([n.mean() / 2.0 for n in nees]) < 1.6
    assert np.mean(squared[::2]) < np.mean(squared[1::2])  # with further sensors, and without
