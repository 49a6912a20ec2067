"""The reference is complete: every public name, column, environment variable and setting."""

import inspect
import re
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

import whichroad
from whichroad import exact
from whichroad.lineage.table import LINEAGE
from whichroad.tables import schema

from .pages import ROOT

PYTHON = (ROOT / "docs" / "reference" / "python.md").read_text("utf-8")
COLUMNS = (ROOT / "docs" / "reference" / "columns.md").read_text("utf-8")
TABLES = {
    "Points": schema.POINTS, "Attributes of the road": schema.ATTRIBUTES, "Path": schema.PATH,
    "Trips": schema.DRIVES, "Hypotheses": LINEAGE,
}  # fmt: skip
LISTED = set(re.findall(r"^\.\. auto\w+:: (?:[a-z_.]+\.)?(\w+)$", PYTHON, re.M))


@pytest.mark.parametrize("name", [*whichroad.__all__, *exact.__all__])
def test_every_public_name_has_its_entry(name: str):
    assert name in LISTED


def section(title: str) -> str:
    return re.split(r"^##+ ", COLUMNS.partition(f"# {title}\n")[2], maxsplit=1, flags=re.M)[0]


def listed_columns(title: str) -> dict[str, str]:
    """The columns of a section's table and their types."""
    found = {}
    for line in section(title).splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if line.startswith("| `"):
            found |= dict.fromkeys(re.findall(r"`(\w+)`", cells[1]), cells[2])
    return found


@pytest.mark.parametrize("title", TABLES)
def test_every_column_is_listed_with_its_type(title: str):
    kinds = {field.name: str(field.type) for field in TABLES[title]}
    plain = {
        name: "timestamp" if kind.startswith("timestamp") else re.split(r"[<\[]", kind)[0]
        for name, kind in kinds.items()
    }
    assert listed_columns(title) == plain


@pytest.mark.parametrize("words", ["against_one_way", "turn_banned", "no_access", "u_turn", "gap"])
def test_a_broken_rule_is_named_as_in_the_path(words: str):
    assert f"`{words}`" in section("Path")


def functions() -> list[Any]:
    """Public functions, and the methods of public classes, that take arguments."""
    found = []
    for module in (whichroad, exact):
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.isclass(thing):
                members = [
                    m for n, m in vars(thing).items()
                    if not n.startswith("_") and callable(getattr(m, "__func__", m))
                ]  # fmt: skip
                found += [getattr(member, "__func__", member) for member in members]
            else:
                found.append(thing)
    return found


@pytest.mark.parametrize("function", functions(), ids=lambda f: f.__qualname__)
def test_a_docstring_says_what_each_argument_is(function: Any):
    names = [n for n in inspect.signature(function).parameters if n not in {"self", "cls"}]
    text = inspect.getdoc(function) or ""
    told = set(re.findall(r"^ +\*{0,2}(\w+): ", text.partition("Args:")[2], re.M))
    if len(names) > 1:
        assert set(names) - told == set()
    assert text


@pytest.mark.parametrize(
    "name", [c for c in whichroad.__all__ if is_dataclass(getattr(whichroad, c))]
)
def test_help_says_what_each_field_of_a_record_is(name: str):
    """Comments beside the fields are not shown by `help`; settings have a page of their own."""
    record = getattr(whichroad, name)
    text = (inspect.getdoc(record) or "").partition("Attributes:")[2]
    told = set(re.findall(r"^ +(\w+): ", text, re.M))
    if name not in ("Settings", "Vehicle"):
        assert {f.name for f in fields(record)} - told == set()
