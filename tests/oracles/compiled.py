"""Kernels that are no entries, compiled for tests that call them many times."""

import ctypes
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from whichroad import _compile
from whichroad.native import cache, library
from whichroad.native.layout import Layout

P = ParamSpec("P")
R = TypeVar("R")

_LEVEL = 1  # of optimisation: what is called a thousand times is not worth more
_ENGINES: list[object] = []  # what holds the machine code


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel as Python calls it, compiled at its first call by whatever runs the entries.

    numba takes ten times as long as the package's own compiler.

    Args:
        function: The kernel, annotated as an entry is.
    """
    made: list[Callable[P, R]] = []

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if not made:
            ways = {"native": _natively, "jit": _compile.jit, "python": lambda one: one}
            made.append(ways[_compile.kernel_mode()](function))
        return made[0](*args, **kwargs)

    return call


def _natively(function: Callable[P, R]) -> Callable[P, R]:
    """By the package's compiler, in this process; by numba where that is not installed."""
    try:
        import llvmlite.binding as llvm
    except ImportError:
        return _compile.jit(function)
    from whichroad.native.compiler.module import Module
    from whichroad.native.lower import TRIPLES

    layout = Layout.of(function)
    module = Module(_compile.kernels(), _compile.operations())
    module.entry(layout, function)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    triple, processor = TRIPLES[cache.own_target()]
    machine = llvm.Target.from_triple(triple).create_target_machine(
        cpu=(*cache.processors(), processor)[0], opt=_LEVEL, codemodel="jitdefault"
    )
    code = llvm.parse_assembly(module.text([layout.name], []))
    code.triple, code.data_layout = triple, str(machine.target_data)
    tuning = llvm.create_pipeline_tuning_options(speed_level=_LEVEL)
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(code, builder)
    engine = llvm.create_mcjit_compiler(code, machine)
    engine.finalize_object()
    _ENGINES.append(engine)
    address = engine.get_function_address(f"whichroad_{layout.name}")
    return library.Call(layout, ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)(address))
