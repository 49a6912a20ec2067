"""Heights by satellites or a barometer, against the levels of roads: bridges, tunnels, ramps."""

from collections.abc import Mapping
from dataclasses import dataclass

from .kinds import Elevation


@dataclass(frozen=True)
class Height:
    """Heights in metres above anything that stays: the sea, the ellipsoid, where a barometer began.

    The defaults are those of satellites.  For a barometer take drift_m = 1.5 and drift_s = 300.
    """

    name: str = "height"
    columns: tuple[str, ...] = ("height_m",)
    sigma_m: float = 0.7  # of the part that each reading draws anew
    drift_m: float = 4.0  # of the part that lasts,
    drift_s: float = 100.0  # for so long

    def rows(self, reading: Mapping[str, float]) -> list[Elevation]:
        """The height."""
        (column,) = self.columns
        return [Elevation(reading[column], self.sigma_m, self.drift_m, self.drift_s)]
