"""What one process lowers and the other calls: a kernel by a name that both know."""

import importlib
from typing import Any

from numba.core import compiler as _compiler
from numba.core import funcdesc as _funcdesc

from .layout import Layout
from .outer import numba_type, types

compiler: Any = _compiler  # these have no types
funcdesc: Any = _funcdesc


class Inner:
    """A kernel that one process lowers and the other calls: by a name that both know.

    Args:
        path: "module:function" of a kernel whose annotations are complete, as an entry's are.
    """

    def __init__(self, path: str) -> None:
        module, _, name = path.partition(":")
        function = getattr(importlib.import_module(module), name)
        function = getattr(function, "function", function)  # of an entry
        layout = Layout.of(function)
        self.symbol = f"whichroad_inner_{layout.name}"
        self.dispatcher = function._dispatcher
        self.arguments = tuple(numba_type(kind) for kind in layout.arguments.values())
        self.result = types.none if layout.result is None else numba_type(layout.result)

    def declare(self) -> None:
        """Let callers call it, though it has no body here."""
        target = self.dispatcher.targetdescr
        described = funcdesc.ExternalFunctionDescriptor(self.symbol, self.result, self.arguments)
        function: Any = [].append  # a builtin of its own: by it numba knows the function
        target.target_context.insert_user_function(function, described)
        self.dispatcher.overloads[self.arguments] = compiler.compile_result(
            signature=self.result(*self.arguments), entry_point=function, objectmode=False,
            fndesc=described, typing_context=target.typing_context,
            target_context=target.target_context,
        )  # fmt: skip
        self.dispatcher._can_compile = False

    def define(self) -> str:
        """Compile it; the name by which LLVM knows it.

        Raises:
            TypeError: It gives what its annotations do not say.
        """
        self.dispatcher.compile(self.arguments)
        made = self.dispatcher.overloads[self.arguments]
        if made.signature.return_type != self.result:
            raise TypeError(
                f"{self.symbol}: gives {made.signature.return_type}; {self.result} was expected"
            )
        return str(made.fndesc.llvm_func_name)
