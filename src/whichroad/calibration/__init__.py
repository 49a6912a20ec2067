"""What a car's sensors are like, from its own unlabelled drives."""

from .calibrate import Calibration, calibrate
from .quantities import Quantity

__all__ = ["Calibration", "Quantity", "calibrate"]
