"""Console output of the commands: a line of progress, names and values."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import typer

_UNITS = {"m": "m", "s": "s", "deg": "degrees", "km": "km"}  # behind the names of figures


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


def url_of(host: str, port: int) -> str:
    """The address of a web server as a browser takes it."""
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def print_skipped_roads(left_out: Mapping[str, int]) -> None:
    """What a table of roads was read without, by reason, to the standard error."""
    for reason, count in left_out.items():
        typer.echo(f"skipped of the map: {reason}: {count:,}", err=True)


def print_table(
    title: str, rows: Iterable[tuple[str, Any]], meanings: Mapping[str, str] | None = None
) -> None:
    """Names and values, one a line, and behind them what they mean.

    Args:
        title: The line above.
        rows: The names, which may end in a unit, and the values.
        meanings: By the end of the name; None: none is printed.
    """
    rows = list(rows)
    texts = [_with_unit(str(name), value) for name, value in rows]
    width = max((len(name) for name, _ in texts), default=0)
    typer.echo(title)
    wide = max((len(text) for _, text in texts), default=0)
    for (name, text), (key, _) in zip(texts, rows, strict=True):
        said = (meanings or {}).get(key.removeprefix("outage_"))
        typer.echo(
            f"  {name:<{width}}  {text:<{wide}}  {said}" if said else f"  {name:<{width}}  {text}"
        )


def _with_unit(name: str, value: Any) -> tuple[str, str]:
    """A name in words, and its value with the unit that ends the name."""
    bare, _, last = name.rpartition("_")
    unit = _UNITS.get(last) if bare and type(value) in (int, float) else None
    if unit is None:
        return name.replace("_", " "), _text(value)
    return bare.replace("_", " "), f"{_text(value)} {unit}"


def _text(value: Any) -> str:
    """A value for people: five digits, lists by commas."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(inner)}" for name, inner in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_text(inner) for inner in value)
    if isinstance(value, float):
        return f"{value:,.1f}" if abs(value) >= 1000 else f"{value:.5g}"
    return f"{value:,}" if type(value) is int else str(value)
