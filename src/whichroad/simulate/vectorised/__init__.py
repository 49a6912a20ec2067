"""Vectorised simulator: tens of thousands of short drives, as epochs, by compiled code.

It simulates what `simulate_drive` does: map error, lanes, corners, wheels, receiver.
Tests compare the two.  Lines are prepared before; no files, records or degrees are made.
Kernels call none of another file here, so that the compile cache, which knows the file's
age and the digest of the filter's kernels, is never stale.
"""

from .buffers import (
    ANGLE,
    BIAS,
    DIFFERENTIAL,
    RATIO,
    SCALE,
    TRACK,
    DriveBuffers,
    Line,
    Numbers,
    Truth,
    new_buffers,
)
from .measurements import sense
from .trajectory import drive_line


def simulate_short(
    line: Line, buffers: DriveBuffers, par: Numbers, odometry: bool, seed: int
) -> int:
    """Simulate one drive along a line.

    Args:
        line: The route, n points, at most `buffers.LONGEST`.
        buffers: Filled from row 0 on: epochs and truth.
        par: What is wrong with map, car and receiver.
        odometry: Wheels at `odometry_rate`; else fixes alone.
        seed: Everything random comes from it, 0 to 2**32 - 1.

    Returns:
        The number of epochs.
    """
    count = drive_line(line, buffers, par, seed)
    return int(sense(line, buffers, par, count, odometry))


__all__ = [
    "ANGLE",
    "BIAS",
    "DIFFERENTIAL",
    "RATIO",
    "SCALE",
    "TRACK",
    "DriveBuffers",
    "Line",
    "Numbers",
    "Truth",
    "new_buffers",
    "simulate_short",
]
