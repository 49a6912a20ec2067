"""Kernels compiled at their first call: never a stale one, never a need for a writable home."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from whichroad.native.cache import PACKAGE

pytest.importorskip("numba")

LEAF = """
from .._compile import kernel

@kernel
def leaf(x: int) -> int:
    return x + {}
"""
TOP = """
from .._compile import entry
from .leaf import leaf

@entry
def top(x: int) -> int:
    return 10 * leaf(x)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package with two kernels more, one calling the other."""
    package = tmp_path / "site" / "whichroad"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    (package / "graph" / "leaf.py").write_text(LEAF.format(1))
    (package / "graph" / "top.py").write_text(TOP)
    return package


def run(package: Path, code: str, **environment: str) -> str:
    """Run `code` in a new process that sees the copy and no cache settings but these."""
    kept = {k: os.environ[k] for k in ("PATH", "SYSTEMROOT") if k in os.environ}
    paths = {"PYTHONPATH": str(package.parent), "WHICHROAD_KERNELS": "jit"}
    done = subprocess.run(
        [sys.executable, "-B", "-c", code], env=kept | paths | environment,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip()


ANSWER = "from whichroad.graph.top import top; print(top(1))"
CACHED = "from whichroad.graph.top import top; top(1); print(len(top._run.stats.cache_hits))"
NO_TEMP = "import tempfile; tempfile.tempdir = '/dev/null/none'; "


def test_a_callee_changed_in_another_file_changes_the_answer(package: Path, tmp_path: Path):
    cache = str(tmp_path / "cache")
    assert run(package, ANSWER, WHICHROAD_CACHE_DIR=cache) == "20"
    assert run(package, CACHED, WHICHROAD_CACHE_DIR=cache) == "1"  # else this tests nothing
    (package / "graph" / "leaf.py").write_text(LEAF.format(2))
    assert run(package, ANSWER, WHICHROAD_CACHE_DIR=cache) == "30"


def test_nothing_is_written_beside_the_sources(package: Path, tmp_path: Path):
    before = sorted(package.rglob("*"))
    run(package, ANSWER, WHICHROAD_CACHE_DIR=str(tmp_path / "cache"))
    assert sorted(package.rglob("*")) == before


def test_without_a_home_the_cache_goes_to_the_temporary_folder(package: Path, tmp_path: Path):
    nowhere = {
        "HOME": "/dev/null", "WHICHROAD_CACHE_DIR": "/dev/null/a", "XDG_CACHE_HOME": "/dev/null/b",
    }  # fmt: skip
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    assert run(package, ANSWER, TMPDIR=str(temporary), **nowhere) == "20"
    assert list(temporary.rglob("*.nbi"))


def test_without_any_writable_folder_kernels_still_run(package: Path):
    nowhere = {"HOME": "/dev/null", "NUMBA_CACHE_DIR": "/dev/null/c"}
    before = sorted(package.rglob("*"))
    assert run(package, NO_TEMP + ANSWER, **nowhere) == "20"
    assert sorted(package.rglob("*")) == before


def test_compiling_leaves_the_cache_folder_of_other_libraries_alone(package: Path, tmp_path: Path):
    code = ANSWER + "; import numba; print(numba.config.CACHE_DIR)"
    theirs, ours = str(tmp_path / "theirs"), str(tmp_path / "ours")
    said = run(package, code, NUMBA_CACHE_DIR=theirs, WHICHROAD_CACHE_DIR=ours)
    assert said.split() == ["20", theirs]
    assert not Path(theirs).exists()
