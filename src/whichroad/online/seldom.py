"""An odometer that is read as seldom as places, on line: it tells the way from fix to fix.

See `sensors.seldom_read`, which does the same for a recorded drive.
"""

from ..filter.state import CLOCK, EPOCH
from ..observations import Distance
from ..sensors.even_steps import EvenSteps
from ..sensors.seldom_read import LEAST, RARE, SELDOM
from ..settings import Vehicle
from .epoch_filter import EpochFilter, offset_of, packed
from .localizer_state import Reading
from .silence import learnt

_LATE = 5.0  # s, by which a reading is older than the fix that it is used with, at most
_UNEVEN = 0.5  # of the way since the reading, sigma
_READ, _AT = packed(EPOCH, "odometer"), offset_of(EPOCH, "odometer")


def seldom_by(
    before: Reading | None, reading: Reading, usual: float, fixed: float, now: EpochFilter
) -> float:  # fmt: skip
    """The usual interval of readings that come so seldom that they tell no motion; 0: these do.

    A single gap of one that is read often is none, nor is an outage of fixes that come often.

    Args:
        before: The last one.
        reading: The new one.
        usual: Interval of readings, s; 0: not known yet.
        fixed: When the last fix came, s.
        now: It knows how often fixes usually come.
    """
    if not (isinstance(reading, Distance) and isinstance(before, Distance)):
        return 0.0
    since, ago = reading.time - before.time, reading.time - fixed
    if since < SELDOM or 0.0 < usual < SELDOM:
        return 0.0
    every = float(now.belief.state["fix_interval"][0]) or ago  # 0: not known yet
    seldom = every >= SELDOM or (since >= RARE and ago < SELDOM)
    return learnt(usual, since) if seldom else 0.0


def write_reading(
    now: EpochFilter, reading: Reading | None, time: float, vehicle: Vehicle, steps: EvenSteps
) -> None:  # fmt: skip
    """Write into the epoch of a fix what a seldom read odometer has read last, if that is new.

    Args:
        now: Its epoch is filled.
        reading: The last one.
        time: Of the fix, s.
        vehicle: The odometer's scale.
        steps: Of that odometer.
    """
    if now.mode != CLOCK or not isinstance(reading, Distance):
        return
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
