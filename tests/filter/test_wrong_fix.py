"""One fix that is wrong does not take the vehicle off its road."""

import numpy as np
import pytest

from scenes import localize, network
from whichroad.filter.state import CLOCK, new_epochs

# a road of 2 km in edges of 100 m, and streets that lead off it; edge 2 i + 1 is edge 2 i back
ROAD = [[[100.0 * k, 0.0], [100.0 * k + 100.0, 0.0]] for k in range(20)]
STREETS = [[[100.0 * k, 0.0], [100.0 * k, -120.0]] for k in (8, 12)]
ROADS = network(ROAD + STREETS)


@pytest.mark.parametrize("seconds", [5.0, 10.0])
@pytest.mark.parametrize("away", [(0.0, -60.0), (0.0, 75.0), (60.0, -150.0)])
def test_a_vehicle_drives_on_along_its_road(seconds: float, away: tuple[float, float]):
    time = seconds * np.arange(1.0 + 1800.0 // (14.0 * seconds))
    epochs = new_epochs(len(time))
    epochs.time[:] = time
    epochs.has_fix[:] = 1
    epochs.fix[:, 0] = 20.0 + 14.0 * time
    epochs.fix[:, 1] = -1.75
    wrong = int(np.searchsorted(epochs.fix[:, 0], 790.0))
    epochs.fix[wrong, :2] += away
    epochs.fix[:, 2:4] = 5.0
    epochs.speed_sigma[:] = np.inf
    epochs.course_sigma[:] = np.inf
    found = localize(ROADS, epochs, mode=CLOCK)
    driven = found.chain.edge.tolist()
    assert driven == list(range(0, driven[-1] + 1, 2))
    assert np.abs(found.output.rows.x - 20.0 - 14.0 * time).max() < 60.0
