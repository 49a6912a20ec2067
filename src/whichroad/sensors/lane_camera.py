"""A camera that sees where in the road the vehicle drives."""

from collections.abc import Mapping
from dataclasses import dataclass

from .kinds import Lateral


@dataclass(frozen=True)
class LaneCamera:
    """Offsets from the road's centre line, right positive: the marking or the middle of the road.

    The line that is drawn on the map may run elsewhere in the road; that lasts.
    """

    name: str = "lane_camera"
    columns: tuple[str, ...] = ("lane_offset_m",)
    sigma_m: float = 0.5  # the camera's and that of the line on the map
    lasts_m: float = 50.0
    bias_sigma_m: float = 0.0  # how surely it is known where it is mounted; the rest is learnt

    def rows(self, reading: Mapping[str, float]) -> list[Lateral]:
        """The offset."""
        (column,) = self.columns
        return [
            Lateral(
                reading[column], self.sigma_m, lasts_m=self.lasts_m,
                bias_sigma=self.bias_sigma_m,
            )
        ]  # fmt: skip
