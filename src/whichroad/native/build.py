"""Builds the library of all kernels: lowered by two processes, linked, kept in the cache."""

import contextlib
import importlib.util
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from . import cache, linking
from .linking import BuildError

Report = Callable[[float], None]  # called with the part that is done, 0 to 1

LEVEL = 3  # of optimisation
# What `run` contains, by one process; all else by the other, in about the same time.
_FIRST = (
    "run", "localize_each", "reduce", "observe_map", "cold_start", "normalise",
)  # fmt: skip
# Of what `run` contains the other has these: called once an epoch or less, long to optimise.
_SHARED = (
    "whichroad.filter.sparse.routing:transit", "whichroad.filter.summary.estimate:describe",
    "whichroad.filter.evidence.observe:observe_evidence", "whichroad.filter.step:_observe_gnss",
)  # fmt: skip
_FUNCTIONS = 1200  # that are lowered, both processes together, about; for the progress
_LOWERING = 0.3  # share of the time


def why_not() -> str | None:
    """What is missing to build here, in one sentence; None: nothing.  Takes no second."""
    if (missing := _no_compiler("llvmlite")) is not None:
        return missing
    target = cache.own_target()
    if target not in linking.TARGETS:
        return (
            f"kernels: this machine is {target}; one of {', '.join(linking.TARGETS)} was "
            "expected for a library; WHICHROAD_KERNELS=jit compiles at each first call instead"
        )
    if linking.linker(target, portable=False) is None:
        return (
            "kernels: no C compiler that can link, and no ziglang; one was expected to link the "
            "compiled kernels; pip install ziglang, or install gcc or clang"
        )
    return None


def _no_compiler(packages: str) -> str | None:
    """What is missing to compile, with the packages to install; None: nothing."""
    if importlib.util.find_spec("llvmlite") is not None:
        return None
    return (
        "kernels: llvmlite is not installed; it was expected, to compile kernels that no wheel and "
        f"no cache holds; pip install {packages}"
    )


def kept() -> Path | None:
    """A library for this machine and these sources that an earlier build left."""
    found = cache.libraries(cache.source_digest(), cache.own_target())
    return found[0] if found else None


def own_library(report: Report = lambda share: None) -> Path:
    """The library for this machine: a kept one, or built and kept.

    Args:
        report: Called with the part that is done.

    Returns:
        Its path.

    Raises:
        BuildError: It cannot be built here.
    """
    target = cache.own_target()
    if (found := kept()) is not None:
        return _used(found)
    if (missing := why_not()) is not None:
        raise BuildError(missing)
    return build([target], portable=False, report=report)[target]


def _used(path: Path) -> Path:
    """A kept file whose age counts from now."""
    with contextlib.suppress(OSError):
        os.utime(path)
    return path


def build(
    targets: Sequence[str], *, portable: bool, report: Report = lambda share: None
) -> dict[str, Path]:
    """Libraries for some machines, kept in the cache; what is there already is not built.

    Args:
        targets: Machines.
        portable: Linked for the oldest systems that are served, by zig.
        report: Called with the part that is done.

    Returns:
        The library of each.

    Raises:
        BuildError: A tool is missing or failed.
    """
    if (missing := _no_compiler("llvmlite ziglang" if portable else "llvmlite")) is not None:
        raise BuildError(missing)
    source, tools = cache.source_digest(), cache.tools_digest()
    kept = cache.cache_folder() or Path(tempfile.mkdtemp(prefix="whichroad-kernels-"))
    processor = "" if portable else (*cache.processors(), "")[0]
    kind = "portable" if portable else processor or "own"

    def place(target: str) -> Path:
        return kept / f"{source}-{tools}-{target}-{kind}-O{LEVEL}{cache.suffix(target)}"

    with _locked(kept / f"{source}.lock"):
        wanted = [target for target in targets if not place(target).exists()]
        if wanted:
            linkers = {target: linking.linker(target, portable) for target in wanted}
            if any(command is None for command in linkers.values()):
                raise BuildError(
                    f"kernels: ziglang is not installed; it was expected to link for "
                    f"{', '.join(wanted)}; pip install ziglang"
                )
            with tempfile.TemporaryDirectory(prefix="whichroad-kernels-") as folder:
                objects = _objects(wanted, Path(folder), (source, processor), report)
                for target in wanted:
                    made = Path(folder) / f"made{cache.suffix(target)}"
                    linking.link(linkers[target] or [], target, objects[target], made)
                    _install(made, place(target))
    report(1.0)
    return {target: _used(place(target)) for target in targets}


def _install(made: Path, place: Path) -> None:
    """Put a file in its place at once, whoever else does the same."""
    part = place.with_name(f".{place.name}.{os.getpid()}")
    shutil.copyfile(made, part)
    part.chmod(0o755)
    part.replace(place)


def _objects(
    targets: Sequence[str], folder: Path, what: tuple[str, str], report: Report
) -> dict[str, list[Path]]:
    """Object files of all kernels for each machine, by two processes.

    Args:
        targets: Machines.
        folder: Where they go.
        what: Digest of the sources, and the kind of processor; nothing: any of a machine.
        report: Called with the part that is done.
    """
    objects = {t: [folder / f"{t}-{part}.o" for part in "ab"] for t in targets}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    jobs = [
        json.dumps({
            "modules": cache.kernel_modules(), "entries": _FIRST, "others": part == "b",
            "shared": _SHARED, "source": what[0], "processor": what[1], "level": LEVEL,
            "objects": {target: str(objects[target]["ab".index(part)]) for target in targets},
        })
        for part in "ab"
    ]  # fmt: skip
    lines: queue.Queue[tuple[int, str | None]] = queue.Queue()
    printed: list[list[str]] = [[] for _ in jobs]

    def listen(number: int, output: Iterable[str]) -> None:
        for line in output:
            lines.put((number, line.rstrip()))
        lines.put((number, None))

    with contextlib.ExitStack() as stack:
        running = [
            stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-m", "whichroad.native.lower", job], env=environment,
                    text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=folder,
                )
            )
            for job in jobs
        ]  # fmt: skip
        try:
            for number, process in enumerate(running):
                threading.Thread(target=listen, args=(number, process.stdout), daemon=True).start()
            _wait(lines, printed, len(running), len(targets), report)
        except BaseException:
            for process in running:
                process.kill()
            raise
    for process, text in zip(running, printed, strict=True):
        if process.returncode:
            last = next((line for line in reversed(text) if line.strip()), "nothing")
            raise BuildError(
                f"kernels: compiling them failed: {last}; a newer or older llvmlite may do; "
                f"what {' and '.join(cache.TOOLS)} said: {' | '.join(text[-12:])}"
            )
    return objects


def _wait(
    lines: "queue.Queue[tuple[int, str | None]]", printed: list[list[str]], processes: int,
    targets: int, report: Report,
) -> None:  # fmt: skip
    """Read what processes say until all have ended."""
    ended = lowered = emitted = 0
    while ended < processes:
        number, line = lines.get()
        if line is None:
            ended += 1
        elif line.startswith("lowered "):
            lowered += 1
        elif line.startswith("emitted "):
            emitted += 1
        else:
            printed[number].append(line)
        report(
            _LOWERING * min(lowered / _FUNCTIONS, 1.0)
            + (0.99 - _LOWERING) * emitted / (processes * targets)
        )


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """One build at a time, where the system can lock files."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with open(path, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
