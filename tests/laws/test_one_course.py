"""Lines above each other are drawings of one course: which of them fits better tells little."""

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
