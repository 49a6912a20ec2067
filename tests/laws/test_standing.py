"""Standing still teaches nothing, wherever and however long."""

import numpy as np
import pytest
from hypothesis import given

from laws.drives import law, said, sensed, way_through
from scenes import Truth, brake, drive_along, gnss, grid_town, network
from strategies import seeds
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS

STANDING = 6000  # epochs: ten minutes
SETTLED = 50  # epochs after which a receiver alone knows that it stands

TOWN = grid_town()
CROSS = [[[0.0, 0.0], [900.0, 0.0]], [[900.0, 0.0], [2000.0, 0.0]], [[900.0, 0.0], [900.0, 300.0]]]


def standing_at(truth: Truth, fix: np.ndarray, where: int, seed: int, mode: int):
    """The drive up to an epoch and ten minutes there, its fixes jumping about; two rows."""
    stood, rows = brake(truth, where, STANDING)
    where += 10  # braking takes twice the time
    seen = fix[rows]
    seen[where:, :2] += np.random.default_rng(seed).normal(0.0, 2.0, (STANDING, 2))
    epochs = sensed(stood, seen, np.arange(0, len(rows), 10), mode)
    return epochs, (where + SETTLED) // (10 if mode == CLOCK else 1), len(epochs) - 1


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
@given(seed=seeds)
@law
def test_ten_minutes_anywhere_in_a_town_change_neither_roads_nor_sigma(mode: int, seed: int):
    rng = np.random.default_rng(seed)
    truth = drive_along(way_through(seed, 2))
    fix = gnss(truth, sigma=rng.uniform(1.0, 6.0), seed=seed)
    where = int(rng.integers(30, len(truth.time)))
    epochs, before, after = standing_at(truth, fix, where, seed, mode)
    each = [[e] for e in range(2 * len(TOWN))]
    told = said(network(TOWN), epochs, each, mode=mode)
    np.testing.assert_allclose(told.p[after], told.p[before], rtol=0.0, atol=0.01)
    assert told.off[after] == pytest.approx(told.off[before], abs=0.01)
    assert told.sigma[after] == pytest.approx(told.sigma[before], rel=0.05)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
@pytest.mark.parametrize("where", [870.0, 880.0, 890.0])
def test_ten_minutes_before_a_crossing_do_not_push_the_vehicle_back_from_it(mode, where):
    """Nothing was measured, so nothing at all may change: 1 mm is rounding."""
    truth = drive_along([[500.0, -1.75], [where, -1.75]], margin=0.0)
    fix = gnss(truth, sigma=4.0, seed=3)
    epochs, before, after = standing_at(truth, fix, len(truth.time) - 1, 0, mode)
    told = said(network(CROSS), epochs, [[e] for e in range(6)], mode=mode)
    np.testing.assert_allclose(told.p[after], told.p[before], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(told.place[after, :2], told.place[before, :2], atol=1e-3)
    assert told.sigma[after] == pytest.approx(told.sigma[before], rel=1e-3)
