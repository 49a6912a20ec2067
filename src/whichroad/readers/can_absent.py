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
_FAULT = (
    r"err(?:ors?)?|faults?|faulty|fail\w*|malfunction\w*|defe[ck]t\w*|gest.{1,2}rt\w*"
    r"|fehler(?!frei|los)\w*|st.{1,2}rung(?!sfrei)\w*|time ?out|inval\w*|under ?voltage"
    r"|unterspannung"
)
_BAD = (
    rf"(?:{_FAULT}|sna|unavail\w*|missing|undef\w*|im?plausib\w*|unplausib\w*|out ?of ?range"
    r"|unsupported|unknown|reserve?d|reserviert\w*|ung.{1,2}ltig\w*|unbekannt\w*|uninit\w*)"
)
# Taken out of a name before words are looked for: they deny a fault, or say that all is well.
_DENIED = re.compile(
    rf"\b(?:no|not|keine?|nicht|ohne|without) {_BAD}\b"
    rf"|\b(?:{_FAULT}) (?:free|less|frei|none|inactive|inaktiv|false|falsch|(?:no|nein|off|aus)$"
    r"|not (?:present|active|detected|set)|nicht (?:vorh\w*|aktiv|erkannt|gesetzt))\b"
    r"|(?<!not )\binit\w* (?:ok|finished|done|completed?|fertig|beendet|abgeschlossen)\b"
)
_WORDS = re.compile(
    rf"^n ?a$|\b{_BAD}\b|\bno ?(data|signal|value)\b|\binit(?!iat|iali[sz]ed\b|ialisiert\b)"
    r"|\bnot ?(avail|valid|received|present|supported|defined|init|plausible)"
    r"|\bnicht ?(verf.{1,2}gbar|vorh|def|init|g.{1,2}ltig|plaus|empf)|\bkeine? ?(daten|signal|wert)"
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
    plain = " ".join(re.sub(r"[\W_]+", " ", words).lower().split())
    return _WORDS.search(_DENIED.sub(" ", plain)) is not None


def absent(about: Any, *, counter: bool, used: float | None = None) -> Absent:
    """The numbers of a signal that stand for no value.

    Args:
        about: cantools' description.
        counter: Whether it counts and wraps: it goes through all its numbers, so only names
            decide.
        used: A value of it that the vehicle's settings tell, as `reverse_value`: whatever its
            name says, it is one.
    """
    if about.is_float:
        return Absent()
    bits = about.length - 1 if about.is_signed else about.length
    scale = float(about.scale)
    named, values = set[float](), set[float]()
    for number, name in (about.choices or {}).items():
        number %= 1 << about.length  # some write those of signed signals as without a sign
        if about.is_signed and number >> bits:
            number -= 1 << about.length
        is_value = number * scale + float(about.offset) == used or not is_no_value(str(name))
        (values if is_value else named).add(float(number))
    found = Absent(frozenset(named), frozenset(values))
    low, high = about.minimum, about.maximum
    if counter or low is None or high is None or not low < high or scale == 0.0:
        return found
    ends = sorted((float(end) - float(about.offset)) / scale for end in (low, high))
    last = (1 << bits) - max(1 << bits >> _END, 2)
    least, lowest = max(ends[1] + 0.5, last), -float(1 << bits)
    most = lowest if about.is_signed and lowest < ends[0] - 0.5 else -math.inf
    return found._replace(least=least, most=most)
