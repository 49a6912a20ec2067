"""Where a hypothesis was before a fix that it takes to be wrong."""

import numpy as np

from ..._compile import Record, kernel

_AT_ONCE = 1e-3  # s between two times that are the same

ORIGIN = np.dtype(
    [
        ("since", "f8"),  # time of the fix before, s
        ("ignored", "f8"),  # time of the fix that it takes to be wrong, s
        ("along", "f8"),  # abscissa at the fix before, m
        ("variance", "f8"),  # of it, m²
        ("rate", "f8"),  # speed then, m/s
        ("rate_variance", "f8"),  # (m/s)²
        ("cross", "f8"),  # covariance of abscissa and speed, m²/s
        ("driven", "f8", (2,)),  # by the odometer to the fix ignored, m, m²; variance 0: not told
        ("edge", "i4"),  # then
        ("entries", "i4"),  # of the path tree since then
        ("waits", "u1"),  # 1: until the next fix decides; 2: it is there again, as that has come
    ],
    align=True,
)


@kernel
def forget_origin(origin: Record) -> None:
    """It waits for nothing."""
    origin.since = origin.ignored = origin.along = origin.variance = 0.0
    origin.rate = origin.rate_variance = origin.cross = 0.0
    origin.driven[0] = origin.driven[1] = 0.0
    origin.edge = origin.entries = origin.waits = 0


@kernel
def is_waiting(hyp: Record, time: float) -> bool:
    """Whether a hypothesis takes the fix of a time (s) to be wrong, and waits for the next one."""
    return bool(hyp.origin.waits == 1 and abs(hyp.origin.ignored - time) < _AT_ONCE)
