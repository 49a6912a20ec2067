"""Odometry that counts backwards: nobody drives so for long."""

import numpy as np
import pytest

from scenes import Truth, drive_along, epochs_of, gnss, localize, network, straight_road
from whichroad._compile import Records
from whichroad.filter.state import DISTANCE, WHEELS

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


def shuttle(leg: float, back: float) -> tuple[Records, np.ndarray, Records]:
    """That many metres forwards at 10 m/s and back at 8 m/s: epochs, places, and what is said."""
    ramp = np.linspace(0.0, 1.0, 50)
    even = np.ones(round(leg)), np.ones(round(back / 0.8))
    one, other = (np.concatenate([ramp, way, ramp[::-1], np.zeros(60)]) for way in even)
    moved = np.concatenate([np.zeros(40), one, -0.8 * other[:-110]])
    x = 500.0 + np.cumsum(moved)
    n = len(x)
    truth = Truth(0.1 * np.arange(n), x, np.full(n, -1.75), np.zeros(n), np.cumsum(np.abs(moved)))
    epochs = epochs_of(truth, gnss(truth, sigma=2.0, seed=1), np.arange(0, n, 10))
    epochs.arc = epochs.forward = moved
    pieces = [np.array([[a, 0.0], [a + 150.0, 0.0]]) for a in np.arange(0.0, 3000.0, 150.0)]
    sides = [np.array([[a, 0.0], [a, 200.0]]) for a in np.arange(150.0, 3000.0, 150.0)]
    return epochs, x, network(pieces + sides)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("lag", [None, "full"])
def test_a_shuttle_that_drives_back_as_fast_as_forth_faces_as_before(mode: int, lag: str | None):
    epochs, x, roads = shuttle(800.0, 700.0)
    rows = localize(roads, epochs, mode=mode, lag=lag).output.rows
    late = np.arange(len(x)) > 300
    assert (np.abs(rows.heading[late]) < 0.5).all()
    assert (rows.speed[-100:] < -7.0).all()
    assert np.hypot(rows.x - x, rows.y + 1.75)[late].max() < 10.0
    assert (rows.protection_level > np.hypot(rows.x - x, rows.y + 1.75))[late].all()


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
def test_a_sign_that_changes_at_a_stop_is_wrong_where_fixes_drive_on(mode: int):
    epochs, _, _ = shuttle(800.0, 800.0)
    turned = 960  # where it drives back
    epochs.fix[turned:, 0] = 2.0 * epochs.fix[turned - 10, 0] - epochs.fix[turned:, 0]
    rows = localize(ROADS, epochs, mode=mode).output.rows
    assert (np.abs(rows.heading[-600:]) < 0.5).all()
    assert (rows.speed[-600:] > 7.0).all()


def test_who_has_only_driven_backwards_may_face_either_way_until_it_is_found():
    _, epochs = driven(400.0)
    rows = localize(ROADS, about(epochs, slice(None))).output.rows
    assert np.sqrt(rows.cov[28, 5]) > 1.0  # rad; 18 m backwards
    assert rows.p_edge[28] < 0.9
    assert (np.cos(rows.heading[60:]) > 0.9).all()
    assert (np.sqrt(rows.cov[60:, 5]) < 0.3).all()


def test_who_backs_in_reverse_gear_is_not_turned_about():
    _, epochs = driven(600.0)
    epochs.geared = 1
    rows = localize(ROADS, about(epochs, slice(None))).output.rows
    late = slice(100, None)
    assert (rows.speed[late] < 0.0).all()
    assert (np.cos(rows.heading[late]) < 0.0).all()
    assert (np.sqrt(rows.cov[300:, 5]) > 1.0).all()  # the gear's own sign may be wrong
