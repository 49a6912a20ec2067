"""Scenes: what is driven lies on the map, and roads are what they are said to be."""

import numpy as np
import pytest

from whichroad.simulate.scenes import SCENES, Scene, draw_scene

KINDS = list(SCENES)


@pytest.fixture(scope="module", params=[(kind, v) for kind in KINDS for v in (0, 1, 2, 3)])
def scene(request: pytest.FixtureRequest) -> Scene:
    return draw_scene(*request.param)


def test_the_same_number_is_the_same_scene():
    for kind in KINDS:
        a, b = draw_scene(kind, 3), draw_scene(kind, 3)
        np.testing.assert_array_equal(a.roads.arrays.vertices.x, b.roads.arrays.vertices.x)
        np.testing.assert_array_equal(a.routes[0].line.x, b.routes[0].line.x)
        assert not np.array_equal(
            a.roads.arrays.vertices.x, draw_scene(kind, 4).roads.arrays.vertices.x
        )


def test_every_road_that_is_driven_is_on_the_map_or_said_to_be_missing(scene: Scene):
    for route in scene.routes:
        seen = set(route.line.road[route.line.hidden == 0].tolist())
        assert seen <= set(scene.road_of.tolist())
        missing = set(route.line.road[route.line.hidden == 1].tolist())
        assert not missing & set(scene.road_of.tolist())


def test_lines_lie_on_their_roads_and_run_their_way(scene: Scene):
    arrays = scene.roads.arrays
    for route in scene.routes:
        line = route.line
        for k in range(0, len(line.x), 5):
            if line.hidden[k]:
                continue
            best = np.inf
            for edge in np.flatnonzero(scene.road_of == line.road[k]):
                row = arrays.edges[edge]
                part = arrays.vertices[row.first_vertex : row.last_vertex + 1]
                near, s = _nearest(part.x, part.y, line.x[k], line.y[k])
                if near < best:
                    best, at = near, part.s[0] + s
                    heading = scene.roads.at(edge, min(max(at, 0.0), arrays.edges.length[edge]))[2]
            # a corner that is cut with sigma 4 m: sqrt(2 / pi) 4 m sin(45 degrees) = 2.3 m
            assert best < 2.6
            if 10 < k < len(line.x) - 10 and len(set(line.road[k - 10 : k + 10].tolist())) == 1:
                way = np.arctan2(line.y[k + 1] - line.y[k - 1], line.x[k + 1] - line.x[k - 1])
                assert np.cos(way - heading) > 0.7


def _nearest(x: np.ndarray, y: np.ndarray, px: float, py: float) -> tuple[float, float]:
    """Distance from a polyline to a point, and how far along it that is."""
    dx, dy = np.diff(x), np.diff(y)
    size2 = dx**2 + dy**2
    f = np.clip(((px - x[:-1]) * dx + (py - y[:-1]) * dy) / size2, 0.0, 1.0)
    away = np.hypot(x[:-1] + f * dx - px, y[:-1] + f * dy - py)
    k = int(np.argmin(away))
    return float(away[k]), float(np.sqrt(size2)[:k].sum() + f[k] * np.sqrt(size2[k]))


def test_routes_part_at_the_branch_point(scene: Scene):
    """Behind it at least two roads are driven, before it and about it the scene is the same."""
    behind = set()
    for route in scene.routes:
        line = route.line
        k = int(np.searchsorted(line.along, route.decision))
        assert line.along[0] + 50.0 < route.decision < line.along[-1] - 30.0
        assert line.road[k - 2] != line.road[k + 1]
        behind.add(int(line.road[k + 1]))
    assert len(behind) >= 2


def test_lines_are_grids_of_about_a_metre(scene: Scene):
    for route in scene.routes:
        step = np.hypot(np.diff(route.line.x), np.diff(route.line.y))
        assert step.min() > 0.3  # shorter in corners, which are cut
        assert step.max() < 1.01
        assert np.diff(route.line.along) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("gap", [8.0, 12.0, 18.0, 25.0])
def test_parallel_roads_are_as_far_apart_as_they_are_called(gap: float):
    left, right = (route.line for route in draw_scene(f"parallel-{gap:g}", 5).routes)
    x, y = left.x[-40], left.y[-40]
    away = np.hypot(right.x - x, right.y - y).min()
    assert away == pytest.approx(gap, abs=0.1)


def test_a_tunnel_is_dark_about_its_forks_and_nowhere_else():
    line = draw_scene("tunnel", 1).routes[0].line
    dark = np.flatnonzero(line.masked)
    assert 500 <= len(dark) <= 1501
    assert (np.diff(dark) == 1).all()
    assert line.masked[int(np.searchsorted(line.along, draw_scene("tunnel", 1).routes[0].decision))]
