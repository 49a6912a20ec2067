"""Console output of the commands: a line of progress, names and values."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import typer


@contextmanager
def progress_line() -> Iterator[Callable[[str, int, int], None]]:
    """A progress bar on a terminal; nothing elsewhere.

    Yields:
        A function of (task, done, total); 0 of 0: the length is unknown.
    """
    if not sys.stderr.isatty():
        yield lambda what, done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def report(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total or None)

        yield report


def print_table(title: str, rows: Iterable[tuple[str, Any]]) -> None:
    """Names and values, one a line."""
    texts = [(str(name).replace("_", " "), _text(value)) for name, value in rows]
    width = max((len(name) for name, _ in texts), default=0)
    typer.echo(title)
    for name, text in texts:
        typer.echo(f"  {name:<{width}}  {text}")


def _text(value: Any) -> str:
    """A value for people: five digits, lists by commas."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(inner)}" for name, inner in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_text(inner) for inner in value)
    if isinstance(value, float):
        return f"{value:,.1f}" if abs(value) >= 1000 else f"{value:.5g}"
    return f"{value:,}" if type(value) is int else str(value)
