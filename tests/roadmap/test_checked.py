"""Maps are checked in full once, noticed when they change, and opened once a process."""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from whichroad.errors import MapError
from whichroad.roadmap import RoadMap, checked, shared_map, store

NODES = {1: (0, 0), 2: (100, 0), 3: (0, 100)}
WAYS = [(10, [1, 2], {"name": "A"}), (20, [1, 3], {"oneway": "yes"})]


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    """A cache of its own, files that count as settled at once, and nothing checked yet."""
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setattr(checked, "_folder", lambda: folder)
    monkeypatch.setattr(checked, "SETTLED", -1.0)
    monkeypatch.setattr(checked, "_here", set())
    checked._opened.clear()
    return folder


@pytest.fixture
def saved(osm, tmp_path):
    roads = osm(NODES, WAYS)
    roads.save(tmp_path / "a.map")
    return roads, tmp_path / "a.map"


@pytest.fixture
def sums(monkeypatch):
    """How many arrays were summed."""
    count = []
    summed = store.zlib.crc32
    monkeypatch.setattr(store.zlib, "crc32", lambda data: count.append(1) or summed(data))
    return count


def test_a_file_is_checked_in_full_once_also_by_other_processes(saved, sums, monkeypatch):
    RoadMap.open(saved[1])
    first = len(sums)
    assert first > 10
    RoadMap.open(saved[1])
    assert len(sums) == first + 1  # the header
    monkeypatch.setattr(checked, "_here", set())  # another process
    RoadMap.open(saved[1])
    assert len(sums) == first + 2
    RoadMap.open(saved[1], check=True)
    assert len(sums) == 2 * first + 2


def test_a_file_that_changed_just_now_is_not_remembered(saved, own_cache, monkeypatch):
    monkeypatch.setattr(checked, "SETTLED", 60.0)
    RoadMap.open(saved[1])
    assert not list(own_cache.iterdir())
    assert shared_map(saved[1]) is not shared_map(saved[1])


def test_what_nobody_checked_for_a_month_is_checked_again(saved, own_cache, sums, monkeypatch):
    RoadMap.open(saved[1])
    first = len(sums)
    (mark,) = own_cache.iterdir()
    os.utime(mark, (0, 0))
    monkeypatch.setattr(checked, "_here", set())
    RoadMap.open(saved[1])
    assert len(sums) == 2 * first


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(data=st.data())
def test_a_byte_that_changes_behind_a_check_is_noticed_though_the_time_is_set_back(saved, data):
    path = saved[1]
    good = path.read_bytes()
    RoadMap.open(path)
    there = path.stat()
    place = data.draw(st.integers(0, len(good) - 1))
    bad = bytearray(good)
    bad[place] ^= data.draw(st.integers(1, 255))
    try:
        path.write_bytes(bad)
        os.utime(path, ns=(there.st_atime_ns, there.st_mtime_ns))
        try:
            opened = RoadMap.open(path)
        except MapError:
            return
        for a, b in zip(opened.arrays, saved[0].arrays, strict=True):
            np.testing.assert_array_equal(a, b)
    finally:
        path.write_bytes(good)


def test_a_process_opens_a_map_once_and_again_when_it_changes(saved, osm):
    roads, path = saved
    first = shared_map(path)
    assert shared_map(str(path)) is first
    assert shared_map(roads) is roads
    osm(NODES, WAYS[:1]).save(path)
    assert len(shared_map(path)) < len(first)


def test_fingerprints_tell_maps_apart_and_not_files(saved, osm, tmp_path):
    roads, path = saved
    RoadMap.open(path).save(tmp_path / "b.map")
    assert RoadMap.open(tmp_path / "b.map").fingerprint == roads.fingerprint
    other = osm(NODES, WAYS[:1])
    assert other.fingerprint != roads.fingerprint
    roads.arrays.edges.speed[0] += 1.0
    roads.save(tmp_path / "c.map")
    assert RoadMap.open(tmp_path / "c.map").fingerprint != RoadMap.open(path).fingerprint
