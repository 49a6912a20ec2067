"""Rows and files of several vehicles are several drives, and never one."""

import json

import numpy as np
import pandas as pd
import pytest

import whichroad
from whichroad import GeoFix
from whichroad.errors import DriveError, ReadError
from whichroad.inspection import inspect_files
from whichroad.observations import STRAY
from whichroad.readers import drive_from_table, read_drive
from whichroad.readers.mixed_rows import alternating
from whichroad.readers.names import NAMES

T0 = 1_780_315_200.0  # 2026-06-01 12:00 UTC
N = 30
METRES = 1.0 / 111_195.0  # degrees of latitude


def going(lat=49.4, t0=T0, n=N, speed=10.0):
    """Fixes of a vehicle that drives north, a second apart."""
    k = np.arange(n)
    return pd.DataFrame({"time": t0 + k, "lat": lat + speed * METRES * k, "lon": 8.7})


def two(**ids):
    """Rows of two vehicles in turn, 11 km apart."""
    a, b = going(49.4), going(49.5)
    rows = pd.concat([a, b]).sort_index(kind="stable").reset_index(drop=True)
    return rows.assign(**{name: np.tile(values, N) for name, values in ids.items()})


USUAL = [
    *("vehicle_id", "device_id", "deviceId", "imei", "vin", "uid", "user_id", "TrackID"),
    *("journeyId", "id", "tripId", "individual-local-identifier", "taxi_id"),
]


@pytest.mark.parametrize("name", USUAL)
def test_the_usual_names_of_ids_tell_vehicles_apart(name):
    drives = drive_from_table(two(**{name: ["7", "8"]}))
    assert [drive.drive_id for drive in drives] == ["7", "8"]
    assert [len(drive.fixes) for drive in drives] == [N, N]
    assert drives[1].fixes.lat_deg.min() >= 49.5 > drives[0].fixes.lat_deg.max()


@pytest.mark.parametrize("quantity", ["drive_id", "vehicle_id"])
def test_every_documented_id_tells_vehicles_apart(quantity):
    for name in NAMES[quantity]:
        assert len(drive_from_table(two(**{name: ["7", "8"]}))) == 2, name


@pytest.mark.parametrize("later", [0.0, 0.5])
def test_rows_of_two_vehicles_without_an_id_are_refused_with_what_to_do(later):
    rows = two()
    rows["time"] += np.tile([0.0, later], N)
    with pytest.raises(ReadError, match=r"farther than any vehicle gets; .*--id COLUMN"):
        drive_from_table(rows)
    three = rows.assign(trip=np.repeat(["a", "b"], N))
    assert any("drive a: " in note for note in drive_from_table(three)[0].notes)


def test_rows_of_a_receiver_without_a_fix_are_no_other_vehicle():
    rows = going()
    rows.loc[::2, ["lat", "lon"]] = 0.0
    (drive,) = drive_from_table(rows)
    assert drive.skipped == {"impossible position": N // 2}


def test_single_wild_fixes_are_no_other_vehicle():
    rows = going()
    rows.loc[[5, 11, 20], "lat"] += 1.0
    (drive,) = drive_from_table(rows)
    assert len(drive.fixes) == N


def test_an_id_that_numbers_rows_does_not():
    (drive,) = drive_from_table(going().assign(id=np.arange(N)))
    assert len(drive.fixes) == N


def test_a_trip_that_two_vehicles_have_is_two_drives():
    drives = drive_from_table(two(trip_id=["1", "1"], vehicle_id=["x", "y"]))
    assert [drive.drive_id for drive in drives] == ["x/1", "y/1"]
    drives = drive_from_table(two(trip_id=["1", "2"], vehicle_id=["x", "x"]))
    assert [drive.drive_id for drive in drives] == ["1", "2"]


def test_the_caller_says_which_column_tells_drives_apart(tmp_path):
    table = two(vehicle_id=["x", "x"], Fahrt=["a", "b"])
    with pytest.raises(ReadError, match="--id"):  # two vehicles are said to be one
        drive_from_table(table)
    assert [d.drive_id for d in drive_from_table(table, id="Fahrt")] == ["a", "b"]
    table.to_csv(tmp_path / "x.csv", index=False)
    assert len(read_drive(tmp_path / "x.csv", id="Fahrt")) == 2
    with pytest.raises(ReadError, match=r"no column 'Trip' .*Fahrt"):
        drive_from_table(table, id="Trip")


def files(folder, **tables):
    """The tables as CSV, by name."""
    paths = []
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
        paths.append(folder / f"{name}.csv")
    return paths


def test_files_of_two_vehicles_at_one_time_are_two_drives(tmp_path):
    drives = read_drive(files(tmp_path, a=going(49.4), b=going(49.5)))
    assert [drive.drive_id for drive in drives] == ["a", "b"]
    assert "2 files are 2 drives" in drives[0].notes[0]


def test_files_of_two_vehicles_in_turn_are_two_drives(tmp_path):
    far = read_drive(files(tmp_path, a=going(49.4), b=going(49.6, T0 + N)))
    late = read_drive(files(tmp_path, a=going(49.4), b=going(49.4, T0 + 86_400)))
    assert len(far) == len(late) == 2


def test_two_receivers_of_one_vehicle_are_one_drive_and_it_is_said(tmp_path):
    (drive,) = read_drive(files(tmp_path, a=going(49.4), b=going(49.4 + 3 * METRES, T0 + 0.5)))
    assert len(drive.fixes) == 2 * N
    assert "a, b: joined to one drive" in drive.notes[0]


def test_parts_of_one_log_are_one_drive_and_it_is_said(tmp_path):
    second = going(49.4 + 10 * N * METRES, T0 + N)
    (drive,) = read_drive(files(tmp_path, b=second, a=going()))
    assert drive.fixes.time == pytest.approx(T0 + np.arange(2 * N))
    assert "a, b: joined to one drive" in drive.notes[0]


def test_files_with_ids_are_kept_apart_whatever_their_times(tmp_path):
    a, b = going().assign(vehicle_id="7"), going(49.4, T0 + N).assign(vehicle_id="8")
    assert [drive.drive_id for drive in read_drive(files(tmp_path, a=a, b=b))] == ["7", "8"]
    b = b.assign(vehicle_id="7", lat=going(49.4 + 10 * N * METRES).lat)
    assert [drive.drive_id for drive in read_drive(files(tmp_path, a=a, b=b))] == ["7"]


def wheels(t0=T0, n=N):
    """Wheel speeds, a row a second."""
    return pd.DataFrame({"time": t0 + np.arange(n), "wheel_rl_mps": 10.0, "wheel_rr_mps": 10.0})


def test_tracks_without_times_are_drives_of_their_own_wherever_they_are(tmp_path):
    places = going().drop(columns="time")
    drives = read_drive(files(tmp_path, a=places, b=places, c=places))
    assert [drive.drive_id for drive in drives] == ["a", "b", "c"]
    assert [len(drive.fixes) for drive in drives] == [N, N, N]


def test_many_files_are_put_together_in_any_order(tmp_path):
    days = {f"{d}_{k}": going(49.4 + 10 * N * k * METRES, T0 + 86_400 * d + N * k)
            for k in range(4) for d in range(10)}  # fmt: skip
    drives = read_drive(files(tmp_path, **days)[::-1])
    assert len(drives) == 10
    assert [len(drive.fixes) for drive in drives] == [4 * N] * 10


def test_odometry_goes_to_the_drive_at_its_time(tmp_path):
    late = T0 + 86_400
    paths = files(tmp_path, a=going(), b=going(49.4, late), w=wheels(late))
    first, second = read_drive(paths)
    assert first.odometry is None
    assert second.odometry is not None


def test_own_names_are_those_of_any_of_several_tables(tmp_path):
    own = {"lat": "Breite", "wheel_rl_kmh": "links", "wheel_rr_kmh": "rechts"}
    fixes = going().rename(columns={"lat": "Breite"}).assign(car="x")
    spun = wheels().rename(columns={"wheel_rl_mps": "links", "wheel_rr_mps": "rechts"})
    paths = files(tmp_path, gnss=fixes, wheels=spun)
    (drive,) = read_drive(paths, columns=own, id="car")
    assert drive.drive_id == "x"
    assert len(drive.fixes) == N
    assert drive.odometry.left == pytest.approx(10 / 3.6)
    for options in ({"id": "trip"}, {"columns": own | {"hdop": "Guete"}}):
        with pytest.raises(ReadError, match="no column"):
            read_drive(paths, **({"columns": own} | options))


def test_odometry_that_may_belong_to_two_drives_is_refused(tmp_path):
    with pytest.raises(ReadError, match=r"share no drive_id; one drive per call, or .*--id"):
        read_drive(files(tmp_path, a=going(49.4), b=going(49.5), w=wheels()))


def test_a_trip_without_places_refuses_no_others_of_its_file(tmp_path, street):
    placed = going().assign(trip_id="a", speed=10.0)
    blind = placed.assign(trip_id="b", lat=np.nan, lon=np.nan)
    (path,) = files(tmp_path, trips=pd.concat([placed, blind]))
    assert [drive.drive_id for drive in read_drive(path)] == ["a", "b"]
    result = whichroad.match(path, street)
    assert result.to_arrow()["drive_id"].unique().to_pylist() == ["a"]
    (failed,) = result.summary["failed"]
    assert "no usable GNSS fix" in failed


def test_files_of_drives_that_share_no_id_are_refused(tmp_path):
    fixes = pd.concat([going().assign(trip="a"), going(49.5).assign(trip="b")])
    spun = pd.concat([wheels().assign(trip="c"), wheels().assign(trip="d")])
    with pytest.raises(ReadError, match=r"fixes.csv: 2, wheels.csv: 2\) share no drive_id"):
        read_drive(files(tmp_path, fixes=fixes, wheels=spun))


def test_two_logs_of_wheels_at_one_time_are_refused(tmp_path):
    with pytest.raises(ReadError, match=r"two logs of odometry cover the same time.*--id"):
        read_drive(files(tmp_path, a=going(), v=wheels(), w=wheels(T0 + 0.5)))


@pytest.fixture
def street(tmp_path):
    """A map of one street that goes north."""
    lat = 49.39 + 1e-3 * np.arange(150)
    line = ", ".join(f"8.7 {y:.4f}" for y in lat)
    (tmp_path / "street.csv").write_text(f'geometry\n"LINESTRING ({line})"\n')
    return tmp_path / "street.csv"


def test_match_splits_by_the_columns_by_which_match_many_splits(street):
    for ids in ({"vehicle_id": ["x", "y"]}, {"trip_id": ["1", "1"], "vehicle_id": ["x", "y"]}):
        table = two(**ids)
        one = whichroad.match(table, street).to_arrow()
        many = whichroad.match_many(table, street).points
        assert one["drive_id"].unique().to_pylist() == many["drive_id"].unique().to_pylist()
        assert len(one["drive_id"].unique()) == 2
    table = two(Fahrt=["a", "b"])
    one = whichroad.match(table, street, id="Fahrt").to_arrow()
    many = whichroad.match_many(table, street, drive_id="Fahrt").points
    assert (
        one["drive_id"].unique().to_pylist() == many["drive_id"].unique().to_pylist() == ["a", "b"]
    )


def test_a_stream_splits_trips_of_several_vehicles_too(street):
    import pyarrow as pa

    table = pa.Table.from_pandas(two(trip_id=["1", "1"], vehicle_id=["x", "y"]))
    whole = whichroad.match_many(table, street)
    parts = whichroad.match_many(table.to_batches(max_chunksize=7), street)
    assert whole.drives["drive_id"].to_pylist() == ["x/1", "y/1"]
    assert whole.points.equals(parts.points)


def turning(t0=T0 + 0.05, n=10 * N):
    """Readings of a gyro, ten a second."""
    return pd.DataFrame({"t": t0 + 0.1 * np.arange(n), "gz": 0.01})


def test_a_yaw_rate_in_a_file_of_its_own_stands_beside_the_odometry_of_another(tmp_path):
    own = {"yaw_rate_radps": "gz"}
    far = pd.DataFrame({"time": T0 + np.arange(N), "odometer_m": 10.0 * np.arange(N)})
    for name, motion in (("wheels", wheels()), ("odometer", far)):
        paths = files(tmp_path, fixes=going(), gyro=turning(), **{name: motion})
        for given in (paths, paths[::-1], paths[1:]):
            (drive,) = read_drive(given, columns=own)
            assert drive.gyro is None
            assert len(drive.odometry.time) == N
            assert drive.odometry.gyro.rate == pytest.approx(np.full(10 * N, 0.01))
    half = [turning(n=5 * N), turning(T0 + 0.05 + N / 2, 5 * N)]
    paths = files(tmp_path, fixes=going(), wheels=wheels(), g1=half[0], g2=half[1])
    late = whichroad.Vehicle(clock_offset={"odometry": 2.0})
    (drive,) = read_drive(paths, columns=own, vehicle=late)
    assert drive.odometry.gyro.time == pytest.approx(T0 + 2.05 + 0.1 * np.arange(10 * N))


def test_a_yaw_rate_that_finds_no_odometry_is_noted(tmp_path, street):
    own = {"yaw_rate_radps": "gz"}
    paths = files(tmp_path, fixes=going(), gyro=turning())
    (drive,) = read_drive(paths, columns=own)
    assert drive.odometry is None
    assert "yaw rate not used: a speed beside it was expected, or an odometer" in drive.notes
    with pytest.raises(
        DriveError, match=r"^yaw rate not used.*; gyro: it holds neither fixes nor odometry; "
    ):
        whichroad.match(paths[1], street, columns=own)
    turned = pd.DataFrame({"time": T0 + np.arange(N), "speed": 10.0, "yaw_rate_radps": 0.0})
    paths = files(tmp_path, fixes=going(), gyro=turning(), turned=turned)
    (drive,) = read_drive(paths, columns=own | {"speed_mps": "speed"})
    assert "a second yaw rate not used: that beside the speed is" in drive.notes


def odd():
    """A table none of whose columns is known."""
    return going().rename(columns={"time": "Zeitx", "lat": "Breitex", "lon": "Laengex"})


def test_a_file_that_cannot_be_understood_stops_no_others(tmp_path, street):
    (tmp_path / "dir").mkdir()
    paths = files(tmp_path / "dir", good=going(), odd=odd(), late=going(49.45, T0 + 86_400))
    for given in (tmp_path / "dir", paths):
        result = whichroad.match(given, street)
        assert result.to_arrow()["drive_id"].unique().to_pylist() == ["good", "late"]
        (failed,) = result.summary["failed"]
        assert failed.startswith("odd: odd.csv: no known column among the columns (Zeitx, Breitex")
        assert "; odd: it holds neither fixes nor odometry; " in failed
        with pytest.raises(ReadError, match=r"^odd.csv: no known column"):
            read_drive(given)
    assert repr(whichroad.match(paths[:2], street)).startswith("Result(1 drive, 1 failed, ")


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"odd": odd(), "odder": odd()}, "odd.csv: no known column"),
        ({"fixes": odd(), "wheels": wheels()}, "fixes.csv: no known column"),
        ({"fixes": going(), "wheels": wheels().drop(columns="time")}, "wheels.csv: no time"),
        ({"a": going(), "b": going(49.4 + 10 * N * METRES, T0 + N), "c": odd()},
         "c.csv: no known column"),
    ],
)  # fmt: skip
def test_a_part_of_a_drive_that_cannot_be_understood_is_refused(tmp_path, street, tables, said):
    with pytest.raises(ReadError, match=said):
        whichroad.match(files(tmp_path, **tables), street)


def test_a_file_that_is_missing_or_of_a_drives_name_is_refused(tmp_path, street):
    (good,) = files(tmp_path, good=going())
    with pytest.raises(ReadError, match="cannot be read"):
        whichroad.match([good, tmp_path / "god.csv"], street)
    (tmp_path / "good.gpx").write_text("<gpx")
    with pytest.raises(ReadError, match=r"good\.gpx"):
        whichroad.match([good, tmp_path / "good.gpx"], street)


def behind(seconds, step=1.0, late=0.37, every=1, n=20 * N):
    """Rows of two vehicles on one way, some seconds behind each other, mixed by time.

    Each stands at times of its own.  `late`: of the second, in steps; it has every so-manieth row.
    """
    k = step * np.arange(n / step)
    way = 8.0 * (k - 12.0 * np.sin(k / 47.0))  # m, at 6 to 10 m/s
    a = pd.DataFrame({"time": T0 + k, "lat": 49.4 + METRES * way})
    way = 8.0 * (k - 15.0 * np.sin(k / 61.0))
    b = pd.DataFrame({"time": T0 + k + seconds + late * step, "lat": 49.4 + METRES * way})
    rows = pd.concat([a.assign(of=0), b[::every].assign(of=1)]).assign(lon=8.70002, trip_id="1")
    return rows.sort_values("time").reset_index(drop=True)


@pytest.mark.parametrize(
    "near",
    [{"seconds": 10.0}, {"seconds": 90.0}, {"seconds": 10.0, "step": 10.0},
     {"seconds": 30.0, "step": 30.0, "n": 3600}, {"seconds": 30.0, "every": 3}],
)  # fmt: skip
def test_rows_of_two_vehicles_near_each_other_are_refused(near, street):
    rows = behind(**near)
    said = r"steps from place to place go back and forth between two tracks; .*--id COLUMN"
    with pytest.raises(ReadError, match=said):
        drive_from_table(rows)
    trips = pd.concat([rows, rows[rows.of == 0].assign(trip_id="2")])
    drives = whichroad.match_many(trips, street).drives.to_pylist()
    assert [drive["answered"] for drive in drives] == [False, True]
    assert "between two tracks" in drives[0]["reason"]
    assert not drives[1]["notes"]
    notes = [drive.notes for drive in drive_from_table(trips)]
    assert "rows seem to be of two vehicles: " in notes[0][0]
    assert not notes[1]


@pytest.mark.parametrize("near", [{"seconds": 10.0}, {"seconds": 30.0, "every": 10}])
def test_a_few_rows_of_two_vehicles_are_noted_everywhere(near, street, tmp_path):
    rows = behind(**near)
    if "every" not in near:  # the second is there for a while only
        rows = rows[(rows.of == 0) | rows.time.between(T0 + 200.0, T0 + 250.0)]
    said = "rows seem to be of two vehicles: "

    def noted(drive):
        return whichroad.match(drive, street).summary["notes"]

    (drive,) = drive_from_table(rows)
    assert drive.notes[0].startswith(said)
    tables = whichroad.match_many(rows, street)
    assert tables.drives["answered"].to_pylist() == [True]
    assert tables.drives["notes"][0].as_py()[0].startswith(said)
    rows.to_csv(tmp_path / "rows.csv", index=False)
    assert any(n.startswith(said) for n in noted(tmp_path / "rows.csv"))
    fixes = [GeoFix(*row) for row in rows[["time", "lat", "lon"]].itertuples(index=False)]
    assert any(n.startswith(said) for n in noted(fixes))
    assert said in str(inspect_files([tmp_path / "rows.csv"]))


def assert_strays_alone(drive, wrong):
    """Nothing is said of a drive but that places are off, and these are of rows that are."""
    strays = (drive.fixes.flags & STRAY) > 0
    assert not strays[~wrong].any()
    assert len(drive.notes) == strays.any()
    assert all("cannot be reached from those around them" in note for note in drive.notes)


@pytest.mark.parametrize("step", [1.0, 10.0])
@pytest.mark.parametrize("share", [0.01, 0.02, 0.1])
def test_wrong_places_now_and_then_are_of_no_second_vehicle(step, share):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rows = behind(0.0, step, n=6000)
        rows = rows[rows.of == 0]
        wrong = rng.random(len(rows)) < share
        away = wrong * rng.uniform(50.0, 500.0, len(rows)) * METRES
        course = rng.uniform(0.0, 2.0 * np.pi, len(rows))
        north, east = away * np.cos(course), away * np.sin(course) / np.cos(np.radians(49.4))
        (drive,) = drive_from_table(rows.assign(lat=rows.lat + north, lon=8.7 + east))
        assert_strays_alone(drive, wrong)


def test_places_of_masts_among_fixes_are_of_no_second_vehicle():
    rows = behind(0.0)
    rows = rows[rows.of == 0]
    mast = np.round(rows.lat / 0.004) * 0.004
    (drive,) = drive_from_table(rows.assign(lat=rows.lat.where(rows.index % 4 > 0, mast)))
    assert_strays_alone(drive, (rows.index % 4 == 0))


def test_only_steps_within_a_drive_alternate():
    rows = behind(10.0)
    lat, lon = (np.tile(rows[name], 3) for name in ("lat", "lon"))
    n = len(rows)
    one = alternating(lat[:n], lon[:n])
    assert one.mean() > 0.8
    found = alternating(lat, lon, np.array([0, n, 2 * n]))
    assert (found == np.concatenate([one, [False], one, [False], one])).all()
    assert not alternating(lat[:n][rows.of == 0], lon[:n][rows.of == 0]).any()
    assert alternating(lat[:1], lon[:1]).shape == (0,)


def records(k, **more):
    """The places of a trip as JSON has them; trip k has 10 + k, an hour after the one before."""
    return going(t0=T0 + 3600.0 * k, n=10 + k).assign(**more).to_dict("records")


def trips(**ids):
    return [{**{name: f"{v}{k}" for name, v in ids.items()}, "points": records(k)} for k in (0, 1)]


LISTS = {
    "below a key": ({"trips": trips(trip_id="t", vehicle="v")}, ["t0", "t1"]),
    "in a list": (trips(trip_id="t"), ["t0", "t1"]),
    "in objects by key": ({t["trip_id"]: t for t in trips(trip_id="t")}, ["t0", "t1"]),
    "columns": ([{"trip_id": f"t{k}", **going(n=10 + k).to_dict("list")} for k in (0, 1)],
                ["t0", "t1"]),
    "of rows that have ids": (records(0, trip_id="t0") + records(1, trip_id="t1"), ["t0", "t1"]),
    "of vehicles": (trips(device="v"), ["v0", "v1"]),
    "by id": (trips(id="t"), ["a/t0", "a/t1"]),
    "by name, of a vehicle": ([t | {"vehicle": "v"} for t in trips(name="t")], ["t0", "t1"]),
    "by number": ([records(0), records(1)], ["a/0", "a/1"]),
    "by key": ({"mon": records(0), "tue": records(1)}, ["a/mon", "a/tue"]),
    "some without an id": ([*trips(trip_id="t")[:1], {"points": records(1)}], ["t0", "a/1"]),
    "in one object each": ({"v1": {"run": records(0)}, "v2": {"run": records(1)}},
                           ["a/v1", "a/v2"]),
}  # fmt: skip


@pytest.mark.parametrize("shape", LISTS)
def test_every_trip_of_a_json_file_is_read(shape, tmp_path):
    content, names = LISTS[shape]
    (tmp_path / "a.json").write_text(json.dumps(content))
    drives = read_drive(tmp_path / "a.json")
    assert [(drive.drive_id, len(drive.fixes)) for drive in drives] == [
        (name, 10 + k) for k, name in enumerate(names)
    ]
    assert not any(drive.skipped for drive in drives)
    assert bool(drives[0].notes) == ("a/" in "".join(names))
    if isinstance(content, list) and isinstance(content[0], dict):  # an object on each line
        (tmp_path / "a.json").write_text("".join(f"{json.dumps(one)}\n" for one in content))
        assert [drive.drive_id for drive in read_drive(tmp_path / "a.json")] == names


def test_batches_of_a_trip_or_a_vehicle_are_one_drive(tmp_path):
    for name in ("trip", "vehicle", "run"):
        batches = [{name: 7, "uploaded": k, "points": records(k)} for k in range(3)]
        (tmp_path / "a.json").write_text(json.dumps({"speed": 3.0, "batches": batches}))
        (drive,) = read_drive(tmp_path / "a.json", id="run" if name == "run" else None)
        assert (drive.drive_id, len(drive.fixes), drive.skipped) == ("7", 33, {})
        assert not np.isfinite(drive.fixes.sigma_speed).any()  # that of the file is of no row


def test_places_in_other_lists_of_a_json_file_are_counted(tmp_path):
    stops = [{"lat": 49.4, "lon": 8.7, "name": "home"}] * 3
    last = [{"device": t["device"], **t["points"][-1], "points": t["points"]} for t in
            trips(device="v")]  # fmt: skip
    for content, left in (({"stops": stops, "points": records(0)}, 3), (last, 2)):
        (tmp_path / "a.json").write_text(json.dumps(content))
        drives = read_drive(tmp_path / "a.json")
        assert sum(len(drive.fixes) for drive in drives) == 10 + 11 * (len(drives) - 1)
        assert drives[0].skipped == {"place in another list of the file": left}
