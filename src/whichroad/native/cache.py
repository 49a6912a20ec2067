"""Where compiled kernels are kept, and the digests that they are found by."""

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import platform
import shutil
import sys
import tempfile
import time
from pathlib import Path

PACKAGE = Path(__file__).parent.parent
KERNELS = (
    "filter/**/*.py",
    "graph/*.py",
    "geodesy/kernels.py",
    "roadmap/topology.py",
)  # files that hold kernels, from the package's folder
_COMPILER = (
    "_compile.py",
    "native/compiler/*.py",
    "native/layout.py",
    "native/lower.py",
)  # also change what comes out
_BY_NUMBA = ("simulate/vectorised/*.py", "native/rows.py", "native/ahead.py")  # never ahead of time
TOOLS = ("llvmlite",)
_V3 = "avx avx2 bmi1 bmi2 f16c fma abm movbe xsave"
_PROCESSORS = {  # better than those that wheels are for, best first: by what flags Linux tells them
    "x86-64-v4": f"{_V3} avx512f avx512bw avx512cd avx512dq avx512vl",
    "x86-64-v3": _V3,
}

_KEEP_DAYS = 30


def kernel_files(package: Path = PACKAGE) -> list[Path]:
    """Files that hold kernels."""
    return sorted(path for pattern in KERNELS for path in package.glob(pattern))


def kernel_modules() -> list[str]:
    """Names of the modules that hold kernels."""
    names = []
    for path in kernel_files():
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        names.append(".".join(parts).removesuffix(".__init__"))
    return names


def source_digest(package: Path = PACKAGE) -> str:
    """Digest of all that compiled code depends on in this package."""
    whole = hashlib.sha256()
    compiler = sorted(path for pattern in _COMPILER for path in package.glob(pattern))
    for path in [*kernel_files(package), *compiler]:
        text = path.read_bytes().replace(b"\r\n", b"\n")
        name = path.relative_to(package).as_posix().encode()
        whole.update(b"%s\0%d\0%s" % (name, len(text), text))
    return whole.hexdigest()[:24]


def tools_digest() -> str:
    """Digest of the compilers' versions; importing none of them."""
    versions = [f"{name} {importlib.metadata.version(name)}" for name in TOOLS]
    return hashlib.sha256("\n".join(versions).encode()).hexdigest()[:8]


def own_target() -> str:
    """This machine, as targets are called: "linux-x86_64"."""
    system = {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    return f"{system}-{'arm64' if (system, machine) == ('macos', 'aarch64') else machine}"


@functools.cache
def processors() -> tuple[str, ...]:
    """Kinds of processor whose code this machine runs, best first, beside what wheels hold."""
    try:
        lines = Path("/proc/cpuinfo").read_text("ascii", "replace").splitlines()
    except OSError:
        return ()
    flags = set(next((line for line in lines if line.startswith("flags")), "").split())
    return tuple(one for one, needed in _PROCESSORS.items() if flags >= set(needed.split()))


def processor_of(library: Path) -> str:
    """The kind of processor that a kept library is for; nothing: any of its platform."""
    return next((one for one in _PROCESSORS if f"-{one}-" in library.name), "")


def suffix(target: str) -> str:
    """Of a library's file."""
    return {"windows": ".dll", "macos": ".dylib"}.get(target.partition("-")[0], ".so")


def libraries(source: str, target: str) -> list[Path]:
    """Kept libraries of these kernels for that machine, by whatever tools.

    Those for the best processor come first, and of these the newest.
    """
    folder = cache_folder()
    if folder is None:
        return []
    kinds = [*processors(), ""]
    found = [
        path for path in folder.glob(f"{source}-*-{target}-*{suffix(target)}")
        if processor_of(path) in kinds
    ]  # fmt: skip
    return sorted(found, key=lambda path: (kinds.index(processor_of(path)), -path.stat().st_mtime))


@functools.cache
def cache_folder() -> Path | None:
    """First writable place for compiled kernels, or None: they are built anew each time."""
    bases = [os.environ.get("WHICHROAD_CACHE_DIR")]
    xdg = os.environ.get("XDG_CACHE_HOME")
    bases.append(f"{xdg}/whichroad" if xdg else None)
    with contextlib.suppress(RuntimeError):
        bases.append(str(Path.home() / ".cache" / "whichroad"))
    bases.append(str(Path(tempfile.gettempdir()) / f"whichroad-{getattr(os, 'getuid', int)()}"))
    for base in bases:
        if base and _writable(Path(base)):
            folder = Path(base) / "kernels"
            if not _writable(folder):
                return None
            _delete_stale(folder)
            return folder
    return None


@functools.cache
def jit_folder() -> Path | None:
    """Where numba keeps what it compiles of these very sources, or None.

    It stamps a kept function with its own file alone, so a callee that changed in another
    file would go on running as it was: the folder is named by all of them.
    """
    base = cache_folder()
    if base is None:
        return None
    more = sorted(path for pattern in _BY_NUMBA for path in PACKAGE.glob(pattern))
    text = source_digest() + "".join(path.read_text("utf-8") for path in more)
    folder = base / f"jit-{hashlib.sha256(text.encode()).hexdigest()[:24]}"
    return folder if _writable(folder) else None


def _writable(base: Path) -> bool:
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            return True
    except OSError:
        return False


def _delete_stale(folder: Path) -> None:
    """Delete what nobody has used for a month."""
    limit = time.time() - _KEEP_DAYS * 86400.0
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if path.stat().st_mtime < limit:
                if path.is_dir():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.unlink(missing_ok=True)
