"""A program of its own: the CAN frames of one MF4 file, out of asammdf, as arrays.

It imports nothing of this package, so that it starts quickly.  asammdf prints, warns and takes
memory about damaged files; none of that reaches whoever asks, and none of it lasts.
"""

import io
import json
import logging
import os
import sys
from typing import Any

import numpy as np

MEMORY = 4 << 30  # bytes that asammdf may take beside a multiple of the file


def _limit(path: str) -> None:
    try:
        import resource
    except ImportError:  # Windows: the time alone is limited
        return
    most = MEMORY + 64 * os.path.getsize(path)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _frames(path: str) -> dict[str, Any]:
    import can

    class Counting(logging.Handler):
        count = 0

        def emit(self, record: logging.LogRecord) -> None:
            self.count += 1

    told = Counting(logging.WARNING)
    for name in ("asammdf", "can"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [told], False
    with open(path, "rb") as file:
        rows = [
            (m.timestamp, m.arbitration_id, m.is_extended_id, bytes(m.data),
             not (m.is_remote_frame or m.is_error_frame))
            for m in can.MF4Reader(file)
        ]  # fmt: skip
    times, ids, extended, data, is_data = zip(*rows, strict=True) if rows else ((),) * 5
    return {
        "time": np.array(times, np.float64),
        "id": np.array(ids, np.int64),
        "extended": np.array(extended, np.bool_),
        "is_data": np.array(is_data, np.bool_),
        "length": np.array([len(d) for d in data], np.int64),
        "data": np.frombuffer(b"".join(data), np.uint8),
        "not_understood": np.array([told.count]),
    }


def main(path: str) -> None:
    """Write the frames of a file to standard output as `.npz`, or why there are none as JSON."""
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed is no answer
    try:
        _limit(path)
        packed = io.BytesIO()
        np.savez(packed, **_frames(path))
        content = packed.getvalue()
    except BaseException as error:
        first = (str(error).splitlines() or [""])[0][:200]
        content = json.dumps([type(error).__name__, first]).encode()
    answer.write(content)
    answer.close()


if __name__ == "__main__":
    main(sys.argv[1])
