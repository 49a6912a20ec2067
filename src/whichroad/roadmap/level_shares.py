"""On which level the vehicle is: bridges, tunnels and layers of its roads, with probabilities."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .attribute_names import LEVELS, levels_of
from .roadmap import RoadMap

_KEPT = 4096  # pieces whose level is known


class LevelShare(NamedTuple):
    """A level with the probability of all roads on it."""

    level: int | None  # roads above the ground; None: off the roads, or not known
    kind: str | None  # bridge, tunnel or ground
    p: float


class LevelShares:
    """Levels of the roads of a map.

    Args:
        roads: The map; one that tells no levels has none.
    """

    def __init__(self, roads: RoadMap) -> None:
        self._roads = roads
        self.are_known = set(LEVELS) <= set(roads.ways)
        self._known: dict[int, tuple[int, str]] = {}  # place in `RoadMap.pieces` -> level, kind

    def of(self, edge: Sequence[int], s: Sequence[float], p: Sequence[float]) -> list[LevelShare]:
        """The levels, the most probable first.

        Args:
            edge: (n,) where the vehicle may be; negative: on no road.
            s: (n,) m from their starts.
            p: (n,) probabilities; what they leave of 1 is on no level.

        Returns:
            None, where the map knows no levels.
        """
        if not self.are_known or not len(edge):
            return []
        roads, shares = self._roads, dict[tuple[int | None, str | None], float]()
        at = np.asarray(edge)
        pieces = roads.piece(np.maximum(at, 0), np.asarray(s, float)).tolist()
        for number, piece, share in zip(edge, pieces, p, strict=True):
            key = self._level(piece) if number >= 0 else (None, None)
            shares[key] = shares.get(key, 0.0) + share
        if (rest := 1.0 - sum(shares.values())) > 1e-9:
            shares[None, None] = shares.get((None, None), 0.0) + rest
        found = [LevelShare(level, kind, share) for (level, kind), share in shares.items()]
        return sorted(found, key=lambda one: -one.p)

    def _level(self, piece: int) -> tuple[int, str]:
        known = self._known.get(piece)
        if known is None:
            if len(self._known) >= _KEPT:
                self._known.clear()
            way = self._roads.pieces.way[[piece]]
            _, bridge, tunnel = (bool(np.asarray(self._roads.ways[n])[way][0]) for n in LEVELS)
            kind = "tunnel" if tunnel else "bridge" if bridge else "ground"
            known = self._known[piece] = (int(levels_of(self._roads.ways, way)[0]), kind)
        return known
