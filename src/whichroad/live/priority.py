"""The priority of a process that works beside the filter."""

import contextlib
import os

_LOWEST = 19  # niceness


def give_way() -> None:
    """Let every other process go first, as far as the system knows priorities."""
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):  # also of a service that was started by chrt
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    if hasattr(os, "nice"):
        os.nice(_LOWEST)
