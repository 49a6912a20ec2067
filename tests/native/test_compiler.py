"""The compiler of kernels: each construct does what Python does, and numba, to the bit."""

import importlib
import itertools
import sys

import numpy as np
import pytest

from whichroad import _compile
from whichroad.native import library
from whichroad.native.compiler.kinds import NotInKernels, of_pointer
from whichroad.native.compiler.module import Module, definitions
from whichroad.native.layout import Layout

from . import constructs
from .conftest import lowered

NUMBERS = [-7.5, -2.0, -0.5, 0.0, 0.3, 0.5, 1.0, 1.5, 2.5, 6.25]
WHOLE = [-9, -4, -1, 1, 2, 3, 8, 1 << 20]
NAN, INF = float("nan"), float("inf")
CASES = {
    "toy_whole_numbers": list(itertools.product(WHOLE, WHOLE)),
    "toy_floats": [(x, y, a) for x in NUMBERS for y in NUMBERS if y for a in (-3, 0, 5)],
    "toy_extremes": list(itertools.product([*NUMBERS, NAN, INF], [-1.0, NAN, 0.5], [-4, 0, 2])),
    "toy_roundings": [(x,) for x in [*NUMBERS, 1e15 + 0.5, -3.5]],
    "toy_constants": [(k, x) for k in range(6) for x in NUMBERS],
    "toy_calls": [(x,) for x in NUMBERS],
}


def values_of(seed, n=8):
    return np.random.default_rng(seed).random(n)


def array_cases():
    rng = np.random.default_rng(5)
    for n in (3, 4, 8):
        yield (
            rng.normal(size=(2, n)), rng.integers(-9, 9, 4),
            rng.integers(-9, 9, 3).astype(np.int32), rng.normal(size=n),
        )  # fmt: skip


def record_cases():
    rng = np.random.default_rng(6)
    for x in NUMBERS:
        smalls = np.zeros(2, constructs.SMALL)
        smalls["weight"], smalls["speed"] = rng.normal(size=(2, 2))
        smalls["edge"], smalls["rule"] = rng.integers(0, 200, (2, 2))
        nested = np.zeros((), constructs.NESTED)
        nested["small"]["pair"] = rng.normal(size=2)
        yield smalls, nested, x


CASES["toy_truths"] = [(x, a, values_of(a)) for x in NUMBERS for a in (0, 2, 5, 7, 8, 20)]
CASES["toy_loops"] = [(n, values_of(n, 30)) for n in range(1, 30)]
CASES["toy_functions"] = [(x, y, np.zeros(23)) for x in NUMBERS for y in NUMBERS]
CASES["toy_arrays"] = list(array_cases())
CASES["toy_fields"] = list(record_cases())


@pytest.fixture(scope="module")
def built(can_build, tmp_path_factory):
    folder = tmp_path_factory.mktemp("constructs")
    return library.load(lowered(folder, "constructs", tuple(CASES), ("constructs:_sum",)))


def copied(arguments):
    return [one.copy() if isinstance(one, np.ndarray) else one for one in arguments]


def bits(value):
    """A result, or an array, as what can be compared to the bit."""
    if isinstance(value, np.ndarray) and value.dtype.names:
        return {name: bits(value[name]) for name in value.dtype.names}
    if isinstance(value, tuple):
        return [bits(one) for one in value]
    return None if value is None else np.asarray(value).tobytes()


def flat(result):
    return result if isinstance(result, tuple) else (result,)


@pytest.mark.parametrize("name", CASES)
def test_a_construct_does_what_python_does(built, name):
    """To 1e-13, as NumPy and Python have functions of their own; numbers of 32 bits to 1e-6."""
    entry = getattr(constructs, name)
    compiled = library.call_of(entry.layout, built)
    within = 1e-6 if name == "toy_fields" else 1e-13
    for arguments in CASES[name]:
        mine, its = copied(arguments), copied(arguments)
        with np.errstate(all="ignore"):
            expected = entry.function(*mine)
        answer = compiled(*its)
        for one, other in zip(
            (*flat(answer), *its),
            (*flat(expected), *mine),
            strict=True,
        ):
            if isinstance(one, np.ndarray) and one.dtype.names:
                assert bits(one) == bits(other), arguments
            elif one is not None:
                np.testing.assert_allclose(one, other, rtol=within, atol=1e-15, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_construct_gives_what_numba_gives_to_the_bit(built, name):
    pytest.importorskip("numba")
    entry = getattr(constructs, name)
    compiled, oracle = library.call_of(entry.layout, built), _compile.jit(entry.function)
    for arguments in CASES[name]:
        mine, its = copied(arguments), copied(arguments)
        expected, answer = oracle(*mine), compiled(*its)
        assert bits(answer) == bits(expected), arguments
        assert [bits(one) for one in its] == [bits(one) for one in mine], arguments


REFUSED_MODULE = """from typing import NamedTuple


class Pair(NamedTuple):
    a: int
    b: int


def unmarked(a: int) -> int:
    return a


def plus(a: int, b: int) -> int:
    return a + b


def broken(a: int) -> int:
    # its body
    {body}
"""
REFUSED = {
    "values = [a]": "List",
    "raise ValueError": "Raise is not for kernels",
    "b = a if a else (a, a)": "a tuple of an int, an int",
    "b = a.imag": "an int has no imag",
    "b = unknown": "unknown is read before it is set",
    "b = print(a)": "a call of <built-in function print> with an int",
    "b = broken(a)": "calls itself",
    "b = plus(1, 2, 3)": "plus takes a, b; ",
    "b = a ** a": "a power whose whole exponent is no constant",
    "b, c = a": "an int is taken apart",
    "b = (a, a)[a]": "a tuple that is no constant",
    "for b in range(1, 9, a): pass": "a range whose step is no constant",
    "a.b = 3": "an int has no b",
    "b = unmarked(a)": "a call of unmarked, which is not marked as a kernel",
    "b = plus(**{})": "a call with a dictionary of arguments",
    "b = Pair(1)": "Pair takes a, b",
    "b = Pair(1, 2, 3)": "Pair takes a, b",
    "b = a & 1.5": "BitAnd of an int and a float",
}


@pytest.mark.parametrize(("line", "message"), REFUSED.items(), ids=list(REFUSED))
def test_what_is_not_for_kernels_is_refused_with_file_and_line(
    line, message, tmp_path, monkeypatch
):
    error = refusal(f"{line}\n    return a", tmp_path, monkeypatch)
    assert error.startswith(f"{tmp_path / 'refused.py'}:19: ")
    assert message in error


@pytest.mark.parametrize(
    "body", ["if a > 0:\n        return a", "while a > 0:\n        return a"], ids=["if", "while"]
)
def test_a_kernel_that_may_end_without_its_result_is_refused(body, tmp_path, monkeypatch):
    assert "broken may end without a result" in refusal(body, tmp_path, monkeypatch)


def test_all_ways_out_of_a_kernel_count_as_its_end(tmp_path, monkeypatch):
    for body in (
        "if a:\n        return 1\n    else:\n        return 2",
        "while True:\n        return a",
    ):
        assert refusal(body, tmp_path, monkeypatch) == ""


@pytest.mark.parametrize("kind", ["u8", "f2", "c16", ">f8", "M8[s]"])
def test_a_number_in_memory_that_no_kernel_holds_is_refused(kind):
    with pytest.raises(NotInKernels, match="a number in memory that is"):
        of_pointer(np.dtype(kind))


def refusal(body, folder, monkeypatch):
    """What the compiler says of a kernel; nothing where it compiles it."""
    (folder / "refused.py").write_text(REFUSED_MODULE.format(body=body))
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "refused", raising=False)
    importlib.invalidate_caches()
    refused = importlib.import_module("refused")
    definitions.cache_clear()
    kernels = [(refused.plus, False), (refused.broken, False)]
    try:
        Module(kernels).entry(Layout.of(refused.broken), refused.broken)
    except NotInKernels as error:
        return str(error)
    return ""
