"""Kernels to objects, by numba and LLVM: the only module that knows numba's inside.

Runs in a process of its own (`python -m whichroad.native.lower`), so that what it sets
touches nobody else, and two of them can run beside each other.
"""

import importlib
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj
from numba.np.numpy_support import from_dtype

from .layout import Array, Fields, Kind, Layout

_WORDS = types.CPointer(types.int64)
OPTIONS = {
    "error_model": "numpy", "nogil": True, "_nrt": False,
    "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
}  # fmt: skip


def numba_type(kind: Kind) -> Any:
    """The type by which numba knows it."""
    if isinstance(kind, Fields):
        parts = [numba_type(one) for one in kind.types]
        return types.NamedTuple(parts, kind.make) if isinstance(kind.make, type) else (
            types.Tuple(parts)
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
        numba = numba_type(kind)
        if isinstance(kind, Fields):
            return context.make_tuple(builder, numba, [self.load(one) for one in kind.types])
        if isinstance(kind, Array):
            word = builder.load(self._next())
            if not kind.ndim:
                return builder.inttoptr(word, context.get_value_type(numba))
            shape = [builder.load(self._next()) for _ in range(kind.ndim)]
            strides = [context.get_constant(types.intp, kind.dtype.itemsize)]
            for length in shape[:0:-1]:
                strides.insert(0, builder.mul(strides[0], length))
            array = arrayobj.make_array(numba)(context, builder)
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
        context, builder = self.context, self.builder
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

    @intrinsic
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

    result = numba_type(layout.result)
    at = min(leaf.at for leaf in layout.leaves() if leaf.path.split(".")[0] == "result")

    @intrinsic
    def store(typing_context: Any, block: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            words = _Words(context, builder, args[0])
            words.at = at
            words.store(layout.result, context.cast(builder, args[1], value, result))
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


class Collected:
    """Modules as numba lowers them, each once, instead of each with all that it calls.

    numba links into every function all functions that it calls, optimises it and emits machine
    code, which takes two thirds of the time and is not wanted here.  What is replaced is not
    public: where it is missing, `Collected` says so and the slower, public way is gone.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        from numba.core import codegen, cpu, targetconfig

        self.modules: list[Any] = []
        library, context = codegen.CPUCodeLibrary, cpu.CPUContext
        config = targetconfig.TargetConfig
        for owner, name in (
            (library, "finalize"), (library, "_optimize_functions"), (library, "_final_module"),
            (context, "get_executable"), (config, "values"),
        ):  # fmt: skip
            if name != "_final_module" and not callable(getattr(owner, name, None)):
                raise AttributeError(f"numba has no {owner.__name__}.{name}")
        defaults: dict[type, dict[str, Any]] = {}

        def finalize(self_: Any) -> None:
            self_._finalized = True
            self.modules.append(self_._final_module)
            tell(self_.name)

        def get_executable(self_: Any, library: Any, fndesc: Any, env: Any) -> Any:
            library._ensure_finalized()
            return [].append  # some builtin of its own: numba's key of this function

        def values(self_: Any) -> dict[str, Any]:
            if type(self_) not in defaults:
                defaults[type(self_)] = {k: one.default for k, one in self_.options.items()}
            return {**defaults[type(self_)], **self_._values}

        library.finalize = finalize  # type: ignore[method-assign]
        library._optimize_functions = lambda self_, module: None  # type: ignore[method-assign]
        context.get_executable = get_executable  # type: ignore[method-assign]
        config.values = values  # type: ignore[method-assign]

    def linked(self) -> Any:
        """All of them in one."""
        first, *others = (module.clone() for module in self.modules)
        for module in others:
            first.link_in(module)
        missing = [
            f.name for f in first.functions if f.is_declaration and f.name.startswith("_ZN")
        ]
        if missing:
            raise RuntimeError(f"functions without a body: {missing[:3]}")
        return first


def lower(names: Iterable[str], tell: Callable[[str], None], plain: bool = False) -> Any:
    """The module of some entries: theirs is what it shows, all else is internal.

    Args:
        names: Of entries whose modules are imported.
        tell: Told of each function that is lowered.
        plain: By public functions of numba alone, which takes longer.
    """
    from .. import _compile

    collected = None if plain else Collected(tell)
    _compile.teach_numba(no_cpython_wrapper=True, no_cfunc_wrapper=True)
    shims, whole = [], None
    for name in names:
        entry = _compile.entries()[name]
        compiled = njit((_WORDS,), **OPTIONS)(outer(entry.layout, entry))
        signature = compiled.signatures[0]
        callee = compiled.overloads[signature].fndesc.llvm_func_name
        shims.append(
            _SHIM.format(name=name, callee=callee, checksum=entry.layout.checksum())
        )
        if collected is None:
            tell(name)
            module = llvm.parse_assembly(_portable(compiled.inspect_llvm(signature)))
            for function in module.functions:
                if not function.is_declaration:
                    function.linkage = "linkonce_odr"
            if whole is None:
                whole = module
            else:
                whole.link_in(module)
    if collected is not None:
        whole = collected.linked()
    whole = llvm.parse_assembly(_portable(str(whole)))
    for shim in shims:
        whole.link_in(llvm.parse_assembly(shim))
    for one in (*whole.functions, *whole.global_variables):
        if not one.is_declaration and not one.name.startswith("whichroad_"):
            one.linkage = "internal"
    _without_counting(whole)
    return whole


def _portable(code: str) -> str:
    """Without what says for which machine it is: the same code serves all."""
    kept = [
        line for line in code.splitlines()
        if not line.startswith(("target triple", "target datalayout"))
    ]  # fmt: skip
    return "\n".join(kept)


def _without_counting(module: Any) -> None:
    """Reference counts are of arrays that own something; here none does."""
    for name in ("NRT_incref", "NRT_decref"):
        for function in module.functions:
            if function.name == name and function.is_declaration:
                raise RuntimeError(f"{name} is called, and defined nowhere")


class Target(dict[str, str]):
    """How LLVM names a platform."""


TRIPLES = {
    "linux-x86_64": ("x86_64-unknown-linux-gnu", "x86-64-v2"),
    "linux-aarch64": ("aarch64-unknown-linux-gnu", "generic"),
    "macos-arm64": ("arm64-apple-macosx11.0.0", "apple-m1"),
    "windows-x86_64": ("x86_64-pc-windows-gnu", "x86-64-v2"),
}


def emit(module: Any, target: str, level: int) -> bytes:
    """Optimised machine code of a module, an object file.

    Args:
        module: Of `lower`; it is not changed.
        target: A platform.
        level: 0 to 3.
    """
    triple, cpu = TRIPLES[target]
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=cpu, opt=min(level, 2), reloc="pic", codemodel="default"
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
    """Lower and emit some entries: a job as JSON, told as lines of text."""
    job = json.loads(arguments[0])
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    for module in job["modules"]:
        importlib.import_module(module)

    def tell(what: str) -> None:
        print("lowered", what, flush=True)

    begin = time.process_time()
    lowered = lower(job["entries"], tell, plain=job["plain"])
    print("seconds lowering", round(time.process_time() - begin, 1), flush=True)
    for target, path in job["objects"].items():
        begin = time.process_time()
        Path(path).write_bytes(emit(lowered, target, job["level"]))
        print("seconds", target, round(time.process_time() - begin, 1), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
