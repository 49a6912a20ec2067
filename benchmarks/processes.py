"""The drives of a benchmark over some processes."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

from . import Options

T = TypeVar("T")


def spread(
    work: Callable[[int], T],
    seeds: range,
    options: Options,
    prepare: Callable[..., None] | None = None,
    arguments: Sequence[Any] = (),
) -> Iterator[T]:
    """What `work` makes of each seed, in their order, in as many processes as `--processes` says.

    Args:
        work: One seed to its result.
        seeds: All seeds.
        options: Of the command line.
        prepare: Run once in each process.
        arguments: Of `prepare`.
    """
    processes = options.more.get("processes", 1)
    if processes == 1:
        if prepare is not None:
            prepare(*arguments)
        yield from map(work, seeds)
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), prepare, tuple(arguments)) as pool:
        yield from pool.map(work, seeds)
