"""Which format the file of a drive is in: by its suffix, else by its first bytes."""

import re
from os import PathLike
from pathlib import Path
from typing import Any

from ..errors import ReadError
from .checks import cannot_be_read
from .csv_text import layout_of
from .reading import Reading
from .source import Source

_SUFFIXES = {
    **dict.fromkeys((".parquet", ".geoparquet", ".pq", ".arrow", ".feather", ".ipc"), "table"),
    **dict.fromkeys((".tsv", ".tab"), "table"),
    **dict.fromkeys((".nmea", ".nma"), "nmea"),
    **dict.fromkeys((".blf", ".asc", ".trc", ".mf4", ".candump"), "can"),
    **dict.fromkeys((".gpkg", ".shp", ".fgb"), "geo"),
    ".gpx": "gpx",
    ".pos": "pos",
    ".ubx": "ubx",
}
_CONTENTS = (  # first bytes of each format
    ("table", re.compile(rb"\A(PAR1|ARROW1|FEA1)")),
    ("geo", re.compile(rb"\A(SQLite format 3\x00|fgb\x03fgb|\x00\x00\x27\x0a)")),
    ("can", re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}(#|\s+\[)", re.MULTILINE)),
    ("can", re.compile(rb"\Atimestamp,arbitration_id,extended,remote,error,dlc,data")),
    ("nmea", re.compile(rb"\$[A-Z]{2}(GGA|GNS|RMC|GST|ZDA|VTG|GLL|GSA|GSV),")),
    ("ubx", re.compile(rb"\xb5\x62\x01\x07[\x54\x5c]\x00")),
    ("gpx", re.compile(rb"<gpx[\s>]")),
    ("kml", re.compile(rb"<kml[\s>]")),
    ("pos", re.compile(rb"\A(%[^\n]*\n)*%\s+(GPST|UTC|JST)\s", re.MULTILINE)),
    ("gnss_logger", re.compile(rb"^#?\s*Fix,Provider,", re.MULTILINE)),
    ("json", re.compile(rb"\A(\xef\xbb\xbf)?\s*[{\[]")),
    ("json", re.compile(rb"\A[-\dT:.Z]+\t\*\s*\t\{")),  # OwnTracks' recorder
    ("table", re.compile(rb"\A\s*[^\n,;\t\x00]+[,;\t][^\n\x00]*(\n|\Z)")),
)
_STRANGERS = (  # what is not read: what it is, what to do, what it begins with
    ("XML, but no GPX", "export GPX", re.compile(rb"\A(\xef\xbb\xbf)?\s*<")),
    ("compressed or a spreadsheet", "unpack it, or save it as CSV",
     re.compile(rb"\A(\x1f\x8b|PK\x03\x04|BZh|\x28\xb5\x2f\xfd)")),
    ("text in UTF-16", "save it in UTF-8", re.compile(rb"\A(\xff\xfe|\xfe\xff)")),
)  # fmt: skip
_DESCRIPTIONS = {  # what describes a car, and the options that take it
    ".dbc": "describes CAN signals and is no drive; give it by dbc= (--dbc), with a CAN log",
    ".toml": "describes a vehicle and is no drive; give it by vehicle= (--vehicle)",
}
_ZIP, _SHAPES = b"PK\x03\x04", re.compile(rb"\.shp")  # a Shapefile in an archive
_SNIFF = 1 << 16  # bytes read to recognise a format


def kind_of_path(path: str | PathLike[str]) -> str | None:
    """The format by suffix alone, or by the first bytes of a CAN log."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(_SNIFF)
    except (OSError, ValueError) as error:
        raise ReadError(cannot_be_read(path, error)) from None
    kind = _SUFFIXES.get(Path(path).suffix.lower())
    return kind or ("can" if any(p.search(head) for k, p in _CONTENTS if k == "can") else None)


def format_of(file: Any) -> str:
    """The format of a drive's file: a key of `_READERS`, or `can`.

    Raises:
        ReadError: The file cannot be opened, is empty or like none of them.
    """
    return kind_of(Source.of(file), Reading())


def kind_of(source: Source, reading: Reading) -> str:
    """The format of a file that was opened; the caller's names show a table.

    Raises:
        ReadError: It is empty or like none of them.
    """
    where, head = source.name, source.data[:_SNIFF]
    if not head.strip():
        raise ReadError(f"{where}: the file is empty; a log or table was expected")
    if source.suffix in _DESCRIPTIONS:
        raise ReadError(f"{where}: {_DESCRIPTIONS[source.suffix]}; a log or table was expected")
    if source.suffix in _SUFFIXES:
        return _SUFFIXES[source.suffix]
    kind = next((kind for kind, pattern in _CONTENTS if pattern.search(head)), None)
    strange = next(((s, advice) for s, advice, p in _STRANGERS if p.search(head)), None)
    if kind is None and not strange and b"\0" not in head and layout_of(head, reading):
        kind = "table"
    if source.data.startswith(_ZIP) and _SHAPES.search(source.data):
        return "geo"
    if kind is not None and not (kind == "table" and strange):
        return kind
    seen, advice = strange or ("a file of unknown format", "convert it")
    raise ReadError(
        f"{where}: {seen}; NMEA 0183, a drive table (CSV, Parquet, Arrow), GPX, KML, GeoJSON, "
        f"UBX, RTKLIB .pos or a CAN log was expected; {advice}"
    )
