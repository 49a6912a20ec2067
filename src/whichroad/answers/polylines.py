"""Encoded polylines: differences of rounded coordinates, five bits a letter."""

from collections.abc import Iterable

import numpy as np

from ..observations import Array


def encoded(lat: Array, lon: Array, digits: int = 5) -> str:
    """A line as text.

    Args:
        lat: (n,) degrees.
        lon: (n,) degrees.
        digits: Decimals that are kept, 5 or 6.
    """
    places = np.rint(np.column_stack([lat, lon]) * 10.0**digits).astype(np.int64)
    steps = np.diff(places, axis=0, prepend=np.zeros((1, 2), np.int64)).ravel()
    letters: list[str] = []
    for number in np.where(steps < 0, ~(steps << 1), steps << 1).tolist():
        while number >= 0x20:
            letters.append(chr((0x20 | (number & 0x1F)) + 63))
            number >>= 5
        letters.append(chr(number + 63))
    return "".join(letters)


def decoded(text: str, digits: int = 5) -> tuple[Array, Array]:
    """Latitudes and longitudes of a line, degrees.

    Args:
        text: The line.
        digits: Decimals that it has, 5 or 6.

    Raises:
        ValueError: A letter is none of the code, or the text is cut short.
    """
    numbers: list[int] = []
    value = shift = 0
    for letter in text:
        bits = ord(letter) - 63
        if not 0 <= bits < 64 or shift > 40:
            raise ValueError("no encoded polyline")
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits < 0x20:
            numbers.append(~(value >> 1) if value & 1 else value >> 1)
            value = shift = 0
    if shift or len(numbers) % 2:
        raise ValueError("an encoded polyline that is cut short")
    places = np.cumsum(np.array(numbers, np.int64).reshape(-1, 2), axis=0) / 10.0**digits
    return places[:, 0], places[:, 1]


def pairs(lat: Array, lon: Array) -> list[list[float]]:
    """Positions of GeoJSON, [lon, lat], of six decimals."""
    return np.round(np.column_stack([lon, lat]), 6).tolist()  # type: ignore[no-any-return]


def rounded(values: Iterable[float], digits: int) -> list[float]:
    """Numbers of so many decimals."""
    return [round(value, digits) for value in values]
