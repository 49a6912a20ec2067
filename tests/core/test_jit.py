"""The compile decorator: never a stale kernel, never a need for a writable home."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from whichroad.core import _jit

LEAF = """
from ._jit import kernel

@kernel
def leaf(x):
    return x + {}
"""
TOP = """
from ._jit import kernel
from .leaf import leaf

@kernel
def top(x):
    return 10 * leaf(x)
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """A package `toy` of two kernels, one calling the other, under our decorator."""
    package = tmp_path / "site" / "toy"
    package.mkdir(parents=True)
    shutil.copy(_jit.__file__, package / "_jit.py")
    (package / "__init__.py").write_text("")
    (package / "leaf.py").write_text(LEAF.format(1))
    (package / "top.py").write_text(TOP)
    return package


def run(toy: Path, code: str, **environment: str) -> str:
    """Run `code` in a new process that sees `toy` and no cache settings but these."""
    kept = {k: os.environ[k] for k in ("PATH", "SYSTEMROOT") if k in os.environ}
    done = subprocess.run(
        [sys.executable, "-B", "-c", code],
        env=kept | {"PYTHONPATH": str(toy.parent)} | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


ANSWER = "from toy.top import top; print(top(1))"
CACHED = "from toy.top import top; top(1); print(sum(top.stats.cache_hits.values()))"
NO_TEMP = "import tempfile; tempfile.tempdir = '/dev/null/none'; "


def test_a_callee_changed_in_another_file_changes_the_answer(toy: Path, tmp_path: Path):
    cache = str(tmp_path / "cache")
    assert run(toy, ANSWER, WHICHROAD_CACHE_DIR=cache) == "20"
    assert run(toy, CACHED, WHICHROAD_CACHE_DIR=cache) == "1"  # else this tests nothing
    (toy / "leaf.py").write_text(LEAF.format(2))
    assert run(toy, ANSWER, WHICHROAD_CACHE_DIR=cache) == "30"


def test_an_unchanged_kernel_is_not_compiled_again(toy: Path, tmp_path: Path):
    cache = str(tmp_path / "cache")
    run(toy, ANSWER, WHICHROAD_CACHE_DIR=cache)
    assert run(toy, CACHED, WHICHROAD_CACHE_DIR=cache) == "1"


def test_nothing_is_written_beside_the_sources(toy: Path, tmp_path: Path):
    before = sorted(toy.rglob("*"))
    run(toy, ANSWER, WHICHROAD_CACHE_DIR=str(tmp_path / "cache"))
    assert sorted(toy.rglob("*")) == before


def test_without_a_home_the_cache_goes_to_the_temporary_folder(toy: Path, tmp_path: Path):
    nowhere = {
        "HOME": "/dev/null",
        "WHICHROAD_CACHE_DIR": "/dev/null/a",
        "XDG_CACHE_HOME": "/dev/null/b",
    }
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    assert run(toy, ANSWER, TMPDIR=str(temporary), **nowhere) == "20"
    assert list(temporary.rglob("*.nbi"))


def test_without_any_writable_folder_kernels_still_run(toy: Path):
    nowhere = {"HOME": "/dev/null", "NUMBA_CACHE_DIR": "/dev/null/c"}
    before = sorted(toy.rglob("*"))
    assert run(toy, NO_TEMP + ANSWER, **nowhere) == "20"
    assert (
        run(toy, NO_TEMP + "from toy import _jit; print(_jit.cache_folder())", **nowhere) == "None"
    )
    assert sorted(toy.rglob("*")) == before


def test_decorating_leaves_the_cache_folder_of_other_libraries_alone(toy: Path, tmp_path: Path):
    code = "import numba; import toy.top; print(numba.config.CACHE_DIR)"
    theirs = str(tmp_path / "theirs")
    ours = str(tmp_path / "ours")
    assert run(toy, code, NUMBA_CACHE_DIR=theirs, WHICHROAD_CACHE_DIR=ours) == theirs


def test_kernels_of_versions_unused_for_a_month_are_deleted(toy: Path, tmp_path: Path):
    root = tmp_path / "cache" / "kernels"
    old, recent = root / "old", root / "recent"
    for folder, days in ((old, 31), (recent, 29)):
        folder.mkdir(parents=True)
        then = time.time() - days * 86400
        os.utime(folder, (then, then))
    run(toy, ANSWER, WHICHROAD_CACHE_DIR=str(tmp_path / "cache"))
    assert not old.exists()
    assert recent.exists()


def test_the_digest_depends_on_names_and_contents_of_all_files(tmp_path: Path):
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "b.py").write_text("2")
    first = _jit.digest(tmp_path)
    assert _jit.digest(tmp_path) == first
    (tmp_path / "b.py").write_text("3")
    changed = _jit.digest(tmp_path)
    (tmp_path / "b.py").rename(tmp_path / "c.py")
    assert len({first, changed, _jit.digest(tmp_path)}) == 3


def test_kernels_in_use_are_kept_however_old(toy: Path, tmp_path: Path):
    cache = str(tmp_path / "cache")
    run(toy, ANSWER, WHICHROAD_CACHE_DIR=cache)
    (folder,) = (tmp_path / "cache" / "kernels").iterdir()
    then = time.time() - 40 * 86400
    os.utime(folder, (then, then))
    assert run(toy, CACHED, WHICHROAD_CACHE_DIR=cache) == "1"
