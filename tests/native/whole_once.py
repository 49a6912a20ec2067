"""numba in less time: what an entry contains is optimised with it, and not also by itself."""

from typing import Any


def optimise_entries_only() -> None:
    """Compile no kernel that only kernels call, but link it into the entries that contain it.

    numba optimises every function with all that it calls, and makes machine code of it, which
    nobody runs where only kernels call it.  Typing, lowering, linking, optimising and running of
    entries stay numba's own.  What is replaced is not public: where a name is missing, numba is
    left as it is, which takes longer.
    """
    from numba.core.codegen import CPUCodeLibrary
    from numba.core.cpu import CPUContext
    from numba.core.targetconfig import TargetConfig

    names = (
        (CPUCodeLibrary, "finalize"), (CPUCodeLibrary, "_optimize_functions"),
        (CPUContext, "get_executable"), (TargetConfig, "values"),
    )  # fmt: skip
    if not all(name in vars(owner) for owner, name in names):
        return
    defaults: dict[type, dict[str, Any]] = {}
    whole: Any = CPUCodeLibrary.finalize
    executable: Any = CPUContext.get_executable

    def finalize(library: Any) -> None:
        if _is_called_from_python(library):
            library._linking_libraries = _callers_first(library)
            whole(library)
        library._finalized = True

    def get_executable(context: Any, library: Any, fndesc: Any, env: Any) -> Any:
        library._ensure_finalized()
        if _is_called_from_python(library):
            return executable(context, library, fndesc, env)
        return [].append  # a builtin of its own: by it numba knows the function

    def optimize_functions(library: Any, module: Any) -> None:
        """Nothing: they are part of an entry that is optimised as a whole."""

    def values(config: Any) -> dict[str, Any]:  # as numba's own, but collected once
        if type(config) not in defaults:
            defaults[type(config)] = {k: one.default for k, one in config.options.items()}
        return {**defaults[type(config)], **config._values}

    ours = (finalize, optimize_functions, get_executable, values)
    for (owner, name), function in zip(names, ours, strict=True):
        setattr(owner, name, function)


def _is_called_from_python(library: Any) -> bool:
    """Of entries alone numba keeps machine code: what it has read from there is one."""
    return getattr(library, "_disable_inspection", False) or any(
        one.name.startswith("_ZN7cpython") and not one.is_declaration
        for one in library._final_module.functions
    )


def _callers_first(library: Any) -> list[Any]:
    """All libraries below one: a function is linked in where something before it calls it."""
    seen: dict[Any, None] = {}

    def visit(one: Any) -> None:
        for callee in one._linking_libraries:
            if callee not in seen:
                visit(callee)
                seen.setdefault(callee)

    visit(library)
    return list(seen)[::-1]
