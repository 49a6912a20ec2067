"""What the map readers give to the compiler: streets with shared nodes, and their attributes."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..observations import Array

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Texts:
    """A column of words, each kept once; an empty word is absence.  Shape (n,)."""

    code: NDArray[np.int32]  # (n,) which word
    offset: Ints  # (words + 1,) where each word starts in utf8
    utf8: Bytes

    @classmethod
    def of(cls, words: list[str]) -> "Texts":
        """The column of a list of words."""
        places: dict[str, int] = {"": 0}
        code = np.array([places.setdefault(w, len(places)) for w in words], dtype=np.int32)
        raw = [w.encode() for w in places]
        offset = np.cumsum([0, *map(len, raw)], dtype=np.int64)
        return cls(code, offset, np.frombuffer(b"".join(raw), dtype=np.uint8))

    def __len__(self) -> int:
        return len(self.code)

    def word(self, code: int) -> str:
        """The word of a code."""
        return bytes(self.utf8[self.offset[code] : self.offset[code + 1]]).decode(errors="replace")

    def __getitem__(self, i: int) -> str:
        return self.word(int(self.code[i]))

    def words(self, rows: ArrayLike) -> list[str]:
        """The words of some rows."""
        codes = self.code[np.asarray(rows)].tolist()
        words = {code: self.word(code) for code in set(codes)}
        return [words[code] for code in codes]


Column = NDArray[Any] | Texts


def take(column: Column, rows: NDArray[Any]) -> Column:
    """The column of some rows."""
    if isinstance(column, Texts):
        return Texts(column.code[rows], column.offset, column.utf8)
    chosen: NDArray[Any] = column[rows]
    return chosen


def attributes(
    *, limit: ArrayLike, lanes: ArrayLike, width: ArrayLike, layer: ArrayLike, bridge: ArrayLike,
    tunnel: ArrayLike, oneway: ArrayLike, roundabout: ArrayLike, access: ArrayLike,
) -> dict[str, Column]:  # fmt: skip
    """What tables of edges show of streets, (W,) each, as maps store it."""
    return {
        "speed_limit_kmh": np.asarray(limit, np.float32),
        "lanes": np.minimum(lanes, 255).astype(np.uint8),
        "width": np.asarray(width, np.float32),
        "layer": np.asarray(layer, np.int8),
        "bridge": np.asarray(bridge, np.uint8),
        "tunnel": np.asarray(tunnel, np.uint8),
        "oneway": np.asarray(oneway, np.int8),
        "roundabout": np.asarray(roundabout, np.uint8),
        "access": np.asarray(access, np.uint8),
    }


@dataclass(frozen=True, slots=True)
class Restriction:
    """A turn restriction, by source ids; where ids are words, by their codes."""

    only: bool  # all other turns are banned, instead of these
    u_turn: bool  # about turning round
    origin: tuple[int, ...]  # ways
    via: int  # node; of one over ways the first, -1: not told
    target: tuple[int, ...]  # ways
    over: tuple[int, ...] = ()  # ways between origin and target, in driving order
    origin_forward: int = -1  # 1: driving the origin as it was drawn, 0: against it, -1: any
    target_forward: int = -1


@dataclass(frozen=True, slots=True)
class Streets:
    """Streets as polylines over shared nodes.  N nodes, W streets, L places in their lists."""

    lat_deg: Array  # (N,)
    lon_deg: Array  # (N,)
    node_id: Column  # (N,) the source's names, -1 or empty where only geometry knows the node
    first: Ints  # (W+1,)
    node: Ints  # (L,)
    rule_forward: Bytes  # (W,) bits of graph.network for driving as drawn
    rule_backward: Bytes  # (W,)
    speed: Array  # (W,) m/s
    lane: Array  # (W,) m right of the centre line, in legal directions
    lane_sigma: Array  # (W,) m, sigma of the lane driven in
    service: Bytes  # (W,)
    highway: Texts  # (W,)
    columns: dict[str, Column]  # (W,) each: source_id, name, ...
    restrictions: list[Restriction] = field(default_factory=list)
    blocked: Ints = field(default_factory=lambda: np.empty(0, np.int64))  # nodes no car passes
    skipped: dict[str, int] = field(default_factory=dict)
    start: Array | None = None  # (W,) m along the source at which each begins; None: 0
    whole: Array | None = None  # (W,) m, length of the source; NaN, None: that of the street
