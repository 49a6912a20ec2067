"""Roads that are left while no fix comes: the level covers wherever the way could have led."""

import numpy as np
import pytest

from scenes import columns, drive_along, epochs_of, gnss, localize, network
from whichroad.filter.state import WHEELS
from whichroad.filter.summary.estimate import Output

SILENT = 60.0  # s, of the last fix
LOST = 70.0  # s, when counts are lost
ROADS = network([[[0.0, 0.0], [2500.0, 0.0]]])
DRIVE = drive_along([[20.0, -1.75], [2000.0, -1.75]])


def in_a_tunnel(lost: float, *, back: float = np.inf, drive=DRIVE, seed: int = 0) -> Output:
    """A drive whose fixes end; its counters turn by so much (rad) within a second, or not."""
    fix = gnss(drive, sigma=2.0, seed=seed)
    rows = np.arange(0, len(drive.time), 10)
    heard = rows[(drive.time[rows] <= SILENT) | (drive.time[rows] >= back)]
    epochs = epochs_of(drive, fix, heard)
    turns = (epochs.time > LOST) & (epochs.time <= LOST + 1.0)
    epochs.turn[turns] += lost / turns.sum()
    return localize(ROADS, epochs, mode=WHEELS).output


def beyond(output: Output, drive=DRIVE):
    x, y, level = columns(output, "x y protection_level").T
    return np.hypot(x - drive.x, y - drive.y) > level, level


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lost", [0.6, -1.2, 1.0])
def test_the_level_covers_a_vehicle_whose_counters_lost_a_turn(lost: float, seed: int):
    output = in_a_tunnel(lost, seed=seed)
    exceeded, _ = beyond(output)
    assert (output.rows.p_off_road[DRIVE.time > LOST + 20.0] > 0.5).all()
    assert not exceeded[DRIVE.time > LOST + 5.0].any()


def test_who_keeps_to_the_road_is_not_doubted():
    output = in_a_tunnel(0.0)
    exceeded, level = beyond(output)
    assert not exceeded.any()
    assert level.max() < 40.0
    assert output.rows.p_off_road[DRIVE.time > 10.0].max() < 0.01


def test_a_fix_ends_the_doubt():
    output = in_a_tunnel(0.6, back=100.0)
    _, level = beyond(output)
    assert level[(DRIVE.time > 95.0) & (DRIVE.time < 100.0)].min() > 150.0
    assert level[DRIVE.time > 110.0].max() < 40.0


def test_who_was_off_the_roads_before_is_not_doubted():
    """It has left the road by 150 m when fixes end."""
    drive = drive_along([[20.0, -1.75], [200.0, -1.75], [380.0, 150.0], [1000.0, 150.0]])
    output = in_a_tunnel(0.0, drive=drive)
    silent = drive.time > SILENT + 5.0
    assert output.rows.p_off_road[silent].mean() > 0.9
    exceeded, level = beyond(output, drive)
    assert not exceeded[silent].any()
    assert level.max() < 60.0


def test_roads_that_fit_again_end_the_doubt():
    """The vehicle itself leaves the road in the tunnel, and comes back to it."""
    line = [[20.0, -1.75], [700.0, -1.75], [800.0, 60.0], [900.0, 60.0], [1000.0, -1.75],
            [2000.0, -1.75]]  # fmt: skip
    drive = drive_along(line, radius=30.0)
    output = in_a_tunnel(0.0, drive=drive)
    _, level = beyond(output, drive)
    x = output.rows.x
    assert level[(x > 860.0) & (x < 900.0)].min() > 100.0
    assert level[x > 1400.0].max() < 60.0
    assert output.rows.p_off_road[x > 1400.0].max() < 0.01
