"""Probability is neither made nor lost, whatever happens to the candidates."""

import numpy as np
import pytest
from hypothesis import given

from laws.drives import law, said, sensed, way_through
from laws.geodetic import CAR, degrees, drive, fixes, road_map
from scenes import Truth, drive_along, gnss, grid_town, living, network, steps, weights
from strategies import seeds
from whichroad import Localizer
from whichroad.filter.state import CLOCK, DISTANCE, KEPT, WHEELS
from whichroad.observations import GeoFix

TOWN = grid_town()
# the same with a node in the middle of each street, where the road just runs on
CUT = [half for a, b in TOWN for half in ([a, np.add(a, b) / 2], [np.add(a, b) / 2, b])]
MODES = pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
EXACT = 1e-12


def messy(seed: int) -> tuple[Truth, np.ndarray, np.ndarray]:
    """All at once: a way through the town, a U-turn in the street, a short cut over no road.

    Then half a minute without fixes, then a receiver that is 300 m off for twenty seconds,
    which starts the filter anew, and again when it comes back.
    """
    rng = np.random.default_rng(seed)
    way = way_through(seed, 4)
    ahead = way[1] - way[0]
    size = np.hypot(*ahead)
    left = np.array([-ahead[1], ahead[0]]) / size
    back = way[0] + 0.6 * ahead
    turned = np.vstack([way[0], back, back + 4.0 * left, way[0] + 0.1 * ahead + 4.0 * left])
    hairpin = True
    while hairpin:  # those cannot be driven
        line = np.vstack([turned, turned[-1] + rng.uniform(-200.0, 200.0, 2), way[2:]])
        heading = np.arctan2(*np.diff(line, axis=0).T[::-1])
        hairpin = bool((np.cos(np.diff(heading)) < -0.8).any())
    truth = drive_along(line, radius=1.5, speed=9.7)
    fix = gnss(truth, sigma=rng.uniform(1.0, 8.0), seed=seed)
    n = len(truth.time)
    at = np.arange(0, n, 10)
    dark = int(rng.integers(50, n - 350))
    lost = int(rng.integers(50, n - 250))
    fix[lost : lost + 200, :2] += rng.choice([-300.0, 300.0], 2)
    return truth, fix, at[(at < dark) | (at > dark + 300)]


@MODES
@given(seed=seeds)
@law
def test_roads_and_no_road_have_one_between_them_at_every_epoch_of_a_messy_drive(mode, seed):
    truth, fix, at = messy(seed)
    roads = network(TOWN, one_way=np.random.default_rng(seed).choice(len(TOWN), 6).tolist())
    told = said(roads, sensed(truth, fix, at, mode), [range(len(roads.edges))], mode=mode)
    np.testing.assert_allclose(told.p[:, 0] + told.off, 1.0, rtol=0.0, atol=EXACT)
    assert told.off.min() >= 0.0
    assert told.p.min() >= 0.0


# streets every 15 m: some 400 directed edges within reach of a fix of 25 m
DENSE = network(grid_town(14, 14, 15.0))


@MODES
@given(seed=seeds)
@law
def test_with_more_candidates_than_there_is_room_for_they_still_have_one_between_them(mode, seed):
    rng = np.random.default_rng(seed)
    way = way_through(seed, 8, 14, 14, 15.0)
    truth = drive_along(way, radius=2.0, speed=4.7, margin=1.0)
    fix = gnss(truth, sigma=25.0, seed=seed)
    at = np.arange(0, len(truth.time), int(rng.integers(5, 40)))
    epochs = sensed(truth, fix, at, mode, course=np.inf)
    most = 0
    for k, belief, _ in steps(DENSE, epochs, mode=mode):
        alive = living(belief)
        most = max(most, len(alive))
        assert len(alive) <= KEPT, k
        assert alive.weight.min() >= 0.0, k
        assert abs(alive.weight.sum() - 1.0) <= EXACT, k
        np.testing.assert_allclose(weights(belief), alive.weight, atol=EXACT)
    assert most == KEPT


@pytest.mark.parametrize("lines", [TOWN, CUT], ids=["streets", "streets of two edges"])
@given(seed=seeds)
@law
def test_on_line_the_hypotheses_have_one_between_them(lines, seed: int):
    truth, fix, at = messy(seed)
    log = drive(truth, fixes(truth, fix, at), CLOCK).fixes
    online = Localizer(road_map([degrees(line) for line in lines]), vehicle=CAR)
    columns = [getattr(log, name).tolist() for name in GeoFix.__slots__]
    for row in zip(*columns, strict=True):
        estimate = online.update(GeoFix(*row))
        p = {h.edge: 0.0 for h in estimate.hypotheses}
        for h in estimate.hypotheses:
            p[h.edge] += h.p
        assert abs(sum(p.values()) - 1.0) <= EXACT
        assert abs(p.get(None, 0.0) - estimate.p_off_road) <= EXACT
        assert estimate.edge is None or abs(p[estimate.edge] - estimate.p_road) <= EXACT
