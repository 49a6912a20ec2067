"""Parsing of numbers in a buffer of text, all fields at once.

Python needs a microsecond for each field of a log.  Here one pass over the columns of
digits reads all fields.
"""

import numpy as np
from numpy.typing import NDArray

from .checks import Bools, Ints

Bytes = NDArray[np.uint8]

LONGEST = 24  # characters; 19 digits fit 64 bits
_DIGITS = 19

HEX = np.full(256, -1, np.int16)  # value of a hexadecimal digit, -1: it is none
for _value, _digit in enumerate("0123456789abcdef"):
    HEX[ord(_digit)] = HEX[ord(_digit.upper())] = _value


def decimal(text: Bytes, start: Ints, stop: Ints) -> tuple[NDArray[np.float64], Bools]:
    """Read decimal numbers (`-12.5`, no exponent) from `text[start:stop]`.

    Args:
        text: The buffer.
        start: First character of each field, shape (n,).
        stop: One past its last, shape (n,).

    Returns:
        The numbers, NaN where the field is empty or bad, and whether a field is bad.
    """
    width = stop - start
    columns = np.arange(min(int(width.max(initial=0)), LONGEST))[:, None]
    inside = columns < width
    char = text[np.minimum(start + columns, max(len(text) - 1, 0))]  # (characters, n)
    digit = char - np.uint8(48)  # unsigned: any other character gives more than 9
    is_digit = inside & (digit <= 9)
    is_point = inside & (char == ord("."))
    negative = np.zeros(len(start), np.bool_)
    signs = np.zeros(len(start), np.bool_)
    if len(columns):
        negative = inside[0] & (char[0] == ord("-"))
        signs = negative | (inside[0] & (char[0] == ord("+")))
    mantissa = np.zeros(len(start), np.int64)
    for each, value in zip(is_digit, digit, strict=True):
        mantissa = np.where(each, mantissa * 10 + value, mantissa)
    digits, points = is_digit.sum(axis=0), is_point.sum(axis=0)
    decimals = np.where(points, width - 1 - np.argmax(is_point, axis=0), 0) if len(columns) else 0
    bad = (width < 0) | (points > 1) | (digits + points + signs < width)
    bad |= (width > 0) & ((digits == 0) | (digits > _DIGITS) | (mantissa < 0))
    number = mantissa / 10.0 ** np.clip(decimals, 0, _DIGITS)
    number = np.where(negative, -number, number)
    return np.where(bad | (width <= 0), np.nan, number), bad


def hexadecimal(text: Bytes, start: Ints) -> tuple[Ints, Bools]:
    """Read hexadecimal numbers of two digits at `start`; also whether one is bad."""
    value = np.zeros(len(start), np.int64)
    bad = np.zeros(len(start), np.bool_)
    for k in range(2):
        at = start + k
        digit = HEX[text[np.minimum(at, len(text) - 1)]]
        bad |= (digit < 0) | (at >= len(text))
        value = value * 16 + np.maximum(digit, 0)
    return value, bad
