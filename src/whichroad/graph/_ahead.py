"""Records that are asked for before they are read.

Compiled, this is an instruction that does not wait (`native.compiler.rows`); as Python, nothing.
"""

from .._compile import Record, lowered_by

lowered_by("whichroad.native.ahead", __name__)


def prefetch(record: Record) -> None:
    """Bring a record near to the processor, which will read it soon."""
