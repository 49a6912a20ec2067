"""A compiled kernel does what the same lines do in Python, whatever it takes."""

import math

import numpy as np
import pytest

from whichroad._compile import kernel_mode
from whichroad.filter.state import new_belief, normalise
from whichroad.native import library

from . import toys


def call(toy_library, entry):
    return library.call_of(entry.layout, toy_library)


def outer(on: bool = True) -> toys.Outer:
    values = np.linspace(0.1, 2.0, 7)
    return toys.Outer(
        toys.Inner(values, 0.3), np.arange(6.0).reshape(3, 2), np.arange(3, dtype=np.int32), on
    )


def records() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    tracks, state = np.zeros(4, toys.TRACK), np.zeros((), toys.STATE)
    for name in ("mean", "cov", "weight"):
        tracks[name] = rng.normal(size=tracks[name].shape)
    return tracks, state


@pytest.mark.parametrize(("a", "b", "c"), [(7, 0.1, True), (-7, 1e300, False), (3, -0.0, True)])
def test_numbers_go_in_and_come_out(toy_library, a, b, c):
    native = call(toy_library, toys.toy_numbers)(a, b, c)
    assert native == toys.toy_numbers.function(a, b, c)
    assert [type(value) for value in native] == [float, int, bool]


def test_a_division_by_zero_is_infinite_as_in_numpy(toy_library):
    assert call(toy_library, toys.toy_numbers)(0, 1.0, True)[0] == math.inf


@pytest.mark.parametrize("on", [True, False])
def test_tuples_in_tuples_are_read_and_their_arrays_written(toy_library, on):
    cube = np.random.default_rng(2).normal(size=(2, 3, 4))
    mine, theirs = outer(on), outer(on)
    native = call(toy_library, toys.toy_tuples)(theirs, cube, 2)
    assert native == toys.toy_tuples.function(mine, cube, 2)
    assert np.array_equal(theirs.inner.values, mine.inner.values)
    assert theirs.numbers.tolist() == [0, 2, 2]


@pytest.mark.parametrize("scalar", [False, True])
def test_records_are_read_written_and_copied(toy_library, scalar):
    (tracks, state), (mine, its) = records(), records()
    holder = state.reshape(1)
    given = holder[0] if scalar else state
    assert call(toy_library, toys.toy_records)(tracks, given, 0.25) == 4
    toys.toy_records.function(mine, its, 0.25)
    for name in toys.TRACK.names:  # what lies between fields is nobody's
        assert np.array_equal(tracks[name], mine[name]), name
    assert state["time"] == its["time"] == 0.25
    assert state["counts"].tolist() == [0, 1]


def test_an_array_may_be_empty_or_read_only(toy_library):
    nothing = call(toy_library, toys.toy_nothing)
    assert nothing(np.zeros(0)) is None
    cube = np.ones((2, 3, 4))
    cube.flags.writeable = False
    assert call(toy_library, toys.toy_tuples)(outer(), cube, 0) == pytest.approx(
        toys.toy_tuples.function(outer(), cube, 0)
    )


def test_a_bound_call_is_the_call_with_other_numbers(toy_library):
    cube, theirs = np.ones((2, 3, 4)), outer()
    bound = call(toy_library, toys.toy_tuples).bind((theirs, cube, ...))
    for k in (0, 3):
        mine = outer()._replace(inner=toys.Inner(theirs.inner.values.copy(), 0.3))
        assert bound(k) == toys.toy_tuples.function(mine, cube, k)
    with pytest.raises(ValueError, match="zip"):
        bound()


def test_a_bound_call_takes_a_tuple_of_numbers_each_time(toy_library):
    values = np.arange(1.0, 5.0)
    bound = call(toy_library, toys.toy_span).bind((values, ..., ...))
    for span, k in ((toys.Span(1, 0.5, True), 3), (toys.Span(3, -2.0, True), -1)):
        assert bound(span, k) == toys.toy_span.function(values, span, k)
    assert bound(toys.Span(0, 1.0, False), 7) == -1.0


@pytest.mark.parametrize(
    "cube",
    [
        np.ones((2, 3)), np.ones((2, 3, 4), np.float32), np.ones((4, 3, 2)).T,
        np.ones((2, 3, 8))[..., ::2],
    ],
    ids=["fewer dimensions", "another type", "Fortran's order", "every second"],
)  # fmt: skip
def test_a_wrong_array_is_refused_by_name(toy_library, cube):
    with pytest.raises(TypeError, match=r"cube: .* 3 dimensions of float64 in C order"):
        call(toy_library, toys.toy_tuples)(outer(), cube, 0)


def test_a_wrong_number_of_arguments_is_refused(toy_library):
    with pytest.raises(TypeError, match="2 arguments; 3 were expected"):
        call(toy_library, toys.toy_numbers)(1, 2.0)


@pytest.mark.skipif(kernel_mode() != "native", reason="without a library")
def test_an_entry_is_compared_with_the_library_once(monkeypatch):
    normalise.bind(new_belief())
    monkeypatch.setattr(library, "call_of", lambda _: pytest.fail("compared again"))
    normalise.bind(new_belief())
