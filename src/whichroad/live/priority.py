"""The priority of a process that works beside the filter."""

import contextlib
import os

_LOWEST = 19  # niceness


def give_way(*, always: bool = False) -> None:
    """Let every other process go first, as far as the system knows priorities.

    Args:
        always: Run only while a processor is idle, where the system can do that.  The others do
            not notice then; beside processors that are always busy it hardly comes forward.
    """
    if hasattr(os, "sched_setscheduler"):
        policy = os.SCHED_IDLE if always else os.SCHED_BATCH
        with contextlib.suppress(OSError):  # also of a service that was started by chrt
            os.sched_setscheduler(0, policy, os.sched_param(0))
    if hasattr(os, "nice"):
        os.nice(_LOWEST)
