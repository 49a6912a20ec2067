"""The process that matches one posted trace.

It reads `request.json` and `body` in a folder and leaves `answer` or `refusal.json`.  It has one
thread and a limit of memory, and it ends when its standard input does.
"""

import contextlib
import json
import os
import re
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from dataclasses import asdict
from io import BufferedWriter, TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from ..errors import WhichroadError
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .background import limit_memory, one_thread
from .message_types import VERSION
from .trace_limits import MOST_ROWS, TooLargeTrace, check_size, stream_of

if TYPE_CHECKING:  # what serves requests is not imported in this process
    from .trace_options import TraceOptions

REQUEST, BODY, ANSWER, REFUSAL = "request.json", "body", "answer", "refusal.json"
MOST_MEMORY = 300 * 1024 * 1024  # bytes that one trace may take, where the system can limit it
GEOMETRIES = ("FeatureCollection", "Feature", "LineString", "MultiLineString", "MultiPoint")
_EXPECTED = "JSON rows with time, lat and lon, columns of them, or GeoJSON were expected"
_BY_OPTION = r"`whichroad match --columns ([^`]*)` \(columns=\)"
_OR_BY_OPTION = re.compile(rf", or [^;,]* {_BY_OPTION}")
_MEANT = re.compile(rf"did you mean {_BY_OPTION}\?")
_ROWS_AT_ONCE = 2000  # rows of the answer that are made at once


class Refused(Exception):
    """A trace that is not matched: status and reason."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status, self.why = status, why


def request(
    suffix: str, options: "TraceOptions", roads: Path, vehicle: Vehicle, settings: Settings,
    *, gzip: bool = False,
) -> str:  # fmt: skip
    """What the worker is asked, as text.

    Args:
        suffix: Format of the body.
        options: How it is matched, and what is given.
        roads: The compiled map.
        vehicle: The car.
        settings: The model's numbers.
        gzip: Whether the answer is compressed.
    """
    asked = {"suffix": suffix, "map": str(roads), "vehicle": asdict(vehicle), "gzip": gzip}
    asked |= options._asdict()
    return json.dumps({**asked, "settings": asdict(settings)})


def check_body(folder: Path) -> None:
    """Check the size of the body in a folder, which takes no more than reading it.

    Args:
        folder: Holds `request.json` and `body`.

    Raises:
        Refused: It stands for too much, or is not what it is called.
    """
    suffix = json.loads((folder / REQUEST).read_text("utf-8"))["suffix"]
    with _refusing(folder):
        body = (folder / BODY).read_bytes()
        if suffix == ".arrow" and (stream := stream_of(body)) is not body:
            body = stream
            (folder / BODY).write_bytes(body)
        check_size(body, suffix)


def match_trace(folder: Path, roads: RoadMap | None = None, most: int = MOST_ROWS) -> None:
    """Match the trace in a folder, whose size was checked, and leave the answer there.

    Args:
        folder: Holds `request.json` and `body`.
        roads: The map; None: the one that the request names.
        most: Rows of a trace, at most.

    Raises:
        Refused: It cannot be matched.
    """
    from ..matching import match

    asked = json.loads((folder / REQUEST).read_text("utf-8"))
    vehicle, settings = Vehicle(**asked["vehicle"]), Settings(**asked["settings"])
    with _refusing(folder):
        drives = _read(folder, asked["suffix"], vehicle, settings)
        if sum(_size(drive) for drive in drives) > most:
            raise TooLargeTrace(f"trace: at most {most:,} rows are taken here")
        result = match(
            drives, roads or RoadMap.open(asked["map"]), vehicle=vehicle, settings=settings,
            mask=[tuple(window) for window in asked["mask"]], lag=asked["lag"],
        )  # fmt: skip
        with _written(folder / ANSWER, asked["gzip"]) as file, _within_bounds():
            file.writelines(answer_of(result, asked["give"]))


@contextlib.contextmanager
def _refusing(folder: Path) -> Iterator[None]:
    """Errors as the status and the sentence that the client gets.

    Raises:
        Refused: There was one.
    """
    try:
        yield
    except TooLargeTrace as error:
        raise Refused(413, str(error)) from None
    except WhichroadError as error:
        raise Refused(422, _for_client(str(error).replace(f"{folder}{os.sep}", ""))) from None
    except MemoryError:
        raise Refused(413, "trace: it needs more memory than one trace may take") from None


def _for_client(said: str) -> str:
    """A message without the options of the command line, which a client cannot give."""
    said = _OR_BY_OPTION.sub("", said)
    return _MEANT.sub(r"did you mean \1? rename the columns so", said)


def _written(path: Path, gzip: bool) -> TextIO:
    """A file of text, compressed or not."""
    if not gzip:
        return path.open("w", encoding="utf-8")
    from gzip import GzipFile

    from ..page.compressed import LEVEL

    return TextIOWrapper(BufferedWriter(GzipFile(path, "wb", LEVEL, mtime=0)), "utf-8")


def answer_of(result: Any, give: str = "all") -> Iterator[str]:
    """The answer as JSON, in pieces: `points`, `path` or `all` of it."""
    yield f'{{"version": {VERSION}, '
    if give in ("all", "points"):
        yield from _points_of(result)
    if give in ("all", "path"):
        yield from _path_of(result)
    summary = {k: v for k, v in result.summary.items() if k != "sources"}
    yield f'"summary": {json.dumps(summary, default=str, allow_nan=False)}}}'


def _points_of(result: Any) -> Iterator[str]:
    yield '"points": ['
    points = result.to_arrow()
    names = [name for name in points.column_names if name != "geometry"]
    points = points.select(names)
    for start in range(0, points.num_rows, _ROWS_AT_ONCE):
        frame = points.slice(start, _ROWS_AT_ONCE).to_pandas()
        yield ("," if start else "") + frame.to_json(orient="records", date_format="iso")[1:-1]
    yield "], "


def _path_of(result: Any) -> Iterator[str]:
    yield '"path": '
    path = result.path
    path = path.assign(**{name: _iso(path[name]) for name in ("enter_time", "exit_time")})
    if len(path):
        for start in range(0, len(path), _ROWS_AT_ONCE):
            part = path.iloc[start : start + _ROWS_AT_ONCE]
            features = json.loads(part.to_json(drop_id=True, default=str))
            text = json.dumps(features.pop("features"), default=str)
            head = json.dumps({**features, "features": []})[: -len("]}")]
            yield (head if start == 0 else ",") + text[1:-1]
        yield "]}, "
    else:
        yield "null, "


def _iso(times: Any) -> Any:
    """Times as in every message: ISO 8601, UTC, milliseconds; null where there is none."""
    text = times.dt.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
    return text.astype(object).where(times.notna(), None)


def _read(folder: Path, suffix: str, vehicle: Vehicle, settings: Settings) -> Any:
    """The drives of a body whose size is checked."""
    from ..readers import drive_from_table, read_drive

    with _within_bounds():
        if suffix == ".json":
            given = _given((folder / BODY).read_bytes())
            if not (isinstance(given, dict) and given.get("type") in GEOMETRIES):
                return drive_from_table(_columns(given), vehicle=vehicle, settings=settings)
            del given
        path = folder / ("trace.geojson" if suffix == ".json" else f"trace{suffix}")
        os.replace(folder / BODY, path)
        return read_drive(path, vehicle=vehicle, settings=settings)


@contextlib.contextmanager
def _within_bounds() -> Iterator[None]:
    """What only a strange value breaks, such as a time beyond the calendar, is the trace's fault.

    Raises:
        Refused: There is one.
    """
    try:
        yield
    except (ValueError, TypeError, ArithmeticError, LookupError, NotImplementedError) as error:
        if isinstance(error, WhichroadError):
            raise
        raise Refused(422, "trace: a value is out of bounds or of another kind") from None


def _size(drive: Any) -> int:
    return sum(len(log.time) for log in (drive.fixes, drive.odometry) if log is not None)


def _given(body: bytes) -> Any:
    """What a JSON text holds."""
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        raise Refused(400, _EXPECTED) from None


def _columns(given: Any) -> Any:
    """Rows, or columns, as columns."""
    import pyarrow as pa

    try:
        given = given.get("points", given) if isinstance(given, dict) else given
        return pa.Table.from_pylist(given) if isinstance(given, list) else pa.table(given)
    except OverflowError:
        raise Refused(400, "a number is beyond 64 bits") from None
    except (ValueError, RecursionError, TypeError, AttributeError, pa.ArrowException):
        raise Refused(400, _EXPECTED) from None


def prepare() -> None:
    """Import what matching needs, so that it does not count as the trace's memory."""
    import geopandas  # noqa: F401
    import pyarrow.csv  # noqa: F401

    from .. import matching  # noqa: F401


def _end_with_the_service(folder: Path) -> None:
    """Wait for the end of the standard input: the service is gone, or the client is."""
    with contextlib.suppress(OSError):
        while os.read(0, 1):
            pass
    shutil.rmtree(folder, ignore_errors=True)
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> None:
    """Match the trace in the folder that is the argument."""
    folder = Path(sys.argv[1])
    threading.Thread(target=_end_with_the_service, args=(folder,), daemon=True).start()
    try:
        check_body(folder)  # before all that matching needs is imported: that takes a second
        prepare()
        one_thread()
        limit_memory(MOST_MEMORY)
        match_trace(folder)
    except Refused as refused:
        text = json.dumps({"status": refused.status, "error": refused.why})
        (folder / REFUSAL).write_text(text, encoding="utf-8")
