"""What every reader does at the door: open the file, put rows in order, count what is skipped.

A `Skipped` counts records by reason; it ends as `Drive.skipped`.
"""

from collections import Counter
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError

Skipped = Counter[str]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

BACKWARDS = "time running backwards (put in order)"
REPEATED = "repeated time"
NO_TIME = "no time"


def read_bytes(path: str | PathLike[str]) -> bytes:
    """All bytes of a file.

    Raises:
        ReadError: It cannot be opened; the message says why.
    """
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ReadError(
            f"{path}: cannot be read ({reason}); a readable file was expected"
        ) from None


def keep(good: Bools, reason: str, skipped: Skipped) -> Bools:
    """`good` as it is; the rows where it is false are counted under `reason`."""
    bad = int(good.size - np.count_nonzero(good))
    if bad:
        skipped[reason] += bad
    return good


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
    fresh = np.ones(len(time), np.bool_)
    fresh[1:] = np.diff(time[order]) > 0
    return order[keep(fresh, REPEATED, skipped)]
