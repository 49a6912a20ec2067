"""Linkers: the C compiler of this machine, else zig, which has those of all machines."""

import functools
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ..errors import WhichroadError
from . import cache

TARGETS = {  # as zig calls them, for the oldest system that is served
    "linux-x86_64": "x86_64-linux-gnu.2.17",
    "linux-aarch64": "aarch64-linux-gnu.2.17",
    "macos-arm64": "aarch64-macos.11.0",
    "windows-x86_64": "x86_64-windows-gnu",
}
_FLAGS = {
    "linux": ("-shared", "-Wl,--gc-sections", "-s", "-lm"),
    "macos": ("-dynamiclib", "-lm"),
    "windows": ("-shared", "-s"),
}


class BuildError(WhichroadError):
    """The kernels cannot be compiled here."""


def linker(target: str, portable: bool) -> list[str] | None:
    """The command that links a library for a machine, or None.

    Args:
        target: The machine.
        portable: For old systems too, not just for this one.
    """
    if not portable and target == cache.own_target() and (own := own_linker()) is not None:
        return [*own]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target]]
    return None


@functools.cache
def own_linker() -> tuple[str, ...] | None:
    """A C compiler of this machine that links an empty library."""
    for name in (os.environ.get("CC", ""), "cc", "gcc", "clang"):
        command = shutil.which(name) if name else None
        if command is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            empty = Path(folder) / "empty.c"
            empty.write_text("int whichroad_nothing;\n")
            try:
                done = subprocess.run(
                    [command, "-shared", "-fPIC", str(empty), "-o", f"{folder}/empty", "-lm"],
                    capture_output=True, timeout=20, check=False,
                )  # fmt: skip
            except (OSError, subprocess.TimeoutExpired):
                continue
            if done.returncode == 0:
                return (command,)
    return None


def link(command: Sequence[str], target: str, objects: Sequence[Path], made: Path) -> None:
    """Link objects to a library.

    Args:
        command: Of `linker`.
        target: The machine.
        objects: Object files.
        made: The library.

    Raises:
        BuildError: The linker failed.
    """
    line = [*command, *map(str, objects), "-o", str(made), *_FLAGS[target.partition("-")[0]]]
    done = subprocess.run(line, capture_output=True, text=True, check=False, cwd=made.parent)
    if done.returncode:
        raise BuildError(
            f"kernels: linking for {target} failed: {(done.stderr or done.stdout).strip()[-400:]}; "
            "a working C compiler was expected; install one, or pip install ziglang"
        )
