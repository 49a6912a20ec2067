"""Tables in text: where the columns' names are, what parts the cells, what is no row.

Found by their meaning: the line of names is the first that names quantities which are known.
Before it may be a preamble, after it a line of units, between the rows comments.
"""

import csv
import io
import re
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import ReadError, first_line
from .checks import Skipped, listed
from .dates import UNSAID, is_clock, of_texts
from .likely_names import as_option, likely_columns
from .names import NAMES, Column, NoSuchColumn, Seen, find, with_unit
from .reading import Reading
from .whole_trips import said_of

if TYPE_CHECKING:
    import pyarrow as pa

WIDTH = "row with a wrong number of cells"
_BLANKS = " "  # any number of blanks between cells
_DELIMITERS = (",", ";", "\t", "|", _BLANKS)
_HEAD = 1 << 16  # bytes within which the names are looked for
_LINES = 200  # lines of them
_COMMENT = re.compile(rb"^[ \t]*[#%][^\n]*(?:\n|\Z)", re.MULTILINE)
_UNITS = frozenset(
    (
        *("s", "ms", "m", "m²", "km", "°", "deg", "degree", "degrees", "rad", "m/s", "km/h", "kmh"),
        *("kph", "mph", "mi/h", "kn", "kt", "knots", "%", "hz", "utc", "iso", "rad/s", "deg/s"),
        *("°/s", "unix time"),
    )
)  # what a line of units consists of
_DATE = r"\d{4}[-/]\d\d[-/]\d\d"
_HEADLESS = (  # tables without a line of names: how a row looks, what its columns are
    (",", re.compile(rf"\d+,{_DATE} \d\d:\d\d:\d\d,-?[\d.]+,-?[\d.]+\s*$"),  # T-Drive
     ["taxi_id", "time", "lon", "lat"]),
    (",", re.compile(rf"-?[\d.]+,-?[\d.]+,[01],-?[\d.]+,[\d.]+,{_DATE},\d\d:\d\d:\d\d\s*$"),
     ["lat", "lon", "", "", "", "date", "time"]),  # GeoLife
    (_BLANKS, re.compile(r"-?\d+\.\d+ -?\d+\.\d+ [01] \d{9,10}\s*$"),  # Cabspotting
     ["lat", "lon", "", "time"]),
)  # fmt: skip


class Layout(NamedTuple):
    """How a table is written."""

    delimiter: str
    names: list[str]
    begin: int  # byte at which the rows begin


def layout_of(head: bytes, reading: Reading | None = None) -> Layout | None:
    """How a table that begins so is written; None: no line names a known quantity."""
    own = reading.columns if reading is not None else {}
    best, most = None, 0
    begin = 0
    for number, line in enumerate(head[:_HEAD].splitlines(keepends=True)[:_LINES]):
        begin += len(line)
        text = line.decode("utf-8", "replace").strip("\r\n")
        if not text.strip():
            continue
        parted = False  # by something else than blanks, which are within names too
        for delimiter in _DELIMITERS:
            names = _cells(re.sub(r"^\s*[#%]\s*", "", text), delimiter)
            if delimiter == _BLANKS and parted:
                break
            parted |= len(names) > 2
            known = _known(names, own)
            if known > most + (1 if delimiter == _BLANKS and most else 0):
                best, most = Layout(delimiter, names, begin), known
        if most > 1 or (most and number == 0 and not own):
            break
    if most > 1:
        return best
    return _headless(head, own) or best


def _known(names: list[str], own: Any) -> int:
    """How many quantities these cells name; none where they are values."""
    own = dict(own)
    while True:
        try:
            found = find(names, own)
            break
        except NoSuchColumn as error:  # the reader will say so
            del own[error.alias]
    return sum(not _is_value(column.name) for column in found.values())


def _is_value(cell: str) -> bool:
    try:
        float(cell)
        return True
    except ValueError:
        return bool(re.match(rf"\s*{_DATE}", cell)) or is_clock(cell)


def _headless(head: bytes, own: Any) -> Layout | None:
    """A table whose rows show what they are, or whose columns the caller gave by number."""
    begin = 0
    for line in head.splitlines(keepends=True)[:_LINES]:
        text = line.decode("utf-8", "replace").strip()
        for delimiter, row, names in _HEADLESS:
            if row.match(text):
                return Layout(delimiter, names, begin)
        if own and all(str(column).isdecimal() for column in own.values()):
            cells = max((_cells(text, delimiter) for delimiter in _DELIMITERS), key=len)
            if len(cells) >= max(int(column) for column in own.values()) and any(
                map(_is_value, cells)
            ):
                delimiter = max(_DELIMITERS, key=lambda d: len(_cells(text, d)))
                return Layout(delimiter, [str(k + 1) for k in range(len(cells))], begin)
        begin += len(line)
    return None


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == _BLANKS:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return []


def read_csv(data: bytes, where: str, skipped: Skipped, reading: Reading) -> Seen:
    """The used columns of a table in text, and the names of all.

    Args:
        data: The file.
        where: Its name, for messages.
        skipped: Counts rows with a wrong number of cells.
        reading: Gives own names of columns.

    Raises:
        ReadError: No column is known, or the rows cannot be read.
    """
    data = _in_utf8(data)
    layout = layout_of(data[:_HEAD], reading)
    if layout is None:
        first = _first(data)
        if reading.columns:
            find(first, reading.columns)  # names a column that is not there
        if any(map(_is_value, first)):
            raise ReadError(_without_names(where, first))
        raise ReadError(no_column(where, "no known column", first, ("time", "lat", "lon")))
    body = data[layout.begin :]
    if b"#" in body or b"%" in body:
        body = _COMMENT.sub(b"", body)
    if layout.delimiter == _BLANKS:
        body = re.sub(rb"(?m)^ | $", b"", re.sub(rb"[ \t]+", b" ", body.replace(b"\r", b"")))
    units, body = _units(layout, body)
    names = _with_index(layout.names, body, layout.delimiter, reading)
    found = {
        quantity: with_unit(quantity, column, units[column.place] if units else "")
        for quantity, column in find(names, reading.columns).items()
    }
    table = _rows(body, names, found, layout.delimiter, where, skipped)
    table = table if layout.delimiter == "," else _with_points(table)
    places = {quantity: c._replace(place=i) for i, (quantity, c) in enumerate(found.items())}
    return Seen(table, names, places)


def _first(data: bytes) -> list[str]:
    """The cells of the first line that is not empty."""
    line = next(
        (line for line in data[:_HEAD].decode("utf-8", "replace").splitlines() if line.strip()), ""
    )
    return max((_cells(line, delimiter) for delimiter in _DELIMITERS[:-1]), key=len)


def _units(layout: Layout, body: bytes) -> tuple[list[str], bytes]:
    """Units that stand in a line below the names, and the rows without such lines."""
    units: list[str] = []
    begin = 0
    for line in body[:_HEAD].splitlines(keepends=True)[:3]:
        cells = _cells(line.decode("utf-8", "replace").strip("\r\n"), layout.delimiter)
        if len(cells) > len(layout.names) or any(map(_is_value, cells)):
            break
        if not units:
            said = [cell.strip("[]()").lower() for cell in cells]
            if not any(unit in _UNITS for unit in said):
                break
            units = said + [""] * (len(layout.names) - len(said))
        begin += len(line)
    return units, body[begin:]


def _with_index(names: list[str], body: bytes, delimiter: str, reading: Reading) -> list[str]:
    """The names, with that of an index without a name (as pandas writes it) that is a time."""
    if not names or names[0] or "time" in find(names, reading.columns):
        return names
    line = body[:_HEAD].split(b"\n", 1)[0].decode("utf-8", "replace")
    cell = (_cells(line, delimiter) or [""])[0]
    return ["time", *names[1:]] if of_texts([cell], UNSAID, "") else names


def _rows(
    body: bytes,
    names: list[str],
    found: dict[str, Column],
    delimiter: str,
    where: str,
    skipped: Skipped,
) -> "pa.Table":
    """The rows of the columns that are used."""
    import pyarrow as pa
    import pyarrow.csv as pc

    places = [column.place for column in found.values()]
    if not re.search(rb"\S", body):
        return pa.table({names[place]: pa.array([], pa.float64()) for place in places})
    line = body[:_HEAD].split(b"\n", 1)[0].decode("utf-8", "replace").rstrip("\r")
    cells = _cells(line, delimiter)
    more = len(cells) == len(names) + 1 and not cells[-1]  # each row ends with a delimiter
    columns = [f"{place}" for place in range(len(names) + more)]
    wanted = [columns[place] for place in places]

    def widths(row: Any) -> str:
        skipped[WIDTH] += 1
        return "skip"

    def read(types: dict[str, Any] | None) -> "pa.Table":
        skipped.pop(WIDTH, None)
        return pc.read_csv(
            io.BytesIO(body),
            read_options=pc.ReadOptions(
                use_threads=False, block_size=1 << 22, column_names=columns
            ),
            parse_options=pc.ParseOptions(delimiter=delimiter, invalid_row_handler=widths),
            convert_options=pc.ConvertOptions(include_columns=wanted, column_types=types),
        )

    try:
        try:
            table = read(None)
        except pa.ArrowInvalid:  # a cell unlike those before it: take them one by one
            table = read(dict.fromkeys(wanted, pa.string()))
    except (pa.ArrowException, KeyError, ValueError) as error:
        reason = first_line(error)
        raise ReadError(
            f"{where}: no readable table ({reason}); comma-separated columns under one line of "
            "names were expected"
        ) from None
    return table.rename_columns([names[place] for place in places])


def _with_points(table: "pa.Table") -> "pa.Table":
    """Numbers with decimal commas, where the comma does not part columns, with points."""
    import pyarrow as pa
    import pyarrow.compute as pc

    for i, column in enumerate(table.columns):
        if pa.types.is_string(column.type):
            commas = pc.match_substring_regex(column, r"^\s*[-+]?\d+,\d+\s*$")
            if pc.any(commas).as_py() and not pc.any(pc.match_substring(column, ".")).as_py():
                points = pc.if_else(commas, pc.replace_substring(column, ",", "."), column)
                table = table.set_column(i, table.column_names[i], points)
    return table


def _in_utf8(data: bytes) -> bytes:
    """The text with a mark in place of what is none, as in tables of older programs."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    try:
        data.decode()
    except UnicodeDecodeError:
        return data.decode(errors="replace").encode()
    return data


def _without_names(where: str, first: list[str]) -> str:
    """The message about a table whose first line holds values."""
    return (
        f"{where}: the first line holds values ({listed(first, 6)}) and no names of columns; a "
        "first line such as time,lat,lon was expected; add one, or give the columns by their "
        "numbers: `whichroad match --columns time=1,lat=2,lon=3` (columns=)"
    )


def no_column(where: str, what: str, seen: list[str], quantities: tuple[str, ...]) -> str:
    """The message about a table that lacks something, with what it has and what would do."""
    accepted = "; ".join(f"{q}: {', '.join(list(NAMES[q])[:8])}" for q in quantities)
    likely = likely_columns(seen)
    what_to_do = (
        f"did you mean `whichroad match --columns {as_option(likely)}` (columns=)?"
        if likely.keys() & set(quantities)
        else "rename the columns, or name your own by `whichroad match --columns "
        "time=...,lat=...` (columns=)"
    )  # fmt: skip
    return (
        f"{where}: {what} among the columns ({listed(seen)}); accepted names are {accepted}; "
        f"{said_of(seen)}{what_to_do}"
    )
