"""Which odometry moves the vehicle on line, where several kinds are heard: one at a time."""

from ..observations import Distance, SpeedYaw, WheelSpeed, WheelTicks
from .localizer_state import Reading

SECOND = "odometry beside another one (not used)"
_RANK = {Distance: 0, SpeedYaw: 1, WheelSpeed: 2, WheelTicks: 3}  # the highest is used


def is_worse(reading: Reading, than: Reading | None) -> bool:
    """Whether a reading is of a kind that another one, if there is one, stands above."""
    return than is not None and _RANK[type(than)] > _RANK[type(reading)]
