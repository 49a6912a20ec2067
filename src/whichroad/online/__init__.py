"""The filter on line: one observation in, one estimate out."""

from .estimates import Estimate as Estimate
from .estimates import Hypothesis as Hypothesis
from .localizer import Localizer as Localizer
from .localizer_state import State as State
