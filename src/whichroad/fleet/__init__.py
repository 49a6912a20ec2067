"""Trips by the million: files in, partitioned files out, by processes; and what engines call."""

from ..batch import MAPS_SCHEMAS as MAPS_SCHEMAS
from ..batch import SCHEMAS as SCHEMAS
from ..batch import match_batches as match_batches
from ..roadmap import RoadMaps as RoadMaps
from .run import Summary as Summary
from .run import run_fleet as run_fleet
