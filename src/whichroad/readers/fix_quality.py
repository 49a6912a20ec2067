"""What a receiver says of its kind of fix, and how exact a fix of that kind is.

Qualities are the numbers of NMEA's GGA; what other formats write becomes one of them.
"""

import numpy as np

from ..geodesy.angles import Array
from .parsing import Bytes

NO_FIX, SINGLE, DIFFERENTIAL, FIXED, FLOAT, RECKONED = 0.0, 1.0, 2.0, 4.0, 5.0, 6.0
LEAST_SIGMA = 0.01  # m: no receiver on a vehicle is finer

# Errors over those of a single fix, which the settings give; other qualities count as single.
# So do differential ones: cheap receivers with SBAS report such at errors of 7 m.
_RATIOS = {FIXED: 0.0075, FLOAT: 0.1, RECKONED: 2.5}
# Modes of GNS, the best last: a receiver that fixes ambiguities of one system has a fixed solution.
_MODES = {"N": NO_FIX, "M": 7.0, "S": 8.0, "E": RECKONED, "P": 3.0, "A": SINGLE}
_MODES |= {"D": DIFFERENTIAL, "F": FLOAT, "R": FIXED}


def error_ratios(quality: Array) -> Array:
    """Errors of fixes over those of single ones, by their qualities, (n,); NaN: not said."""
    ratios = np.ones(len(quality))
    for kind, ratio in _RATIOS.items():
        ratios[quality == kind] = ratio
    return ratios


def quality_of_modes(letters: Bytes) -> Array:
    """Quality of the best of several modes, one a system of satellites.

    Args:
        letters: (systems, n) of GNS, 0 where there are less.

    Returns:
        (n,), NaN where no letter is a mode.
    """
    quality = np.full(letters.shape[1], np.nan)
    for letter, kind in _MODES.items():
        quality[(letters == ord(letter)).any(axis=0)] = kind
    return quality
