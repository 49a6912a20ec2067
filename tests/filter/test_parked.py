"""Who stands beside a road, in a yard or a car park, is not said to stand on it."""

import numpy as np
import pytest

from scenes import localize, network
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, OFF_ROAD, new_epochs
from whichroad.filter.summary.estimate import STOPPED
from whichroad.lookback.traversals import traversals
from whichroad.settings import Settings

# a street in edges of 200 m; edge 2 i + 1 is edge 2 i back
ROADS = network([[[200.0 * k, 0.0], [200.0 * k + 200.0, 0.0]] for k in range(10)])
HONEST = Settings(gnss_inflation=1.0)  # the receiver errs as it says
STOPS, STANDS = 60.0, 240.0  # s: drives, then stands


def drive(seconds: float, aside: float, leaves: float = np.inf) -> Records:
    """14 m/s along the street; stands so many metres beside it; drives on from some time."""
    time = np.arange(0.0, min(STOPS + STANDS, leaves) + 60.0, seconds)
    epochs = new_epochs(len(time))
    epochs.time[:] = time
    epochs.has_fix[:] = 1
    stands = (time >= STOPS) & (time < leaves)
    epochs.fix[:, 0] = 100.0 + 14.0 * np.minimum(time, STOPS) + 14.0 * np.maximum(time - leaves, 0)
    epochs.fix[:, 1] = np.where(stands, -aside, -1.75)
    epochs.fix[:, :2] += np.random.default_rng(1).normal(0.0, 2.0, (len(time), 2))
    epochs.fix[:, 2:4] = 5.0
    epochs.speed_sigma[:] = np.inf
    epochs.course_sigma[:] = np.inf
    return epochs


def off_road(epochs: Records) -> np.ndarray:
    return np.asarray(localize(ROADS, epochs, settings=HONEST, mode=CLOCK).output.rows.p_off_road)


@pytest.mark.parametrize("seconds", [5.0, 10.0])
@pytest.mark.parametrize("aside", [22.0, -30.0])
def test_fixes_that_stay_beside_a_road_show_that_the_vehicle_does(seconds: float, aside: float):
    assert off_road(drive(seconds, aside))[-1] > 0.9


@pytest.mark.parametrize("seconds", [5.0, 10.0, 30.0])
def test_who_stands_on_the_road_is_on_it(seconds: float):
    assert off_road(drive(seconds, 1.75))[-1] < 0.2


def test_how_long_a_vehicle_stands_does_not_speak_for_the_yard():
    p = off_road(drive(5.0, 1.75))
    assert p[-1] < p[len(p) // 2] + 0.1


@pytest.mark.parametrize("seconds", [5.0, 10.0])
def test_who_stands_on_the_road_has_stopped(seconds: float):
    epochs = drive(seconds, 1.75)
    status = localize(ROADS, epochs, settings=HONEST, mode=CLOCK).output.rows.status
    assert np.mean(status[epochs.time > STOPS + 90.0] == STOPPED) > 0.8


@pytest.mark.parametrize("seconds", [3.0, 10.0, 30.0])
@pytest.mark.parametrize("lag", [None, "full"])
def test_an_hour_of_fixes_that_err_alike_tells_a_place_no_better_than_a_minute(
    seconds: float, lag: str | None
):
    time = np.arange(0.0, 3600.0, seconds)
    epochs = new_epochs(len(time))
    epochs.time[:] = time
    epochs.has_fix[:] = 1
    x = 100.0 + 14.0 * np.minimum(time, STOPS)
    noise = np.random.default_rng(2).normal(0.0, 0.7, (2, len(time)))
    epochs.fix[:, 0], epochs.fix[:, 1] = x + 4.0 + noise[0], -5.75 + noise[1]
    epochs.fix[:, 2:4] = 4.0
    epochs.speed_sigma[:] = epochs.course_sigma[:] = np.inf
    rows = localize(ROADS, epochs, mode=CLOCK, lag=lag).output.rows
    late = time > 600.0
    wrong = np.hypot(rows.x - x, rows.y + 1.75)[late]
    assert (wrong < rows.protection_level[late]).all()
    assert np.mean(wrong**2) < 4.0 * np.mean(rows.cov[late, 0] + rows.cov[late, 3])


@pytest.mark.parametrize("seconds", [5.0, 20.0])
def test_who_leaves_a_yard_is_on_its_road_again(seconds: float):
    epochs = drive(seconds, 25.0, leaves=STOPS + 120.0)
    found = localize(ROADS, epochs, settings=HONEST, mode=CLOCK)
    rows = found.output.rows
    stood = (epochs.time > STOPS + 60.0) & (epochs.time < STOPS + 120.0)
    assert (rows.alt_edge[stood, 0] == OFF_ROAD).all()
    left = epochs.time > STOPS + 125.0 + seconds
    assert rows.p_off_road[left].max() < 0.05
    driven = traversals(epochs, found.output, found.chain, ROADS)
    assert driven.edge.tolist() == [0, 2, 4, 6, 8, 10, 12, 14, 16][: len(driven)]
    end = epochs.fix[-1, 0]
    assert np.sum(driven.exit_m - driven.enter_m) == pytest.approx(end - 100.0, abs=60.0)
