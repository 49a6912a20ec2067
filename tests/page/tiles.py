"""A slow and plain reader of vector tiles, after the specification, for tests."""

from typing import Any


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7


def _fields(data: bytes) -> list[tuple[int, Any]]:
    at, found = 0, []
    while at < len(data):
        key, at = _varint(data, at)
        if key & 7 == 0:
            value, at = _varint(data, at)
            found.append((key >> 3, value))
        else:
            assert key & 7 == 2, "only numbers and bytes are in a tile"
            size, at = _varint(data, at)
            found.append((key >> 3, data[at : at + size]))
            at += size
    return found


def _packed(data: bytes) -> list[int]:
    at, found = 0, []
    while at < len(data):
        value, at = _varint(data, at)
        found.append(value)
    return found


def _lines(commands: list[int]) -> list[list[tuple[int, int]]]:
    lines: list[list[tuple[int, int]]] = []
    x = y = at = 0
    while at < len(commands):
        kind, count = commands[at] & 7, commands[at] >> 3
        at += 1
        for _ in range(count):
            dx, dy = commands[at], commands[at + 1]
            x += (dx >> 1) ^ -(dx & 1)
            y += (dy >> 1) ^ -(dy & 1)
            at += 2
            if kind == 1:
                lines.append([])
            lines[-1].append((x, y))
    return lines


def decode(tile: bytes) -> dict[str, list[tuple[dict[str, Any], list[list[tuple[int, int]]]]]]:
    """Layers by name: properties and lines of each feature."""
    layers = {}
    for _, layer in _fields(tile):
        parts = _fields(layer)
        (name,) = (v.decode() for k, v in parts if k == 1)
        keys = [v.decode() for k, v in parts if k == 3]
        values = [_value(v) for k, v in parts if k == 4]
        assert (15, 2) in parts, "version 2 is written"
        layers[name] = [_feature(v, keys, values) for k, v in parts if k == 2]
    return layers


def _value(data: bytes) -> Any:
    ((kind, value),) = _fields(data)
    return value.decode() if kind == 1 else value


def _feature(data: bytes, keys: list[str], values: list[Any]) -> tuple[dict[str, Any], Any]:
    fields = dict(_fields(data))
    assert fields[3] == 2, "a line"
    tags = _packed(fields[2])
    properties = {keys[k]: values[v] for k, v in zip(tags[::2], tags[1::2], strict=True)}
    return properties, _lines(_packed(fields[4]))
