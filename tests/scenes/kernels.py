"""What kernels take beside a belief: the usual parameters, those that a test is about changed."""

from typing import Any

from whichroad.filter.state import WHEELS, Context, new_work
from whichroad.graph.network import Roads
from whichroad.settings import Settings, Vehicle, parameters


def context(roads: Roads, mode: int = WHEELS, **given: Any) -> Context:
    """The constants of a drive.

    Args:
        roads: The network.
        mode: What moves the vehicle.
        given: Fields of `filter.state.PARAMETERS` that are not the usual ones.
    """
    par = parameters(Settings(), Vehicle(), mode)
    for name, value in given.items():
        par[name] = value
    return Context(par, roads, new_work())
