"""What is known later makes a place surer: smoothed levels beside the filter's."""

from functools import cache

import numpy as np
import pytest

import whichroad
from whichroad.simulate import MapBuilder

from .town import fixes

X = np.arange(0.0, 1500.0, 12.0)
LINE = np.column_stack([X, 25.0 * np.sin(X / 28.0) + 8.0 * np.sin(X / 9.0 + 1.0)])


@cache
def winding() -> whichroad.RoadMap:
    """A winding road with a side street every 36 m."""
    builder = MapBuilder()
    for k, (x, y) in enumerate(LINE):
        builder.node(f"n{k}", x, y)
    builder.way([f"n{k}" for k in range(len(X))], "residential", name="Winding")
    for k in range(3, len(X) - 1, 3):
        builder.node(f"s{k}", X[k] + 10.0, LINE[k, 1] + 70.0)
        builder.way([f"n{k}", f"s{k}"], "residential", name=f"Side {k}")
    return builder.compiled()


@pytest.mark.parametrize("every", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("sigma", [5.0, 10.0])
@pytest.mark.parametrize("lag", [20.0, "full"])
def test_a_smoothed_place_is_no_less_sure_than_the_filter_s(every: float, sigma: float, lag):
    for seed in range(2):
        table = fixes(LINE, speed=8.0, every=every, sigma=sigma, seed=seed, white=True)
        before = whichroad.match(table, winding()).points
        after = whichroad.match(table, winding(), lag=lag).points
        assert (after.protection_level_m <= 1.1 * before.protection_level_m + 2.0).all()
        for name in ("cov_ee_m2", "cov_nn_m2"):
            assert (after[name] <= 4.0 * before[name]).all()
