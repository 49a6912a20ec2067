"""All wheels from one machine: one library for each platform, linked by zig.

    python release/wheels.py dist [--target linux-x86_64 ...]

needs pip, numpy, llvmlite and ziglang.  Prints what each library imports; one that asks for more
than the C library's functions, or a macOS one without a signature, is an error.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "release")]

from imports import needs_of  # noqa: E402

from whichroad.errors import WhichroadError  # noqa: E402
from whichroad.native import build, linking, wheel  # noqa: E402

SYSTEM = {  # libraries that every such system has
    "linux-x86_64": {"libc.so.6", "libm.so.6"},
    "linux-aarch64": {"libc.so.6", "libm.so.6", "ld-linux-aarch64.so.1"},
    "macos-arm64": {"/usr/lib/libSystem.B.dylib"},
    "windows-x86_64": {"KERNEL32.dll", "api-ms-win-crt-*", "ucrtbase.dll"},
}


def _check(target: str, library: Path) -> str:
    """What a library imports; an error where that is not on every system."""
    needs = needs_of(library.read_bytes())
    allowed = SYSTEM[target]
    foreign = {
        name
        for name in needs.libraries
        if name not in allowed and not (name.startswith("api-ms-win-crt-") and "win" in target)
    }
    if foreign or (target.startswith("macos") and not needs.signed):
        raise SystemExit(
            f"{library}: needs {foreign or 'a signature'}; of {sorted(allowed)} alone was expected"
        )
    return f"{needs.kind}, {library.stat().st_size} bytes: {' '.join(sorted(needs.symbols))}"


def main() -> None:
    """Build them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--target", action="append", choices=sorted(linking.TARGETS))
    given = parser.parse_args()
    targets = given.target or list(linking.TARGETS)
    given.folder.mkdir(parents=True, exist_ok=True)
    try:
        libraries = build.build(targets, portable=True)
    except WhichroadError as error:
        raise SystemExit(str(error)) from None
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, str(ROOT)],
            env=os.environ | {"WHICHROAD_KERNELS": "jit"}, check=True,
        )  # fmt: skip
        (pure,) = Path(folder).glob("*-py3-none-any.whl")
        for target in targets:
            told = _check(target, libraries[target])
            made = wheel.with_library(pure, libraries[target], wheel.TAGS[target], given.folder)
            print(f"{made.name}\n  {told}")


if __name__ == "__main__":
    main()
