"""Many trips in one process: Arrow in, Arrow out, threads over trips."""

from .batches import MAPS_SCHEMAS as MAPS_SCHEMAS
from .batches import SCHEMAS as SCHEMAS
from .batches import Give as Give
from .batches import match_batches as match_batches
from .batches import match_many as match_many
from .batches import match_stream as match_stream
from .trips import Tables as Tables
from .trips import joined as joined
