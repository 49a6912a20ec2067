"""Kernels to objects, by numba and LLVM.

This module, `outer` and `inner` are the only ones that know numba's inside.

Runs in a process of its own (`python -m whichroad.native.lower`), so that what it sets
touches nobody else, and two of them can run beside each other.
"""

import gc
import importlib
import json
import os
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core.errors import NumbaError
from numba.np import arrayobj as _arrayobj

from .inner import Inner
from .outer import WORDS, outer, types

njit: Any = numba.njit  # these have no types, or not all of them
arrayobj: Any = _arrayobj

_SELDOM = (100_000, 50, 100)  # garbage collection: numba's objects live on, and there are millions
PLAIN = "plain"  # argument: by public functions of numba alone


_SHIM = """
define i32 @whichroad_{name}(ptr %block) {{
  %result = alloca ptr
  %exception = alloca ptr
  %status = call i32 @"{callee}"(ptr %result, ptr %exception, ptr %block)
  ret i32 %status
}}
declare i32 @"{callee}"(ptr, ptr, ptr)
@whichroad_layout_{name} = constant i64 {checksum}
"""


_SOURCE = """
@whichroad_source = constant [{length} x i8] c"{digest}\\00"
"""


class _Collector:
    """Modules as numba lowers them, each once, instead of each with all that it calls.

    numba links into every function all functions that it calls, optimises them and emits
    machine code: two thirds of the time, and not wanted here.  What is replaced is not public;
    where it is missing, or what comes out is not whole, an error says so, and all is lowered
    by public functions.
    """

    def __init__(self) -> None:
        from numba.core.codegen import CPUCodeLibrary
        from numba.core.cpu import CPUContext
        from numba.core.targetconfig import TargetConfig

        self._modules: list[Any] = []
        defaults: dict[type, dict[str, Any]] = {}

        def finalize(library: Any) -> None:
            library._finalized = True
            self._modules.append(library._final_module)
            _print_line(f"lowered {library.name}")

        def get_executable(context: Any, library: Any, fndesc: Any, env: Any) -> Any:
            library._ensure_finalized()
            return [].append  # a builtin of its own: by it numba knows the function

        def values(config: Any) -> dict[str, Any]:
            if type(config) not in defaults:
                defaults[type(config)] = {k: one.default for k, one in config.options.items()}
            return {**defaults[type(config)], **config._values}

        for owner, function in (
            (CPUCodeLibrary, finalize), (CPUContext, get_executable), (TargetConfig, values),
        ):  # fmt: skip
            if function.__name__ not in vars(owner):
                raise AttributeError(f"{owner.__name__} has no {function.__name__}")
            setattr(owner, function.__name__, function)
        setattr(CPUCodeLibrary, "_optimize_functions", lambda library, module: None)  # noqa: B010

    def linked(self) -> Any:
        """All of them in one."""
        whole, *others = (module.clone() for module in self._modules)
        for module in others:
            whole.link_in(module)
        for function in whole.functions:
            if function.is_declaration and function.name.startswith("_ZN"):
                raise RuntimeError(f"{function.name} has no body")
        return whole


def _index_as_it_is() -> None:
    """Let numba take an index as it stands: no kernel counts from the end of an array.

    Else each access to an element first adds the length to the index, should it be negative.
    """

    def index(context: Any, builder: Any, known: Any, value: Any, size: Any) -> Any:
        return context.cast(builder, value, known, types.intp)

    if hasattr(arrayobj, "fix_integer_index"):  # not public; without it, code is slower
        arrayobj.fix_integer_index = index


def _one_overload() -> None:
    """Let a kernel be lowered once, for numbers of the usual sizes, whoever calls it.

    Else numba lowers it anew for each constant that a caller has for an argument, and for indices
    of 32 bits beside those of 64: each sixth function.
    """

    def general(known: Any) -> Any:
        known = types.unliteral(known)
        return types.int64 if isinstance(known, types.Integer) else known

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        wide = {name: general(known) for name, known in kws.items()}
        return usual(self, context, tuple(general(known) for known in args), wide)

    usual: Any = getattr(types.Dispatcher, "get_call_type", None)  # not public; else more work
    if usual is not None:
        types.Dispatcher.get_call_type = get_call_type


def lower(
    names: Iterable[str], collect: bool, inner: Iterable[str] = (), elsewhere: Iterable[str] = ()
) -> Any:
    """The module of some entries: these are what it shows, all else is internal.

    Args:
        names: Of entries whose modules are imported.
        collect: Each function once, by replacing parts of numba; else by public functions
            alone, which takes three times as long.
        inner: Kernels that it has for another module, as `Inner` takes them.
        elsewhere: Kernels of another module that it may call; where not collected, it has them
            itself.

    Returns:
        LLVM's module, for any machine.
    """
    from .. import _compile

    collector = _Collector() if collect else None
    _index_as_it_is()
    _one_overload()
    _compile.teach_numba()
    shims, modules, shown = [], [], {}
    if collector is not None:
        for path in elsewhere:
            Inner(path).declare()
    for path in inner:
        one = Inner(path)
        shown[one.define()] = one.symbol
        if collector is None:
            modules.append(llvm.parse_assembly(one.dispatcher.inspect_llvm(one.arguments)))
    for name in names:
        layout = _compile.entries()[name].layout
        compiled = njit((WORDS,), **_compile.OPTIONS)(outer(layout, _compile.entries()[name]))
        signature = compiled.signatures[0]
        callee = compiled.overloads[signature].fndesc.llvm_func_name
        shims.append(_SHIM.format(name=name, callee=callee, checksum=layout.checksum()))
        if collector is None:
            _print_line(f"lowered {name}")
            module = llvm.parse_assembly(compiled.inspect_llvm(signature))
            for one in module.functions:
                if not one.is_declaration and one.name != callee:
                    one.linkage = "linkonce_odr"
            modules.append(module)
    if collector is not None:
        modules.append(collector.linked())
    whole, *others = (llvm.parse_assembly(_portable(str(module))) for module in modules)
    for module in (*others, *map(llvm.parse_assembly, shims)):
        whole.link_in(module)
    for value in (*whole.functions, *whole.global_variables):
        if value.name in shown:
            value.name, value.visibility = shown[value.name], "hidden"
        elif not value.is_declaration and not value.name.startswith("whichroad_"):
            value.linkage = "internal"
    return whole


def _portable(code: str) -> str:
    """Without what says for which machine it is: the same code serves all."""
    kept = [
        line for line in code.splitlines()
        if not line.startswith(("target triple", "target datalayout"))
    ]  # fmt: skip
    return "\n".join(kept)


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
    before = llvm.newpassmanagers.ModulePassManager()
    before.add_global_dead_code_eliminate_pass()
    before.run(own, builder)
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
    begin = time.process_time()
    try:
        inner, elsewhere = ((), job["inner"])[:: -1 if job["others"] else 1]
        lowered = lower(names, PLAIN not in arguments, inner, elsewhere)
    except Exception as error:
        if PLAIN in arguments or isinstance(error, NumbaError):  # a kernel that is wrong
            raise
        _print_line(f"lowering again by public functions alone, because of {error!r}")
        again = [sys.executable, "-m", "whichroad.native.lower", *arguments, PLAIN]
        os.execv(sys.executable, again)
    _print_line(f"seconds {time.process_time() - begin:.1f} of CPU to lower")
    if not job["others"]:
        lowered.link_in(
            llvm.parse_assembly(_SOURCE.format(digest=job["source"], length=len(job["source"]) + 1))
        )
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
