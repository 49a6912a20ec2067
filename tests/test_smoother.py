"""What looking back says: laws that hold for every lag, and routes that are roads."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given

import whichroad
from oracles.chains import all_chains, random_history
from scenes import Town, columns, drive_along, epochs_of, gnss, grid_town, network
from strategies import seeds
from whichroad._compile import Records
from whichroad.epochs import Timeline
from whichroad.errors import SettingError
from whichroad.filter.lookback.passage import joins
from whichroad.filter.state import CLOCK, OFF_ROAD, WHEELS, new_path
from whichroad.geodesy.plane import Plane
from whichroad.graph.network import TURN, records
from whichroad.lookback.path import Alternative, Route, alternatives, best_routes, shortest
from whichroad.lookback.smoothing import Lag
from whichroad.observations import GeoFix
from whichroad.online import Localizer
from whichroad.recorded import Recorded, localize_recorded
from whichroad.simulate.town import draw_town

PLANE = Plane(49.4, 8.7)
TOWN = Town(network(grid_town(5, 4, 120.0), curvature=PLANE.curvature), PLANE)
CROSSINGS = [(0, 0), (1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (3, 3)]  # of the town
CORNERS = [[i * 120.0 + 10.0 * math.sin(j), j * 120.0 + 8.0 * math.cos(i)] for i, j in CROSSINGS]
TRUTH = drive_along(CORNERS)
POSE = "x y heading xx xy yy hh p_edge"


def epochs(mode: int = WHEELS, seed: int = 1) -> Records:
    rows = gnss(TRUTH, sigma=3.0, seed=seed)
    at = np.arange(0, len(TRUTH.time), 10)
    found = epochs_of(TRUTH, rows, at, course=0.1)
    return found if mode == WHEELS else found[at]


def look(lag: object, mode: int = WHEELS, seed: int = 1, until: int | None = None) -> Recorded:
    rows = epochs(mode, seed)[:until]
    return localize_recorded(TOWN, Timeline(rows, mode, 0), lag=Lag.of(lag))


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
def test_asking_for_a_lag_leaves_the_filter_as_it_is(mode: int):
    plain, asked = look(None, mode), look("full", mode)
    assert plain.past is None
    assert asked.past is not None
    for a, b in zip(plain.output, asked.past.filtered, strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(plain.output, look(0, mode).output, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
@pytest.mark.parametrize("lag", [math.inf, "inf", 1e6, "1e6m"])
def test_a_lag_beyond_the_drive_is_full_smoothing(lag: object, mode: int):
    full, late = look("full", mode), look(lag, mode)
    for a, b in zip(full.output, late.output, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(full.chain.edge, late.chain.edge)


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
def test_at_the_end_smoothing_is_filtering(mode: int):
    full = look("full", mode)
    plain = look(None, mode)
    assert full.past is not None
    history = full.past.history
    last = int(history.steps.epoch[history.count[0].steps - 1])
    a, b = (columns(one.output, POSE)[last] for one in (full, plain))
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
    assert full.output.rows.edge[last] == plain.output.rows.edge[last]


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
def test_probabilities_sum_to_one_and_shares_too(mode: int):
    full = look("full", mode)
    assert full.past is not None
    history = full.past.history
    steps, nodes, links = history.count[0].tolist()
    first = history.steps.first_node[:steps]
    for p in (history.nodes.p, history.nodes.smoothed):
        np.testing.assert_allclose(np.add.reduceat(p[:nodes], first), 1.0, atol=1e-6)
    after = int(history.steps.first_node[1])
    share = np.add.reduceat(history.links.share[:links], history.nodes.first_link[after:nodes])
    np.testing.assert_allclose(share, 1.0, atol=1e-3)


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
def test_a_fixed_lag_looks_back_from_so_much_later(mode: int):
    """Each epoch is what full smoothing of a drive that ends then makes of it."""
    lagged, full = look(8, mode), look("full", mode)
    assert lagged.past is not None
    time = lagged.past.epochs.time
    steps = lagged.past.history.steps[: lagged.past.history.count[0].steps]
    pose = columns(lagged.output, POSE)
    checked = 0
    for step in steps[:: max(len(steps) // 6, 1)]:
        k = int(step.epoch)
        for later in steps.epoch[steps.time >= step.time + 8.0][:8]:
            short = look("full", mode, until=int(later) + 1).output
            if np.allclose(columns(short, POSE)[k], pose[k], atol=1e-9):
                assert time[later] - time[k] <= 8.0 * 1.125 + 1.0 + 1e-6
                checked += 1
                break
    assert checked >= 4
    assert not np.allclose(pose, columns(full.output, POSE))


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
@pytest.mark.parametrize("lag", [5, "full"])
def test_the_route_is_connected_and_ends_where_the_drive_does(lag: object, mode: int):
    answer = look(lag, mode)
    edges = [e for e in answer.chain.edge.tolist() if e != OFF_ROAD]
    for a, b in itertools.pairwise(edges):
        assert joins(TOWN.arrays, a, b)
    assert (np.diff(answer.chain.time) >= 0.0).all()
    assert len(edges) >= 5


def test_looking_back_finds_the_truth_more_surely():
    """Positions over some receivers: nearer, and as far off as said."""
    squared, nees = np.zeros(2), np.zeros(2)
    n = 0
    for seed in range(6):
        full = look("full", WHEELS, seed)
        assert full.past is not None
        for i, output in enumerate((full.past.filtered, full.output)):
            v = columns(output, "x y xx xy xy yy")[50:]
            error = v[:, :2] - np.column_stack([TRUTH.x, TRUTH.y])[50:]
            cov = v[:, 2:].reshape(-1, 2, 2)
            squared[i] += (error**2).sum()
            nees[i] += np.einsum("ni,ni->", error, np.linalg.solve(cov, error[..., None])[..., 0])
        n += len(v)
    assert squared[1] < 0.9 * squared[0]
    assert nees[1] / (2 * n) < 1.3
    assert full.past is not None
    assert full.past.decided_until() == pytest.approx(TRUTH.time[-1], abs=8.0)


def fixes() -> list[GeoFix]:
    rows = epochs(CLOCK)
    lat, lon = PLANE.to_geodetic(rows.fix[:, 0], rows.fix[:, 1])
    return [
        GeoFix(float(t), float(a), float(o), 9.0, 0.0, 9.0)
        for t, a, o in zip(rows.time, lat, lon, strict=True)
    ]


def test_on_line_a_lag_ago_is_the_drive_so_far_looked_back_over():
    online = Localizer(TOWN, lag=10)
    seen = fixes()
    for k, fix in enumerate(seen):
        now = online.update(fix)
        lagged = online.lagged()
        if k < 10:
            assert lagged is None
        if k % 13 != 12:
            continue
        rows = [online.roads.plane.from_geodetic(np.array([f.lat_deg]), np.array([f.lon_deg]))
                for f in seen[: k + 1]]  # fmt: skip
        drive = epochs(CLOCK)[: k + 1]
        drive.fix[:, 0], drive.fix[:, 1] = np.array(rows)[:, 0, 0], np.array(rows)[:, 1, 0]
        drive.fix[:, 2:4], drive.course_sigma[:] = 3.0, np.inf
        batch = localize_recorded(TOWN, Timeline(drive, CLOCK, 0), lag=Lag.of("full"))
        assert lagged is not None
        at = int(np.argmin(np.abs(drive.time - lagged.time)))
        row = batch.output.rows[at]
        assert lagged.time == pytest.approx(now.time - 10.0, abs=1.0)
        assert [lagged.pose.x, lagged.pose.y] == pytest.approx([row.x, row.y], abs=0.05)
        assert lagged.p_road == pytest.approx(row.p_edge, abs=0.02)
    decided = online.decided_until
    assert decided is not None
    assert seen[-1].time - 30.0 < decided <= seen[-1].time


def test_a_long_drive_on_line_stays_small():
    online = Localizer(TOWN, lag=2)
    start = fixes()
    size = 0
    for k in range(1200):
        fix = start[min(k, 40)]
        online.update(GeoFix(float(k), fix.lat_deg, fix.lon_deg, 9.0, 0.0, 9.0))
        if k == 400:
            size = len(online._past.history.steps)  # type: ignore[union-attr]
    assert online._past is not None
    assert len(online._past.history.steps) == size
    assert online.lagged() is not None


def test_lags_that_make_no_sense_are_refused():
    for lag in (-1, "soon", "5km", True, float("nan")):
        with pytest.raises(SettingError, match="lag is"):
            Lag.of(lag)
    for lag in ("full", "100m"):
        with pytest.raises(SettingError, match="seconds"):
            Localizer(TOWN, lag=lag)
    with pytest.raises(SettingError, match="lag is None"):
        Localizer(TOWN).lagged()
    assert str(Lag.of("200m")) == "200m"
    assert str(Lag.of(7)) == "7s"
    assert str(Lag.of("full")) == "full"


@given(seeds)
def test_ways_have_the_probability_of_all_their_chains(seed: int):
    history = random_history(seed, edges=3)
    chains = all_chains(history)
    # every edge is followed by every other: two streets and a way round
    roads = network([[[0, 0], [100, 0]], [[100, 0], [0, 0.1]], [[0, 0.1], [100, 0.1]]])
    table = history.nodes
    table.smoothed = table.p
    table.path_entry = -1
    exact: dict[tuple[int, ...], float] = {}
    for nodes, p in zip(chains.nodes, chains.p, strict=True):
        edges = tuple(int(e) for e, _ in itertools.groupby(table.edge[nodes]))
        exact[edges] = exact.get(edges, 0.0) + p
    turns = records(36, TURN)
    turns.edge = np.tile(np.arange(6), 6)
    roads.edges.first_turn, roads.edges.end_turn = 6 * np.arange(6), 6 * np.arange(1, 7)
    last = int(history.steps[history.count[0].steps - 1].first_node)
    table.smoothed[:last] *= 0.5  # nothing is sure before the end
    parts = alternatives(history, new_path(1), roads._replace(turns=turns))
    if len(parts) != 1:
        return
    for route in parts[0].routes:
        assert route.p == pytest.approx(exact[route.edges], abs=2e-3)


def test_routes_come_in_the_order_of_their_probability():
    one = Alternative(0.0, 1.0, (Route(0.7, (0, 1, 2)), Route(0.3, (0, 5, 2))))
    two = Alternative(3.0, 4.0, (Route(0.6, (2, 3)), Route(0.4, (2, 4, 3))))
    routes = best_routes([one, two], 10)
    assert [r.p for r in routes] == pytest.approx([0.42, 0.28, 0.18, 0.12])
    assert routes[0].edges == (0, 1, 2, 3)
    assert routes[3].edges == (0, 5, 2, 4, 3)
    assert math.fsum(r.p for r in routes) == pytest.approx(1.0)


def test_a_way_that_no_hypothesis_took_is_the_shortest():
    arrays = TOWN.arrays
    a = 0
    edges = arrays.edges

    def after(edge: int) -> list[int]:
        follow = arrays.turns.edge[edges.first_turn[edge] : edges.end_turn[edge]]
        return follow[follow != edges.opposite[edge]].tolist()

    b = after(a)[0]
    c = next(e for e in after(b) if not joins(arrays, a, e))
    between = shortest(arrays, a, c)
    assert between is not None
    assert len(between) == 1
    assert joins(arrays, between[-1], c)
    assert shortest(arrays, a, b) == []


def test_the_call_for_people_tells_lag_routes_and_alternatives(tmp_path):
    (tmp_path / "town.osm").write_text(draw_town())
    roads = whichroad.RoadMap.from_osm(tmp_path / "town.osm")
    drive = whichroad.simulate_drive(roads, seed=1, length_m=1500.0)
    plain = whichroad.match(drive.drive, roads, vehicle=drive.vehicle)
    with pytest.raises(SettingError, match="no lag"):
        plain.routes()
    result = whichroad.match(drive.drive, roads, vehicle=drive.vehicle, lag="full")
    assert result.summary["lag"] == "full"
    assert "lag" not in plain.summary
    routes = result.routes(2)
    assert 0.0 < routes[0].p <= 1.0
    assert all(joins(roads.arrays, a, b) for a, b in itertools.pairwise(routes[0].edges))
    for part in result.alternatives:
        assert len(part.routes) > 1
        assert part.start <= part.end
    with pytest.raises(SettingError, match="paper"):
        whichroad.match(drive.drive, roads, model="paper", lag=5)
