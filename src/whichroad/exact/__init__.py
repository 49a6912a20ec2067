"""Exact inference in small conditional linear Gaussian networks, as the paper's JLO.

    posterior = infer(Network([...]), {"L": 1.1})
    posterior = slds.infer_slds(model, observations)

The on-line filter approximates what this package computes exactly, over windows that are
short enough.  Nothing here knows roads.
"""

from .gaussian_network import Discrete, Gaussian, Network, NetworkError
from .inference import Posterior, infer
from .posterior import Mixture
from .slds import Sensor, SwitchingModel, infer_window, unroll

__all__ = [
    "Discrete",
    "Gaussian",
    "Mixture",
    "Network",
    "NetworkError",
    "Posterior",
    "Sensor",
    "SwitchingModel",
    "infer",
    "infer_window",
    "unroll",
]
