"""Wheels: whole, tagged for their platform, and asking the system for nothing unusual."""

import base64
import hashlib
import importlib.util
import zipfile
from pathlib import Path

import pytest

from whichroad.native import cache, library, linking, wheel

ROOT = Path(__file__).resolve().parents[2]
ABOUT = "whichroad-1.dist-info"


def released(name: str):
    """A module of the folder release."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "release" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules[name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def pure(tmp_path: Path) -> Path:
    path = tmp_path / "whichroad-1-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("whichroad/__init__.py", "")
        file.writestr(
            f"{ABOUT}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n\n"
        )
        file.writestr(f"{ABOUT}/RECORD", "")
    return path


def made(pure: Path, folder: Path, platform: str) -> Path:
    kernels = folder / "some.so"
    kernels.write_bytes(b"machine code")
    return wheel.with_library(pure, kernels, platform, folder)


def test_a_wheel_holds_the_library_and_says_for_which_platform(pure, tmp_path):
    path = made(pure, tmp_path, wheel.TAGS["linux-x86_64"])
    assert path.name == "whichroad-1-py3-none-manylinux_2_17_x86_64.manylinux2014_x86_64.whl"
    with zipfile.ZipFile(path) as file:
        assert file.read("whichroad/native/kernels.so") == b"machine code"
        about = file.read(f"{ABOUT}/WHEEL").decode().splitlines()
        record = [line.split(",") for line in file.read(f"{ABOUT}/RECORD").decode().splitlines()]
        for name, digest, size in record[:-1]:
            content = file.read(name)
            right = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
            assert (digest, int(size)) == (f"sha256={right.decode()}", len(content))
        assert {row[0] for row in record} == set(file.namelist())
    assert "Root-Is-Purelib: false" in about
    assert [line for line in about if line.startswith("Tag: ")] == [
        "Tag: py3-none-manylinux_2_17_x86_64", "Tag: py3-none-manylinux2014_x86_64",
    ]  # fmt: skip


def test_files_are_added_to_a_wheel_and_recorded(pure):
    wheel.with_files(pure, {"whichroad/page/maplibre/maplibre-gl.js": b"script"})
    with zipfile.ZipFile(pure) as file:
        assert file.read("whichroad/page/maplibre/maplibre-gl.js") == b"script"
        assert "Root-Is-Purelib: true" in file.read(f"{ABOUT}/WHEEL").decode()
        record = file.read(f"{ABOUT}/RECORD").decode().splitlines()
        assert {line.split(",")[0] for line in record} == set(file.namelist())


def test_another_archive_than_that_of_maplibre_is_refused():
    maplibre = released("maplibre_gl")
    with pytest.raises(ValueError, match="the digest is sha512-"):
        maplibre.unpacked(b"another archive")


def test_without_npm_maplibre_is_not_fetched(tmp_path, monkeypatch):
    maplibre = released("maplibre_gl")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OSError, match="npm was not found"):
        maplibre.bring(tmp_path)


def test_the_same_files_make_the_same_wheel(pure, tmp_path):
    first = made(pure, tmp_path, "win_amd64").read_bytes()
    assert made(pure, tmp_path, "win_amd64").read_bytes() == first


def test_a_library_for_a_better_processor_is_loaded_only_where_it_runs(pure, tmp_path, monkeypatch):
    end = cache.suffix(cache.own_target())
    kept = tmp_path / f"digest-tools-linux-x86_64-x86-64-v3-O3{end}"
    kept.write_bytes(b"machine code")
    path = wheel.with_library(pure, kept, "linux_x86_64", tmp_path)
    with zipfile.ZipFile(path) as file:
        file.extractall(tmp_path)
    monkeypatch.setattr(library, "__file__", str(tmp_path / "whichroad/native/library.py"))
    for runs in (("x86-64-v4", "x86-64-v3"), ("x86-64-v3",), ()):
        monkeypatch.setattr(cache, "processors", lambda runs=runs: runs)
        assert library.packed().exists() == bool(runs)


def test_every_platform_has_a_tag():
    assert wheel.TAGS.keys() == linking.TARGETS.keys()


def test_the_library_asks_for_functions_of_the_c_library_alone():
    needs = released("imports").needs_of(library.found().read_bytes())
    names = {symbol.partition("@")[0] for symbol in needs.symbols}
    known = {
        "acos", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "erf", "erfc",
        "exp", "expm1", "fmod", "hypot", "log", "log1p", "log2", "logf", "memcpy", "memmove",
        "memset", "pow", "sin", "sincos", "sinh", "tan", "tanh",
    }  # fmt: skip
    system = cache.own_target().partition("-")[0]
    if system == "linux":
        assert names <= known, names - known
        assert set(needs.libraries) <= {"libc.so.6", "libm.so.6"}
    elif system == "macos":
        assert needs.signed
