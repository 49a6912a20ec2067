"""One call from files to tables: read, localize, make tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from .diagnosis.finding import Finding
from .epochs import Timeline, build_timeline, check_mask
from .errors import DriveError, MapError, SettingError
from .evidence.sensed import Sensed
from .filter.state import NO_EDGE, OFF_ROAD
from .filter.summary.estimate import Output
from .global_start import MAP
from .lineage import lineage_of
from .lookback.smoothing import Lag
from .lookback.traversals import Traversals, traversals
from .observations import Drive, Observation, StartPose
from .places import Places, places_on
from .readers import (
    drive_from_table,
    drive_of_observations,
    is_file,
    read_drive,
    read_vehicle,
    vehicle_beside,
)  # fmt: skip
from .readers.checks import NO_POSITION
from .readers.dates import Writing
from .readers.reading import own_columns
from .recorded import Recorded, localize_by_paper, localize_recorded
from .roadmap import RoadMap, open_map
from .roadmap.extent import are_near as are_near
from .roadmap.extent import check_start, fixes_outside, start_note
from .sensors import Sensor
from .settings import Settings, Vehicle, tuned_by
from .tables.export import path_table, points_table, summary_of, summary_of_several
from .tables.provenance import with_map
from .tables.relative_places import Surroundings
from .tables.result import Result

Start = StartPose | tuple[float, float, float] | str | None
Window = tuple[Any, Any]

_USUAL, _A_CAR = Settings(), Vehicle()  # checking their numbers takes as long as some fixes


def _drives(drive: Any, settings: Settings, can: Any, dbc: Any, **reading: Any) -> list[Drive]:
    """The drives of whatever names them or holds them.

    Raises:
        SettingError: A CAN log is given beside something else than paths.
    """
    several = isinstance(drive, list | tuple)
    if is_file(drive) or (several and drive and all(is_file(d) for d in drive)):
        return read_drive(
            drive, settings=settings, can=can, dbc=dbc, skip_unreadable=True, **reading
        )
    if can is not None or dbc is not None:
        raise SettingError(
            f"can, dbc: given beside a {type(drive).__name__}; paths of the drive's files were "
            "expected with a CAN log; read it by whichroad.read_drive(can=..., dbc=...)"
        )
    if isinstance(drive, Drive):
        return [drive]
    if several:
        if all(isinstance(d, Drive) for d in drive):
            return list(drive)
        if any(isinstance(d, Observation) for d in drive):
            return [drive_of_observations(drive, settings, reading.get("vehicle"))]
    return drive_from_table(drive, settings=settings, **reading)


def _seconds(value: Any) -> float:
    if isinstance(value, int | float):
        return float(value)
    if isinstance(value, datetime):
        return (value if value.tzinfo else value.replace(tzinfo=UTC)).timestamp()
    if hasattr(value, "timestamp"):
        return float(value.timestamp())
    try:
        time = datetime.fromisoformat(str(value).replace("Z", "+00:00"))
    except ValueError:
        raise SettingError(
            f"mask: {value!r} is not a time; seconds from the drive's start or an ISO 8601 "
            "time were expected"
        ) from None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def _start(start: Start, model: str) -> StartPose | str | None:
    if not isinstance(start, str):
        return StartPose.of(start)
    if start != MAP:
        raise SettingError(f'start is {start!r}; a pose or "{MAP}" was expected')
    if model == "paper":
        raise SettingError(f'start is "{MAP}"; the paper\'s method needs a fix or a start pose')
    return start


def match(
    drive: Any,
    roads: RoadMap | str | Path,
    *,
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    model: str = "default",
    start: Start = None,
    mask: Sequence[Window] = (),
    lag: float | str | None = None,
    attributes: bool = False,
    hypotheses: bool = False,
    places: Any = None,
    sensors: Sequence[Sensor] = (),
    can: str | Path | None = None,
    dbc: str | Path | None = None,
    crs: Any = None,
    id: str | None = None,
    columns: Mapping[str, str | int] | None = None,
    tz: str | None = None,
    dates: str | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Result:
    """Match a drive to the road network: pose, road and probabilities at every epoch.

    Args:
        drive: Paths of logs and tables (also folders, patterns and open files), a DataFrame,
            an Arrow table or anything with `__arrow_c_stream__`, `Drive` records, or a list
            of observations (`GeoFix`, ...), of dicts with the columns of a table, or of
            (time, lat, lon); a GPX object of gpxpy, trajectories of movingpandas.
        roads: A `RoadMap`, the path of a compiled map, an OSM extract or an edge table, or a
            GeoDataFrame of edges.
        vehicle: The car's wheels, antenna and clocks, or the path of its vehicle.toml.
        settings: The model's numbers.
        model: "default"; "paper" is the paper's method, for comparison.
        start: A known pose (lat, lon, bearing in degrees), a vague one (a `StartPose` with a
            sigma of hundreds of metres), or "map" to find the start from wheel data alone.
            None: the first fix starts.
        mask: Windows in which GNSS is withheld: seconds from the drive's start, or times.
        lag: Smooth with a fixed lag: seconds, "200m" driven, or "full" for the whole drive.
            None: filter, as on line.
        attributes: Whether the road's name, class and speed limit are added to the points.
        hypotheses: Whether the alternatives' poses are kept for pictures.
        places: Point objects for `Result.ahead` and `nearby`: `Places`, or a table or path as
            that takes it.
        sensors: Further sensors (`whichroad.sensors`), whose columns are in the tables.
        can: The path of a CAN log with wheel data, beside the paths of fixes.
        dbc: The path of the database that describes its signals.
        crs: Reference system of `x, y` columns, and of a table of roads in a plane that names
            none, as pyproj takes it, e.g. "EPSG:3067".
        id: The column of tables whose values tell drives apart.
        columns: Own names of columns in tables, e.g. {"time": "ts", "speed_kmh": "v"}.
        tz: Zone of times in tables that name none, e.g. "Europe/Berlin"; None: UTC.
        dates: "mdy", "dmy" or "ymd": the order in dates such as 06/01/2026 and 010626.
        progress: Called with (drive_id, epochs done, epochs in all).

    Returns:
        Tables of points and path, and a summary.  Of several drives those that cannot be matched
        are in `summary["failed"]`, each by its name and why; the others go on.

    Raises:
        ReadError: A file could not be understood, or there is no such zone or order of dates.
        MapError: The drive is nowhere near the map, or the map is not one.
        DriveError: Nothing could be answered.
        SettingError: A setting or the model's name is out of bounds.
    """
    if model not in MODELS:
        raise SettingError(f"model is {model!r}; one of {', '.join(MODELS)} was expected")
    Writing.of(tz, dates)  # before a map is read for minutes
    pose = _start(start, model)
    later = Lag.of(lag)
    if later is not None and model == "paper":
        raise SettingError(f"lag is {lag!r}; None was expected: the paper's method does not smooth")
    if isinstance(vehicle, str | Path):
        vehicle = read_vehicle(vehicle)
    elif vehicle is None:
        vehicle = vehicle_beside(drive)
    road_map = open_map(roads, crs=crs)
    tuned = tuned_by(settings, vehicle)
    windows = [(_seconds(a), _seconds(b)) for a, b in mask]
    about = places_on(places, road_map)
    if about is not None and model == "paper":
        raise SettingError("places: given; none were expected with the paper's method")
    sensed = Sensed(sensors, road_map) if sensors else None
    if sensed is not None and model == "paper":
        raise SettingError("sensors: given; none were expected with the paper's method")
    own = own_columns(columns) | (sensed.columns if sensed else {})
    parts: list[Result] = []
    failed: list[str] = []
    if isinstance(pose, StartPose):
        check_start(pose, road_map)
    drives = _drives(
        drive, settings or _USUAL, can, dbc, vehicle=vehicle or _A_CAR, crs=crs, id=id,
        columns=own or None, tz=tz, dates=dates,
    )  # fmt: skip
    check_mask(drives, windows)
    for one in drives:
        try:
            parts.append(
                _match_one(
                    one, road_map, vehicle or _A_CAR, tuned, model, pose, windows,
                    attributes, hypotheses, progress, later, about,
                    Sensed(sensors, road_map) if sensed else None,
                )
            )  # fmt: skip
        except (DriveError, MapError) as error:
            if len(drives) == 1:
                raise
            failed.append(f"{one.drive_id}: {str(error).removeprefix(f'{one.drive_id}: ')}")
    if not parts:
        raise DriveError(
            failed[0] if failed else "drive: the input holds no drive; at least one was expected"
        )
    return _pooled_result(parts, failed)


MODELS = ("default", "paper")


def _match_one(
    drive: Drive, roads: RoadMap, vehicle: Vehicle, settings: Settings, model: str,
    start: StartPose | str | None, mask: list[tuple[float, float]], attributes: bool,
    hypotheses: bool, progress: Callable[[str, int, int], None] | None, lag: Lag | None,
    places: Places | None, sensed: Sensed | None,
) -> Result:  # fmt: skip
    outside, drive = _outside(drive, roads), _with_start_note(drive, start)
    localize: Callable[..., Recorded] = (
        localize_by_paper if model == "paper" else partial(localize_recorded, lag=lag)
    )
    try:
        timeline = build_timeline(drive, roads.plane, vehicle, mask, sensed)
        if sensed is not None:
            drive = sensed.reported(drive)
        n = len(timeline.epochs)
        recorded = localize(
            roads, timeline, vehicle=vehicle, settings=settings, start=start,
            poses=hypotheses or places is not None,
            progress=(lambda done: progress(drive.drive_id, done, n)) if progress else None,
        )  # fmt: skip
    except DriveError as error:  # what a reader noted may be why
        raise DriveError("; ".join([*drive.notes, str(error)])) from None
    driven = cache(
        partial(traversals, timeline.epochs, recorded.output, recorded.chain, roads.arrays)
    )
    diagnosis = cache(lambda: recorded.diagnosis)

    def placed() -> Output:
        driven()  # which puts epochs of filled gaps on the path
        return recorded.output

    return Result(
        lambda: with_map(
            points_table(
                drive.drive_id, timeline.epochs, placed(), roads, attributes=attributes
            ),
            roads.identity,
        ),
        lambda: with_map(path_table([drive.drive_id], driven(), roads), roads.identity),
        lambda: _summary(drive, timeline, recorded, driven(), diagnosis(), outside),
        _poses(recorded.output, timeline) if hypotheses else None,
        diagnosis,
        None if recorded.past is None else recorded.past.alternatives,
        roads,
        partial(
            lineage_of, drive.drive_id, roads, timeline, vehicle=vehicle, settings=settings,
            start=start, model=model,
        ),
        [] if places is None else [
            Surroundings(drive.drive_id, timeline.epochs, recorded.output, places)
        ],
        recorded.track,
    )  # fmt: skip


def _summary(
    drive: Drive,
    timeline: Timeline,
    recorded: Recorded,
    driven: Traversals,
    diagnosis: tuple[Finding, ...],
    outside: int,
) -> dict[str, Any]:
    figures = summary_of(timeline.epochs, recorded.output, driven, timeline.masked)
    figures |= {
        "drive_id": drive.drive_id,
        "sources": list(drive.sources),
        "skipped": {**drive.skipped, **timeline.skipped},
        "notes": list(drive.notes),
        "diagnosis": [asdict(finding) for finding in diagnosis],
    }
    if outside:
        figures["fixes_outside_map"] = outside
    if recorded.map_error is not None:
        figures["map_error"] = {k: round(v, 2) for k, v in recorded.map_error._asdict().items()}
    if recorded.sensors:
        figures["sensors"] = {name: dict(counts) for name, counts in recorded.sensors.items()}
    past = recorded.past
    if past is not None:
        figures |= {"lag": str(past.lag), "decided_until_s": past.decided_until()}
    return figures


def timeline_of(
    drive: Drive, roads: RoadMap, vehicle: Vehicle, *, sensed: Sensed | None = None
) -> tuple[Timeline, int]:
    """A drive in epochs, and how many of its fixes are off the map.

    Raises:
        MapError: It is nowhere near the map.
        DriveError: There is neither a fix nor odometry.
    """
    outside = _outside(drive, roads)
    return build_timeline(drive, roads.plane, vehicle, sensed=sensed), outside


def skipped_of(drive: Drive, rows: int, timeline: Timeline | None = None) -> dict[str, int]:
    """What was skipped of rows; without any fix also those that only a start pose could use."""
    skipped = dict(drive.skipped)
    rest = rows - sum(skipped.values())
    if drive.fixes is not None and not len(drive.fixes) and rest > 0:
        skipped[NO_POSITION] = skipped.get(NO_POSITION, 0) + rest
    return skipped if timeline is None else {**skipped, **timeline.skipped}


def _outside(drive: Drive, roads: RoadMap) -> int:
    """How many fixes are off the map.

    Raises:
        MapError: All of them are.
    """
    fixes = drive.fixes
    if fixes is None or not len(fixes):
        return 0
    return fixes_outside(drive.drive_id, fixes.lat_deg, fixes.lon_deg, roads)


def _with_start_note(drive: Drive, start: StartPose | str | None) -> Drive:
    """The drive, with a note where its first fix contradicts the start pose."""
    if not isinstance(start, StartPose) or drive.fixes is None or not len(drive.fixes):
        return drive
    note = start_note(start, float(drive.fixes.lat_deg[0]), float(drive.fixes.lon_deg[0]))
    return drive if note is None else replace(drive, notes=(*drive.notes, note))


def _poses(output: Output, timeline: Timeline) -> dict[str, Any]:
    poses, rows, epochs = output.alt_pose, output.rows, timeline.epochs
    edge = np.where(rows.alt_edge == NO_EDGE, -2, rows.alt_edge)
    edge = np.where(edge == OFF_ROAD, -1, edge)
    return {
        "time": epochs.time, "edge": edge.astype(np.int32), "p": rows.alt_p.astype(float),
        "x": poses[..., 0], "y": poses[..., 1], "heading": poses[..., 2],
        "cov_xx": poses[..., 3], "cov_xy": poses[..., 4], "cov_yy": poses[..., 5],
        "has_fix": epochs.has_fix.astype(bool), "fix": epochs.fix,
    }  # fmt: skip


def _pooled_result(parts: list[Result], failed: list[str]) -> Result:
    if len(parts) == 1 and not failed:
        return parts[0]
    return Result(
        lambda: pa.concat_tables([p.to_arrow() for p in parts]),
        lambda: pa.concat_tables([p.path_arrow() for p in parts]),
        lambda: summary_of_several([p.summary for p in parts], failed),
        parts[0].hypotheses if len(parts) == 1 else None,
        lambda: tuple(finding for p in parts for finding in p.diagnosis),
        parts[0]._find_alternatives if len(parts) == 1 else None,
        parts[0]._roads,
        parts[0]._find_lineage if len(parts) == 1 else None,
        [one for p in parts for one in p.surroundings],
    )
