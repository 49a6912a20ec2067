"""Drives whose truth is known, on any map or on a town drawn here, in the real formats.

The simulator knows nothing of the filter: its map error is a sum of Fourier modes, its
car follows lanes and cuts corners, its wheels are never what the user believes.
"""

from .drive import START, SimulatedDrive, Truth, simulate_drive
from .route import drivable, random_route
from .settings import GOOD, OUTAGE, PRESETS, URBAN, SimulationSettings

__all__ = [
    "GOOD",
    "OUTAGE",
    "PRESETS",
    "START",
    "URBAN",
    "SimulatedDrive",
    "SimulationSettings",
    "Truth",
    "drivable",
    "random_route",
    "simulate_drive",
]
