"""The build of kernels at first use, reported on stderr: a bar on a terminal, else lines."""

import sys
import time
from pathlib import Path

from . import build

_ABOUT = "whichroad: compiling the kernels for this machine, once; about 20 seconds"
_EVERY = 0.25  # share between two lines


def build_own() -> Path:
    """The library for this machine, built with its progress reported where it takes time.

    Raises:
        BuildError: It cannot be built here.
    """
    if build.kept() is not None or build.why_not() is not None:
        return build.own_library()  # at once, or an error at once
    if sys.stderr.isatty():
        return _with_bar()
    _print_line(_ABOUT)
    begin, reported = time.monotonic(), 0.0

    def report(share: float) -> None:
        nonlocal reported
        if share >= reported + _EVERY:
            reported = share
            seconds = time.monotonic() - begin
            _print_line(f"whichroad: {share:.0%}, {seconds:.0f} s")

    return build.own_library(report)


def _print_line(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _with_bar() -> Path:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(_ABOUT, total=1.0)
        return build.own_library(lambda share: bar.update(task, completed=share))
