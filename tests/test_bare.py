"""The core alone: no drawing, no frames, no CAN, no pandas, no compiler."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
NOT_IN_ALL = {"explore", "jit", "ros", "openlr", "mf4", "spark", "compass"}
NOT_FOR_RUNNING = {"dev", "docs", "tools", "worlds"}
MODULES = {  # of requirements that bring others than the one of their own name
    "geopandas": {"geopandas", "pandas", "pyogrio"}, "pyserial": {"serial"},
    "python-can": {"can"}, "numba": {"numba", "llvmlite"},
}  # fmt: skip


def test_drives_are_matched_and_written_without_any_extra():
    done = subprocess.run(
        [sys.executable, ROOT / "release" / "smoke.py"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "a table of trips" in done.stdout


def test_a_command_names_the_extra_that_it_lacks(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); from smoke import Absent; "
        "sys.meta_path.insert(0, Absent()); from whichroad.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, ROOT / "release", "demo", "--out", tmp_path / "demo"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 1
    assert 'pip install "whichroad[' in done.stderr
    assert "Traceback" not in done.stderr


def test_what_a_module_imports_comes_with_the_package_or_an_extra_for_running():
    project = project_table()
    extras = project["optional-dependencies"]
    told = [one for name in extras.keys() - NOT_FOR_RUNNING for one in extras[name]]
    names = {re.split(r"[^\w.-]", one)[0] for one in project["dependencies"] + told}
    known = {"whichroad"} | sys.stdlib_module_names
    known |= {module for name in names for module in MODULES.get(name, {name.replace("-", "_")})}
    strangers = {
        f"{path.relative_to(ROOT)}: {module}"
        for path in (ROOT / "src").rglob("*.py")
        for module in imported(path) - known
    }
    assert strangers == set()


def test_all_holds_the_extras_that_the_readme_uses():
    extras = project_table()["optional-dependencies"]
    used = extras.keys() - NOT_FOR_RUNNING - NOT_IN_ALL - {"all"}
    assert set(extras["all"]) == {f"whichroad[{name}]" for name in used}


def project_table() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def imported(path: Path) -> set[str]:
    """Packages that a module imports by name, at its top or later."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add(str(node.module))
    return {name.partition(".")[0] for name in found}
