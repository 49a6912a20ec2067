"""Speeds of edges: against sums by hand, and intervals that hold the truth as often as they say."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import whichroad
from whichroad.errors import ReadError, SettingError
from whichroad.tables.schema import PATH, TIME


def path(edge, length, seconds, *, p=1.0, drive="a", time=0.0, forward=True, enter=0.0):
    """A path without its line."""
    n = len(edge)
    start = (np.broadcast_to(time, n) * 1e6).astype(np.int64)
    names = [drive] * n if isinstance(drive, str) else list(drive)
    columns = {
        "drive_id": names,
        "seq": np.arange(n),
        "edge_id": np.asarray(edge, np.int64),
        "source_id": [f"way {e // 2}" for e in edge],
        "forward": np.broadcast_to(forward, n),
        "enter_time": pa.array(start).cast(TIME),
        "enter_m": np.broadcast_to(np.float64(enter), n),
        "exit_m": enter + np.asarray(length, np.float64),
        "duration_s": np.asarray(seconds, np.float64),
        "p": np.broadcast_to(np.float64(p), n),
    }
    return pa.table({k: pa.array(v, PATH.field(k).type) for k, v in columns.items()})


def test_the_mean_is_the_harmonic_one_weighed_by_p():
    one = path([7, 7, 8], [100.0, 100.0, 50.0], [10.0, 20.0, 5.0], p=[1.0, 0.5, 1.0])
    rows = whichroad.speeds(one, hours=False).to_pylist()
    assert [row["edge_id"] for row in rows] == [7, 8]
    assert rows[0]["speed_mps"] == pytest.approx(150.0 / 20.0)
    assert (rows[0]["passages"], rows[0]["vehicles"], rows[0]["hour"]) == (2, 1, None)
    assert rows[0]["low_mps"] is None
    assert rows[1]["speed_mps"] == pytest.approx(10.0)


def test_passages_between_fixes_far_apart_count_less():
    one = path([7, 7], [100.0, 100.0], [10.0, 20.0], drive=["often", "seldom"])
    drives = pa.table(
        {"drive_id": ["often", "seldom"], "epochs": [1001, 11], "duration_s": [1000.0, 900.0]}
    )
    weights = 100 / (100 + 10 * np.array([1.0, 90.0]))
    (row,) = whichroad.speeds(one, hours=False, drives=drives).to_pylist()
    assert row["weight"] == pytest.approx(weights.sum(), rel=1e-6)
    assert row["speed_mps"] == pytest.approx(weights.sum() * 100 / (weights @ [10, 20]), rel=1e-6)


def test_passages_with_a_long_stop_are_left_out_and_counted():
    seconds = [10.0] * 7 + [3610.0, 10.0, 3610.0]
    one = path([7] * 8 + [8, 9], [100.0] * 10, seconds, drive=[f"v{k}" for k in range(10)])
    found = whichroad.speeds(one, hours=False).to_pylist()
    columns = ("speed_mps", "passages", "vehicles", "weight", "left_out")
    assert [tuple(row[name] for name in columns) for row in found] == [
        (pytest.approx(10.0), 7, 7, pytest.approx(7.0), 1),
        (pytest.approx(10.0), 1, 1, pytest.approx(1.0), 0),
        (None, 0, 0, 0.0, 1),
    ]
    assert found[0]["low_mps"] == pytest.approx(10.0)
    assert found[2]["low_mps"] is found[2]["high_mps"] is None
    every = whichroad.speeds(one, hours=False, longest_stop=None).to_pylist()
    assert every[0]["speed_mps"] == pytest.approx(800.0 / 3680.0)
    assert [row["left_out"] for row in every] == [0, 0, 0]
    assert [row["passages"] for row in every] == [8, 1, 1]


def test_what_is_a_long_stop_may_be_said_and_a_jam_is_none():
    jam = path([7] * 3, [600.0] * 3, [590.0, 890.0, 910.0])  # 1 m/s, and 5 minutes more or less
    assert whichroad.speeds(jam, hours=False)["left_out"].to_pylist() == [1]
    for longest, left in (("1h", 0), (280, 2), ("1min", 2)):
        found = whichroad.speeds(jam, hours=False, longest_stop=longest)
        assert found["left_out"].to_pylist() == [left]
    with pytest.raises(SettingError, match=r"longest_stop is 'long'; .* 5min.* or None"):
        whichroad.speeds(jam, longest_stop="long")
    rows = [("a", "way 1", True, None)] * 3  # of a road one passage, with the stop on one edge
    for stop in (200.0, 500.0):
        found = whichroad.speeds(by_source(rows, [10.0, stop, 10.0]), by="source_id", hours=False)
        assert found["left_out"].to_pylist() == [int(stop > 400.0)]


def test_hours_are_those_of_the_zone_and_vehicles_are_told_by_their_names():
    monday = 1_780_272_000.0  # 2026-06-01T00:00:00Z
    times = monday + np.array([0.0, 3600.0, 6 * 86400.0 + 23 * 3600.0])
    one = path([1, 1, 1], [50.0] * 3, [5.0] * 3, time=times, drive=["v/1", "v/2", "w/1"])
    utc = whichroad.speeds(one)
    assert utc["hour"].to_pylist() == [0, 1, 167]
    berlin = whichroad.speeds(one, tz="Europe/Berlin")
    assert berlin["hour"].to_pylist() == [1, 2, 3]
    (row,) = whichroad.speeds(one, hours=False).to_pylist()
    assert (row["passages"], row["vehicles"]) == (3, 2)
    roads = whichroad.speeds(path([2, 9, 3], [50.0] * 3, [5.0] * 3), by="source_id", hours=False)
    assert dict(zip(*(roads[n].to_pylist() for n in ("source_id", "passages")), strict=True)) == {
        "way 1": 2, "way 4": 1,
    }  # fmt: skip


def by_source(rows, seconds=10.0):
    """A path by roads of (drive, road, forward, broken rule)."""
    drive, road, forward, rule = zip(*rows, strict=True)
    duration = np.broadcast_to(seconds, len(rows))
    one = path(range(len(rows)), [100.0] * len(rows), duration, drive=drive)
    told = {"source_id": road, "forward": forward, "broken_rule": rule}
    for name, values in told.items():
        one = one.drop_columns(name) if name in one.column_names else one
        one = one.append_column(name, pa.array(values, PATH.field(name).type))
    return one


def test_a_run_of_a_trip_on_a_road_is_one_passage_however_many_edges_it_has():
    rows = [("a", "way 1", True, None)] * 3 + [("a", "way 2", True, None)]
    rows += [("a", "way 1", True, None)] * 2 + [("a", "way 1", False, "u_turn")]
    rows += [("b", "way 1", False, None)] * 2 + [("b", "way 1", False, "gap")]
    one = by_source(rows)
    found = whichroad.speeds(one, by="source_id", hours=False)
    keys = zip(found["source_id"].to_pylist(), found["forward"].to_pylist(), strict=True)
    passages = dict(zip(keys, found["passages"].to_pylist(), strict=True))
    assert passages == {("way 1", True): 2, ("way 1", False): 3, ("way 2", True): 1}
    assert found["weight"].to_pylist() == pytest.approx(found["passages"].to_pylist())
    edges = whichroad.speeds(one, hours=False)
    assert edges["passages"].to_pylist() == [1] * len(rows)
    for size in (1, 2, 5):  # a passage may lie in two parts
        parts = [one.slice(k, size) for k in range(0, len(rows), size)]
        assert whichroad.speeds(parts, by="source_id", hours=False).equals(found)


def test_parts_say_what_the_whole_says(tmp_path, monkeypatch):
    from whichroad.fleet import edge_speeds

    rng = np.random.default_rng(1)
    n = 5000
    one = path(
        rng.integers(0, 40, n), rng.uniform(20, 300, n), rng.uniform(2, 60, n),
        p=rng.uniform(0.3, 1.0, n), time=rng.uniform(0, 1e6, n), forward=rng.random(n) < 0.5,
        drive=[f"v{k}/1" for k in rng.integers(0, 300, n)],
    )  # fmt: skip
    whole = whichroad.speeds(one)
    monkeypatch.setattr(edge_speeds, "_MERGE", 300)
    (tmp_path / "path").mkdir()
    for k in range(5):
        pq.write_table(one.slice(1000 * k, 1000), tmp_path / "path" / f"{k}.parquet")
    for parts in (tmp_path, tmp_path / "path", [one.slice(k, 700) for k in range(0, n, 700)]):
        found = whichroad.speeds(parts)
        for name in whole.column_names:
            a, b = whole[name].to_pylist(), found[name].to_pylist()
            assert a == (pytest.approx(b) if name.endswith(("mps", "weight")) else b), name
    keys = zip(one["edge_id"].to_pylist(), one["forward"].to_pylist(), hours_of(one), strict=True)
    assert whole.num_rows == len(set(keys))


def hours_of(table):
    seconds = table["enter_time"].cast(pa.int64()).to_numpy() // 10**6
    return ((seconds // 3600) + 3 * 24) % 168  # 1970 began on a Thursday


@pytest.mark.parametrize("passages", [10, 40])
def test_intervals_hold_the_truth_as_often_as_they_say(passages):
    rng = np.random.default_rng(passages)
    edges = 3000
    pace = rng.uniform(0.05, 0.3, edges)  # s/m, the mean over all who ever pass
    edge = np.repeat(np.arange(edges), passages)
    seconds = 100.0 * pace[edge] * rng.gamma(12.0, 1 / 12.0, len(edge))
    p = rng.uniform(0.5, 1.0, len(edge))
    found = whichroad.speeds(path(edge, np.full(len(edge), 100.0), seconds, p=p), hours=False)
    low, high = (found[name].to_numpy() for name in ("low_mps", "high_mps"))
    held = np.mean((low <= 1 / pace) & (1 / pace <= high))
    assert 0.92 <= held <= 0.98


LENGTHS = np.array([600.0, 20.0, 60.0, 200.0] * 4)  # m, of a route


def driven(rng, interval, trips=12):
    """A path of trips over one route, and true seconds a metre.

    Vehicles wait 4 m before half of the nodes.  Time is spread evenly between two fixes, as by
    `match`.
    """
    pace = 0.1 * np.exp(0.1 * rng.normal(size=len(LENGTHS)))
    waits = rng.uniform(0.0, 0.4, len(LENGTHS)) * (rng.random(len(LENGTHS)) < 0.5)
    ends = np.concatenate([[0.0], np.cumsum(LENGTHS)])
    stops = ends[1:] - 4.0
    known = np.sort(np.concatenate([ends, stops, stops + 1e-6]))
    guessed, true = [], []
    for _ in range(trips):
        driven = np.concatenate([[0.0], np.cumsum(LENGTHS * pace)]) * np.exp(0.1 * rng.normal())
        wait = (rng.random(len(LENGTHS)) < waits) * rng.exponential(10.0, len(LENGTHS))
        waited = np.concatenate([[0.0], np.cumsum(wait)])[np.searchsorted(stops, known)]
        time = np.interp(known, ends, driven) + waited
        fixes = np.arange(-rng.uniform(0.0, interval), time[-1] + interval, interval)
        guessed.append(np.diff(np.interp(ends, np.interp(fixes, time, known), fixes)))
        true.append(np.diff(np.interp(ends, known, time)))
    one = path(
        np.tile(np.arange(len(LENGTHS)), trips), np.tile(LENGTHS, trips), np.concatenate(guessed),
        drive=[f"trip {k}" for k in range(trips) for _ in LENGTHS],
    )  # fmt: skip
    return one, np.mean(true, axis=0) / LENGTHS


@pytest.mark.parametrize("interval", [5.0, 30.0])
def test_intervals_hold_the_speed_of_short_edges_between_fixes_far_apart(interval):
    rng = np.random.default_rng(7)
    held = []
    for _ in range(60):
        one, pace = driven(rng, interval)
        names = pa.array(one["drive_id"].unique())
        epochs = pa.array([11] * len(names))
        duration = pa.array([10.0 * interval] * len(names))
        drives = pa.table({"drive_id": names, "epochs": epochs, "duration_s": duration})
        found = whichroad.speeds(one, hours=False, drives=drives).to_pandas()
        held.append((found.low_mps * pace <= 1.0) & ~(found.high_mps * pace < 1.0))
    share = np.mean(held, axis=0)[4:-4].reshape(-1, 4).mean(axis=0)  # by length
    assert np.all(share >= 0.92), share


def test_what_is_no_path_is_refused(tmp_path):
    with pytest.raises(ReadError, match="not its points"):
        whichroad.speeds(pa.table({"drive_id": ["a"]}))
    with pytest.raises(ReadError, match="cannot be read"):
        whichroad.speeds(tmp_path / "none.parquet")
    one = path([1], [50.0], [5.0])
    with pytest.raises(SettingError, match="source_id"):
        whichroad.speeds(one, by="name")
    with pytest.raises(SettingError, match="Europe/Berlin"):
        whichroad.speeds(one, tz="Nowhere/None")
    assert whichroad.speeds(one.slice(0, 0)).num_rows == 0
