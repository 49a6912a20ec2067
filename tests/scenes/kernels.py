"""Calling a kernel by what a test is about; the rest is the usual."""

import inspect
from typing import Any

import numpy as np

from whichroad.core.belief import N, new_route
from whichroad.core.switching import new_work
from whichroad.settings import Settings

USUAL: dict[str, Any] = {
    **Settings().parameters()._asdict(),
    "scale": 1.0,
    "side": 1.0,
    "lever": np.zeros(2),
    "row": np.zeros(N),
    "cut": False,
    "limit": 0.05,
    "most": 2,
    "gate": 9.0,
    "white": 0.5,
    "white_ratio": 0.5,
    "jumps": False,
    "total": 1.0,
    "slow": 1.0,
    "passed": 0.0,
    "refuted": 0.0,
    "least": 1.0 / (1.0 + Settings().gnss_white_ratio ** 2),
    "node_variance": 0.0,
    "heading_sigma": Settings().edge_heading_sigma,
    "leave": Settings().off_road_leave,
    "back": Settings().off_road_return,
    "off_road": Settings().off_road_start,
}


def call(kernel: Any, **given: Any) -> Any:
    """Call a kernel by the names of its arguments, those not given being the usual ones."""
    known = {**USUAL, "route": new_route(1 << 12), "work": new_work(), **given}
    names = inspect.signature(kernel).parameters
    assert given.keys() <= names.keys(), given.keys() - names.keys()
    with np.errstate(all="ignore"):  # divisions as in compiled code
        return kernel(*(known[name] for name in names))
