"""Maps and roads of `benchmarks worlds`: identity is kept under every fault of the map."""

from itertools import pairwise

import numpy as np
import pytest
from benchmarks.worlds.drivers import Truth, roads_along, without_shortcuts
from benchmarks.worlds.faults import FAULTS, Event
from benchmarks.worlds.maps import INVENTED, beside, draw_map
from benchmarks.worlds.nets import Net, Street
from benchmarks.worlds.situations import situations


def town(side: int = 6, block: float = 150.0) -> Net:
    """A grid of two-way streets; its first row is one-way and eastbound."""
    streets, leaving, code = [], {}, {}
    for i in range(side):
        for j in range(side):
            for k, h in ((i + 1, j), (i, j + 1)):
                if k < side and h < side:
                    ends = f"{i}.{j}", f"{k}.{h}"
                    line = block * np.array([[i, j], [0.5 * (i + k), 0.5 * (j + h)], [k, h]])
                    oneway = j == h == 0
                    streets.append(Street(line, ends, 2, oneway, "residential", 13.9, False))
    for n, s in enumerate(streets):
        leaving.setdefault(s.nodes[0], []).append(2 * n)
        code[f"{n}"] = 2 * n
        if not s.oneway:
            leaving.setdefault(s.nodes[1], []).append(2 * n + 1)
            code[f"-{n}"] = 2 * n + 1
    return Net(None, 49.0, 8.0, streets, code, {}, leaving)


def at_each_end(net: Net, chart, code: int) -> np.ndarray:
    """Where the map's road of a code runs, (n, 2) m."""
    edges = np.flatnonzero(chart.road_of_edge == chart.road_of_code[code])
    roads = chart.roads
    parts = []
    for e in edges:
        line = roads.edge_line(int(e))
        lat, lon = roads.plane.to_geodetic(line[:, 0], line[:, 1])
        parts.append(chart.plane.metres(lon, lat))
    return np.vstack(parts)


@pytest.mark.parametrize("name", ["none", *[n for n, f in FAULTS.items() if f.part == "map"]])
def test_each_true_road_is_the_maps_road_at_its_place(name):
    net = town()
    chart = draw_map(net, [Event(name, 0.0, 1.0)], np.random.default_rng(5))
    slack = {"shift": 32.0, "warp": 30.0, "chords": 15.0}.get(name, 9.0)
    missing = 0
    for code in net.code.values():
        if chart.road_of_code[code] < 0:
            missing += 1
            continue
        line = at_each_end(net, chart, code)
        for end in (net.line(code)[0], net.line(code)[-1]):
            assert np.hypot(*(line - end).T).min() < slack
    assert (missing > 0) == (name == "missing")


def test_both_directions_of_a_street_are_two_roads():
    net = town()
    chart = draw_map(net, [], np.random.default_rng(6))
    both = [n for n, s in enumerate(net.streets) if not s.oneway]
    for n in both:
        assert chart.road_of_code[2 * n] != chart.road_of_code[2 * n + 1]


def test_invented_streets_belong_to_no_true_road_and_make_decisions():
    net = town()
    chart = draw_map(net, [Event("invented", 0.0, 1.0)], np.random.default_rng(7))
    ids = [int(i) for i in chart.roads.drawn_as(np.arange(len(chart.roads.pieces.way)))[0]]
    assert sum(i >= INVENTED for i in ids) >= 2
    assert chart.false_nodes
    assert len(chart.lines) > len(net.streets)


def test_a_street_beside_another_leaves_it_and_comes_back():
    line = np.array([[0.0, 0.0], [200.0, 0.0]])
    other = beside(line, 10.0)
    assert other[[0, -1]].tolist() == line.tolist()
    assert other[:, 1].max() == pytest.approx(10.0)


def drive_along(points: list[tuple[float, float]], cut: float = 0.0) -> Truth:
    """A drive at 10 m/s over points, one row every 0.1 s."""
    p = np.array(points, float)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(p, axis=0).T))])
    s = np.arange(0.0, along[-1], 1.0)
    x, y = (np.interp(s, along, p[:, i]) for i in (0, 1))
    heading = np.arctan2(np.gradient(y), np.gradient(x))
    return Truth(0.1 * s, x, y + cut, np.unwrap(heading), s, np.full(len(s), -1))


def route_of(net: Net, *nodes: str) -> list[int]:
    ends = {net.ends(c): c for c in net.code.values()}
    return [ends[pair] for pair in pairwise(nodes)]


def test_a_rows_road_follows_the_lines_even_where_a_loop_comes_back():
    net = town()
    route = route_of(net, "0.1", "1.1", "2.1", "2.2", "1.2", "1.1", "1.2")
    truth = drive_along(
        [(0, 150), (150, 150), (300, 150), (300, 300), (150, 300), (150, 150), (152, 148),
         (152, 290)], cut=2.0,
    )  # fmt: skip
    code, along = roads_along(truth, route, net)
    assert along == pytest.approx(truth.travel, abs=8.0)
    seen = code[np.concatenate([[True], np.diff(code) != 0])].tolist()
    assert seen == route
    change = truth.travel[np.flatnonzero(np.diff(code)) + 1]
    assert change == pytest.approx([150, 300, 450, 600, 750], abs=8.0)


def test_decisions_are_passed_at_nodes_of_three_streets_with_their_kind():
    net = town()
    chart = draw_map(net, [], np.random.default_rng(8))
    route = route_of(net, "0.0", "1.0", "2.0", "2.1")
    truth = drive_along([(0, 0), (150, 0), (300, 0), (300, 150)])
    truth = Truth(
        truth.time, truth.x, truth.y, truth.heading, truth.travel, roads_along(truth, route, net)[0]
    )
    times, kinds = situations(net, chart, truth)
    assert times == pytest.approx([15.0, 30.0], abs=0.8)
    assert kinds == [frozenset({"junction"})] * 2


def test_a_drive_is_cut_where_it_skips_a_part_of_its_route():
    travel = np.arange(0.0, 1000.0, 0.5)
    assert without_shortcuts(travel, travel) == slice(0, 2000)
    skips = travel + np.where(travel > 300.0, 60.0, 0.0)
    part = without_shortcuts(travel, skips)
    assert travel[part.start] == pytest.approx(300.0, abs=25.0)
    assert part.stop == 2000
    round_ = travel + 10.0 * np.floor(travel / 100.0)  # corners that lie 10 m off the lines
    assert without_shortcuts(travel, round_) == slice(0, 2000)
