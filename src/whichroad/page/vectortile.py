"""Mapbox Vector Tiles, version 2.1: lines with a few properties, as bytes.

Enough of protobuf to write one message type; what reads them is MapLibre.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

EXTENT = 4096  # units across a tile

_LINE = 2  # geometry type
_MOVE, _DRAW = 1, 2  # commands
_VARINT, _BYTES = 0, 2  # wire types


class Line(NamedTuple):
    """A feature: one or more polylines and what is known of them."""

    parts: Sequence[Sequence[tuple[int, int]]]  # tile units, x right and y down
    properties: dict[str, str | int]


def encode_layer(name: str, lines: Iterable[Line]) -> bytes:
    """One layer, ready to be joined with others to a tile.

    Args:
        name: Of the layer.
        lines: Its features; a part of fewer than two different points is left out.

    Returns:
        The layer as a field of the tile, empty where no line is left.
    """
    keys: dict[str, int] = {}
    values: dict[str | int, int] = {}
    features = []
    for line in lines:
        drawn = _commands(line.parts)
        if not drawn:
            continue
        tags = []
        for key, value in line.properties.items():
            tags += [keys.setdefault(key, len(keys)), values.setdefault(value, len(values))]
        features.append(
            _field(2, _packed(tags)) + _number(3, _LINE) + _field(4, _packed(drawn))
        )  # fmt: skip
    if not features:
        return b""
    body = [_number(15, 2), _field(1, name.encode())]
    body += [_field(2, feature) for feature in features]
    body += [_field(3, key.encode()) for key in keys]
    body += [_field(4, _value(value)) for value in values]
    body.append(_number(5, EXTENT))
    return _field(3, b"".join(body))


def _commands(parts: Sequence[Sequence[tuple[int, int]]]) -> list[int]:
    """Moves and lines from point to point, each relative to the last."""
    out: list[int] = []
    x = y = 0
    for part in parts:
        points = [p for i, p in enumerate(part) if not i or p != part[i - 1]]
        if len(points) < 2:
            continue
        for i, (px, py) in enumerate(points):
            if i == 0:
                out.append(1 << 3 | _MOVE)
            elif i == 1:
                out.append(len(points) - 1 << 3 | _DRAW)
            dx, dy = px - x, py - y
            out += [dx << 1 ^ dx >> 31, dy << 1 ^ dy >> 31]  # zigzag
            x, y = px, py
    return out


def _varint(value: int) -> bytes:
    if value < 128:
        return bytes((value,))
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def _packed(values: Sequence[int]) -> bytes:
    return b"".join(map(_varint, values))


def _field(number: int, body: bytes) -> bytes:
    return _varint(number << 3 | _BYTES) + _varint(len(body)) + body


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3 | _VARINT) + _varint(value)


def _value(value: Any) -> bytes:
    """A tile's value: text, or a number that is not negative."""
    return _field(1, value.encode()) if isinstance(value, str) else _number(5, value)
