"""Compiled kernels are kept once for each source, and nothing stale is ever found."""

import os
import shutil
import sys
import time
from pathlib import Path

import pytest

from whichroad.native import __main__ as program
from whichroad.native import build, cache, linking


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """An empty cache."""
    monkeypatch.setenv("WHICHROAD_CACHE_DIR", str(tmp_path))
    cache.cache_folder.cache_clear()
    yield tmp_path / "kernels"
    cache.cache_folder.cache_clear()


def copy_of_package(tmp_path: Path) -> Path:
    package = tmp_path / "whichroad"
    shutil.copytree(cache.PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    return package


def test_the_digest_is_of_every_kernel_file_and_nothing_else(tmp_path):
    package = copy_of_package(tmp_path)
    digests = [cache.source_digest(package)]
    assert digests[0] == cache.source_digest()
    for path in (cache.kernel_files(package)[3], package / "native" / "lower.py"):
        path.write_text(path.read_text("utf-8") + "\n# changed\n", "utf-8")
        digests.append(cache.source_digest(package))
    new = cache.kernel_files(package)[0].with_name("another.py")
    new.write_text("")
    digests.append(cache.source_digest(package))
    assert len(set(digests)) == len(digests)
    (package / "settings.py").write_text("")
    assert cache.source_digest(package) == digests[-1]


def test_line_ends_of_a_checkout_do_not_matter(tmp_path):
    package = copy_of_package(tmp_path)
    for path in cache.kernel_files(package):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert cache.source_digest(package) == cache.source_digest()


def test_every_kernel_module_is_found():
    modules = cache.kernel_modules()
    assert len(modules) == len(set(modules)) >= 10
    assert not any(name.endswith("_llvm") for name in modules)


def test_a_kept_library_is_taken_by_any_environment(folder, monkeypatch):
    """Without llvmlite, and without a C compiler: as in an environment of users."""
    path = folder / f"{cache.source_digest()}-other-{cache.own_target()}-own-O2"
    path = path.with_name(path.name + cache.suffix(cache.own_target()))
    cache.cache_folder()
    path.write_bytes(b"")
    monkeypatch.setattr(build, "why_not", lambda: pytest.fail("nothing is to be built"))
    assert build.own_library() == path


def test_libraries_of_other_sources_and_machines_are_not_taken(folder):
    cache.cache_folder()
    (folder / f"0123-tools-{cache.own_target()}-own-O2.so").write_bytes(b"")
    (folder / f"{cache.source_digest()}-tools-atari-st-own-O2.so").write_bytes(b"")
    assert cache.libraries(cache.source_digest(), cache.own_target()) == []


def test_a_library_for_a_better_processor_is_taken_first_and_only_where_it_runs(
    folder, monkeypatch
):
    cache.cache_folder()
    kinds = ("x86-64-v4", "x86-64-v3", "own")
    end = cache.suffix(cache.own_target())
    v4, v3, any_ = (
        folder / f"{cache.source_digest()}-tools-{cache.own_target()}-{kind}-O3{end}"
        for kind in kinds
    )
    for path in (v4, v3, any_):
        path.write_bytes(b"")
    for runs, found in (
        (("x86-64-v4", "x86-64-v3"), [v4, v3, any_]), (("x86-64-v3",), [v3, any_]), ((), [any_]),
    ):  # fmt: skip
        monkeypatch.setattr(cache, "processors", lambda runs=runs: runs)
        assert cache.libraries(cache.source_digest(), cache.own_target()) == found


def test_what_nobody_used_for_a_month_is_deleted(folder):
    folder.mkdir(parents=True)
    old, new = folder / "old.so", folder / "new.so"
    for path, days in ((old, 40), (new, 10)):
        path.write_bytes(b"")
        os.utime(path, (time.time() - 86400 * days,) * 2)
    cache.cache_folder()
    assert (old.exists(), new.exists()) == (False, True)


def test_without_a_writable_place_nothing_is_kept(monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("WHICHROAD_CACHE_DIR", str(blocked / "no"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked / "no"))
    monkeypatch.setenv("HOME", str(blocked / "no"))
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(blocked))
    cache.cache_folder.cache_clear()
    assert cache.cache_folder() is None
    cache.cache_folder.cache_clear()


@pytest.mark.parametrize(
    ("llvmlite", "linker", "message"),
    [(False, True, "pip install llvmlite"), (True, False, "pip install ziglang")],
)
def test_a_build_that_cannot_work_says_in_one_line_what_to_install(
    folder, monkeypatch, llvmlite, linker, message
):
    real = build.importlib.util.find_spec
    monkeypatch.setattr(
        build.importlib.util,
        "find_spec",
        lambda n: real(n) if llvmlite or n != "llvmlite" else None,
    )
    if not linker:
        monkeypatch.setattr(linking, "linker", lambda target, portable: None)
    told = []
    with pytest.raises(build.BuildError, match=message) as error:
        build.own_library()
    told.append(str(error.value))
    with pytest.raises(build.BuildError, match=message.replace("install ", "install .*")) as error:
        build.build(["linux-aarch64"], portable=True)
    told.append(str(error.value))
    for text in told:
        assert "\n" not in text
        assert text.count("; ") == 2  # what was seen; what was expected; what to do


def test_who_builds_for_another_machine_without_tools_reads_what_to_install(monkeypatch, capsys):
    real = build.importlib.util.find_spec
    monkeypatch.setattr(
        build.importlib.util, "find_spec", lambda n: None if n == "llvmlite" else real(n)
    )
    monkeypatch.setattr(sys, "argv", ["native", "build", "--target", "linux-aarch64"])
    assert program.main() == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install llvmlite ziglang" in said
