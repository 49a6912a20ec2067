"""Odometry that counts backwards: nobody drives so for long."""

import numpy as np
import pytest

from scenes import Truth, drive_along, epochs_of, gnss, localize, network, straight_road
from whichroad._compile import Records

ROADS = network(straight_road(9000.0))


def driven(metres: float) -> tuple[Truth, Records]:
    """A drive along a straight road, with fixes every second."""
    road = drive_along([[500.0, -1.75], [500.0 + metres, -1.75]])
    return road, epochs_of(road, gnss(road, sigma=2.0, seed=1), np.arange(0, len(road.time), 10))


def about(epochs: Records, rows: slice) -> Records:
    """The same epochs; in some rows distances have the other sign."""
    for name in ("arc", "forward", "left"):
        epochs[name][rows] *= -1.0
    return epochs


@pytest.mark.parametrize("metres", [400.0, 2000.0])
def test_who_counts_backwards_all_the_time_drives_forwards(metres: float):
    road, epochs = driven(metres)
    right = localize(ROADS, epochs.copy()).output.rows
    said = localize(ROADS, about(epochs, slice(None))).output.rows
    late = road.s - road.s[0] > 200.0
    assert (said.edge[late] == right.edge[late]).all()
    assert (said.p_edge[late] > 0.99).all()
    assert said.speed[-1] == pytest.approx(right.speed[-1], rel=0.02)


def test_a_sign_that_is_wrong_from_some_moment_on_is_turned_about_again():
    road, epochs = driven(3000.0)
    where = road.s - road.s[0]
    said = localize(ROADS, about(epochs, slice(len(road.time) // 2, None))).output.rows
    settled = (where > 1800.0) | ((where > 200.0) & (where < 1400.0))
    assert len(np.unique(said.edge[settled])) == 1


def test_who_backs_out_of_a_yard_is_not_turned_about():
    """20 m backwards at a walk, along the road."""
    back = drive_along([[520.0, -1.75], [500.0, -1.75]])
    epochs = epochs_of(back, gnss(back, sigma=2.0, seed=1), np.arange(0, len(back.time), 10))
    epochs.time[:] = epochs.time[0] + 8.0 * (epochs.time - epochs.time[0])
    about(epochs, slice(None))
    said = localize(ROADS, epochs).output.rows
    assert len(np.unique(said.edge[5:])) == 1


def test_a_counter_that_jumps_back_once_turns_nobody_about():
    road, epochs = driven(2000.0)
    epochs.arc[len(road.time) // 2] = epochs.forward[len(road.time) // 2] = -100.0
    said = localize(ROADS, epochs).output.rows
    assert len(np.unique(said.edge[50:])) == 1


def test_who_has_driven_forwards_may_back_up_for_long():
    """400 m forwards, 250 m back at a walk: its sign is known."""
    road = drive_along([[500.0, -1.75], [900.0, -1.75]])
    back = drive_along([[900.0, -1.75], [650.0, -1.75]])
    time = np.concatenate([road.time, road.time[-1] + 1.0 + 4.0 * (back.time - back.time[0])])
    both = Truth(time, *(np.concatenate(pair) for pair in zip(road[1:], back[1:], strict=True)))
    epochs = epochs_of(both, gnss(both, sigma=2.0, seed=1), np.arange(0, len(time), 10))
    about(epochs, slice(len(road.time) + 1, None))
    said = localize(ROADS, epochs).output.rows
    assert len(np.unique(said.edge[50:])) == 1
