"""What the filter holds of its sensors: what of them is doubted, and what was learnt of them."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..filter.motion import GYRO_PACE
from ..filter.state import CLOCK, WHEELS, B, Belief, K
from ..filter.vetting.motion_sources import ARC, COURSE, SPEED, TURN, is_possible
from ..filter.vetting.windows import BY_WHEELS
from ..geodesy.angles import degrees
from .further_sensors import bias_of

GNSS, DISTANCE, TURNS = "gnss", "distance", "turn"
_NEVER = 1e-12  # variance of a state that was not learnt


class Learnt(NamedTuple):
    """A number that was learnt of a sensor."""

    what: str  # errors, scale, drift or bias
    value: float
    sigma: float | None  # None: not known
    unit: str


class SensorState(NamedTuple):
    """One sensor, or what several measure alike, as the filter holds it."""

    name: str  # gnss, distance, turn, or what a further sensor is called
    doubted: tuple[str, ...] = ()  # what of it is not believed now
    misfits: int | None = None  # readings of a further sensor that fitted no hypothesis
    withheld: int | None = None  # and those that were left out
    learnt: tuple[Learnt, ...] = ()


class SensorTrack(NamedTuple):
    """The states of a drive's sensors from moment to moment."""

    time: list[float]  # s, rising
    states: list[tuple[SensorState, ...]]

    def at(self, time: float) -> tuple[SensorState, ...]:
        """As of the last moment that is not after a time (s); before the first: that one."""
        return self.states[max(bisect_right(self.time, time) - 1, 0)] if self.states else ()


def states_of(
    belief: Belief, names: Sequence[str], gyro: int = BY_WHEELS
) -> tuple[SensorState, ...]:
    """The receiver, what moves the vehicle, and further sensors.

    Args:
        belief: The filter's.
        names: Of the further sensors.
        gyro: What measures the turn (`filter.vetting.windows`), as the last epoch had it.

    Returns:
        States of `gnss`, `distance` and `turn`, then one of each further sensor.
    """
    state = belief.state.view(np.ndarray)  # (1,): records are slow to read
    vetting = state["vetting"]
    refused = vetting["refused"][0].tolist()
    rolls = bool(is_possible(_Fields(vetting)))
    fixes = [
        ("fixes", state["misfits"][0] > 0.0), ("speed", refused[SPEED]), ("course", refused[COURSE])
    ]  # fmt: skip
    further = [
        SensorState(
            name, ("readings",) if one["refused"] else (), int(one["misfits"]),
            int(one["withheld"]), _bias(*bias_of(one)),
        )
        for name, one in zip(names, state["sensors"][0], strict=False)
    ]  # fmt: skip
    return (
        SensorState(GNSS, tuple(n for n, doubt in fixes if doubt), learnt=_errors(state)),
        SensorState(
            DISTANCE, () if rolls and not refused[ARC] else ("distance",),
            learnt=_scale(belief, state),
        ),
        SensorState(
            TURNS, () if rolls and not refused[TURN] else ("turn",),
            learnt=_drift(belief, state, gyro != BY_WHEELS),
        ),
        *further,
    )  # fmt: skip


class _Fields:
    """The first row of a structured array; its fields are attributes, as kernels read them."""

    __slots__ = ("_rows",)

    def __init__(self, rows: Any) -> None:
        self._rows = rows

    def __getattr__(self, name: str) -> Any:
        values = self._rows[name]
        return _Fields(values) if values.dtype.names else values[0]


def _errors(state: Any) -> tuple[Learnt, ...]:
    """How large the receiver's errors are, over what it reports."""
    factor = float(state["gnss_factor"][0])
    if factor <= 0.0:
        return ()
    return (Learnt("errors", math.sqrt(factor), None, "times what is reported"),)


def _bias(value: float, sigma: float, own: float, unit: str) -> tuple[Learnt, ...]:
    """What a further sensor always measures too much."""
    return (Learnt("bias", value, sigma, unit),) if own > 0.0 else ()


def _scale(belief: Belief, state: Any) -> tuple[Learnt, ...]:
    """Metres for each metre of the odometer."""
    if state["mode"][0] != CLOCK:
        mean, variance = _moments(belief, K)
    else:  # the state is the speed now
        mean, variance = (float(one) for one in state["known_rate"][0])
    if variance <= _NEVER:
        return ()
    factor = float(state["vetting"]["wheel_size"]["scale"]["factor"][0])
    return (Learnt("scale", factor * mean, factor * math.sqrt(variance), "m/m"),)


def _drift(belief: Belief, state: Any, by_gyro: bool) -> tuple[Learnt, ...]:
    """What turns are measured too far to the left: by wheels per way, by a gyro in time."""
    if state["mode"][0] != WHEELS:
        return ()
    mean, variance = _moments(belief, B)
    if variance <= _NEVER:
        return ()
    sigma = math.sqrt(variance)
    if by_gyro:
        value, sigma = -degrees(mean * GYRO_PACE), degrees(sigma * GYRO_PACE)
        return (Learnt("bias", value, sigma, "deg/s"),)
    return (Learnt("drift", -degrees(1e3 * mean), degrees(1e3 * sigma), "deg/km"),)


def _moments(belief: Belief, of: int) -> tuple[float, float]:
    """Mean and variance of one state over all hypotheses."""
    hyp = belief.hyp.view(np.ndarray)[: int(belief.state.view(np.ndarray)["count"][0])]
    if not len(hyp):
        return 0.0, 0.0
    weight, mu, cov = hyp["weight"].copy(), hyp["mu"][:, of], hyp["cov"][:, of, of]
    total = float(weight.sum())
    if total <= 0.0:
        return 0.0, 0.0
    mean = float(weight @ mu) / total
    return mean, float(weight @ (cov + (mu - mean) ** 2)) / total
