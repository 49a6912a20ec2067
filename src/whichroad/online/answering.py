"""Estimates of a belief, and what they need to know of the places about it."""

from typing import Any

from ..filter.state import Belief
from ..filter.summary.estimate import Output
from ..graph.network import bytes_of
from ..places import StanceReader, places_on
from ..roadmap import RoadMap
from .epoch_filter import EpochFilter, living_words, words_of
from .estimates import Estimate

FarFix = tuple[float, float]  # time of the last fix (s), m that it lies away if not believed


def _by(far_fix: FarFix, behind: float) -> FarFix:
    return (far_fix[0] - behind, far_fix[1]) if behind else far_fix


class Answering:
    """Makes the estimates of a localizer.

    Args:
        roads: The map.
        places: Point objects, as `Places` takes them, or None.
        unknown: P(what no hypothesis knows).
    """

    def __init__(self, roads: RoadMap, places: Any, unknown: float) -> None:
        self._roads, self._unknown = roads, unknown
        self.places = places_on(places, roads)
        self._stances = StanceReader()

    def of(self, now: EpochFilter, far_fix: FarFix, behind: float) -> Estimate:
        """The estimate of a filter's last epoch; its clock is ahead of the sensors', s."""
        row, known = now.estimate.tobytes(), now.living()
        return Estimate(
            now.time - behind, row, known, self._roads, _by(far_fix, behind), self._unknown,
            self._about(now.belief),
        )  # fmt: skip

    def of_past(self, belief: Belief, output: Output, far_fix: FarFix, behind: float) -> Estimate:
        """The estimate of a smoothed epoch; the filter's clock is so far ahead, s."""
        state = belief.state[0]
        known = living_words(words_of(belief), int(state.count), int(state.rows))
        time, row = float(state.time), bytes_of(output.rows).tobytes()
        return Estimate(
            time - behind, row, known, self._roads, _by(far_fix, behind), self._unknown,
            self._about(belief),
        )  # fmt: skip

    def _about(self, belief: Belief) -> Any:
        return None if self.places is None else (self.places, self._stances.of(belief))
