"""The benchmarks name what there is: few of them run in the tests."""

import ast
import importlib
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in (ROOT / "benchmarks").rglob("*.py")
    if path.stem not in ("__main__", "whichroad_adapter")
)


def named(tree: ast.AST, bound: dict[str, ModuleType]) -> list[tuple[str, str]]:
    """Attributes of our own modules that some code reads."""
    return [
        (node.value.id, node.attr)
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        and node.value.id in bound
    ]  # fmt: skip


@pytest.mark.parametrize("name", MODULES)
def test_what_a_benchmark_names_exists(name: str):
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as missing:
        pytest.skip(f"{missing.name} is not installed")
    tree = ast.parse(Path(str(module.__file__)).read_text("utf-8"))
    bound = {k: v for k, v in vars(module).items() if isinstance(v, ModuleType)}
    for node in ast.walk(tree):  # within functions
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("whichroad"):
            origin = importlib.import_module(node.module)
            for alias in node.names:
                found = getattr(origin, alias.name, None)
                if found is None:
                    found = importlib.import_module(f"{node.module}.{alias.name}")
                if isinstance(found, ModuleType):
                    bound[alias.asname or alias.name] = found
    bound = {k: v for k, v in bound.items() if v.__name__.startswith(("whichroad", "benchmarks"))}
    assert [f"{a}.{b}" for a, b in named(tree, bound) if not hasattr(bound[a], b)] == []


def test_every_benchmark_has_its_row_in_the_table():
    from benchmarks.__main__ import BENCHMARKS

    table = (ROOT / "benchmarks" / "README.md").read_text("utf-8").partition("## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.M)) == set(BENCHMARKS)


def test_every_option_that_a_benchmark_asks_for_can_be_given():
    from benchmarks.__main__ import parser

    source = "".join(path.read_text("utf-8") for path in (ROOT / "benchmarks").rglob("*.py"))
    asked = set(re.findall(r"""\bmore(?:\.get\(|\[)"(\w+)\"""", source)) - {"settings"}
    given = vars(parser().parse_args(["town"]))
    assert len(asked) > 10
    assert asked - set(given) == set()
