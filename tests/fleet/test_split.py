"""Trips of a vehicle: cut where it pauses, stops or jumps, whatever order its rows have."""

from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from fleet.conftest import PLANE
from whichroad.batch import match_batches, match_many
from whichroad.errors import SettingError
from whichroad.readers.splitting import STANDING, seconds_of, split_trips

PAUSE = 300.0


def vehicle(legs, *, step=30.0, seed=0, noise=3.0):
    """Rows of a vehicle: drives of so many m at 12 m/s and stands of so many s, by turns.

    Returns:
        The table, and for each drive its first and last row.
    """
    rng = np.random.default_rng(seed)
    x, time, bounds = [0.0], [0.0], []
    for metres, seconds, silent in legs:
        first = len(x) - 1
        for _ in range(round(metres / 12.0 / step)):
            x.append(x[-1] + 12.0 * step)
            time.append(time[-1] + step)
        bounds.append((first, len(x) - 1))
        if silent:
            x.append(x[-1])
            time.append(time[-1] + seconds)
        else:
            for _ in range(round(seconds / step)):
                x.append(x[-1])
                time.append(time[-1] + step)
    x, time = np.array(x), np.array(time)
    lat, lon = PLANE.to_geodetic(*(v + rng.normal(0, noise, len(x)) for v in (x, 0 * x)))
    return pa.table({"time": 1.6e9 + time, "lat": lat, "lon": lon}), bounds


def test_trips_end_where_the_vehicle_stands_or_is_silent_for_long():
    legs = [(7200, 60, False), (3600, 900, False), (7200, 900, True), (3600, 900, False),
            (5000, 0, False)]  # fmt: skip
    table, bounds = vehicle(legs)
    ordered, parts = split_trips(table, PAUSE)
    assert ordered.equals(table)
    found = [(part.low, part.high - 1) for part in parts]
    wanted = [(bounds[0][0], bounds[1][1]), bounds[2], bounds[3], bounds[4]]
    assert len(found) == len(wanted)
    for (low, high), (first, last) in zip(found, wanted, strict=True):
        assert abs(low - first) <= 1
        assert abs(high - last) <= 1
    counted = sum(p.high - p.low + p.standing for p in parts)
    assert counted == table.num_rows


@pytest.mark.parametrize("step", [10.0, 60.0])
def test_ends_of_trips_of_many_days_are_found_within_one_fix(step):
    right = total = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        legs = [
            (rng.uniform(4000, 30000), rng.uniform(400, 20000), rng.random() < 0.5)
            for _ in range(30)
        ]
        table, bounds = vehicle(legs, step=step, seed=seed)
        parts = split_trips(table, PAUSE)[1]
        ends = np.array([part.high - 1 for part in parts])
        right += sum(np.abs(ends - last).min() <= 1 for _, last in bounds)
        total += len(bounds)
        assert len(parts) == len(bounds)
    assert right >= 0.99 * total


def test_the_order_of_rows_changes_no_trip():
    table, _ = vehicle([(7200, 900, False), (7200, 900, True), (3000, 0, False)])
    usual = split_trips(table, PAUSE)
    mixed = table.take(np.random.default_rng(3).permutation(table.num_rows))
    found = split_trips(mixed, PAUSE)
    assert found[1] == usual[1]
    assert found[0].equals(usual[0])


def test_a_jump_that_no_car_makes_ends_a_trip_and_one_wrong_fix_does_not():
    table, _ = vehicle([(9000, 0, False)])
    lat = table["lat"].to_numpy().copy()
    lat[10] += 1.0  # there and back again
    assert len(split_trips(table.set_column(1, "lat", pa.array(lat)), PAUSE)[1]) == 1
    lat[15:] += 1.0
    parts = split_trips(table.set_column(1, "lat", pa.array(lat)), PAUSE)[1]
    assert [(p.low, p.high) for p in parts] == [(0, 15), (15, table.num_rows)]


def test_a_vehicle_that_only_stands_is_one_trip_and_rows_without_time_are_kept():
    table, _ = vehicle([(0, 4000, False)])
    assert [p[:2] for p in split_trips(table, PAUSE)[1]] == [(0, table.num_rows)]
    texts = table.set_column(0, "time", pa.array(["when"] * table.num_rows))
    assert [p[:2] for p in split_trips(texts, PAUSE)[1]] == [(0, table.num_rows)]
    holes = table.set_column(0, "time", pa.array([None, *table["time"].to_pylist()[1:]]))
    ordered, parts = split_trips(holes, PAUSE)
    assert parts[-1].high == table.num_rows
    assert ordered["time"][-1].as_py() is None


def test_clocks_that_are_set_forward_cut_no_trip(town):
    table, _ = vehicle([(960, 0, False)], step=5.0)
    night = datetime(2026, 3, 29, 0, 59, 30, tzinfo=UTC).timestamp()  # 01:59:30 in Berlin
    at = table["time"].to_numpy() - 1.6e9 + night
    hours = np.where(at < night + 30.0, 1, 2)
    local = pa.array((at + 3600.0 * hours) * 1e6).cast(pa.int64()).cast(pa.timestamp("us"))
    names = pa.array(["v"] * len(at))
    table = table.set_column(0, "time", local).append_column("vehicle_id", names)
    for more, trips in (({}, 2), ({"tz": "Europe/Berlin"}, 1)):
        ordered = match_batches(
            iter(table.to_batches()), town, give="drives", split="5min", ordered=True, **more
        )
        assert pa.Table.from_batches(ordered).num_rows == trips
        assert match_many(table, town, split="5min", **more).drives.num_rows == trips


def test_times_are_understood_or_refused():
    assert [seconds_of(t) for t in ("5min", "300s", "1.5h", 90, None)] == [300, 300, 5400, 90, None]
    for text in ("soon", "5 days", "-3min", "0", ""):
        with pytest.raises(SettingError, match="5min"):
            seconds_of(text)


def test_trips_are_named_by_their_vehicle_and_number_and_what_is_left_out_is_counted(town):
    table, _ = vehicle([(900, 900, False), (0, 0, False)], step=5.0)
    back = table["lon"].to_numpy()[: 900 // 60 + 1][::-1]
    n = len(back)
    end = table["time"].to_numpy()[-1]
    home = pa.table(
        {"time": end + 5.0 + 5.0 * np.arange(n), "lat": table["lat"].to_numpy()[:n], "lon": back}
    )
    rows = pa.concat_tables([table, home])
    rows = rows.append_column("vehicle", pa.array(["a b"] * rows.num_rows))
    drives = match_many(rows, town, drive_id="vehicle", split="5min").drives
    assert drives["drive_id"].to_pylist() == ["a b/1", "a b/2"]
    assert drives["answered"].to_pylist() == [True, True]
    left_out = dict(drives["skipped"][0].as_py())[STANDING]
    assert left_out + sum(drives["fixes"].to_pylist()) == rows.num_rows
    batches = match_batches(
        iter(rows.to_batches(max_chunksize=7)), town, give="drives", trip_id="vehicle", split=300
    )
    assert pa.Table.from_batches(list(batches)).to_pylist() == drives.to_pylist()
    ordered = match_batches(
        iter(rows.to_batches(max_chunksize=7)), town, give="drives", trip_id="vehicle",
        split=300, ordered=True,
    )  # fmt: skip
    assert pa.Table.from_batches(list(ordered)).to_pylist() == drives.to_pylist()
    assert whichroad.map_of(drives)["fingerprint"]
