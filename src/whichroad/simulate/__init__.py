"""Drives whose truth is known, on any map or on a town drawn here, in the real formats.

The simulator knows nothing of the filter: its map error is a sum of Fourier modes, its
car follows lanes and cuts corners, its wheels are never what the user believes.
"""

from .demo_drive import Scenes, demo_drive, demo_route, demo_scenes, write_demo
from .drive_files import FILES, truth_table, vehicle_text, write_drive
from .map_builder import MapBuilder
from .route_choice import drivable, random_route, shortest_route
from .sensor_models import Jump, Pull
from .simulated_drive import START, SimulatedDrive, Truth, simulate_drive
from .simulation_settings import GOOD, OUTAGE, PRESETS, URBAN, SimulationSettings
from .town import draw_town

__all__ = [
    "FILES",
    "GOOD",
    "OUTAGE",
    "PRESETS",
    "START",
    "URBAN",
    "Jump",
    "MapBuilder",
    "Pull",
    "Scenes",
    "SimulatedDrive",
    "SimulationSettings",
    "Truth",
    "demo_drive",
    "demo_route",
    "demo_scenes",
    "draw_town",
    "drivable",
    "random_route",
    "shortest_route",
    "simulate_drive",
    "truth_table",
    "vehicle_text",
    "write_demo",
    "write_drive",
]
