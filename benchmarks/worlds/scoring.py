"""Is what the filter declared true?  Counted over decisions, epochs and drives.

A decision is a node of the true net, with invented streets, at which three streets or more meet.
A declaration is the first epoch behind it, before the next one, at which a road has P >= 0.999.
Roads that were left in the last 30 m do not count as declared: whoever has just passed a node
may well be thought just before it.  A declaration is wrong if the vehicle is not on that road
within 10 m of travel.
"""

from dataclasses import dataclass

import numpy as np

DECLARED = 0.999
SLACK = 10.0  # m of travel
LEFT = 30.0  # m of travel
WARM_UP = 20.0  # s, left out at the start of a drive
MOVING = 0.5  # m/s
INSIDE = -2.0 * np.log(0.05)  # chi-square of two degrees that 95 % stay below
ALERT = 300.0  # s, longest count under a fault, from its beginning
AFTER = 120.0  # s after a fault's end that count as under it


@dataclass(frozen=True, slots=True)
class Said:
    """What the filter said of a drive, and where the vehicle was; (n,) epochs that have a pose."""

    time: np.ndarray  # s
    travel: np.ndarray  # m, true
    speed: np.ndarray  # m/s, true
    true_road: np.ndarray  # -1: the map lacks it
    error: np.ndarray  # (n, 2) m
    cov: np.ndarray  # (n, 3) ee, en, nn; m²
    level: np.ndarray  # m, protection level
    top: np.ndarray  # most probable road, -1: none
    p_top: np.ndarray
    lost: np.ndarray  # whether the status says so


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision and what was declared behind it."""

    time: float  # s, when it was passed
    until: float  # s, when the next one was
    declared: bool
    wrong: bool
    when: float  # s of the declaration, or `until`
    epoch: int  # of the declaration, -1: none
    road: int  # declared, -1: none
    true_road: int = -1  # then; -1: the map lacks it
    error: float = 0.0  # m, of the position then


@dataclass(frozen=True, slots=True)
class PoseSums:
    """Sums over some epochs of a drive."""

    epochs: int = 0
    exceeded: int = 0
    nees: float = 0.0
    inside: int = 0
    square: float = 0.0
    right: int = 0
    roads: int = 0  # epochs at which the map has the true road
    level: float = np.nan  # median, m


def top_roads(
    epoch: np.ndarray, edge: np.ndarray, p: np.ndarray, road_of_edge: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """The most probable road of each epoch: sums over the edges of a road.

    Args:
        epoch: (m,) epoch of each alternative.
        edge: (m,) its edge.
        p: (m,) its probability.
        road_of_edge: (E,).
        n: How many epochs there are.

    Returns:
        (n,) road, -1 where there is none, and (n,) its probability.
    """
    road, best = np.full(n, -1), np.zeros(n)
    if not len(edge):
        return road, best
    roads = int(road_of_edge.max()) + 1
    key, place = np.unique(epoch * roads + road_of_edge[edge], return_inverse=True)
    sums = np.bincount(place, weights=p)
    order = np.argsort(sums, kind="stable")  # the largest is written last
    at, named = key[order] // roads, key[order] % roads
    road[at], best[at] = named, sums[order]
    return road, best


def driven(said: Said, epoch: int, back: float, on: float) -> set[int]:
    """Roads on which the vehicle was from `back` m before an epoch to `on` m behind it."""
    s = said.travel[epoch]
    low = int(np.searchsorted(said.travel, s - back, "left"))
    high = int(np.searchsorted(said.travel, s + on, "right"))
    return set(said.true_road[low:high].tolist()) - {-1}


def decide(said: Said, passed: np.ndarray) -> list[Decision]:
    """What was declared behind each decision.

    Args:
        said: The drive.
        passed: (d,) times at which decisions were passed, ascending.

    Returns:
        One for each decision after the warm-up.
    """
    sure = np.flatnonzero(said.p_top >= DECLARED)
    ends = np.append(passed[1:], said.time[-1] + 1e-6)[: len(passed)]
    out = []
    for begin, end in zip(passed, ends, strict=True):
        if begin < said.time[0] + WARM_UP:
            continue
        first = int(np.searchsorted(said.time[sure], begin, "left"))
        last = int(np.searchsorted(said.time[sure], end, "left"))
        found = Decision(float(begin), float(end), False, False, float(end), -1, -1)
        for k in sure[first:last]:
            road = int(said.top[k])
            just_left = driven(said, k, LEFT, 0.0) - {int(said.true_road[k])}
            if road in just_left:
                continue
            wrong = road not in driven(said, k, SLACK, SLACK)
            found = Decision(
                float(begin), float(end), True, wrong, float(said.time[k]), int(k), road,
                int(said.true_road[k]), float(np.hypot(*said.error[k])),
            )  # fmt: skip
            break
        out.append(found)
    return out


def right_road(said: Said) -> np.ndarray:
    """Whether the most probable road is driven within 10 m of travel, (n,)."""
    right = np.zeros(len(said.time), bool)
    for shift in np.linspace(-SLACK, SLACK, 9):
        at = np.searchsorted(said.travel, said.travel + shift).clip(0, len(said.travel) - 1)
        right |= said.top == said.true_road[at]
    return right & (said.top >= 0)


def nees(said: Said) -> np.ndarray:
    """Squared error of the position over its covariance, (n,)."""
    (e, n), (ee, en, nn) = said.error.T, said.cov.T
    return np.asarray((nn * e * e - 2 * en * e * n + ee * n * n) / (ee * nn - en * en))


def counted(said: Said) -> np.ndarray:
    """Epochs that count for the pose: moving, after the warm-up, (n,)."""
    return (said.speed > MOVING) & (said.time >= said.time[0] + WARM_UP)


def pose_sums(said: Said, which: np.ndarray) -> PoseSums:
    """The sums over some epochs, (n,) bool."""
    at = np.flatnonzero(which)
    if not len(at):
        return PoseSums()
    size = np.hypot(*said.error[at].T)
    chi = nees(said)[at]
    mapped = said.true_road[at] >= 0
    return PoseSums(
        len(at), int((size > said.level[at]).sum()), float(chi.sum()), int((chi < INSIDE).sum()),
        float((size**2).sum()), int((right_road(said)[at] & mapped).sum()), int(mapped.sum()),
        float(np.median(said.level[at])),
    )  # fmt: skip


def under(time: np.ndarray, begin: float, end: float) -> np.ndarray:
    """Epochs that count as under a fault, (n,): until 120 s after it, 300 s at most."""
    return (time >= begin) & (time <= min(end + AFTER, begin + ALERT))


def time_to_alert(said: Said) -> float:
    """Longest time from an error beyond the level until it holds again or `lost` is said, s."""
    beyond = (np.hypot(*said.error.T) > said.level) & (said.time >= said.time[0] + WARM_UP)
    longest, begun = 0.0, -1.0
    for k in np.flatnonzero(beyond | np.roll(beyond, 1)):
        if beyond[k] and not said.lost[k]:
            begun = said.time[k] if begun < 0.0 else begun
            longest = max(longest, float(said.time[k] - begun))
        else:
            if begun >= 0.0:
                longest = max(longest, float(said.time[k] - begun))
            begun = -1.0
    return longest
