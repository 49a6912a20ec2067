"""Numbers of a CAN signal that stand for no value: not available, invalid, an error.

The .dbc names them (`VAL_`), or they lie at the end of what the bits can say, beyond the range
that it declares.  Such a range alone decides nothing: many are wrong.
"""

import math
import re
from typing import Any, NamedTuple

import numpy as np

from ..observations import Array
from .checks import Bools

NOT_AVAILABLE = "signal not available"

_END = 7  # J1939 keeps the last of each 128 numbers of a signal for errors and for no value
_WORDS = re.compile(
    r"\bsna\b|^n ?a$|\bnot ?avail|\bunavail|\bno ?(data|signal|value)\b|\bmissing\b|\btime ?out\b"
    r"|\bnot ?(valid|received|present|supported|defined|init|plausible)|\binval|\bunsupported\b"
    r"|\bunknown\b|\bundef|\bim?plausib|\bunplausib|\bout ?of ?range\b|\breserve?d\b|\breserviert"
    r"|\binit(?!iat)"
    r"|\bnicht ?(verf.{1,2}gbar|vorh|def|init|g.{1,2}ltig|plaus|empf)|\bkeine? ?(daten|signal|wert)"
    r"|\bung.{1,2}ltig|\bunbekannt|\bunterspannung|\bunder ?voltage"
    r"|(?<!\bno )(?<!\bnot )(?<!\bkein )(?<!\bkeine )(?<!\bohne )(?<!\bwithout )"
    r"\b(err(ors?)?\b|faults?\b|faulty|fail|malfunction|defe[ck]t|fehler|gest.{1,2}rt|st.{1,2}rung)"
    r"(?! ?(free|less|frei))"
)


class Absent(NamedTuple):
    """Which numbers of a signal, before scale and offset, stand for no value."""

    named: frozenset[float] = frozenset()
    values: frozenset[float] = frozenset()  # that the .dbc names as something else
    least: float = math.inf  # numbers from here on
    most: float = -math.inf  # numbers up to here

    def holds(self, number: float) -> bool:
        """Whether one number does."""
        beyond = number >= self.least or number <= self.most
        return number in self.named or (beyond and number not in self.values)

    def among(self, numbers: Array) -> Bools:
        """Which of several numbers do, shape (n,)."""
        found: Bools = (numbers >= self.least) | (numbers <= self.most)
        if self.values:
            found &= ~np.isin(numbers, list(self.values))
        return found | np.isin(numbers, list(self.named)) if self.named else found


def is_no_value(name: str) -> bool:
    """Whether a name of the .dbc says that there is no value."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return _WORDS.search(" ".join(re.sub(r"[\W_]+", " ", words).lower().split())) is not None


def absent(about: Any, *, counter: bool) -> Absent:
    """The numbers of a signal that stand for no value.

    Args:
        about: cantools' description.
        counter: Whether it counts and wraps: it goes through all its numbers, so only names
            decide.
    """
    if about.is_float:
        return Absent()
    bits = about.length - 1 if about.is_signed else about.length
    named, values = set[float](), set[float]()
    for number, name in (about.choices or {}).items():
        number %= 1 << about.length  # some write those of signed signals as without a sign
        if about.is_signed and number >> bits:
            number -= 1 << about.length
        (named if is_no_value(str(name)) else values).add(float(number))
    found = Absent(frozenset(named), frozenset(values))
    low, high, scale = about.minimum, about.maximum, float(about.scale)
    if counter or low is None or high is None or not low < high or scale == 0.0:
        return found
    ends = sorted((float(end) - float(about.offset)) / scale for end in (low, high))
    last = (1 << bits) - max(1 << bits >> _END, 2)
    least, lowest = max(ends[1] + 0.5, last), -float(1 << bits)
    most = lowest if about.is_signed and lowest < ends[0] - 0.5 else -math.inf
    return found._replace(least=least, most=most)
