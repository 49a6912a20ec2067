"""Many trips: what is said of each is what is said of it alone, and none takes others along."""

import itertools
import uuid
from collections.abc import Iterator

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.feather as feather
import pyarrow.parquet as pq
import pytest

import whichroad
from whichroad import workspace
from whichroad.batch import Tables, filtering, match_batches, match_many, match_stream, trips
from whichroad.batch.filtering import filter_batch
from whichroad.errors import ReadError
from whichroad.geodesy.plane import Plane
from whichroad.readers import (
    drive_from_table,
    many_trips,
    read_drive,
    table_units,
    trip_files,
    trip_units,
)
from whichroad.recorded import localize_recorded
from whichroad.tables import export
from whichroad.tables.schema import ATTRIBUTES, DRIVES, PATH, POINTS

PLANE = Plane(49.4, 8.7)
BLOCK = 200.0  # m


@pytest.fixture(scope="module")
def roads() -> whichroad.RoadMap:
    """Three streets along, three across."""
    import geopandas
    import shapely

    k = np.arange(3) * BLOCK
    ends = [((a, b), (a + BLOCK, b)) for a in k[:2] for b in k]
    ends += [((b, a), (b, a + BLOCK)) for a in k[:2] for b in k]
    lines = []
    for line in ends:
        lat, lon = PLANE.to_geodetic(*np.array(line).T)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
    return whichroad.RoadMap.from_edges(
        geopandas.GeoDataFrame({"id": np.arange(len(lines))}, geometry=lines, crs="EPSG:4326")
    )


def trip(name: str, row: int, start: float = 1.6e9, seed: int = 0) -> pa.Table:
    """A drive of half a minute along one of the streets."""
    rng = np.random.default_rng(seed)
    x = np.arange(10.0, 390.0, 12.0)
    lat, lon = PLANE.to_geodetic(
        x + rng.normal(0, 2, len(x)), row * BLOCK + rng.normal(0, 2, len(x))
    )
    time = start + np.arange(len(x))
    return pa.table({"drive_id": [name] * len(x), "time": time, "lat": lat, "lon": lon})


@pytest.fixture(scope="module")
def fleet() -> pa.Table:
    return pa.concat_tables([trip(f"car {i}", i % 3, 1.6e9 + 50 * i, i) for i in range(7)])


def same(a: Tables, b: Tables) -> bool:
    return all(x.equals(y) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("lag", [None, "full", 5.0, "100m", 0])
def test_each_trip_is_answered_as_if_it_were_alone(roads, fleet, lag):
    many = match_many(fleet, roads, lag=lag)
    for i in (0, 3):
        mine = fleet.filter(pa.compute.equal(fleet["drive_id"], f"car {i}"))
        one = whichroad.match(mine, roads, lag=lag)
        mine = pa.compute.equal(many.points["drive_id"], f"car {i}")
        assert many.points.filter(mine).equals(one.to_arrow())
        mine = pa.compute.equal(many.path["drive_id"], f"car {i}")
        assert many.path.filter(mine).equals(one.path_arrow())
    assert many.points.schema.equals(POINTS)
    assert many.path.schema.equals(PATH)
    assert many.drives.schema.equals(DRIVES)


def odd_trips() -> list[pa.Table]:
    """Trips about whose reading there is something to say, in columns of one type."""

    def changed(name: str, column: str, rows: slice, value: float) -> pa.Table:
        table = trip(name, 1, 1.6e9 + 1000.0, 9)
        values = table[column].to_numpy().copy()
        values[rows] = value
        return table.set_column(table.column_names.index(column), column, pa.array(values))

    late = trip("late", 0)
    return [
        changed("twice", "time", slice(4, 6), 1.6e9 + 1004.0),
        changed("nearly twice", "time", slice(5, 6), 1.6e9 + 1004.00005),
        late.take([*range(10), 12, 11, 10, *range(13, 32)]),
        changed("nowhere", "lat", slice(3, 4), 95.0),
        changed("null island", "lat", slice(0, 1), 0.0),
        changed("no number", "lon", slice(7, 9), np.nan),
        trip("one fix", 2).slice(0, 1),
    ]


@pytest.mark.parametrize("lag", [None, "full", "5s"])
@pytest.mark.parametrize("sigma", ["float", "integer", "text", "nothing"])
@pytest.mark.parametrize("units", ["s", "s and ms"])
def test_odd_trips_among_plain_ones_are_answered_as_if_they_were_alone(
    roads, fleet, lag, sigma, units
):
    alone = [fleet.slice(32 * i, 32) for i in range(3)] + odd_trips()
    if units == "s and ms":
        alone.append(trip("milliseconds", 1, 1.6e12))
    kinds = {"float": pa.float64(), "integer": pa.int32(), "text": pa.string()}
    if sigma in kinds:
        alone = [
            t.append_column("sigma_m", pa.array(np.full(len(t), 4)).cast(kinds[sigma]))
            for t in alone
        ]
    mixed = [alone[i] for i in (3, 0, 4, 5, 1, 6, 7, 2, 8, 9)] + alone[10:]
    many = match_many(pa.concat_tables(mixed), roads, lag=lag)
    for table in mixed:
        one = whichroad.match(table, roads, lag=lag)
        name = one.summary["drive_id"]
        mine = pa.compute.equal(many.points["drive_id"], name)
        assert many.points.filter(mine).equals(one.to_arrow()), name
        mine = pa.compute.equal(many.path["drive_id"], name)
        assert many.path.filter(mine).equals(one.path_arrow()), name
        row = many.drives.filter(pa.compute.equal(many.drives["drive_id"], name)).to_pylist()[0]
        told = {"fixes_outside_map": 0} | one.summary
        told |= {"skipped": list(one.summary["skipped"].items())}
        told |= {"notes": list(one.summary["notes"]), "answered": True, "reason": None}
        assert row == {field: told[field] for field in DRIVES.names}


def test_speeds_courses_and_stamps_are_read_as_of_a_trip_alone(roads, fleet):
    n = len(fleet)
    more = fleet.set_column(
        1,
        "time",
        pa.array(np.round(fleet["time"].to_numpy() * 1e3).astype(np.int64)).cast(
            pa.timestamp("ms", tz="UTC")
        ),
    )
    more = more.append_column("speed_kmh", pa.array(np.full(n, 43.0)))
    more = more.append_column("course", pa.array(np.full(n, 90.0)))
    more = more.append_column("hdop", pa.array(np.linspace(0.5, 2.0, n)))
    more = more.append_column("fix_quality", pa.array(1 + np.arange(n) % 6))
    many = match_many(more, roads)
    for i in range(7):
        one = whichroad.match(more.slice(32 * i, 32), roads).to_arrow()
        assert many.points.slice(32 * i, 32).equals(one)


def test_there_is_one_row_for_every_trip_in_the_order_in_which_they_begin(roads, fleet):
    many = match_many(fleet, roads)
    assert many.drives["drive_id"].to_pylist() == [f"car {i}" for i in range(7)]
    assert many.drives["answered"].to_pylist() == [True] * 7
    assert many.drives["epochs"].to_pylist() == [32] * 7
    order = [name for name, _ in itertools.groupby(many.points["drive_id"].to_pylist())]
    assert order == many.drives["drive_id"].to_pylist()


def test_the_number_of_threads_changes_nothing(roads, fleet, monkeypatch):
    monkeypatch.setattr(many_trips, "BATCH_ROWS", 40)  # a trip a chunk
    assert same(match_many(fleet, roads, threads=1), match_many(fleet, roads, threads=3))


@pytest.mark.parametrize("rows", [1, 17, 1000])
def test_a_stream_says_what_the_table_says_wherever_it_is_cut(roads, fleet, rows):
    whole = match_many(fleet, roads)
    assert same(whole, match_many(iter(fleet.to_batches(max_chunksize=rows)), roads))
    reader = pa.RecordBatchReader.from_batches(fleet.schema, fleet.to_batches(max_chunksize=rows))
    assert same(whole, match_many(reader, roads))


def test_trips_whose_rows_lie_between_one_another_are_told_apart(roads, fleet):
    by_time = fleet.take(np.argsort(np.tile(np.arange(32), 7), kind="stable"))
    assert same(match_many(by_time, roads), match_many(fleet, roads))
    assert same(match_many(by_time.to_batches(max_chunksize=20), roads), match_many(fleet, roads))


def test_a_trip_that_cannot_be_matched_gets_a_row_that_says_why(roads, fleet):
    far = trip("on the moon", 0)
    far = far.set_column(2, "lat", pa.array(np.full(len(far), -33.0)))
    blank = trip("blank", 0)
    blank = blank.set_column(2, "lat", pa.nulls(len(blank), pa.float64()))
    blank = blank.set_column(3, "lon", pa.nulls(len(blank), pa.float64()))
    timeless = trip("timeless", 0)
    timeless = timeless.set_column(1, "time", pa.nulls(len(timeless), pa.float64()))
    nameless = trip("x", 0)
    nameless = nameless.set_column(0, "drive_id", pa.nulls(len(nameless), pa.string()))
    bad = [far, blank, timeless, nameless]
    many = match_many(pa.concat_tables([fleet.slice(0, 32), *bad, fleet.slice(32, 32)]), roads)
    said = dict(zip(many.drives["drive_id"].to_pylist(), many.drives.to_pylist(), strict=True))
    assert [row["answered"] for row in said.values()] == [True, False, False, False, False, True]
    assert "km from the map" in said["on the moon"]["reason"]
    assert "neither fixes nor odometry" in said["blank"]["reason"]
    assert "time" in said["timeless"]["reason"]
    assert "name no trip" in said[""]["reason"]
    assert said["blank"]["skipped"] == [("no position", 32)]
    assert set(many.points["drive_id"].to_pylist()) == {"car 0", "car 1"}


def test_rows_without_a_place_are_counted_also_where_they_have_a_speed(roads, fleet):
    blank = trip("blank", 0)
    for at, name in ((2, "lat"), (3, "lon")):
        blank = blank.set_column(at, name, pa.nulls(len(blank), pa.float64()))
    table = pa.concat_tables([fleet.slice(0, 32), blank])
    many = match_many(table.append_column("speed_mps", pa.array(np.full(64, 12.0))), roads)
    assert many.drives["answered"].to_pylist() == [True, False]
    assert many.drives["skipped"].to_pylist() == [[], [("no position", 32)]]


def test_trips_in_a_projected_system_are_matched_by_its_name(roads, fleet):
    import pyproj

    x, y = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform(
        fleet["lon"].to_numpy(), fleet["lat"].to_numpy()
    )
    projected = fleet.drop_columns(["lat", "lon"]).append_column("x", pa.array(x))
    projected = projected.append_column("y", pa.array(y))
    usual, found = match_many(fleet, roads), match_many(projected, roads, crs="EPSG:32632")
    assert found.points["edge_id"].equals(usual.points["edge_id"])
    told = match_many(projected, roads).drives
    assert not any(told["answered"].to_pylist())
    assert "crs=" in told["reason"][0].as_py()
    assert told["skipped"][0].as_py() == []


def test_a_failure_nobody_thought_of_is_one_trips_alone(roads, fleet, monkeypatch):
    def localize(roads, timeline, **more):
        if timeline.epochs.time[0] == 1.6e9 + 100:
            raise ZeroDivisionError("oops")
        return localize_recorded(roads, timeline, **more)

    def localize_all(roads, epochs, *more):
        if (epochs.time == 1.6e9 + 100).any():
            raise ZeroDivisionError("oops")
        return filter_batch(roads, epochs, *more)

    monkeypatch.setattr(trips, "localize_recorded", localize)
    monkeypatch.setattr(trips, "filter_batch", localize_all)
    rows = match_many(fleet, roads).drives.to_pylist()
    assert [row["answered"] for row in rows] == [i != 2 for i in range(7)]
    assert "ZeroDivisionError: oops" in rows[2]["reason"]


@pytest.mark.parametrize("room", [0, 5, 12])
def test_trips_that_need_more_room_are_matched_alone(roads, fleet, monkeypatch, room):
    whole = match_many(fleet, roads)
    monkeypatch.setattr(filtering, "_EDGES", 0)
    monkeypatch.setattr(filtering, "_MORE_EDGES", room)  # a trip drives some four edges
    assert same(whole, match_many(fleet, roads))


def test_buffers_are_allocated_once_however_many_calls_and_threads(roads, fleet, monkeypatch):
    whole = match_many(fleet, roads, threads=1)
    monkeypatch.setattr(workspace, "new_work", None)  # calling it would fail
    assert same(whole, match_many(fleet, roads, threads=1))  # in another thread than before


@pytest.mark.parametrize("steps", [9, 32, 33])
def test_trips_that_need_more_room_are_smoothed_alone(roads, fleet, monkeypatch, steps):
    mixed = pa.concat_tables([fleet, trip("last", 1, 1.6e9 + 900.0).slice(0, 9)])
    whole = match_many(mixed, roads, lag="full", threads=1)
    monkeypatch.setattr(workspace, "_STEPS", steps)  # a trip has 32
    assert same(whole, match_many(mixed, roads, lag="full", threads=1))


def test_tables_that_cannot_be_made_are_one_trips_alone(roads, fleet, monkeypatch):
    def path_table(names, *args):
        if "car 3" in names:
            raise ZeroDivisionError("oops")
        return export.path_table(names, *args)

    monkeypatch.setattr(trips, "path_table", path_table)
    many = match_many(fleet, roads)
    rows = many.drives.to_pylist()
    assert [row["answered"] for row in rows] == [i != 3 for i in range(7)]
    assert "ZeroDivisionError: oops" in rows[3]["reason"]
    assert set(many.points["drive_id"].to_pylist()) == {f"car {i}" for i in range(7) if i != 3}


def test_batches_of_a_stream_may_have_other_types_and_columns(roads, fleet):
    whole = match_many(fleet, roads)
    first, second = fleet.slice(0, 40), fleet.slice(40)
    texts = second.cast(pa.schema([(name, pa.string()) for name in second.column_names]))
    assert same(match_many(iter([first, texts]), roads), whole)
    more = second.append_column("hdop", pa.nulls(len(second), pa.float64()))
    assert same(match_many(iter([first, more]), roads), whole)


def test_what_a_trip_had_skipped_is_its_own(roads, fleet):
    lat = fleet["lat"].to_numpy().copy()
    lat[40:43] = 95.0
    dirty = fleet.set_column(2, "lat", pa.array(lat))
    rows = match_many(dirty, roads).drives.to_pylist()
    assert [sum(n for _, n in row["skipped"]) for row in rows] == [0, 3, 0, 0, 0, 0, 0]


def test_the_trips_column_is_found_by_its_aliases_or_named(roads, fleet):
    whole = match_many(fleet, roads)
    assert same(whole, match_many(fleet.rename_columns(["trip_id", "time", "lat", "lon"]), roads))
    odd = fleet.rename_columns(["Fahrt", "time", "lat", "lon"])
    assert same(whole, match_many(odd, roads, drive_id="Fahrt"))
    assert same(whole, match_many(odd.to_pandas(), roads, drive_id="Fahrt"))
    theirs = fleet.rename_columns(["journey", "device_ts", "lat", "lon"]).to_pandas()
    with pytest.raises(whichroad.ReadError, match=r"no time .*\(journey, device_ts, lat, lon\)"):
        match_many(theirs, roads)
    with pytest.raises(whichroad.ReadError, match="no column 'drive_id'"):
        match_many(odd, roads)


def test_attributes_have_their_columns_also_where_nothing_is_answered(roads, fleet, monkeypatch):
    monkeypatch.setattr(many_trips, "BATCH_ROWS", 40)
    lat = fleet["lat"].to_numpy().copy()
    lat[:32] = -33.0
    many = match_many(fleet.set_column(2, "lat", pa.array(lat)), roads, attributes=True)
    assert many.points.schema.equals(pa.schema([*POINTS, *ATTRIBUTES]))
    assert many.drives["answered"].to_pylist() == [False] + [True] * 6


def test_numbers_name_trips_too(roads):
    table = pa.concat_tables([trip("a", 0), trip("b", 1)])
    for ids in ([7, 5], [7.0, 123456789012345680.0], [7.5, 5.0]):
        named = table.set_column(0, "drive_id", pa.array(np.repeat(ids, 32)))
        expected = [str(i if i % 1 else int(i)) for i in ids]
        assert match_many(named, roads).drives["drive_id"].to_pylist() == expected


NAMED = [uuid.uuid5(uuid.NAMESPACE_DNS, str(i)) for i in range(7)]


def of_bytes(ids: list[uuid.UUID]) -> pa.Array:
    return pa.ExtensionArray.from_storage(
        pa.uuid(), pa.array([i.bytes for i in ids], pa.binary(16))
    )


@pytest.mark.parametrize(
    ("ids", "column", "text"),
    [
        (NAMED, of_bytes, str),
        ([f"car {i}" for i in range(7)], lambda ids: pc.run_end_encode(pa.array(ids)), str),
        ([f"car {i}" for i in range(7)], lambda ids: pa.array(ids, pa.binary()), str),
        ([b"\xff\x00", b"\xff\x01"], pa.array, bytes.hex),
        # UUIDs, one of which is text by chance
        (
            [b"\xff" * 16, b"\x1f!YB)x`&^tYB\x05JAB"],
            lambda ids: pa.array(ids, pa.binary(16)),
            bytes.hex,
        ),
        ([b"\xff" * 16, b"\x1f!YB)x`&^tYB\x05JAB"], pa.array, bytes.hex),
        ([["car", str(i)] for i in range(7)], pa.array, str),
    ],
    ids=["uuid", "runs", "bytes", "no text", "fixed", "one text", "lists"],
)
def test_names_of_trips_may_be_of_any_type_of_arrow(roads, fleet, ids, column, text):
    rows = fleet.slice(0, 32 * len(ids))
    each = [name for name in ids for _ in range(32)]
    table = rows.set_column(0, "trip_id", column(each))
    wanted = match_many(rows.set_column(0, "trip_id", pa.array(list(map(text, each)))), roads)
    assert wanted.drives["answered"].to_pylist() == [True] * len(ids)
    assert same(match_many(table, roads), wanted)
    assert same(match_many(iter(table.to_batches(20)), roads), wanted)
    assert same(match_many(table.rename_columns({"trip_id": "own"}), roads, drive_id="own"), wanted)
    alone = whichroad.match(table, roads).to_arrow()["drive_id"]
    assert alone.to_pylist() == wanted.points["drive_id"].to_pylist()


def test_uuids_of_pandas_and_runs_of_numbers_are_read(roads, fleet):
    frame = fleet.to_pandas()
    frame["drive_id"] = [NAMED[int(name[-1])] for name in frame["drive_id"]]
    assert match_many(frame, roads).drives["drive_id"].to_pylist() == list(map(str, NAMED))
    runs = {name: pc.run_end_encode(fleet[name].combine_chunks()) for name in fleet.column_names}
    assert same(match_many(pa.table(runs), roads), match_many(fleet, roads))


def test_files_and_folders_are_streams(roads, fleet, tmp_path):
    whole = match_many(fleet, roads)
    pq.write_table(fleet, tmp_path / "one.parquet", row_group_size=20)
    assert same(whole, match_many(tmp_path / "one.parquet", roads))
    folder = tmp_path / "many"
    folder.mkdir()
    for i in range(7):
        pq.write_table(fleet.slice(32 * i, 32), folder / f"{i}.parquet")
    assert same(whole, match_many(str(folder), roads))


def test_values_that_folders_bear_are_columns_of_text(roads, fleet, tmp_path):
    names = [f"car {i}" for i in range(7)]
    whole = match_many(fleet, roads)
    for i, name in enumerate(names):
        part = tmp_path / "trips" / f"trip_id={name.replace(' ', '%20')}"
        part.mkdir(parents=True)
        pq.write_table(fleet.slice(32 * i, 32).drop_columns("drive_id"), part / "part-0.parquet")
    assert same(whole, match_many(tmp_path / "trips", roads))
    for i, number in enumerate(["007", "8"]):
        part = tmp_path / "numbers" / "region=eu" / f"trip_id={number}"
        part.mkdir(parents=True)
        rows = fleet.slice(32 * i, 32)
        pq.write_table(rows.drop_columns("drive_id"), part / "part-0.parquet")
        part = tmp_path / "twice" / f"drive_id={number}"
        part.mkdir(parents=True)
        pq.write_table(rows, part / "part-0.parquet")
    assert match_many(tmp_path / "numbers", roads).drives["drive_id"].to_pylist() == ["007", "8"]
    twice = match_many(tmp_path / "twice", roads)  # what the files say goes first
    assert twice.drives["drive_id"].to_pylist() == names[:2]


def lake(folder, fleet):
    """A folder of one file for each of seven trips, with a speed."""
    folder.mkdir()
    table = fleet.append_column("speed_mps", pa.array([12.0] * len(fleet)))
    for i in range(7):
        pq.write_table(table.slice(32 * i, 32), folder / f"{i}.parquet")
    return table


def test_columns_that_the_first_file_of_a_folder_lacks_are_used(roads, fleet, tmp_path):
    table, folder = lake(tmp_path / "trips", fleet), tmp_path / "trips"
    whole = match_many(folder, roads)
    first = table.slice(0, 32).drop_columns("speed_mps")
    whole_seconds = pa.array(np.array(first["time"]).astype(np.int64))
    pq.write_table(first.set_column(1, "time", whole_seconds), folder / "0.parquet")
    found = match_many(folder, roads)
    later = pc.field("drive_id") != "car 0"
    assert found.points.filter(later).equals(whole.points.filter(later))
    assert not found.points.equals(whole.points)
    assert found.drives["answered"].to_pylist() == [True] * 7


def test_a_folder_tells_its_system_of_coordinates_by_its_first_file(tmp_path, fleet):
    lake(tmp_path / "trips", fleet)
    first = pq.read_table(tmp_path / "trips" / "0.parquet").replace_schema_metadata({"geo": "{}"})
    pq.write_table(first, tmp_path / "trips" / "0.parquet")
    data = trip_files.dataset_of(tmp_path / "trips")
    assert data.schema.metadata[b"geo"] == b"{}"
    assert data.schema.names == [*fleet.column_names, "speed_mps"]
    text = first.set_column(1, "time", pa.array(["x"] * 32))  # it goes with no number
    pq.write_table(text, tmp_path / "trips" / "1.parquet")
    assert trip_files.dataset_of(tmp_path / "trips").schema.field("time").type == pa.float64()
    with pytest.raises(ReadError, match=r"1\.parquet: cannot be read to its end .*of one kind"):
        list(trip_files.batches_in(data, data.schema.names, 100))


def test_other_files_of_a_folder_are_left_out_and_bad_ones_are_named(roads, fleet, tmp_path):
    table, folder = lake(tmp_path / "trips", fleet), tmp_path / "trips"
    whole = match_many(table, roads)
    (folder / "readme.txt").write_text("hi")
    (folder / "_SUCCESS").write_text("")
    assert same(match_many(folder, roads), whole)
    said = []
    assert len(trip_files.dataset_of(folder, said).files) == 7
    assert said == ["readme.txt: no .parquet file"]
    (folder / "0a.parquet").write_bytes(b"")
    (folder / "3.parquet").write_bytes((folder / "4.parquet").read_bytes()[:500])
    with pytest.raises(
        ReadError, match=r"2 files: .*0a\.parquet: .*3\.parquet: .*sound files were"
    ):
        match_many(folder, roads)
    said = []
    assert len(trip_files.dataset_of(folder, said).files) == 6
    assert [line.partition(":")[0] for line in said] == ["readme.txt", "0a.parquet", "3.parquet"]
    (folder / "more.csv").write_text("drive_id,time,lat,lon\n")
    with pytest.raises(ReadError, match=r"more\.csv in it may hold trips, too"):
        match_many(folder, roads)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ReadError, match=r"no \.parquet file is in it"):
        match_many(empty, roads)


def test_a_file_that_is_damaged_inside_is_named(roads, fleet, tmp_path):
    lake(tmp_path / "trips", fleet)
    bad = tmp_path / "trips" / "3.parquet"
    data = bytearray(bad.read_bytes())
    data[4:400] = b"\xff" * 396
    bad.write_bytes(data)
    with pytest.raises(ReadError, match=r"3\.parquet: cannot be read to its end"):
        match_many(tmp_path / "trips", roads)


def test_what_is_no_table_of_trips_is_refused_with_what_to_do(roads, fleet):
    frame = fleet.to_pandas()
    for one in (frame["lat"], iter([frame["lat"]]), frame.iloc[0]):
        with pytest.raises(ReadError, match=r"Series is one column; .*give the whole frame"):
            match_many(one, roads)
    with pytest.raises(ReadError, match=r"pandas\.read_csv .*`whichroad fleet`"):
        match_many("trips.csv", roads)
    with pytest.raises(ReadError, match="where each file is a drive"):
        match_many("trip.gpx", roads)


class Capsule:
    """A table that shows nothing but its stream, as `to_arrow()` of geopandas gives it."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self._table.__arrow_c_stream__(requested_schema)


def test_whatever_gives_a_stream_of_arrow_is_a_table(roads, fleet):
    whole = match_many(fleet, roads)
    for given in (Capsule(fleet), ds.dataset(fleet).scanner(), ds.dataset(fleet)):
        assert same(whole, match_many(given, roads))
        if not isinstance(given, ds.Dataset):
            for ordered in (False, True):
                paths = match_batches(given, roads, ordered=ordered)
                assert pa.Table.from_batches(paths).equals(whole.path)


def test_no_trips_are_tables_without_rows(roads, fleet):
    for none in (fleet.slice(0, 0), iter([])):
        many = match_many(none, roads)
        assert [t.num_rows for t in many] == [0, 0, 0]
        assert many.points.schema.equals(POINTS)


def test_only_what_is_worked_on_is_taken_from_a_stream(roads, monkeypatch):
    monkeypatch.setattr(many_trips, "APART", 50)
    monkeypatch.setattr(many_trips, "BATCH_ROWS", 40)
    taken = itertools.count()
    last = 0

    def endless() -> Iterator[pa.RecordBatch]:
        nonlocal last
        for last in taken:
            yield from trip(f"car {last}", last % 3, 1.6e9 + 50 * last).to_batches()

    for i, part in enumerate(match_stream(endless(), roads, threads=2)):
        assert part.drives["drive_id"].to_pylist() == [f"car {i}"]
        assert last - i <= 2 * 2 + 4  # chunks ahead, and trips that may not be whole
        if i == 20:
            break


def test_a_trip_over_the_end_of_a_large_batch_is_one(roads, fleet, monkeypatch):
    monkeypatch.setattr(many_trips, "APART", 20)
    whole = match_many(fleet, roads)
    for rows in (50, 70, 110):  # more than `APART`; the trips have 32 each
        batches = fleet.combine_chunks().to_batches(max_chunksize=rows)
        assert same(whole, match_many(iter(batches), roads))
        paths = list(match_batches(iter(batches), roads))
        assert pa.Table.from_batches(paths).equals(whole.path)


def test_progress_is_told(roads, fleet):
    told = []
    match_many(fleet, roads, progress=lambda what, done, of: told.append((what, done, of)))
    assert told[-1] == ("trips", 7, 0)


@pytest.mark.parametrize("thing", [7, None])
def test_what_is_no_table_is_refused(roads, thing):
    with pytest.raises(whichroad.ReadError, match="not a table of trips"):
        match_many(thing, roads)


@pytest.mark.parametrize("split", [None, 300.0])
@pytest.mark.parametrize("stream", [False, True])
def test_a_table_without_places_is_refused_by_its_columns(roads, fleet, split, stream):
    table = fleet.drop_columns("lat")
    source = pa.RecordBatchReader.from_batches(table.schema, table.to_batches())
    with pytest.raises(whichroad.ReadError, match=r"no position among .*time, lon.*lat: lat, "):
        match_many(source if stream else table, roads, split=split)


def test_a_list_of_rows_is_a_table(roads, fleet):
    rows = fleet.to_pylist()
    assert same(match_many(rows, roads), match_many(fleet, roads))
    assert same(match_many([fleet.to_pydict()], roads), match_many(fleet, roads))


def test_records_of_numpy_are_a_table(roads, fleet):
    whole = match_many(fleet, roads)
    for index in (False, True):
        assert same(match_many(fleet.to_pandas().to_records(index=index), roads), whole)


def test_places_in_a_struct_are_columns(roads, fleet, tmp_path):
    whole = match_many(fleet, roads)
    places = pa.StructArray.from_arrays(
        [fleet[name].combine_chunks() for name in ("lat", "lon")], ["lat", "lon"]
    )
    nested = fleet.drop_columns(["lat", "lon"]).append_column("location", places)
    pq.write_table(nested, tmp_path / "nested.parquet")
    stream = pa.RecordBatchReader.from_batches(nested.schema, nested.to_batches(50))
    for given in (nested, stream, tmp_path / "nested.parquet"):
        assert same(match_many(given, roads), whole)
    first = fleet["drive_id"][0]
    for suffix, write in (("parquet", pq.write_table), ("arrow", feather.write_feather)):
        path = tmp_path / f"one.{suffix}"
        write(nested.filter(pc.equal(nested["drive_id"], first)), path)
        (drive,) = read_drive(path)
        assert len(drive.fixes) == 32


def test_fields_of_structs_may_be_named(roads, fleet, tmp_path):
    whole, own = match_many(fleet, roads), {"lat": "at.a", "lon": "at.b"}
    places = pa.StructArray.from_arrays(
        [fleet[name].combine_chunks() for name in ("lat", "lon")], ["a", "b"]
    )
    nested = fleet.drop_columns(["lat", "lon"]).append_column("at", places)
    pq.write_table(nested, tmp_path / "nested.parquet")
    stream = pa.RecordBatchReader.from_batches(nested.schema, nested.to_batches(50))
    for given in (nested, stream, tmp_path / "nested.parquet"):
        assert same(match_many(given, roads, columns=own), whole)
    one = nested.filter(pc.equal(nested["drive_id"], fleet["drive_id"][0]))
    for suffix, write in (("parquet", pq.write_table), ("arrow", feather.write_feather)):
        path = tmp_path / f"one.{suffix}"
        write(one, path)
        (drive,) = read_drive(path, columns=own)
        assert len(drive.fixes) == 32
    with pytest.raises(ReadError, match=r"'at\.c'"):
        drive_from_table(one, columns={"lat": "at.c", "lon": "at.b"})


def test_the_column_that_is_named_names_trips_beside_one_of_a_usual_name(roads, fleet, tmp_path):
    vehicles = pa.array([f"bus {i // 96}" for i in range(len(fleet))])
    table = fleet.append_column("vehicle", vehicles)
    pq.write_table(table, tmp_path / "trips.parquet")
    for given in (table, table.to_pandas(), str(tmp_path / "trips.parquet")):
        for named in (
            {"drive_id": "vehicle"},
            {"drive_id": "Vehicle"},
            {"columns": {"trip_id": "vehicle"}},
            {"columns": {"vehicle_id": "vehicle"}, "drive_id": "vehicle"},
        ):
            drives = match_many(given, roads, **named).drives
            assert drives["drive_id"].to_pylist() == ["bus 0", "bus 1", "bus 2"]


def test_ids_beyond_64_bits_are_texts(roads):
    table = trip("a", 0).to_pandas().assign(drive_id=pd.Series([2**70 + 1] * 32, dtype=object))
    for given in (table, table.to_dict("list"), table.to_dict("records")):
        assert match_many(given, roads).drives["drive_id"].to_pylist() == [str(2**70 + 1)]


def test_a_frame_without_rows_yet_is_refused_before_its_columns_are_asked(roads):
    class LazyFrame:
        """One of polars: it works out what its columns are, and warns."""

        @property
        def columns(self):
            raise AssertionError

        schema = columns

    with pytest.raises(whichroad.ReadError, match=r"LazyFrame .* give its \.collect"):
        match_many(LazyFrame(), roads)


def test_objects_that_polars_has_for_names_are_read_as_their_text(roads, fleet):
    class Frame:
        """One of polars: of objects it gives where they are in memory."""

        columns = fleet.column_names
        schema = dict.fromkeys(fleet.column_names, "Float64") | {"drive_id": "Object"}

        def __getitem__(self, name):
            return [NAMED[int(each[-1])] for each in fleet[name].to_pylist()]

        def __arrow_c_stream__(self, requested_schema=None):
            places = pa.array([i.to_bytes(8) for i in range(len(fleet))], pa.binary(8))
            return fleet.set_column(0, "drive_id", places).__arrow_c_stream__(requested_schema)

    assert match_many(Frame(), roads).drives["drive_id"].to_pylist() == list(map(str, NAMED))


def test_a_frame_of_dask_is_refused_with_what_gives_its_rows(roads, fleet):
    lazy = type("DataFrame", (pd.DataFrame,), {"__module__": "dask.dataframe.dask_expr"})
    frame = lazy(fleet.to_pandas())
    for read in (lambda: match_many(frame, roads), lambda: whichroad.match(frame, roads)):
        with pytest.raises(whichroad.ReadError, match=r"a DataFrame of Dask .*\.compute\(\)"):
            read()


def test_cells_of_several_kinds_are_read_as_those_of_a_column_of_text(roads, fleet):
    cells = fleet["lat"].to_pylist()
    cells[40] = "n/a"
    many = match_many({**fleet.to_pydict(), "lat": cells}, roads)
    text = fleet.set_column(2, "lat", pa.array(map(str, cells)))
    assert same(many, match_many(text, roads))
    assert [len(skipped) for skipped in many.drives["skipped"].to_pylist()] == [0, 1, *[0] * 5]


def test_fixes_whose_error_is_beyond_use_are_skipped_and_counted_in_their_trip(roads, fleet):
    sigma = np.full(len(fleet), 3.0)
    sigma[40:45] = 9999.0
    table = fleet.append_column("sigma_m", pa.array(sigma))
    many = match_many(table, roads)
    assert [[n for _, n in s] for s in many.drives["skipped"].to_pylist()][:3] == [[], [5], []]
    one = whichroad.match(table.slice(32, 32), roads)
    mine = pa.compute.equal(many.points["drive_id"], "car 1")
    assert many.points.filter(mine).equals(one.to_arrow())


def test_rounded_coordinates_are_found_in_each_trip_as_alone(roads, fleet):
    lat, lon = fleet["lat"].to_numpy().copy(), fleet["lon"].to_numpy().copy()
    lat[32:96] += 1e-4 * (np.arange(64) % 7)
    lat[32:96], lon[32:96] = lat[32:96].round(4), lon[32:96].round(4)
    table = fleet.set_column(2, "lat", pa.array(lat)).set_column(3, "lon", pa.array(lon))
    many = match_many(table, roads)
    told = [[n[:23] for n in notes] for notes in many.drives["notes"].to_pylist()]
    assert told == [[], ["coordinates are rounded"], ["coordinates are rounded"], *[[]] * 4]
    one = whichroad.match(table.slice(32, 32), roads)
    mine = pa.compute.equal(many.points["drive_id"], "car 1")
    assert many.points.filter(mine).equals(one.to_arrow())
    assert one.summary["notes"] == many.drives["notes"][1].as_py()


def resampled(column: str) -> pa.Table:
    """The trips one after the other as two of 112 rows, the first of which is resampled."""
    n, rng = 224, np.random.default_rng(5)
    x = 10.0 + np.tile(np.cumsum(1.5 + np.sin(np.arange(112) / 9.0)), 2)
    values = {
        "time": 1.6e9 + np.arange(n),
        "speed_mps": (2.0 + np.sin(np.arange(n) / 7.0)).round(2),
        "bearing_deg": rng.normal(90.0, 2.0, n),
    }
    lat, lon = PLANE.to_geodetic(*(np.array([x, 0.0 * x]) + rng.normal(0.0, 1.0, (2, n))))
    values |= {"lat": lat, "lon": lon}
    row = np.arange(112)
    for name in (column, "lon") if column == "lat" else (column,):
        own = values[name][:112]
        own[:] = np.interp(row, row[::9], own[::9]) if column == "lat" else own[row // 4 * 4]
    return pa.table({"drive_id": np.repeat(["a", "b"], 112), **values})


@pytest.mark.parametrize(
    ("column", "note"), [("lat", "places of 99"), ("speed_mps", "speeds of 84"),
                         ("bearing_deg", "courses of 84")]
)  # fmt: skip
def test_resampled_columns_are_found_in_each_trip_as_alone(roads, column, note):
    table = resampled(column)
    many = match_many(table, roads)
    told, others = many.drives["notes"].to_pylist()
    assert others == []
    assert told[0].startswith(note)
    one = whichroad.match(table.slice(0, 112), roads)
    mine = pa.compute.equal(many.points["drive_id"], "a")
    assert many.points.filter(mine).equals(one.to_arrow())
    assert one.summary["notes"] == told


def test_no_thread_is_no_number_of_threads(roads, fleet):
    with pytest.raises(whichroad.SettingError, match="threads is 0"):
        match_many(fleet, roads, threads=0)


def test_a_wrong_setting_is_the_callers_not_a_trips(roads, fleet):
    with pytest.raises(whichroad.SettingError, match="lag is 'soon'"):
        match_many(fleet, roads, lag="soon")


def their_own(fleet: pa.Table) -> pa.Table:
    """The same with other names, and times of Berlin that name no zone."""
    local = pa.array((fleet["time"].to_numpy() + 7200.0) * 1e6).cast(pa.int64())
    names = {"Fahrt": fleet["drive_id"], "Zeit": local.cast(pa.timestamp("us"))}
    return pa.table(names | {"Breite": fleet["lat"], "Laenge": fleet["lon"]})


OWN = {"time": "Zeit", "lat": "Breite", "lon": "Laenge"}


def test_own_names_of_columns_and_a_zone_are_those_of_a_trip_alone(roads, fleet, tmp_path):
    whole, theirs = match_many(fleet, roads), their_own(fleet)
    assert fleet["time"][0].as_py() == 1.6e9  # in September, two hours before UTC
    more = {"columns": OWN, "tz": "Europe/Berlin"}
    assert same(whole, match_many(theirs, roads, drive_id="Fahrt", **more))
    assert same(whole, match_many(theirs.to_pandas(), roads, drive_id="Fahrt", **more))
    named = more | {"columns": OWN | {"drive_id": "Fahrt"}}
    assert same(whole, match_many(iter(theirs.to_batches(max_chunksize=20)), roads, **named))
    pq.write_table(theirs, tmp_path / "theirs.parquet")
    assert same(whole, match_many(tmp_path / "theirs.parquet", roads, **named))
    batches = whichroad.fleet.match_batches(theirs.to_batches(), roads, ordered=True, **named)
    assert pa.Table.from_batches(batches).equals(whole.path)
    parts = match_many(theirs, roads, split="5min", **named)
    assert parts.drives["drive_id"][0].as_py() == "car 0/1"
    utc = match_many(theirs, roads, columns=named["columns"])
    assert (utc.points["time"][0].as_py() - whole.points["time"][0].as_py()).seconds == 7200
    for column in (1, "1"):
        with pytest.raises(ReadError, match="the name of a column was expected"):
            match_many(theirs, roads, drive_id="Fahrt", columns=OWN | {"time": column})
    with pytest.raises(ReadError, match="not a known time zone"):
        match_many(fleet, roads, tz="Mars")


def test_a_zone_that_is_not_needed_is_noted_as_of_a_trip_alone(roads, fleet):
    notes = match_many(fleet.slice(0, 32), roads, tz="Europe/Berlin").drives["notes"][0].as_py()
    alone = whichroad.match(fleet.slice(0, 32), roads, tz="Europe/Berlin")
    assert notes == alone.summary["notes"] != []


def test_fixes_off_the_map_are_counted_for_each_trip(roads, fleet):
    lat = fleet["lat"].to_numpy().copy()
    lat[5:12] += 0.05
    away = fleet.set_column(2, "lat", pa.array(lat))
    drives = match_many(away, roads).drives
    assert drives["fixes_outside_map"].to_pylist() == [7, 0, 0, 0, 0, 0, 0]
    alone = whichroad.match(away.slice(0, 32), roads).summary
    assert alone["fixes_outside_map"] == 7
    plain = match_many(fleet, roads, lag="full").drives
    assert plain["fixes_outside_map"].to_pylist() == [0] * 7


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("room", [0, 1, 64])
def test_a_speed_whose_unit_cannot_be_told_is_noted(roads, fleet, monkeypatch, lag, room):
    """And once the places have shown that it is wrong, that it was withheld."""
    monkeypatch.setattr(filtering, "_VETTED", room)
    few = pa.concat_tables([fleet.slice(0, 32), fleet.slice(32, 5)])
    table = few.append_column("speed", pa.array([43.2] * 32 + [0.5] * 5))
    moving, standing = match_many(table, roads, lag=lag).drives["notes"].to_pylist()
    assert "'speed' taken in m/s" in moving[0]
    assert "too short" in moving[0]
    assert moving[1].startswith("gnss speed: the receiver's speed was 3.")
    assert standing == []  # whatever the unit, it stands
    alone = [one["notes"] for one in whichroad.match(table, roads).summary["each"]]
    assert alone == [moving[:1], []]
    kmh = table.rename_columns([*table.column_names[:-1], "speed_kmh"])
    assert match_many(kmh, roads).drives["notes"].to_pylist() == [[], []]


def with_speed(fleet: pa.Table, factor: float = 3.6) -> pa.Table:
    """Trips of 32, 5, 9, 32, ... fixes whose speed, 12 m/s, is in a unit that no name tells."""
    lengths = (32, 5, 9, 32, 5, 9, 32)
    table = pa.concat_tables([fleet.slice(32 * i, n) for i, n in enumerate(lengths)])
    return table.append_column("speed", pa.array(np.full(len(table), 12.0 * factor)))


KMH = "column 'speed' taken in km/h, which fits the places"


def test_a_column_has_one_unit_for_all_trips_of_a_table_as_of_match(roads, fleet, tmp_path):
    table = with_speed(fleet)
    one = whichroad.match(table, roads)
    many = match_many(table, roads)
    assert many.points.equals(one.to_arrow())
    assert many.path.equals(one.path_arrow())
    assert many.drives["notes"].to_pylist() == [[KMH]] * 7
    assert [drive["notes"] for drive in one.summary["each"]] == [[KMH]] * 7
    named = table.rename_columns([*table.column_names[:-1], "speed_kmh"])
    assert many.points.equals(match_many(named, roads).points)
    pq.write_table(table, tmp_path / "t.parquet", row_group_size=40)
    for source in (iter(table.to_batches(max_chunksize=11)), tmp_path / "t.parquet"):
        assert same(many, match_many(source, roads))
    parts = whichroad.fleet.match_batches(table.to_batches(max_chunksize=11), roads, ordered=True)
    assert pa.Table.from_batches(parts).equals(many.path)


@pytest.mark.parametrize("kind", ["text", "odometry", "odd"])
def test_trips_that_are_read_alone_have_the_unit_of_their_table(roads, fleet, kind):
    table = with_speed(fleet, 6.0 if kind == "odd" else 3.6)  # 6.0 fits no unit
    if kind == "text":
        table = table.set_column(4, "speed", table["speed"].cast(pa.string()))
    elif kind == "odometry":
        table = table.append_column("yaw_rate", pa.array(np.zeros(len(table))))
    one, many = whichroad.match(table, roads), match_many(table, roads)
    assert many.points.equals(one.to_arrow())
    notes = many.drives["notes"].to_pylist()
    assert notes == [drive["notes"] for drive in one.summary["each"]]
    said = "column 'speed' not used: as m/s it is " if kind == "odd" else KMH
    assert all(note[0].startswith(said) for note in notes)


def test_the_trips_that_tell_the_unit_are_the_same_however_they_come(roads, fleet, monkeypatch):
    table = with_speed(fleet)
    speed = np.where(np.arange(len(table)) < 46, 43.2, 12.0)  # those behind would say m/s
    table = table.set_column(4, "speed", pa.array(speed))
    monkeypatch.setattr(table_units, "MOST_ROWS", 78)  # those of four trips
    monkeypatch.setattr(trip_units, "MOST_ROWS", 78)
    monkeypatch.setattr(many_trips, "BATCH_ROWS", 40)
    one, many = whichroad.match(table, roads), match_many(table, roads)
    assert many.points.equals(one.to_arrow())
    assert same(many, match_many(iter(table.to_batches(max_chunksize=7)), roads))
    monkeypatch.setattr(table_units, "MOST_ROWS", 46)
    other = whichroad.match(table, roads)
    assert not many.points.equals(other.to_arrow())


def test_columns_that_come_later_in_a_stream_are_asked_for_their_unit(roads, fleet):
    first, then = fleet.slice(0, 32), with_speed(fleet).slice(32)
    notes = match_many(iter([first, then]), roads).drives["notes"].to_pylist()
    assert notes == [[], *[[KMH]] * 6]
