"""Two antennas on one receiver: the heading of the line between them."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..geodesy.angles import wrap_bearing
from .kinds import Heading


@dataclass(frozen=True)
class DualAntenna:
    """True bearings of the line from the first to the second antenna."""

    name: str = "dual_antenna"
    columns: tuple[str, ...] = ("antennas_deg", "antennas_sigma_deg")
    mounted_deg: float = 0.0  # of that line, clockwise from the vehicle's axis
    bias_sigma_deg: float = 2.0  # how surely that is known; the rest is learnt
    sigma_deg: float = 0.5  # where no column says it
    lasts_s: float = 5.0

    def rows(self, reading: Mapping[str, float]) -> list[Heading]:
        """The bearing of the vehicle's axis."""
        bearing, sigma = (reading.get(name) for name in self.columns)
        if bearing is None:
            return []
        sigma = self.sigma_deg if sigma is None else sigma
        bearing = wrap_bearing(bearing - self.mounted_deg)
        return [Heading(bearing, sigma, lasts_s=self.lasts_s, bias_sigma=self.bias_sigma_deg)]
