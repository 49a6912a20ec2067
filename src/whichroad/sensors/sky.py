"""The sky over the road: satellites that are lost or few speak for a tunnel."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from .kinds import Attribute


@dataclass(frozen=True)
class Sky:
    """Numbers of satellites in use, 0 where the receiver has none, and how strong the best are.

    Nothing is ruled out: receivers fail under the sky, and a car park is no tunnel.
    """

    name: str = "sky"
    columns: tuple[str, ...] = ("satellites", "cn0_dbhz")
    attribute: str = "tunnel"  # of the map, true where the sky is covered
    few: float = 4.0  # satellites, below which they are lost,
    weak_dbhz: float = 25.0  # or C/N0 of the best ones
    p_lost_covered: float = 0.95  # P(lost) where the sky is covered,
    p_lost_open: float = 0.03  # and where it is not
    lasts_s: float = 20.0  # for which a receiver that errs about it goes on to do so

    def rows(self, reading: Mapping[str, float]) -> list[Attribute]:
        """How likely that number is below a cover and elsewhere."""
        count, strength = (reading.get(column, math.inf) for column in self.columns)
        covered, elsewhere = self.p_lost_covered, self.p_lost_open
        if count >= self.few and strength >= self.weak_dbhz:
            covered, elsewhere = 1.0 - covered, 1.0 - elsewhere
        return [Attribute(self.attribute, {True: covered}, elsewhere, lasts_s=self.lasts_s)]
