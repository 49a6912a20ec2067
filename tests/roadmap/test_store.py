"""Compiled maps as files: what comes back, and what is refused."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import MapError, WhichroadError, WriteError
from whichroad.roadmap import RoadMap
from whichroad.roadmap.streets import Texts

NODES = {1: (0, 0), 2: (100, 0), 3: (0, 100), 4: (-100, 0), 5: (0, -100)}
WAYS = [
    (10, [1, 2], {"name": "Höhenweg", "maxspeed": "30"}),
    (20, [1, 3], {"oneway": "yes"}),
    (30, [4, 1, 5], {"highway": "service"}),
]


def same(one, two):
    """Assert that two maps say the same."""
    for a, b in zip(one.arrays, two.arrays, strict=True):
        np.testing.assert_array_equal(a, b)
        assert np.asarray(a).dtype == np.asarray(b).dtype
    assert one.plane == two.plane
    for a, b in zip(one.pieces, two.pieces, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(one.way, two.way)
    assert list(one.ways) == list(two.ways)
    edges = range(len(one))
    assert [one.attributes(e) for e in edges] == [two.attributes(e) for e in edges]
    assert [one.source(e, 1.0) for e in edges] == [two.source(e, 1.0) for e in edges]
    junctions = np.arange(len(one.node_id))
    assert one.node_ids(junctions) == two.node_ids(junctions)
    assert one.info() == two.info()


@pytest.fixture
def saved(osm, tmp_path):
    """A map and its file."""
    roads = osm(NODES, WAYS)
    roads.save(tmp_path / "a.map")
    return roads, tmp_path / "a.map"


def test_what_is_saved_is_what_is_opened(saved):
    roads, path = saved
    same(roads, RoadMap.open(path))
    assert isinstance(roads.ways["name"], Texts)


def test_saving_an_opened_map_gives_the_same_bytes(saved, tmp_path):
    RoadMap.open(saved[1]).save(tmp_path / "b.map")
    assert (tmp_path / "b.map").read_bytes() == saved[1].read_bytes()


def test_a_map_can_be_saved_over_itself(saved):
    roads, path = saved
    opened = RoadMap.open(path)
    opened.save(path)
    same(opened, RoadMap.open(path))
    same(roads, opened)


def test_arrays_lie_at_multiples_of_64_bytes(saved):
    for name, array in RoadMap.open(saved[1]).arrays._asdict().items():
        if name != "plane":  # the file has its numbers in the header
            assert array.ctypes.data % 64 == 0


def test_writing_to_an_array_does_not_change_the_file(saved):
    roads, path = saved
    RoadMap.open(path).arrays.vertices.x[:] = 0
    same(roads, RoadMap.open(path))


def test_a_file_cut_short_is_refused_by_name(saved):
    path = saved[1]
    content = path.read_bytes()
    for size in [*range(60), len(content) // 2, len(content) - 1]:
        path.write_bytes(content[:size])
        with pytest.raises(MapError, match=r"a\.map"):
            RoadMap.open(path)
    path.write_bytes(content + b"x")
    with pytest.raises(MapError, match=r"bytes; .* were expected"):
        RoadMap.open(path)


@pytest.mark.parametrize("content", [b"", b"PK\3\4", b"WHICHROAD", b"WHICHROADS" * 50, b"\0" * 99])
def test_a_foreign_file_is_refused_by_name(tmp_path, content):
    path = tmp_path / "b.map"
    path.write_bytes(content)
    with pytest.raises(MapError, match=r"b\.map: .* expected; "):
        RoadMap.open(path)


def test_another_version_is_refused_with_what_to_do(saved):
    path = saved[1]
    content = bytearray(path.read_bytes())
    content[12:16] = struct.pack("<I", 99)
    path.write_bytes(content)
    with pytest.raises(MapError, match="version 99; version 6 was expected; make it anew"):
        RoadMap.open(path)


def test_a_missing_file_or_a_folder_is_refused_by_name(tmp_path):
    with pytest.raises(MapError, match="nowhere"):
        RoadMap.open(tmp_path / "nowhere.map")
    with pytest.raises(MapError, match=tmp_path.name):
        RoadMap.open(tmp_path)


def test_a_folder_that_is_not_there_cannot_be_written_to(saved, tmp_path):
    with pytest.raises(WriteError, match="missing"):
        saved[0].save(tmp_path / "missing" / "a.map")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.map", "map.osm"]


@pytest.fixture(scope="module")
def content(tmp_path_factory, xml):
    """The bytes of a map, and the map."""
    folder = tmp_path_factory.mktemp("map")
    (folder / "a.osm").write_text(xml(NODES, WAYS))
    roads = RoadMap.from_osm(folder / "a.osm")
    roads.save(folder / "a.map")
    return roads, (folder / "a.map").read_bytes(), folder / "changed.map"


@given(st.data())
def test_a_changed_byte_is_noticed_or_does_not_matter(content, data):
    roads, good, path = content
    place = data.draw(st.integers(0, len(good) - 1))
    bad = bytearray(good)
    bad[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(bad)
    try:
        opened = RoadMap.open(path)
    except MapError:
        return
    same(roads, opened)


@given(st.binary(max_size=300), st.booleans())
def test_random_bytes_are_refused(content, noise, with_magic):
    path = content[2]
    path.write_bytes(b"WHICHROAD\0\0\0" + noise if with_magic else noise)
    with pytest.raises(WhichroadError):
        RoadMap.open(path)
