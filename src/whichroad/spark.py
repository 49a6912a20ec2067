"""Many trips by Spark: a DataFrame of fixes in, a DataFrame of paths, points or drives out.

    from whichroad.spark import match
    paths = match(df, "city.map", trip_id="trip_id")

Rows go by trip to partitions, are sorted there, and each partition is matched in one call.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import MapError, SettingError

if TYPE_CHECKING:
    import pyarrow as pa
    from pyspark.sql import DataFrame


def match(
    df: "DataFrame",
    map: str | Path,
    *,
    trip_id: str = "drive_id",
    give: str = "path",
    partitions: int | None = None,
    ship: bool = False,
    **options: Any,
) -> "DataFrame":
    """Match all trips of a DataFrame on the workers.

    Args:
        df: Rows with time, lat and lon, in any order, by the names of docs/formats.md.
        map: The path of a compiled map, or of a folder of them, that driver and workers see;
            with `ship` one on the driver.
        trip_id: The column that names trips; the default finds its usual aliases.
        give: "path", "points", "slim" (points without poses) or "drives".
        partitions: Of the shuffle by trip; None: as Spark is set.
        ship: Send the map to the workers by `SparkContext.addFile`.
        options: As of `whichroad.fleet.match_batches`: vehicle, settings, lag, crs, columns, tz,
            dates, sensors, split.

    Returns:
        A DataFrame with the columns of `whichroad.fleet.SCHEMAS[give]`, of a folder of maps with
        those of `MAPS_SCHEMAS[give]`; lazy, as all of Spark.

    Raises:
        SettingError: pyspark is not installed, or `give` is unknown.
        MapError: The map to be shipped is not there.
        ReadError: The DataFrame lacks a column of trips or of times.
    """
    try:
        from pyspark.sql.pandas.types import from_arrow_schema
    except ImportError as error:
        raise SettingError(
            f"spark: the package {str(error.name).partition('.')[0]} is not installed; it was "
            'expected for this call; pip install "whichroad[spark]"'
        ) from None
    from .evidence.sensed import columns_of
    from .fleet import MAPS_SCHEMAS, SCHEMAS
    from .fleet.inputs import used_columns
    from .readers.dates import Writing
    from .readers.many_trips import own_names
    from .readers.names import find

    if give not in SCHEMAS:
        raise SettingError(f"give is {give!r}; one of {', '.join(SCHEMAS)} was expected")
    columns, trip_id = own_names(options.get("columns"), trip_id)
    Writing.of(options.get("tz"), options.get("dates"))
    own = {**columns, **columns_of(options.get("sensors", ()))}
    used = used_columns(df.columns, trip_id, "df", own)
    name, several = str(map), Path(map).is_dir()
    if ship:
        if not Path(map).exists():
            raise MapError(f"{map}: it is not there; a compiled map on the driver was expected")
        df.sparkSession.sparkContext.addFile(name, recursive=several)
        name = Path(map).name
    found = find(df.columns, own)
    places = [found[q].name for q in ("lat", "lon") if q in found]
    rows = df.select(*(_quoted(column) for column in used.columns))
    trip = _quoted(used.trip)
    rows = rows.repartition(partitions, trip) if partitions else rows.repartition(trip)
    rows = rows.sortWithinPartitions(trip, *(_quoted(n) for n in (used.time, *places)))
    schema = (MAPS_SCHEMAS if several else SCHEMAS)[give]
    options |= {"columns": columns, "give": give, "trip_id": used.trip}
    work = partial(_partition, map=name, shipped=ship, several=several, **options)
    return rows.mapInArrow(work, from_arrow_schema(schema))


def _quoted(name: str) -> str:
    return "`" + name.replace("`", "``") + "`"


def _partition(
    batches: "Iterable[pa.RecordBatch]", *, map: str, shipped: bool, several: bool, **options: Any
) -> "Iterator[pa.RecordBatch]":
    """The trips of a partition, on a worker."""
    from .fleet import match_batches

    if shipped:
        from pyspark import SparkFiles

        map = SparkFiles.get(map)
    if Path(map).is_dir() != several:
        raise MapError(f"{map}: a folder for the driver or for a worker alone; both must see it")
    yield from match_batches(batches, map, ordered=True, **options)
