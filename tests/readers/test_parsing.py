"""Numbers of many fields at once are those that Python reads one by one."""

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from whichroad.readers.parsing import LONGEST, decimal, hexadecimal

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
FIELDS = st.lists(st.text("0123456789.+-e ", max_size=LONGEST + 2), max_size=20)


def parsed(fields: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """The fields, one behind the other in one buffer."""
    text = np.frombuffer("".join(fields).encode() + b"*", np.uint8)
    width = np.array([len(field) for field in fields], np.int64)
    stop = np.cumsum(width)
    return decimal(text, stop - width, stop)


@given(FIELDS)
def test_decimal_numbers_are_read_as_python_reads_them(fields):
    values, bad = parsed(fields)
    for field, value, wrong in zip(fields, values.tolist(), bad.tolist(), strict=True):
        digits = sum(c.isdigit() for c in field)
        mantissa = int(re.sub(r"\D", "", field) or 0)
        fits = len(field) <= LONGEST and digits <= 19 and mantissa < 2**63
        known = bool(NUMBER.fullmatch(field)) and fits
        assert wrong == (bool(field) and not known)
        if known:
            assert np.isclose(value, float(field), rtol=4e-16, atol=0.0)
        else:
            assert np.isnan(value)


@given(st.lists(st.integers(0, 255), max_size=20))
def test_hexadecimal_numbers_are_read_as_python_reads_them(numbers):
    text = np.frombuffer("".join(f"{n:02X}" for n in numbers).encode(), np.uint8)
    value, bad = hexadecimal(text, 2 * np.arange(len(numbers)))
    assert value.tolist() == numbers
    assert not bad.any()


def test_what_is_no_hexadecimal_digit_or_lies_beyond_the_text_is_bad():
    text = np.frombuffer(b"0GA", np.uint8)
    assert hexadecimal(text, np.array([0, 1, 2]))[1].tolist() == [True, True, True]
