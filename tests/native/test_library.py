"""A library that is not of these kernels is refused, by its name and with what to do."""

import ast
import ctypes

import numpy as np
import pytest

from whichroad._compile import entries
from whichroad.native import cache, library
from whichroad.native.layout import Array, Layout, kind_of

from . import toys


def test_a_library_of_other_kernels_is_refused(toy_path, monkeypatch):
    monkeypatch.setattr(library, "found", lambda: toy_path)
    with pytest.raises(library.LibraryError, match=r"holds the kernels toys; .* install"):
        library._loaded.__wrapped__()


def test_a_file_that_is_no_library_is_refused(tmp_path):
    path = tmp_path / "kernels.so"
    path.write_bytes(b"\x7fELF and nothing else")
    with pytest.raises(library.LibraryError, match=str(path)):
        library.load(path)


def test_an_entry_whose_records_have_changed_is_refused(toy_library):
    before = toys.toy_records.layout
    longer = np.dtype([*toys.TRACK.descr[:1], ("cov", "f8", (4, 4))], align=True)
    changed = Layout(before.name, before.arguments | {"tracks": Array(longer, 1)}, before.result)
    with pytest.raises(library.LibraryError, match="arguments of toy_records have the layout"):
        library.call_of(changed, toy_library)


def test_an_entry_that_the_library_does_not_have_is_refused(toy_library):
    missing = Layout("toy_missing", {}, None)
    with pytest.raises(library.LibraryError, match="arguments of toy_missing"):
        library.call_of(missing, toy_library)


def test_the_packages_own_library_holds_every_entry():
    own = library._loaded()
    for name, entry in entries().items():
        if not name.startswith("toy_"):
            theirs = ctypes.c_int64.in_dll(own, f"whichroad_layout_{name}").value
            assert theirs == entry.layout.checksum(), name


def test_any_change_of_a_record_changes_the_checksum():
    fields = [("a", "f8"), ("b", "i4"), ("c", "f4", (3,))]
    variants = [
        fields, fields[::-1], fields[:2], [("x", "f8"), *fields[1:]], [*fields, ("d", "u1")],
        [("a", "f4"), *fields[1:]], [*fields[:2], ("c", "f4", (4,))],
    ]  # fmt: skip
    layouts = [Layout("k", {"r": Array(np.dtype(v, align=True), 1)}, None) for v in variants]
    assert len({layout.checksum() for layout in layouts}) == len(variants)


def test_any_change_of_a_signature_changes_the_checksum():
    vector = Array(np.dtype("f8"), 1)
    layouts = [
        Layout("k", {"a": vector, "n": int}, None), Layout("k", {"n": int, "a": vector}, None),
        Layout("k", {"a": vector, "n": float}, None), Layout("k", {"a": vector, "n": int}, int),
        Layout("k", {"a": vector}, None), Layout("l", {"a": vector, "n": int}, None),
        Layout("k", {"a": Array(np.dtype("f8"), 2), "n": int}, None),
    ]  # fmt: skip
    assert len({layout.checksum() for layout in layouts}) == len(layouts)


def test_an_annotation_that_c_does_not_know_is_refused():
    with pytest.raises(TypeError, match=r"k: names: list\[str\].*was expected"):
        kind_of(list[str], "k: names")


def test_the_package_knows_which_file_it_loads():
    assert cache.suffix(cache.own_target()) == library.found().suffix


def _subscripts_of_kernels(path):
    for function in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(function, ast.FunctionDef):
            marks = {ast.unparse(one).partition("(")[0] for one in function.decorator_list}
            if marks & {"kernel", "entry"}:
                yield from (n for n in ast.walk(function) if isinstance(n, ast.Subscript))


@pytest.mark.parametrize("path", cache.kernel_files(), ids=lambda path: path.stem)
def test_no_kernel_counts_from_the_end_of_an_array(path):
    """The library takes an index as it stands (`native.lower`)."""
    for one in _subscripts_of_kernels(path):
        signs = [n for n in ast.walk(one.slice) if isinstance(n, ast.UnaryOp)]
        assert not any(isinstance(n.op, ast.USub) for n in signs), ast.unparse(one)
