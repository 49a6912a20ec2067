"""The compiler of kernels: each construct does what Python does, and numba, to the bit."""

import itertools
import textwrap

import numpy as np
import pytest

from whichroad import _compile
from whichroad.native import library
from whichroad.native.compiler.kinds import NotInKernels
from whichroad.native.compiler.module import Module

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


def _flat(result):
    return result if isinstance(result, tuple) else (result,)


@pytest.mark.parametrize("name", CASES)
def test_a_construct_does_what_python_does(built, name):
    """Functions of `math` and powers to 1e-15: NumPy and Python have some of their own."""
    entry = getattr(constructs, name)
    compiled = library.call_of(entry.layout, built)
    for arguments in CASES[name]:
        mine, its = copied(arguments), copied(arguments)
        with np.errstate(all="ignore"):
            expected = entry.function(*mine)
        answer = compiled(*its)
        for one, other in zip(
            (*_flat(answer), *its),
            (*_flat(expected), *mine),
            strict=True,
        ):
            if isinstance(one, np.ndarray) and one.dtype.names:
                assert str(one) == str(other), arguments
            elif one is not None:
                np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-15, err_msg=name)


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
}


@pytest.mark.parametrize(("line", "message"), REFUSED.items(), ids=list(REFUSED))
def test_what_is_not_for_kernels_is_refused_with_file_and_line(
    line, message, tmp_path, monkeypatch
):
    source = f"""
    def plus(a: int, b: int) -> int:
        return a + b


    def broken(a: int) -> int:
        {line}
        return a
    """
    (tmp_path / "refused.py").write_text(textwrap.dedent(source))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "refused", raising=False)
    import refused

    from whichroad.native.layout import Layout

    with pytest.raises(NotInKernels) as error:
        Module().entry(Layout.of(refused.broken), refused.broken)
    assert str(error.value).startswith(f"{tmp_path / 'refused.py'}:7: ")
    assert message in str(error.value)
