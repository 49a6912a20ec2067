"""A second receiver of satellites, with an antenna of its own."""

from collections.abc import Mapping
from dataclasses import dataclass

from .kinds import Position


@dataclass(frozen=True)
class SecondReceiver:
    """Positions of a second receiver, in columns of their own.

    They do not start the filter: a fix of the drive's own receiver does, or a pose.

    Its errors last as those of a first one do.  What both have in common, such as the same
    reflections, is not known here: make the sigma larger where the antennas are close.
    """

    name: str = "second_receiver"
    columns: tuple[str, ...] = ("second_lat", "second_lon", "second_sigma_m")
    sigma_m: float = 4.0  # of each axis, where no column says it
    lasts_s: float = 80.0
    forward_m: float = 0.0  # of the antenna, from the middle of the rear axle
    left_m: float = 0.0

    def rows(self, reading: Mapping[str, float]) -> list[Position]:
        """The position, where both coordinates are there."""
        lat, lon, sigma = (reading.get(name) for name in self.columns)
        if lat is None or lon is None:
            return []
        return [
            Position(
                lat, lon, self.sigma_m if sigma is None else sigma, forward_m=self.forward_m,
                left_m=self.left_m, lasts_s=self.lasts_s,
            )
        ]  # fmt: skip
