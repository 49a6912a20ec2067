"""Ranges to surveyed points: radio beacons, ultra-wide band, reflectors of a lidar."""

from collections.abc import Mapping
from dataclasses import dataclass

from .kinds import Range


@dataclass(frozen=True)
class Ranging:
    """Horizontal distances to points by their number.

    A point that was read off the map, and not surveyed, shares the map's error: `on_map`.
    """

    points: Mapping[int, tuple[float, float]]  # number -> lat, lon in degrees
    name: str = "ranging"
    columns: tuple[str, ...] = ("range_to", "range_m")
    sigma_m: float = 1.0
    lasts_s: float = 0.0
    bias_sigma_m: float = 0.3  # sigma of what all are too long or too short by; it is learnt
    on_map: bool = False
    forward_m: float = 0.0  # of the sensor, from the middle of the rear axle
    left_m: float = 0.0

    def rows(self, reading: Mapping[str, float]) -> list[Range]:
        """The range, where the point is known."""
        number, metres = (reading.get(name) for name in self.columns)
        point = None if number is None else self.points.get(int(number))
        if point is None or metres is None:
            return []
        return [
            Range(
                *point, metres, self.sigma_m, on_map=self.on_map, forward_m=self.forward_m,
                left_m=self.left_m, lasts_s=self.lasts_s, bias_sigma=self.bias_sigma_m,
            )
        ]  # fmt: skip
