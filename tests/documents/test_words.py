"""Words: short sentences in README, help and messages, and spelling everywhere.

A sentence of a page is counted by the rules of `tests/test_prose.py`.  A message reads
`where: what was seen; what was expected; what to do`: it is read part by part, so that its
semicolons end a sentence too.  A value that is filled in counts as one word.
"""

import ast
import functools
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from test_prose import LONGEST, sentences, words
from whichroad.cli import app

from .pages import NOTEBOOKS, PAGES, ROOT, title

SOURCES = sorted((ROOT / "src" / "whichroad").rglob("*.py"))

# Kept as they were written, with their dates; and pages that programs write.
KEPT = {
    "docs/experiments-log.md",
    "docs/benchmarks.md",
    "docs/honesty.md",
    "docs/worlds-history.md",
}
# For those who read equations: one sentence in twenty may be longer.
TECHNICAL = {
    "docs/model.md", "docs/sensors-that-fail.md", "docs/architecture.md", "docs/exact.md",
    "benchmarks/README.md",
    *(f"docs/model/{path.name}" for path in (ROOT / "docs" / "model").iterdir()),
}  # fmt: skip
READ = [p for p in PAGES if title(p) not in KEPT and "decisions" not in p.parts]
SHORT = [p for p in READ if title(p) not in TECHNICAL]
_SHORT_END = re.compile(r"(?<!e\.g)(?<!i\.e)[.!?;:]\s+")


@pytest.mark.parametrize("path", SHORT, ids=title)
def test_no_sentence_of_a_page_is_long(path: Path):
    found = sentences(path.read_text("utf-8"))
    assert [s for s in found if words(s) > LONGEST] == []


@pytest.mark.parametrize("page", sorted(TECHNICAL))
def test_few_sentences_of_a_technical_page_are_long(page: str):
    found = sentences((ROOT / page).read_text("utf-8"))
    long = [s for s in found if words(s) > LONGEST]
    assert len(long) <= 0.05 * len(found), long


def helps(command: Any, name: str = "whichroad") -> Iterator[tuple[str, str]]:
    """The name and the text of every help of the command line."""
    yield name, command.help or ""
    for parameter in command.params:
        yield f"{name} {parameter.opts[0]}", getattr(parameter, "help", None) or ""
    for inner, one in getattr(command, "commands", {}).items():
        yield from helps(one, f"{name} {inner}")


HELPS = [(name, text) for name, text in helps(get_command(app)) if text]


@pytest.mark.parametrize(("name", "text"), HELPS, ids=[name for name, _ in HELPS])
def test_no_sentence_of_help_is_long(name: str, text: str):
    parts = re.split(r"(?<=[.!?])\s+", " ".join(text.split()))
    assert [part for part in parts if words(part) > LONGEST] == []
    assert text[0].isupper() or text[0] in "`.", text
    assert text.rstrip().endswith((".", "png")), text


SAID = {"echo", "BadParameter", "_count", "HTTPException", "_Stale", "Finding", "append", "note"}


@functools.cache
def messages(path: Path) -> list[tuple[int, str]]:
    """What a module may say: the texts of what it raises, prints, counts, and notes.

    Every text that is built somewhere below a `raise`, or in the arguments of a call by which
    things are said, and that has blanks in it.
    """
    found: list[tuple[int, str]] = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Raise) and node.exc is not None:
            found += texts(node.exc)
        elif isinstance(node, ast.Call) and called(node) in SAID:
            for argument in (*node.args, *(k.value for k in node.keywords)):
                found += texts(argument)
        elif isinstance(node, ast.Return) and node.value is not None:
            found += (t for t in texts(node.value) if "expected" in t[1])
    return found


def called(call: ast.Call) -> str:
    return getattr(call.func, "attr", None) or getattr(call.func, "id", "")


def texts(node: ast.AST) -> Iterator[tuple[int, str]]:
    """The strings in an expression, each value that is filled in as one word."""
    if isinstance(node, ast.JoinedStr):
        parts = [v.value if isinstance(v, ast.Constant) else "X" for v in node.values]
        yield node.lineno, "".join(str(part) for part in parts)
        for value in node.values:
            if isinstance(value, ast.FormattedValue):
                yield from texts(value.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.lineno, node.value
    else:
        for child in ast.iter_child_nodes(node):
            yield from texts(child)


def test_no_part_of_a_message_is_long():
    long = [
        f"{title(path)}, line {line}: {part}"
        for path in SOURCES
        for line, text in messages(path)
        for part in _SHORT_END.split(text)
        if words(part) > LONGEST
    ]
    assert long == []


# Phrases at which a reader stumbles, and what is said in their place
_ODD = {
    r"\bwhat was known\b": "smooth with a lag",
    r"covariance that is not one": "not positive definite",
    r"this should not happen": "a bug",
    r"\bthere is no such file\b": "the file does not exist",
    r"\b(?:is|are) no (?:table|folder|file|number|path|map|time)\b": "is not a ...",
    r"\btells? \w+ apart\b": "names, identifies",
    r"\b1 (?:drives|fixes|epochs|rows|edges|trips)\b": "wording.counted",
}


def test_no_message_has_an_odd_phrase():
    found = [
        f"{title(path)}, line {line}: {text!r}; better: {better}"
        for path in SOURCES
        for line, text in messages(path)
        for odd, better in _ODD.items()
        if re.search(odd, text)
    ]
    assert found == []


def test_messages_are_found_where_they_are():
    found = [text for path in SOURCES for _, text in messages(path)]
    assert sum("was expected" in text or "were expected" in text for text in found) > 150
    assert any("the file does not exist" in text for text in found)


def test_the_spelling_is_right():
    files = [*PAGES, *NOTEBOOKS, *SOURCES, ROOT / "CHANGELOG.md"]
    done = subprocess.run(
        [sys.executable, "-m", "codespell_lib", "--ignore-words-list", ",".join(NAMES), *files],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


NAMES = ["ths", "nees", "tung", "ue", "nd", "pont", "vie", "ans"]  # people, places, symbols, tags
