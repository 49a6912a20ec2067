"""The reference is complete: every public name, column, environment variable and setting."""

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

import whichroad
from whichroad import exact, observations
from whichroad.diagnosis import sensors
from whichroad.lineage.table import LINEAGE
from whichroad.tables import schema

from .pages import ROOT

PYTHON = (ROOT / "docs" / "reference" / "python.md").read_text("utf-8")
FINDINGS = (ROOT / "docs" / "reference" / "findings.md").read_text("utf-8")
FORMATS = (ROOT / "docs" / "formats.md").read_text("utf-8")
COMMANDS = (ROOT / "docs" / "reference" / "commands.md").read_text("utf-8")
SOURCE = ROOT / "src" / "whichroad"
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


def listed_findings() -> set[str]:
    """What stands in the first cells of the tables of findings."""
    tables = re.findall(r"^\| `what` \| what was seen \|\n(.*?)(?:\n\n|\Z)", FINDINGS, re.M | re.S)
    cells = [line.split(" | ")[0] for table in tables for line in table.splitlines()]
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def named_findings() -> Iterator[re.Pattern[str]]:
    """The names that findings have in the source, any word where a value is filled in."""
    for path in sorted(SOURCE.rglob("*.py")):
        tree = ast.parse(path.read_text("utf-8"))
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args]
        for what in (c.args[0] for c in calls if getattr(c.func, "id", "") == "Finding"):
            if isinstance(what, ast.Name):  # one of the texts that it may hold
                yield from (
                    re.compile(re.escape(one.value.value))
                    for one in ast.walk(tree)
                    if isinstance(one, ast.Assign) and isinstance(one.value, ast.Constant)
                    if getattr(one.targets[0], "id", "") == what.id
                )
            elif isinstance(what, ast.JoinedStr):
                parts = [getattr(value, "value", "") for value in what.values]
                plain = [re.escape(p) if isinstance(p, str) else "[A-Za-z ]+" for p in parts]
                yield re.compile("".join(plain))
            else:
                yield re.compile(re.escape(ast.literal_eval(what)))


def test_every_finding_is_listed():
    listed, patterns = listed_findings(), list(named_findings())
    assert len(patterns) > 30
    assert [p.pattern for p in patterns if not any(map(p.fullmatch, listed))] == []
    assert [name for name in listed if not any(p.fullmatch(name) for p in patterns)] == []
    built = [one.what for one in sensors.column_findings(tuple(sensors._COLUMNS))]
    built += [sensors.refused_finding(kind, 1.0, 9.0).what for kind in sensors._READINGS]
    built += [sensors.late_finding(kind, 0.5, 0.1).what for kind in sensors._READINGS]
    built += [
        f"{name}: {sensors._turned_wrongly(who, gain)[0]}"
        for who, name in ((sensors.WHEELS, "wheels"), (sensors.GYRO, "gyro"))
        for gain in (-1.0, 0.0, 0.5, 57.3)
    ]
    assert set(built) - listed == set()


def test_every_flag_of_a_fix_is_named():
    flags = re.findall(r"^([A-Z_, ]+) = [\d, ]+  #", inspect.getsource(observations), re.M)
    names = {name for line in flags for name in line.split(", ")}
    assert names >= {"FROM_HDOP", "RECKONED_PLACE", "OTHER_UNIT"}
    assert {
        name for name in names if not re.search(rf"`(observations\.)?{name}`", FORMATS)
    } == set()


def test_every_environment_variable_is_listed():
    source = "".join(path.read_text("utf-8") for path in SOURCE.rglob("*.py"))
    read = re.findall(r"""(?:environ\.get\(|envvar=)["'](WHICHROAD_\w+)""", source)
    assert len(set(read)) >= 4
    assert set(read) - set(re.findall(r"^\| `(\w+)` \|", COMMANDS, re.M)) == set()


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


def test_the_pages_that_the_source_names_exist():
    source = "".join(path.read_text("utf-8") for path in SOURCE.rglob("*.py"))
    named = set(re.findall(r"\bdocs/[\w/-]+\.md\b", source))
    assert len(named) > 5
    assert {page for page in named if not (ROOT / page).is_file()} == set()


PAGES_OF_THE_MODEL = [*(ROOT / "docs" / "model").iterdir(), ROOT / "docs" / "model.md"]


@pytest.mark.parametrize("path", PAGES_OF_THE_MODEL, ids=lambda path: path.name)
def test_a_setting_has_the_default_that_the_model_states(path: Path):
    """`name` (value): a value in words, such as two sigmas, is not compared."""
    text = path.read_text("utf-8")
    stated = re.findall(r"`(\w+)`\s+\((-?[\d.]+(?:e-?\d+)?)[ )]", text)
    defaults = {field.name: field.default for field in fields(whichroad.Settings)}
    told = [(name, float(value)) for name, value in stated if name in defaults]
    assert [one for one in told if one[1] != defaults[one[0]]] == []
    assert told or path.name not in ("model.md", "motion.md", "gnss.md", "hypotheses.md")
