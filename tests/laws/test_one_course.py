"""Lines above each other are drawings of one course: which of them fits better tells little."""

from itertools import pairwise

import numpy as np
import pytest

from laws.drives import said, sensed
from scenes import drive_along, gnss, network
from whichroad.filter.state import CLOCK, WHEELS

FORK, END = 600.0, 1600.0  # m
BY_HAND = 0.7  # m, sigma of points every 50 m across


def lines(gap: float, by_hand: float, seed: int) -> list[list[list[float]]]:
    """A road that splits into two that run beside each other, each line with its own errors."""
    rng = np.random.default_rng(seed)
    x = np.arange(FORK + 50.0, END + 1.0, 50.0)
    branches = []
    for side in (-0.5, 0.5):
        y = side * gap + by_hand * rng.standard_normal(len(x))
        branches.append([[FORK, 0.0], *np.column_stack([x, y]).tolist()])
    return [[[0.0, 0.0], [FORK, 0.0]], *branches]


def p_first(gap: float, by_hand: float, seed: int, mode: int) -> np.ndarray:
    """P of the first branch at the end of a drive along it, of both branches together."""
    truth = drive_along([[200.0, -1.75], [FORK, -1.75], [FORK + 50.0, -0.5 * gap - 1.75],
                         [END - 100.0, -0.5 * gap - 1.75]])  # fmt: skip
    fix = gnss(truth, sigma=1.5, seed=seed)
    epochs = sensed(truth, fix, np.arange(0, len(truth.time), 10), mode)
    p = said(network(lines(gap, by_hand, seed)), epochs, [[2, 3], [4, 5]], mode=mode).p[-1]
    return p[0] / p.sum()


def test_lines_drawn_by_hand_above_each_other_are_seldom_told_apart():
    away = np.array([abs(p_first(0.0, BY_HAND, seed, WHEELS) - 0.5) for seed in range(20)])
    assert np.median(away) < 0.2
    assert np.sum(away > 0.45) <= 2


@pytest.mark.parametrize("mode", [WHEELS, CLOCK])
def test_roads_that_lie_apart_are_told_apart(mode: int):
    assert min(p_first(10.0, BY_HAND, seed, mode) for seed in range(10)) > 0.9


def p_behind_a_fork(degrees: float, metres: float, cuts: tuple[float, ...] = ()) -> float:
    """P of the branch driven by wheels, so many metres behind a fork; cut where it runs on."""
    side = np.radians(degrees)
    ahead = [[FORK + s * np.cos(side), -s * np.sin(side)] for s in (0.0, *cuts, 400.0)]
    roads = network(
        [[[0.0, 0.0], [FORK, 0.0]], [[FORK, 0.0], [FORK + 400.0, 0.0]], *map(list, pairwise(ahead))]
    )
    truth = drive_along([[200.0, -1.75], [FORK, -1.75], [ahead[-1][0], ahead[-1][1] - 1.75]])
    at = np.arange(0, len(truth.time), 10)
    fix = gnss(truth, sigma=1.5, seed=1)
    groups = [[2, 3], list(range(4, 4 + 2 * (1 + len(cuts))))]
    answer = said(roads, sensed(truth, fix, at[truth.x[at] < FORK - 50.0], WHEELS), groups)
    k = np.searchsorted(truth.s, FORK - 200.0 + metres)
    return float(answer.p[k, 1] / answer.p[k].sum())


def test_branches_of_a_fork_are_no_drawings_of_one_course():
    """By the wheels' turn alone, 40 m behind a fork of 4 degrees, however its exit is cut."""
    p = [p_behind_a_fork(4.0, 40.0, cuts) for cuts in ((), (12.0,), (10.0, 30.0))]
    assert min(p) > 0.9
    assert np.ptp(p) < 0.002
