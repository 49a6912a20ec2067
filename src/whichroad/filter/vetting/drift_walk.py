"""How fast the drift of wheels changes: a tyre that loses air turns more with each metre.

The drift b walks at random, by q of its variance a metre.  Sound wheels hardly do.  Over a way L
the filter expects its estimate to change by no more than

    E[(b̂₁ − b̂₀)²] = P₀ + q L − P₁

Where it has changed by three times the root of that, q was too small.
"""

import math

import numpy as np

from ..._compile import Record, kernel

WALK = np.dtype(
    [
        ("more", "f8"),  # rad²/m³ that are added to q
        ("drift", "f8"),  # b̂ some time ago, rad/m,
        ("variance", "f8"),  # and P; 0: nothing is known of it
        ("arc", "f8"),  # m by the odometer, where that was
    ],
    align=True,
)

_WAY = 25.0  # m, over which it is looked at
_UNUSUAL = 3.0**2  # times what is expected
_GAIN, _MOST = 0.5, 1e-4**2  # share of what was too much that is taken; rad²/m³, at most
_LASTS = 1000.0  # m, after which sound wheels are believed again


@kernel
def learn_walk(walk: Record, drift: float, variance: float, arc: float, usual: float) -> None:
    """Compare what is known of the drift with what was known some way ago.

    Args:
        walk: In place.
        drift: b̂ of the most probable hypothesis, rad/m.
        variance: Of it.
        arc: By the odometer since the drive began, m.
        usual: q of sound wheels, rad²/m³.
    """
    way = abs(arc - walk.arc)
    if way < _WAY and walk.variance > 0.0:
        return
    if way < _LASTS and walk.variance > 0.0:
        expected = walk.variance + (usual + walk.more) * way - variance
        change = (drift - walk.drift) ** 2
        if change <= _UNUSUAL * expected:
            walk.more *= math.exp(-way / _LASTS)
        elif expected > 0.0:
            walk.more = min(walk.more + _GAIN * (change - expected) / way, _MOST)
    walk.drift = drift
    walk.variance = variance
    walk.arc = arc


@kernel
def forget_walk(walk: Record) -> None:
    """The drift is drawn anew."""
    walk.more = walk.variance = 0.0
