"""What an on-line filter says of moments before the last one, by all that was observed since."""

from threading import RLock

from ..errors import SettingError
from ..filter.state import Belief
from ..filter.summary.estimate import Output
from ..lookback.smoothing import Window
from .answering import Answering
from .epoch_filter import EpochFilter
from .estimates import Estimate
from .set_back import Clocks


class LooksBack:
    """The part of a `Localizer` that smooths with a fixed lag."""

    _lock: RLock
    _past: Window | None
    _filter: EpochFilter
    _answers: Answering
    _far_fix: tuple[float, float]
    _clocks: Clocks

    def lagged(self) -> Estimate | None:
        """The estimate of a moment the lag ago, by all that was observed since.

        Of the last epoch before that moment at which something was observed; None before
        there is one.

        Raises:
            SettingError: The localizer was made without a lag.
        """
        with self._lock:
            found = self._smoothed(True)
            if found is None:
                return None
            behind = self._clocks.behind
            return self._answers.of_past(found[0], found[1], self._far_fix, behind)

    @property
    def decided_until(self) -> float | None:
        """The last time at which one road has 0.999 of the probability, by all that is known.

        What was driven before it is decided as well as it ever will be; None: nothing is.

        Raises:
            SettingError: The localizer was made without a lag.
        """
        with self._lock:
            found = self._smoothed(False)
            until = None if found is None else found[2]
            return None if until is None else until - self._clocks.behind

    def _smoothed(self, back: bool) -> tuple[Belief, Output, float | None] | None:
        if self._past is None:
            raise SettingError(
                "lag is None; seconds were expected for smoothing, as in Localizer(roads, lag=10)"
            )
        return self._past.smoothed_at(self._filter.ctx, self._filter.path, self._filter.time, back)
