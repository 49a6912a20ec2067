"""One fix that is wrong does not take the vehicle off its road, and hides no turn."""

import numpy as np
import pytest

from scenes import localize, network
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, new_epochs
from whichroad.graph.network import bytes_of
from whichroad.lookback.traversals import traversals
from whichroad.workspace import Workspace

# a road of 2 km in edges of 100 m, and streets that lead off it; edge 2 i + 1 is edge 2 i back
ROAD = [[[100.0 * k, 0.0], [100.0 * k + 100.0, 0.0]] for k in range(20)]
STREETS = [[[100.0 * k, 0.0], [100.0 * k, -120.0]] for k in (8, 12)]
ROADS = network(ROAD + STREETS)


def drive(seconds: float, turns_at: float = np.inf) -> Records:
    """14 m/s along the road, or at an abscissa off into the street there."""
    time = seconds * np.arange(1.0 + 1800.0 // (14.0 * seconds))
    epochs = new_epochs(len(time))
    epochs.time[:] = time
    epochs.has_fix[:] = 1
    epochs.fix[:, 0] = 20.0 + 14.0 * time
    epochs.fix[:, 1] = -1.75
    beyond = np.maximum(epochs.fix[:, 0] - turns_at, 0.0)
    epochs.fix[:, 0] -= beyond
    epochs.fix[:, 1] -= beyond
    epochs.fix[:, 2:4] = 5.0
    epochs.speed_sigma[:] = np.inf
    epochs.course_sigma[:] = np.inf
    return epochs


@pytest.mark.parametrize("seconds", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("away", [(0.0, -60.0), (0.0, 75.0), (60.0, -150.0)])
def test_a_vehicle_drives_on_along_its_road(seconds: float, away: tuple[float, float]):
    epochs = drive(seconds)
    wrong = int(np.searchsorted(epochs.fix[:, 0], 790.0))
    epochs.fix[wrong, :2] += away
    found = localize(ROADS, epochs, mode=CLOCK)
    driven = found.chain.edge.tolist()
    assert driven == list(range(0, driven[-1] + 1, 2))
    assert np.abs(found.output.rows.x - 20.0 - 14.0 * epochs.time).max() < 60.0 + 2.0 * seconds


@pytest.mark.parametrize("lag", [None, "full"])
def test_a_fix_that_is_wrong_does_not_hide_a_turn(lag: object):
    """Nobody would drive straight on: the next fix is beside the road, in a street."""
    epochs = drive(5.0, turns_at=800.0)[:13]
    wrong = int(np.searchsorted(-epochs.fix[:, 1], 10.0)) - 1  # the last one before the turn
    epochs.fix[wrong, 1] += 120.0
    found = localize(ROADS, epochs, mode=CLOCK, lag=lag)
    assert found.chain.edge.tolist() == [*range(0, 16, 2), 40]
    rows = traversals(epochs, found.output, found.chain, ROADS)
    assert not rows.gap.any()


def test_what_was_smoothed_before_leaves_no_trace():
    """Buffers are used again: whatever a node holds is written, also where a fix was passed."""
    epochs = drive(5.0, turns_at=800.0)[:13]
    wrong = int(np.searchsorted(-epochs.fix[:, 1], 10.0)) - 1
    epochs.fix[wrong, 1] += 120.0
    first = localize(ROADS, epochs, mode=CLOCK, lag="full").output.rows.copy()
    workspace = Workspace.taken()
    history, _ = workspace.smoothing()
    np.asarray(bytes_of(history.nodes)).fill(0x40)  # 32.5 as a number
    workspace.give_back()
    again = localize(ROADS, epochs, mode=CLOCK, lag="full").output.rows
    for name in first.dtype.names:
        np.testing.assert_array_equal(again[name], first[name], name)


def test_points_and_path_agree_at_a_wrong_fix():
    epochs = drive(10.0)
    wrong = int(np.searchsorted(epochs.fix[:, 0], 790.0))
    epochs.fix[wrong, :2] += (60.0, -150.0)
    found = localize(ROADS, epochs, mode=CLOCK, lag="full")
    rows = traversals(epochs, found.output, found.chain, ROADS)
    row = int(np.searchsorted(rows.exit_time, epochs.time[wrong]))
    assert found.output.rows.edge[wrong] == rows.edge[row]
    assert abs(found.output.rows.x[wrong] - 20.0 - 14.0 * epochs.time[wrong]) < 80.0
