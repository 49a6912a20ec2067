"""docs/honesty.md."""

from pathlib import Path

from .figures import Summary


def write_report(path: Path, summaries: list[Summary], seeds: range) -> None:
    """Write the page and its plots."""
    raise NotImplementedError
