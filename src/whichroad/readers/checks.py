"""Checks shared by all readers: open the file, sort rows, count what is skipped.

A `Skipped` counts records by reason; it ends as `Drive.skipped`.
"""

import difflib
import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError
from ..observations import Array
from ..sensors.validation import LATEST

Skipped = Counter[str]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

LAST = LATEST  # s: no log has later times
BACKWARDS = "time running backwards (sorted)"
REPEATED = "repeated time"
NO_TIME = "no time"
UNPARSABLE_TIME = "unparsable time"
NO_POSITION = "no position"


def read_bytes(path: str | PathLike[str]) -> bytes:
    """All bytes of a file.

    Raises:
        ReadError: It cannot be opened; the message gives the reason.
    """
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        raise ReadError(cannot_be_read(path, error)) from None


def cannot_be_read(path: str | PathLike[str], error: Exception) -> str:
    """The message about a file that cannot be opened, with files of similar names.

    Args:
        path: As the caller wrote it.
        error: What opening it raised.
    """
    reason = str(getattr(error, "strerror", None) or error or type(error).__name__)
    text = f"{path}: cannot be read ({reason.splitlines()[0]}); a readable file was expected"
    if not isinstance(error, FileNotFoundError):
        return text
    folder = Path(path).parent
    try:
        there = sorted(one.name for one in folder.iterdir() if not one.name.startswith("."))
    except OSError:
        return f"{text}; there is no folder {folder}"
    close = difflib.get_close_matches(Path(path).name, there, 3, 0.5)
    if close:
        return f"{text}; did you mean {' or '.join(str(folder / name) for name in close)}?"
    where = "in this folder" if folder == Path() else f"in {folder}"
    return f"{text}; check the name; {where} are {listed(there, 5) or 'no files'}"


def listed(names: Iterable[str], most: int = 20) -> str:
    """Names as one line of an error message."""
    names = list(names)
    texts = [name[:40] if name.isprintable() else ascii(name[:40]) for name in names[:most]]
    return ", ".join(texts) + (", ..." if len(names) > most else "") if names else "none"


@contextmanager
def counted_warnings(library: str, reason: str, skipped: Skipped) -> Iterator[None]:
    """Count the warnings that a library logs, and keep them from being printed."""

    class Counting(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            skipped[reason] += 1

    handler = Counting(logging.WARNING)
    logging.getLogger(library).addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger(library).removeHandler(handler)


def keep(good: Bools, reason: str, skipped: Skipped) -> Bools:
    """Return `good`, and count the rows where it is false under `reason`."""
    bad = int(good.size - np.count_nonzero(good))
    if bad:
        skipped[reason] += bad
    return good


def as_time_passes(time: NDArray[Any], rows: Ints) -> Ints:
    """Rows in the order of the file, turned round where that has the latest first."""
    step = np.diff(time[rows])
    return rows[::-1] if np.count_nonzero(step < 0) > np.count_nonzero(step > 0) else rows


def in_order(time: NDArray[Any], skipped: Skipped) -> Ints:
    """The rows by strictly increasing time.

    Rows that came late are put in order and counted; of several rows with one time
    the first stays and the others are counted.

    Args:
        time: Finite times, shape (n,).
        skipped: Where to count.

    Returns:
        Indices into `time`.
    """
    if len(time) == 0:
        return np.zeros(0, np.int64)
    late = int(np.count_nonzero(time[1:] < np.maximum.accumulate(time)[:-1]))
    if late:
        skipped[BACKWARDS] += late
    order = np.argsort(time, kind="stable") if late else np.arange(len(time))
    new = np.ones(len(time), np.bool_)
    new[1:] = np.diff(time[order]) > 0
    return order[keep(new, REPEATED, skipped)]


def is_place(lat: Array, lon: Array) -> Bools:
    """Whether degrees (n,) can be where a vehicle is."""
    # receivers without a fix write 0, 0: in the Gulf of Guinea there is no road
    possible: Bools = (np.abs(lat) <= 90) & (np.abs(lon) <= 180) & ((lat != 0) | (lon != 0))
    return possible
