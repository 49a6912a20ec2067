"""Kernels to objects: compiled to LLVM's code by `compiler`, to machine code by LLVM.

Runs in a process of its own (`python -m whichroad.native.lower`), so that two of them can run
beside each other.
"""

import gc
import importlib
import json
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from .compiler.module import Module

_SELDOM = (100_000, 50, 100)  # garbage collection: what is made lives on

_SOURCE = """
@whichroad_source = constant [{length} x i8] c"{digest}\\00"
"""
_MARK = """
@whichroad_layout_{name} = constant i64 {checksum}
"""


def lower(entries: Iterable[str], shared: Iterable[str], own: Iterable[str], more: str = "") -> Any:
    """The module of some entries: these are what it shows, all else is internal.

    Args:
        entries: Their names; their modules are imported.
        shared: Kernels that stand in one of several modules, each as "module:function".
        own: Those that stand in this one.
        more: LLVM's code of what else it shows.

    Returns:
        LLVM's module, for any machine.
    """
    from .. import _compile

    made = Module(
        _compile.kernels(), _compile.operations(), map(_function_of, shared),
        lambda name: _print_line(f"lowered {name}"),
    )  # fmt: skip
    for one in _compile.entries().values():
        made.entry(one.layout, one.function)
    names = list(entries)
    marks = [
        _MARK.format(name=name, checksum=_compile.entries()[name].layout.checksum())
        for name in names
    ]
    whole = llvm.parse_assembly(made.text(names, map(_function_of, own)) + "".join(marks) + more)
    whole.verify()
    return whole


def _function_of(path: str) -> Any:
    module, _, name = path.partition(":")
    found = getattr(importlib.import_module(module), name)
    return getattr(found, "function", found)  # of an entry


TRIPLES = {
    "linux-x86_64": ("x86_64-unknown-linux-gnu", "x86-64-v2"),
    "linux-aarch64": ("aarch64-unknown-linux-gnu", "generic"),
    "macos-arm64": ("arm64-apple-macosx11.0.0", "apple-m1"),
    "windows-x86_64": ("x86_64-pc-windows-gnu", "x86-64-v2"),
}


def emit(module: Any, target: str, level: int, processor: str = "") -> bytes:
    """Optimised machine code of a module, an object file.

    Args:
        module: Of `lower`; it is not changed.
        target: A platform.
        level: 0 to 3.
        processor: As LLVM calls it; nothing: the one that all machines of the platform run.
    """
    triple, usual = TRIPLES[target]
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=processor or usual, opt=min(level, 2), reloc="pic", codemodel="default"
    )
    own = module.clone()
    own.triple, own.data_layout = triple, str(machine.target_data)
    tuning = llvm.create_pipeline_tuning_options(speed_level=level)
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(own, builder)
    return machine.emit_object(own)  # type: ignore[no-any-return]


def main(arguments: Sequence[str]) -> None:
    """Lower and emit some entries: a job as JSON; progress is printed as lines of text."""
    from .. import _compile

    gc.set_threshold(*_SELDOM)
    job = json.loads(arguments[0])
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    for module in job["modules"]:
        importlib.import_module(module)
    first = [name for name in job["entries"] if name in _compile.entries()]
    names = [name for name in _compile.entries() if name not in first] if job["others"] else first
    source = _SOURCE.format(digest=job["source"], length=len(job["source"]) + 1)
    begin = time.process_time()
    own, more = (job["shared"], "") if job["others"] else ((), source)
    lowered = lower(names, job["shared"], own, more)
    _print_line(f"seconds {time.process_time() - begin:.1f} of CPU to lower")
    for target, path in job["objects"].items():
        begin = time.process_time()
        processor = job.get("processor", "")
        Path(path).write_bytes(emit(lowered, target, job["level"], processor))
        _print_line(f"emitted {target} in {time.process_time() - begin:.1f} s of CPU")


def _print_line(line: str) -> None:
    """Print a line for the process that waits."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
