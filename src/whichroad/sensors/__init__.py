"""What each sensor observes: one file each, from readings to what the filter takes.

Further sensors are classes that turn their readings into kinds of evidence (`kinds`).
"""

from ..observations import SensorReading as SensorReading
from .compass import Compass as Compass
from .compass import declination as declination
from .dual_antenna import DualAntenna as DualAntenna
from .height import Height as Height
from .kinds import Attribute as Attribute
from .kinds import Bearing as Bearing
from .kinds import Elevation as Elevation
from .kinds import Evidence as Evidence
from .kinds import Heading as Heading
from .kinds import Lateral as Lateral
from .kinds import Position as Position
from .kinds import Range as Range
from .kinds import Sensor as Sensor
from .kinds import Speed as Speed
from .lane_camera import LaneCamera as LaneCamera
from .ranging import Ranging as Ranging
from .second_receiver import SecondReceiver as SecondReceiver
from .sky import Sky as Sky
