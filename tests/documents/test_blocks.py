"""Every code block of README and docs runs, in order, in a folder with the demo's files."""

import contextlib
import io
import re
from collections.abc import Callable
from pathlib import Path

import pytest

import whichroad

from .pages import PAGES, ROOT, Block, blocks, title

RUN = {"python", "sh"}
SHOWN = {"text", "", "csv", "toml", "json", "c"}  # read with care below, or what a command prints


def code(path: Path) -> list[Block]:
    return [b for b in blocks(path) if not b.kind.startswith("{")]


WITH_CODE = [p for p in PAGES if any(b.kind in RUN for b in code(p))]


def commands(text: str) -> list[str]:
    """The commands of a shell block; a backslash at the end of a line continues it."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


@pytest.mark.parametrize("path", WITH_CODE, ids=title)
def test_the_code_of_a_page_runs(
    path: Path, place: Path, shell: Callable[[str], str], process: Callable[[str], str]
):
    """The commands of the README as processes, as its readers run them."""
    run = process if path.name == "README.md" else shell
    names = {"__name__": "__main__"}
    for block in code(path):
        if block.mark == "file":
            (place / block.text).write_text(block.code, encoding="utf-8")
        elif block.mark or block.kind not in RUN:
            continue
        elif block.kind == "python":
            where = f"{title(path)}, line {block.line}"
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile("\n" * (block.line - 1) + block.code, where, "exec"), names)
        else:
            for command in commands(block.code):
                run(command)


@pytest.mark.parametrize("path", PAGES, ids=title)
def test_every_block_runs_or_says_why_not(path: Path):
    for block in code(path):
        assert block.kind in RUN | SHOWN, f"line {block.line}: {block.kind}"
        if block.mark == "not run":
            assert len(block.text.split()) >= 3, f"line {block.line}: no reason"
        if block.kind in ("", "text"):  # what is printed, or a formula: no command hides there
            assert not re.search(r"^\$? ?(whichroad|python|pip) ", block.code, re.M), block.line


@pytest.mark.parametrize("path", PAGES, ids=title)
def test_no_command_is_written_as_an_indented_block(path: Path):
    text = path.read_text("utf-8")
    assert re.findall(r"^    (?:whichroad|python|pip) .*$", text, re.M) == []


@pytest.mark.parametrize(
    "path", [p for p in PAGES if any(b.kind == "toml" for b in code(p))], ids=title
)
def test_a_vehicle_of_a_page_can_be_read(path: Path, tmp_path: Path):
    for block in code(path):
        if block.kind == "toml":
            file = tmp_path / "vehicle.toml"
            file.write_text(block.code, encoding="utf-8")
            assert whichroad.read_vehicle(file).track_width > 0.0


def test_twenty_tasks_take_three_commands_or_five_lines():
    page = ROOT / "docs" / "how-to" / "common-tasks.md"
    parts = re.split(r"^## \d+\. ", page.read_text("utf-8"), flags=re.M)[1:]
    assert len(parts) == 20
    for part in parts:
        (found,) = re.findall(r"^```(sh|python)\n(.*?)^```$", part, re.M | re.S)
        lines = [line for line in found[1].splitlines() if line.strip()]
        assert len(lines) <= (3 if found[0] == "sh" else 5), part


def test_blocks_are_found_with_what_is_said_above_them(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A\n\n```python\na = 1\n```\n\n<!-- not run: it serves for ever -->\n```sh\nx\n```\n"
        "<!-- file: a.csv -->\n\n```csv\na\n```\n\n```{toctree}\nx\n```\n"
    )
    assert [(b.kind, b.mark, b.text, b.code, b.line) for b in blocks(page)] == [
        ("python", "", "", "a = 1\n", 4),
        ("sh", "not run", "it serves for ever", "x\n", 9),
        ("csv", "file", "a.csv", "a\n", 14),
        ("{toctree}", "", "", "x\n", 18),
    ]
    assert commands("a \\\n  b\n\n# no\nc  # d\n") == ["a    b", "c  # d"]
