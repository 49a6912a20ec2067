"""Who stood near a junction with a slow side road drives off along a fast one, and is followed."""

from itertools import pairwise

import numpy as np
import pytest

from scenes import localize, network
from whichroad._compile import Records
from whichroad.filter.sparse.candidates import usual_speed
from whichroad.filter.state import CLOCK, new_epochs
from whichroad.graph.network import Roads
from whichroad.graph.route_costs import edge_costs

FAST, SLOW = 19.4, 4.2  # m/s, usual on the main road and on the side road
STANDS, SECONDS = 75.0, 15.0  # s: as long; between fixes


def junction(side: tuple[float, float]) -> Roads:
    """A main road along y = 0, and at x = 0 a short side road to a point."""
    main = [-900.0, -140.0, 0.0, 1650.0]
    roads = network([*([[a, 0.0], [b, 0.0]] for a, b in pairwise(main)), [[0.0, 0.0], side]])
    roads.edges.speed[:6] = FAST
    roads.edges.speed[6:] = SLOW
    edge_costs(roads.edges, roads.vertices)
    return roads


def drive(speed: float, waits: float) -> Records:
    """Stands 12 m before the junction, and drives off so many seconds after a fix; exact fixes."""
    time = np.arange(0.0, 180.0, SECONDS)
    moves = np.maximum(time - STANDS - waits, 0.0)
    spends = speed / 1.5  # s, to get up to its speed
    metres = 0.75 * np.minimum(moves, spends) ** 2 + speed * np.maximum(moves - spends, 0.0)
    epochs = new_epochs(len(time))
    epochs.time[:] = time
    epochs.has_fix[:] = 1
    epochs.fix[:, 0] = np.where(time == 0.0, -200.0, metres - 12.0)
    epochs.fix[:, 2:4] = 5.0
    epochs.speed_sigma[:] = np.inf
    epochs.course_sigma[:] = np.inf
    return epochs


@pytest.mark.parametrize("side", [(-10.0, 24.0), (0.0, 30.0), (-20.0, 40.0)])
@pytest.mark.parametrize("speed", [12.0, 19.4])
@pytest.mark.parametrize("waits", [0.0, 10.0])
def test_who_drives_off_past_a_slow_side_road_is_followed(
    side: tuple[float, float], speed: float, waits: float
):
    epochs = drive(speed, waits)
    rows = localize(junction(side), epochs, mode=CLOCK).output.rows
    assert np.hypot(rows.x - epochs.fix[:, 0], rows.y - epochs.fix[:, 1]).max() < 20.0
    assert rows.edge[-4:].tolist() == [4] * 4


def test_the_usual_speed_of_a_route_counts_what_is_driven_on_its_last_edge():
    roads = junction((0.0, 30.0))
    seconds = 30.0 / SLOW + 300.0 / FAST
    assert usual_speed(roads, 30.0, 30.0 / SLOW, 4, 300.0) == pytest.approx(330.0 / seconds)
    assert usual_speed(roads, 0.0, 0.0, 4, 0.0) == pytest.approx(FAST)
