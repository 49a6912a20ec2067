"""Kernels to objects, by numba and LLVM: the only module that knows numba's inside.

Runs in a process of its own (`python -m whichroad.native.lower`), so that what it sets
touches nobody else, and two of them can run beside each other.
"""

import gc
import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from numba import types as _types
from numba.core import cgutils as _cgutils
from numba.core.errors import NumbaError
from numba.extending import intrinsic as _intrinsic
from numba.np import arrayobj as _arrayobj
from numba.np.numpy_support import from_dtype

from .layout import Array, Fields, Kind, Layout

njit: Any = numba.njit  # these have no types, or not all of them
types: Any = _types
cgutils: Any = _cgutils
intrinsic: Any = _intrinsic
arrayobj: Any = _arrayobj

_SELDOM = (100_000, 50, 100)  # garbage collection: numba's objects live on, and there are millions
PLAIN = "plain"  # argument: by public functions of numba alone
_WORDS = types.CPointer(types.int64)


def numba_type(kind: Kind) -> Any:
    """The type by which numba knows it."""
    if isinstance(kind, Fields):
        parts = [numba_type(one) for one in kind.types]
        return (
            types.NamedTuple(parts, kind.make)
            if isinstance(kind.make, type)
            else (types.Tuple(parts))
        )
    if isinstance(kind, Array):
        dtype = from_dtype(kind.dtype)
        return types.Array(dtype, kind.ndim, "C") if kind.ndim else dtype
    return {int: types.int64, float: types.float64, bool: types.boolean}[kind]


class _Words:
    """Reads and writes a block's words one behind the other, as code."""

    def __init__(self, context: Any, builder: Any, block: Any) -> None:
        self.context, self.builder, self.block, self.at = context, builder, block, 0

    def _next(self) -> Any:
        at = self.context.get_constant(types.intp, self.at)
        self.at += 1
        return self.builder.gep(self.block, [at])

    def load(self, kind: Kind) -> Any:
        context, builder = self.context, self.builder
        known = numba_type(kind)
        if isinstance(kind, Fields):
            return context.make_tuple(builder, known, [self.load(one) for one in kind.types])
        if isinstance(kind, Array):
            word = builder.load(self._next())
            if not kind.ndim:
                return builder.inttoptr(word, context.get_value_type(known))
            shape = [builder.load(self._next()) for _ in range(kind.ndim)]
            strides = [context.get_constant(types.intp, kind.dtype.itemsize)]
            for length in shape[:0:-1]:
                strides.insert(0, builder.mul(strides[0], length))
            array = arrayobj.make_array(known)(context, builder)
            arrayobj.populate_array(
                array, data=builder.inttoptr(word, array.data.type), shape=shape,
                strides=strides, itemsize=context.get_constant(types.intp, kind.dtype.itemsize),
                meminfo=None,
            )  # fmt: skip
            return array._getvalue()
        place = self._next()
        if kind is float:
            pointer = context.get_value_type(types.float64).as_pointer()
            return builder.load(builder.bitcast(place, pointer))
        word = builder.load(place)
        return cgutils.is_not_null(builder, word) if kind is bool else word

    def store(self, kind: Kind, value: Any) -> None:
        builder = self.builder
        if isinstance(kind, Fields):
            for k, one in enumerate(kind.types):
                self.store(one, builder.extract_value(value, k))
            return
        place = self._next()
        if kind is float:
            place = builder.bitcast(place, value.type.as_pointer())
        elif kind is bool:
            value = builder.zext(value, place.type.pointee)
        builder.store(value, place)


def outer(layout: Layout, kernel: Any) -> Callable[[Any], None]:
    """The function of one block that calls a kernel."""
    arguments = types.Tuple([numba_type(kind) for kind in layout.arguments.values()])

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typing_context: Any, block: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            words = _Words(context, builder, args[0])
            values = [words.load(kind) for kind in layout.arguments.values()]
            return context.make_tuple(builder, arguments, values)

        return arguments(_WORDS), generate

    if layout.result is None:

        def call(block: Any) -> None:
            kernel(*load(block))

        return call

    kind, result = layout.result, numba_type(layout.result)
    at = min(leaf.at for leaf in layout.leaves() if leaf.is_result)

    @intrinsic  # type: ignore[untyped-decorator]
    def store(typing_context: Any, block: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            words = _Words(context, builder, args[0])
            words.at = at
            words.store(kind, context.cast(builder, args[1], value, result))
            return context.get_dummy_value()

        return types.void(_WORDS, value), generate

    def call_and_store(block: Any) -> None:
        store(block, kernel(*load(block)))

    return call_and_store


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


def lower(names: Iterable[str], collect: bool) -> Any:
    """The module of some entries: these are what it shows, all else is internal.

    Args:
        names: Of entries whose modules are imported.
        collect: Each function once, by replacing parts of numba; else by public functions
            alone, which takes three times as long.

    Returns:
        LLVM's module, for any machine.
    """
    from .. import _compile

    collector = _Collector() if collect else None
    _index_as_it_is()
    _compile.teach_numba()
    shims, modules = [], []
    for name in names:
        layout = _compile.entries()[name].layout
        compiled = njit((_WORDS,), **_compile.OPTIONS)(outer(layout, _compile.entries()[name]))
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
    for one in (*whole.functions, *whole.global_variables):
        if not one.is_declaration and not one.name.startswith("whichroad_"):
            one.linkage = "internal"
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
        lowered = lower(names, collect=PLAIN not in arguments)
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
