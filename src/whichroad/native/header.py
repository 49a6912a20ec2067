"""The C header of some entries, for programs that call the library without Python."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from .layout import Array, Layout

_SCALARS = {
    "f8": "double", "f4": "float", "i8": "int64_t", "i4": "int32_t", "i2": "int16_t",
    "i1": "int8_t", "u8": "uint64_t", "u4": "uint32_t", "u2": "uint16_t", "u1": "uint8_t",
    "b1": "uint8_t",
}  # fmt: skip
_NUMBERS = {int: "int64_t", float: "double", bool: "int64_t"}

_TOP = """\
/* Kernels of whichroad, made by `python -m whichroad.native header`.
 *
 * Each function takes one block.  Arrays are in C order, and *_shape are their lengths; the
 * functions keep no pointer.  0 is returned where all went well.  Before the first call, compare
 * whichroad_layout_NAME with WHICHROAD_LAYOUT_NAME: a library of other records would read
 * garbage.
 */
#ifndef WHICHROAD_H
#define WHICHROAD_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define WHICHROAD_CHECK(what) static_assert(what, #what)
extern "C" {
#else
#define WHICHROAD_CHECK(what) _Static_assert(what, #what)
#endif

extern const char whichroad_source[]; /* digest of the kernels' sources */
"""
_BOTTOM = """
#ifdef __cplusplus
}
#endif
#endif
"""


def header(layouts: Iterable[Layout], documents: Iterable[str | None]) -> str:
    """The header of some entries.

    Args:
        layouts: Of the entries.
        documents: Their docstrings.
    """
    records: dict[str, str] = {}  # a record's definition -> its name
    parts: list[str] = []
    for layout, document in zip(layouts, documents, strict=True):
        members, name = [], layout.name
        for leaf in layout.leaves():
            member = leaf.path.replace(".", "_")
            if isinstance(leaf.kind, Array):
                kind = _type_of(leaf.kind.dtype, f"{name}_{member}", records, parts)
                members.append(f"    {kind} *{member};")
                if leaf.kind.ndim:
                    members.append(f"    int64_t {member}_shape[{leaf.kind.ndim}];")
            else:
                members.append(f"    {_NUMBERS[leaf.kind]} {member};")
        about = (document or "").strip().partition("\n")[0].replace("*/", "")
        block = f"struct whichroad_{name}_block"
        parts.append(
            f"\n/* {about} */\n{block} {{\n" + "\n".join(members) + "\n};\n"
            f"WHICHROAD_CHECK(sizeof({block}) == {8 * layout.words});\n"
            f"#define WHICHROAD_LAYOUT_{name.upper()} INT64_C({layout.checksum()})\n"
            f"extern const int64_t whichroad_layout_{name};\n"
            f"int32_t whichroad_{name}({block} *block);\n"
        )
    return _TOP + "".join(parts) + _BOTTOM


def _type_of(dtype: np.dtype[Any], at: str, records: dict[str, str], parts: list[str]) -> str:
    """C's name of a type; a record is defined where it is met first."""
    if dtype.fields is None:
        return _SCALARS[dtype.str[1:]]
    known = records.get(repr(dtype))
    if known is not None:
        return known
    lines, checks = [], []
    name = records[repr(dtype)] = f"struct whichroad_{at}"
    for field, (kind, offset, *_) in dtype.fields.items():
        base, shape = kind.subdtype or (kind, ())
        lengths = "".join(f"[{n}]" for n in shape)
        lines.append(f"    {_type_of(base, f'{at}_{field}', records, parts)} {field}{lengths};")
        checks.append(f"WHICHROAD_CHECK(offsetof({name}, {field}) == {offset});\n")
    checks.append(f"WHICHROAD_CHECK(sizeof({name}) == {dtype.itemsize});\n")
    parts.append(f"\n{name} {{\n" + "\n".join(lines) + "\n};\n" + "".join(checks))
    return name
