"""What is kept of the vehicle's way by odometry alone, see `filter.separation`."""

import numpy as np

from ._simd import N

COPIES = 2

RECKONED = np.dtype(
    [
        ("mu", "f8", (N,)),  # state by odometry alone since it was copied from the belief
        ("cov", "f8", (N, N)),
        ("begun", "f8"),  # s, when it was copied
        ("live", "u1"),
        ("p", "f8"),  # P(the belief and this differ by a fault)
        ("away", "f8", (2,)),  # from the heaviest hypothesis to it, m, axes of the plane
    ],
    align=True,
)

SEPARATION = np.dtype(
    [
        ("reckoned", RECKONED, (COPIES,)),
        ("begun", "f8"),  # s, when the last one was copied
        ("split", "f8"),  # s, when the belief was last split at one
        ("sums", "f8", (4,)),  # of the odometry until now: x, y (m), turn (rad), arc (m)
        ("calm", "f8"),  # scale of the receiver's sigmas, in calm times; 0: not known
        ("restless", "f8"),  # by how much sigmas of the position may be too small
    ],
    align=True,
)
