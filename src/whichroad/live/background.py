"""Processes that work beside the filter: they go last, with one thread and a limit of memory."""

import contextlib
import os
from pathlib import Path

SURROUNDINGS = {  # environment: one thread; allocators reserve memory that counts as used
    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system",
    "MALLOC_ARENA_MAX": "2",
}  # fmt: skip
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


def one_thread() -> None:
    """Let Arrow have no threads of its own."""
    import pyarrow as pa

    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)


def limit_memory(most: int) -> None:
    """Let private memory grow by so many bytes and no more, on Linux; elsewhere nothing limits it.

    Args:
        most: Bytes beyond those that are taken now.
    """
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        data = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_DATA, (data + most, data + most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
