"""The aarch64 library, run under qemu-user on calls that were captured here.

    python release/emulated.py LIBRARY [--system /usr/aarch64-linux-gnu]

needs qemu-user, an aarch64 C library (Debian: qemu-user libc6-arm64-cross) and ziglang.
Every call starts from what it started from here, so differences are those of one call.
"""

import argparse
import struct
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whichroad.native import library
from whichroad.native.layout import Array, Fields

HERE = Path(__file__).resolve().parent
CALLS: list[tuple[str, bytes, list[tuple[int, np.ndarray, np.ndarray]], Any]] = []


def _leaves(kind: Any, value: Any, at: int, found: list[tuple[int, np.ndarray]]) -> int:
    """The arrays of an argument with their words; returns the word after it."""
    if isinstance(kind, Fields):
        for one, inner in zip(kind.types, value, strict=True):
            at = _leaves(one, inner, at, found)
        return at
    if isinstance(kind, Array):
        found.append((at, value))
        return at + 1 + kind.ndim
    return at + 1


def capture() -> None:
    """Keep what goes into each native call from now on, and what comes out."""
    real = library.Call.__call__

    def call(self: Any, *args: Any) -> Any:
        words, at, arrays = self._words(args), 0, []
        for (_, kind), value in zip(self._kinds, args, strict=True):
            at = _leaves(kind, value, at, arrays)
        block = bytearray(len(self._codes) * 8)
        self._pack(block, 0, *words)
        before = [np.array(array, copy=True) for _, array in arrays]
        result = real(self, *args)
        kept = [
            (place, old, np.array(array, copy=True))
            for (place, array), old in zip(arrays, before, strict=True)
        ]
        CALLS.append((self._name, bytes(block), kept, result))
        return result

    library.Call.__call__ = call  # type: ignore[method-assign]


def drives() -> None:
    """Answer a short drive in several ways."""
    import whichroad
    from whichroad.simulate import draw_town, simulate_drive

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.osm"
        path.write_text(draw_town(), encoding="utf-8")
        roads = whichroad.RoadMap.from_osm(path)
    drive = simulate_drive(roads, seed=1, length_m=600.0).drive
    whichroad.match(drive, roads, lag="full")
    whichroad.match(replace(drive, odometry=None), roads, lag="full")
    whichroad.match(drive, roads, model="paper")


def _apart(mine: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference, relative where numbers are large; infinite for other integers."""
    if mine.dtype.fields is not None:
        return max(_apart(mine[name], theirs[name]) for name in mine.dtype.names or ())
    if mine.dtype.kind != "f":
        return 0.0 if np.array_equal(mine, theirs) else np.inf
    same = (mine == theirs) | (np.isnan(mine) & np.isnan(theirs))
    with np.errstate(invalid="ignore"):
        apart = np.abs(mine - theirs) / np.maximum(np.abs(mine), 1.0)
    return float(np.where(same, 0.0, apart).max(initial=0.0))


def main() -> None:
    """Capture, replay, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", type=Path)
    parser.add_argument("--system", type=Path, default=Path("/usr/aarch64-linux-gnu"))
    given = parser.parse_args()
    capture()
    drives()
    message = bytearray()
    for name, block, arrays, _ in CALLS:
        symbol = f"whichroad_{name}".encode()
        message += struct.pack("<qqq", len(symbol), len(block) // 8, len(arrays)) + symbol + block
        for place, before, _ in arrays:
            message += struct.pack("<qq", place, before.nbytes) + before.tobytes()
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "replay"
        subprocess.run(
            [sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-gnu.2.17",
             str(HERE / "replay.c"), "-o", str(program), "-ldl"], check=True,
        )  # fmt: skip
        said = subprocess.run(
            ["qemu-aarch64", "-L", str(given.system), str(program), str(given.library.resolve())],
            input=bytes(message), stdout=subprocess.PIPE, check=True,
        ).stdout  # fmt: skip
    at, worst = 0, dict.fromkeys((name for name, *_ in CALLS), 0.0)
    for name, block, arrays, _ in CALLS:
        at += len(block)
        for _, before, after in arrays:
            theirs = np.frombuffer(said, after.dtype, after.size, at).reshape(after.shape)
            at += before.nbytes
            worst[name] = max(worst[name], _apart(after, theirs))
    for name, apart in sorted(worst.items()):
        count = sum(one[0] == name for one in CALLS)
        print(f"{name}: {count} calls, largest difference {apart:.1e}")
    if max(worst.values()) > 1e-9:
        raise SystemExit("more than 1e-9 apart")


if __name__ == "__main__":
    main()
