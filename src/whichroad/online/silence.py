"""When an odometer counts as silent on line, by how often it usually comes."""

from dataclasses import fields, replace

from ..observations import SpeedYaw, WheelSpeed
from .localizer_state import Reading

LOST = 2.0  # s without odometry, and three usual intervals, after which others take its place
_FEW, _USUAL = 5.0, 3.0  # usual intervals of a quick sensor, and of any
_SOONEST = 0.2  # s, of a silence
_NEWS = 0.2  # share of a new interval in what is usual


def lost_after(interval: float) -> float:
    """How long an odometer says nothing until another one, or a gyro alone, takes its place, s.

    Args:
        interval: Usually between its readings, s; 0: not known yet.
    """
    return max(LOST, _USUAL * interval)


def silent_after(interval: float) -> float:
    """How long an odometer says nothing until motion is no more what it was at its last reading.

    Single readings may be lost, and a slow sensor is not silent between two readings.

    Args:
        interval: Usually between its readings, s; 0: not known yet.
    """
    if interval == 0.0:
        return LOST
    return max(_SOONEST, min(_FEW * interval, LOST), _USUAL * interval)


def learnt(interval: float, new: float) -> float:
    """The usual interval with one more, s; a silence counts for little in it."""
    if interval == 0.0:
        return new
    return interval + _NEWS * (min(new, max(LOST, 2.0 * interval)) - interval)


def is_speed(reading: Reading) -> bool:
    """Whether a reading is a speed: it says nothing of the way in a silence before it."""
    return isinstance(reading, WheelSpeed | SpeedYaw)


def between(before: Reading, after: Reading, time: float) -> Reading:
    """What a sensor of speeds would have read in a silence, had they changed evenly.

    Args:
        before: The last reading before it.
        after: The first one after it, of the same kind.
        time: A moment in it, s.
    """
    share = (time - before.time) / (after.time - before.time)
    speeds = {
        field.name: (1.0 - share) * getattr(before, field.name) + share * getattr(after, field.name)
        for field in fields(before) if field.name not in ("time", "geared")
    }  # fmt: skip
    return replace(before, time=time, **speeds)
