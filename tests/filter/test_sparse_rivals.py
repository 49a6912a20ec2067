"""Between two fixes an edge is as sure as the routes that pass it are likely together."""

import numpy as np
import pytest

from scenes import localize, network
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, new_epochs
from whichroad.graph.network import Roads
from whichroad.lookback.path import alternatives
from whichroad.lookback.traversals import traversals

FIXES = (60.0, 460.0, 940.0, 1340.0)  # m along the road, the ways being between the middle two
UPPER, LOWER = (10, 12), (14, 16)  # edges, as below


def ways(upper: float, lower: float) -> Roads:
    """A road of 1.5 km with two ways from 500 to 900 m, so far above and below its line, m."""
    before = [[[100.0 * k, 0.0], [100.0 * k + 100.0, 0.0]] for k in range(5)]
    above = [[[500.0, 0.0], [700.0, upper]], [[700.0, upper], [900.0, 0.0]]]
    below = [[[500.0, 0.0], [700.0, -lower]], [[700.0, -lower], [900.0, 0.0]]]
    after = [[[100.0 * k, 0.0], [100.0 * k + 100.0, 0.0]] for k in range(9, 15)]
    return network([*before, *above, *below, *after])


def seen_every_30_s(fixes: tuple[float, ...] = FIXES) -> Records:
    """A vehicle on the road."""
    epochs: Records = new_epochs(len(fixes))
    epochs.time[:] = 30.0 * np.arange(len(fixes))
    epochs.has_fix[:] = 1
    epochs.fix[:, 0] = fixes
    epochs.fix[:, 1] = -1.75
    epochs.fix[:, 2:4] = 5.0
    epochs.speed_sigma[:] = np.inf
    epochs.course_sigma[:] = np.inf
    return epochs


def said(
    roads: Roads, lag: object, column: str = "p", fixes: tuple[float, ...] = FIXES
) -> dict[int, float]:
    """P of each edge of the path of the vehicle, or of its route."""
    epochs = seen_every_30_s(fixes)
    found = localize(roads, epochs, mode=CLOCK, lag=lag)
    rows = traversals(epochs, found.output, found.chain, roads)
    return dict(zip(rows.edge.tolist(), rows[column].tolist(), strict=True))


@pytest.mark.parametrize("lag", [None, "full"])
def test_of_two_ways_alike_neither_is_sure(lag: object):
    p = said(ways(100.0, 101.0), lag)
    assert (set(UPPER) <= set(p)) != (set(LOWER) <= set(p))
    for edge in {*UPPER, *LOWER} & set(p):
        assert 0.4 < p[edge] < 0.65
    assert min(p[8], p[18]) > 0.9  # before the fork, behind the ways


def test_a_way_that_is_much_longer_is_nothing_against_the_other():
    p = said(ways(100.0, 600.0), None)
    assert all(p[edge] > 0.97 for edge in UPPER)


def test_the_longer_the_other_way_the_surer_the_edge():
    p = [said(ways(100.0, lower), None)[UPPER[0]] for lower in (110.0, 180.0, 260.0)]
    assert p == sorted(p)
    assert p[0] < 0.7
    assert p[2] > 0.9


@pytest.mark.parametrize("lag", [None, "full"])
def test_a_route_is_at_most_as_sure_as_each_of_its_edges(lag: object):
    fixes = (60.0, 360.0, 940.0, 1340.0)
    p, route = (said(ways(100.0, 130.0), lag, column, fixes) for column in ("p", "p_route"))
    assert all(route[edge] <= p[edge] + 1e-9 for edge in p)
    assert route[UPPER[0]] == pytest.approx(p[UPPER[0]], abs=0.01)  # the one rival avoids both
    assert route[8] == pytest.approx(route[UPPER[0]], abs=1e-6)  # which no rival avoids
    assert p[8] > 0.97 > route[8]
    assert route[18] == p[18]  # a fix lies on it


def test_the_way_that_was_not_taken_is_told_with_its_probability():
    roads = ways(100.0, 130.0)
    past = localize(roads, seen_every_30_s(), mode=CLOCK, lag="full").past
    assert past is not None
    p_upper = said(roads, "full", "p_route")[UPPER[0]]
    parts = alternatives(past.history, past.path, roads)
    (doubtful,) = (part for part in parts if set(UPPER) <= set(part.routes[0].edges))
    first, second = doubtful.routes
    assert set(UPPER) <= set(first.edges)
    assert set(LOWER) <= set(second.edges)
    assert first.p == pytest.approx(p_upper, abs=0.02)
    assert first.p + second.p == pytest.approx(1.0, abs=0.01)
    untold = alternatives(past.history, past.path, roads, told=False)
    assert min(part.routes[0].p for part in untold) == pytest.approx(first.p, abs=1e-6)
