"""The steps of building a map against slow, obviously right versions, and what building needs."""

import math
import subprocess
import sys
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from whichroad.geodesy.plane import Plane
from whichroad.roadmap import cells
from whichroad.roadmap.arrays import to_arrays
from whichroad.roadmap.chains import chains, end_headings

SIZE = 64.0


def _out(tail, nodes):
    """The halves that leave each node, in order."""
    out = np.argsort(tail, kind="stable").astype(np.int32)
    count = np.bincount(tail, minlength=nodes)
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int32), out


def _walked(head, cut, out_first, out):
    """Chains one half at a time, rings last."""
    cut, done, found = cut.copy(), set(), []

    def follow(half):
        chain = [half]
        while not cut[head[half]]:
            leaving = out[out_first[head[half]] : out_first[head[half] + 1]]
            (half,) = [int(h) for h in leaving if h != half ^ 1]
            chain.append(half)
        done.update(chain)
        found.append(chain)

    for half in range(len(head)):
        if cut[head[half ^ 1]]:
            follow(half)
    for half in range(len(head)):
        if half not in done:
            node = head[half ^ 1]
            cut[node] = 1
            for other in out[out_first[node] : out_first[node + 1]]:
                follow(int(other))
    return found


segments = st.lists(
    st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(lambda s: s[0] != s[1]),
    min_size=1, max_size=16, unique_by=lambda s: (min(s), max(s)),
)  # fmt: skip


@given(segments, st.sets(st.integers(0, 9)))
def test_chains_are_those_found_half_by_half(drawn, junctions):
    ends = np.array(drawn, dtype=np.int32)
    tail, head = ends.ravel(), ends[:, ::-1].ravel()
    out_first, out = _out(tail, 10)
    cut = (np.bincount(tail, minlength=10) != 2).astype(np.uint8)
    cut[list(junctions)] = 1
    first, half = chains(head, cut, out_first, out)
    found = [half[a:b].tolist() for a, b in pairwise(first.tolist())]
    assert found == _walked(head, cut, out_first, out)


def test_headings_at_ends_are_those_of_chords_of_the_given_length():
    x, y = np.array([0.0, 3.0, 3.0, 0.0, 0.0]), np.array([0.0, 0.0, 20.0, 0.0, 5.0])
    first = np.array([0, 3, 5], np.int32)
    s = np.array([0.0, 3.0, 23.0, 0.0, 5.0])
    start, end = end_headings(x, y, s, first, 8.0)
    assert np.allclose(start, [math.atan2(5.0, 3.0), math.pi / 2])
    assert np.allclose(end, [math.pi / 2, math.pi / 2])


places = st.floats(-400.0, 400.0).map(lambda at: round(at, 9)) | st.integers(-6, 6).map(
    lambda i: SIZE * i
)


@given(st.lists(st.tuples(places, places), min_size=2, max_size=6, unique=True))
def test_a_cell_lists_the_segments_that_touch_it_and_no_others(line):
    x, y = np.array(line).T
    first = np.array([0, len(line)], np.int32)
    key, cell_first, segments = cells.build(x, y, first, SIZE)
    vertex = segments.vertex
    assert (key[1:] > key[:-1]).all()
    assert (segments.edge == 0).all()
    listed = set()
    for k, (a, b) in zip(key.tolist(), pairwise(cell_first.tolist()), strict=True):
        column, row = k >> 32, k % 2**32 - 2**31
        for v in vertex[a:b].tolist():
            assert (column, row, v) not in listed
            listed.add((column, row, v))
            assert _apart(x[v : v + 2], y[v : v + 2], column, row) < 1e-5
    for v in range(len(line) - 1):
        for t in np.linspace(0.0, 1.0, 50):
            px, py = x[v] + t * (x[v + 1] - x[v]), y[v] + t * (y[v + 1] - y[v])
            around = {(math.floor((px + dx) / SIZE), math.floor((py + dy) / SIZE), v)
                      for dx in (-1e-9, 1e-9) for dy in (-1e-9, 1e-9)}  # fmt: skip
            assert around & listed


def _apart(x, y, column, row):
    """How far a segment stays out of a cell: clipped to its column, then seen by height, m."""
    west, east = column * SIZE, (column + 1) * SIZE
    low, high = row * SIZE, (row + 1) * SIZE
    (ax, bx), (ay, by) = x, y
    if ax == bx:
        a, b = ay, by
        aside = max(west - ax, ax - east, 0.0)
    else:
        t = sorted(np.clip([(west - ax) / (bx - ax), (east - ax) / (bx - ax)], 0.0, 1.0))
        a, b = ay + t[0] * (by - ay), ay + t[1] * (by - ay)
        aside = max(west - max(ax, bx), min(ax, bx) - east, 0.0)
    return max(low - max(a, b), min(a, b) - high, aside, 0.0)


@given(
    st.floats(-89.0, 89.0), st.floats(-180.0, 180.0),
    st.floats(-5.0, 5.0), st.floats(-5.0, 5.0),
)  # fmt: skip
def test_a_map_is_laid_where_drives_are(lat0, lon0, north, east):
    plane = Plane(lat0, lon0)
    lat, lon = np.array([max(min(lat0 + north, 89.9), -89.9)]), np.array([lon0 + east])
    there = plane.from_geodetic(lat, lon)
    assert np.allclose(plane.lay(lat, lon), there, rtol=0.0, atol=1e-6)


def test_a_map_built_in_parts_on_disk_is_the_same(tmp_path, monkeypatch):
    """Streets of a grid, one of them drawn twice, others one-way."""
    import geopandas
    import shapely

    from whichroad.roadmap import RoadMap, compile, laid_out, shelf, turns

    rng = np.random.default_rng(4)
    at = rng.normal(0, 2e-4, (12, 12, 2)) + np.stack(
        np.meshgrid(8.7 + 0.002 * np.arange(12), 49.4 + 0.001 * np.arange(12)), axis=-1
    )
    lines = [shapely.LineString(row) for row in at]
    lines += [shapely.LineString(at[:, k]) for k in range(12)]
    table = geopandas.GeoDataFrame(
        {"oneway": [""] * 24 + ["yes"] * 5, "highway": [*["primary", "service"] * 14, "primary"]},
        geometry=[*lines, *lines[:5]], crs="EPSG:4326",
    )  # fmt: skip
    whole = RoadMap.from_edges(table)
    for module, name in ((laid_out, "BLOCK"), (compile, "BLOCK"), (compile, "_AT_ONCE"),
                         (turns, "_AT_ONCE"), (cells, "_SORTED"), (cells, "_EVERY")):  # fmt: skip
        monkeypatch.setattr(module, name, 2 if name == "_EVERY" else 7)
    monkeypatch.setattr(shelf, "LEAST", 1)
    parts = RoadMap.from_edges(table)
    for (name, a), (_, b) in zip(
        to_arrays(whole)[1].items(), to_arrays(parts)[1].items(), strict=True
    ):
        if a.dtype.names:
            for field in a.dtype.names:
                assert np.allclose(a[field], b[field], rtol=0.0, atol=1e-9), (name, field)
        else:
            assert np.allclose(a, b, rtol=0.0, atol=1e-9), name
    parts.save(tmp_path / "parts.map")
    opened = RoadMap.open(tmp_path / "parts.map", check=True)
    assert opened.fingerprint == parts.fingerprint
    assert opened.info() == parts.info() == whole.info()


LOADED = """
import sys
from whichroad import RoadMap
RoadMap.from_osm(sys.argv[1]).save(sys.argv[2])
print(len(RoadMap.open(sys.argv[2])), "llvmlite" in sys.modules)
"""


def test_building_and_opening_a_map_needs_no_compiler(tmp_path, xml):
    """A kernel costs a newcomer seconds of compiling; LLVM costs everyone 70 MiB."""
    source = tmp_path / "cross.osm"
    source.write_text(xml({1: (0, 0), 2: (100, 0)}, [(1, (1, 2), {})]))
    done = subprocess.run(
        [sys.executable, "-c", LOADED, source, tmp_path / "cross.map"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == ["2", "False"]
