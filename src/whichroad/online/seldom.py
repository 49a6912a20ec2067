"""An odometer that is read as seldom as places, on line: it tells the way from fix to fix.

See `sensors.seldom_read`, which does the same for a recorded drive.
"""

from ..filter.state import EPOCH
from ..observations import Distance
from ..sensors.even_steps import EvenSteps
from ..sensors.seldom_read import LEAST, RARE, SELDOM
from ..settings import Vehicle
from .epoch_filter import EpochFilter, offset_of, packed
from .localizer_state import Reading

_LATE = 5.0  # s, by which a reading is older than the fix that it is used with, at most
_UNEVEN = 0.5  # of the way since the reading, sigma
_READ, _AT = packed(EPOCH, "odometer"), offset_of(EPOCH, "odometer")


def is_seldom(before: Reading | None, reading: Reading, fixed: float) -> bool:
    """Whether a reading comes so long after the one before that it tells no motion.

    Args:
        before: The last one.
        reading: The new one.
        fixed: When the last fix came, s.
    """
    if not (isinstance(reading, Distance) and isinstance(before, Distance)):
        return False
    since = reading.time - before.time
    return since >= SELDOM and (reading.time - fixed >= SELDOM or since >= RARE)


def write_reading(
    now: EpochFilter, reading: Distance, time: float, vehicle: Vehicle, steps: EvenSteps
) -> None:  # fmt: skip
    """Write into the epoch of a fix what the odometer has read last, unless that is too old.

    Args:
        now: Its epoch is filled.
        reading: The last one.
        time: Of the fix, s.
        vehicle: The odometer's scale.
        steps: Of that odometer.
    """
    late = time - reading.time
    if not 0.0 <= late <= _LATE:
        return
    ahead = now.speed * late
    variance = LEAST + steps.coarsest**2 / 6.0 + (_UNEVEN * ahead) ** 2
    read = 1.0 + vehicle.odometer_scale * reading.distance + ahead
    _READ.pack_into(now.epoch, _AT, max(read, 1e-9), variance)


def forget(now: EpochFilter) -> None:
    """The next epoch knows nothing of it."""
    _READ.pack_into(now.epoch, _AT, 0.0, 0.0)
