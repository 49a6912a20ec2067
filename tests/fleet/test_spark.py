"""A real cluster of two workers gives the rows of one machine."""

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from fleet.conftest import trip
from fleet.test_folder import maps as maps
from fleet.test_folder import trips as trips
from fleet.test_own_columns import BERLIN, OWN, their_own
from whichroad.batch import match_many
from whichroad.errors import MapError, ReadError, SettingError

BRIEF = "-XX:TieredStopAtLevel=1 -XX:+UseSerialGC"  # less compiling, for what ends soon
SOURCE = Path(whichroad.__file__).parents[1]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        shutil.which("java") is None and "JAVA_HOME" not in os.environ,
        reason="Spark needs Java 17, and there is no java on the path",
    ),
    pytest.mark.filterwarnings("ignore"),  # pyspark warns of pandas 3 at every start
]


@pytest.fixture(scope="module")
def spark():
    """Two workers, each a process of its own with one core."""
    sql = pytest.importorskip("pyspark.sql", reason='pyspark is missing: pip install ".[spark]"')
    os.environ["PYSPARK_PYTHON"] = os.environ["PYSPARK_DRIVER_PYTHON"] = sys.executable
    python_path = os.pathsep.join([str(SOURCE), os.environ.get("PYTHONPATH", "")])
    session = (
        sql.SparkSession.builder.master("local-cluster[2,1,1024]")
        .config("spark.ui.enabled", "false")
        .config("spark.executor.memory", "700m")
        .config("spark.sql.shuffle.partitions", "4")
        .config("spark.sql.session.timeZone", "UTC")
        .config("spark.executorEnv.PYTHONPATH", python_path)
        .config("spark.driver.extraJavaOptions", BRIEF)
        .config("spark.executor.extraJavaOptions", BRIEF)
        .config("spark.driver.host", "127.0.0.1")
        .config("spark.driver.bindAddress", "127.0.0.1")
        .getOrCreate()
    )
    session.sparkContext.setLogLevel("ERROR")
    yield session
    session.stop()


@pytest.mark.parametrize("give", ["path", "points", "slim", "drives"])
def test_the_rows_are_those_of_one_machine(spark, town, table, shuffled, give):
    from whichroad.spark import match

    df = spark.createDataFrame(shuffled.to_pandas())
    out = match(df, town if give == "path" else str(town), give=give, ship=give == "path")
    found = out.toArrow().to_pylist()
    usual = match_many(table, town)
    wanted = (usual.points if give == "slim" else getattr(usual, give)).to_pylist()
    keys = ("drive_id", "seq") if give == "path" else ("drive_id", "time")
    found.sort(key=lambda row: [str(row.get(key)).zfill(30) for key in keys])
    wanted.sort(key=lambda row: [str(row.get(key)).zfill(30) for key in keys])
    assert len(found) == len(wanted)
    for a, b in zip(found, wanted, strict=True):
        for name in out.columns:
            assert _plain(a[name]) == _plain(b[name]), name


def _plain(value):
    return sorted(value.items()) if isinstance(value, dict) else value


def test_a_vehicle_is_cut_into_the_same_trips(spark, town):
    from whichroad.spark import match

    rows = [trip("v", k, 1.6e9 + 5000.0 * k, k) for k in range(3)]
    rows += [trip("w", k, 1.6e9 + 900.0 * k, k) for k in range(2)]
    whole = pa.concat_tables(rows)
    mixed = whole.take(np.random.default_rng(2).permutation(whole.num_rows))
    out = match(spark.createDataFrame(mixed.to_pandas()), town, give="drives", split="5min")
    usual = match_many(whole, town, split="5min").drives
    found = sorted((row.drive_id, row.fixes, row.path_m) for row in out.collect())
    wanted = [tuple(row[n] for n in ("drive_id", "fixes", "path_m")) for row in usual.to_pylist()]
    assert found == sorted(wanted)
    assert [name for name, *_ in found] == ["v/1", "v/2", "v/3", "w/1", "w/2"]


def test_own_names_and_a_zone_are_those_of_one_machine(spark, town, table, shuffled):
    from whichroad.spark import match

    theirs = their_own(shuffled)
    zoneless = spark.createDataFrame(
        theirs.to_pandas(), "Fahrt string, Zeit timestamp_ntz, Breite double, Laenge double"
    )
    columns = OWN | {"drive_id": "Fahrt"}
    out = match(zoneless, town, give="drives", columns=columns, tz=BERLIN)
    usual = match_many(table, town).drives.sort_by("drive_id").to_pylist()
    found = sorted((row.asDict() for row in out.collect()), key=lambda row: row["drive_id"])
    for a, b in zip(found, usual, strict=True):
        for name in ("drive_id", "fixes", "path_m", "duration_s", "notes"):
            assert a.get(name) == b.get(name), name
    with pytest.raises(ReadError, match="did you mean Zeit"):
        match(zoneless, town, columns=columns | {"time": "Zeiit"})
    with pytest.raises(ReadError, match="not a known time zone"):
        match(zoneless, town, columns=columns, tz="Mars")


def test_a_folder_of_maps_names_the_map_of_each_row(spark, maps, trips):
    from whichroad.spark import match

    out = match(spark.createDataFrame(trips.to_pandas()), maps, give="path")
    usual = match_many(trips, maps).path
    names = ["drive_id", "seq", "edge_id", "map"]
    found = sorted(tuple(row[n] for n in names) for row in out.collect())
    assert found == sorted(tuple(row.values()) for row in usual.select(names).to_pylist())
    assert len({row[-1] for row in found}) == 2


def test_what_cannot_be_run_is_refused_by_the_driver(spark, town, table):
    from whichroad.spark import match

    df = spark.createDataFrame(table.slice(0, 5).to_pandas())
    with pytest.raises(SettingError, match="path, drives"):
        match(df, town, give="lines")
    with pytest.raises(ReadError, match="no column 'car'"):
        match(df, town, trip_id="car")
    with pytest.raises(MapError, match="on the driver"):
        match(df, town.parent / "none.map", ship=True)
