"""Many trips in one process: Arrow in, Arrow out, threads over trips."""

from .trips import Tables as Tables
from .trips import joined as joined
from .trips import match_many as match_many
from .trips import match_stream as match_stream
