"""Directives that write the reference out of the code itself, so that it cannot drift.

`{commands}` lists every command with its arguments and options, `{settings}` every number of
the model with unit, default and bounds.
"""

import re
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from typer.main import get_command
from typer.testing import CliRunner

from whichroad.cli import app
from whichroad.settings import Settings


def commands() -> str:
    """All commands as Markdown: a heading, and what `--help` prints, 100 columns wide."""
    return "\n".join(line for words in _names([], get_command(app)) for line in _command(words))


def _names(words: list[str], command: Any) -> Iterator[list[str]]:
    """The words of each command, groups resolved."""
    inner = getattr(command, "commands", None)
    if inner is None:
        yield words
        return
    for name in inner:
        yield from _names([*words, name], inner[name])


def _command(words: list[str]) -> list[str]:
    done = CliRunner(env={"COLUMNS": "100", "TERMINAL_WIDTH": "100"}).invoke(
        app, [*words, "--help"], prog_name="whichroad", max_content_width=100
    )
    if done.exit_code != 0:
        raise RuntimeError(f"whichroad {' '.join(words)} --help: {done.output}")
    return [f"## {' '.join(words)}", "", "```text", done.output.strip(), "```", ""]


def settings() -> str:
    """All numbers of the model as a Markdown table."""
    rows = ["| setting | default | unit | bounds | what |", "|---|---|---|---|---|"]
    for field in fields(Settings):
        m = field.metadata
        rows.append(
            f"| `{field.name}` | {field.default:g} | {m['unit']} | {m['low']:g} to {m['high']:g} "
            f"| {m['why']} |"
        )
    return "\n".join(rows)


_STAR = re.compile(r"(?<![\\\w*`])\*(?=[\w(])")


def _plain_stars(
    site: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]
) -> None:
    """Docstrings write shapes as (*modes, D): that star begins no emphasis."""
    lines[:] = [_STAR.sub(r"\\*", line) for line in lines]


class _Generated(SphinxDirective):
    """Markdown that a function writes, parsed where the directive stands."""

    write: Any

    def run(self) -> list[nodes.Node]:
        return self.parse_text_to_nodes(type(self).write(), allow_section_headings=True)


class _Commands(_Generated):
    write = staticmethod(commands)


class _Settings(_Generated):
    write = staticmethod(settings)


def setup(site: Sphinx) -> dict[str, bool]:
    """Add the directives to a site."""
    site.add_directive("commands", _Commands)
    site.add_directive("settings", _Settings)
    site.connect("autodoc-process-docstring", _plain_stars)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
