"""Where the kernels' decorators are; see `whichroad._compile`."""

from .._compile import (
    Bytes,
    Cube,
    Floats32,
    Hyper,
    Ints,
    Ints32,
    Matrix,
    Matrix32,
    Table32,
    Vector,
    entry,
    kernel,
    lowered_by,
    part,
)

__all__ = [
    "Bytes",
    "Cube",
    "Floats32",
    "Hyper",
    "Ints",
    "Ints32",
    "Matrix",
    "Matrix32",
    "Table32",
    "Vector",
    "entry",
    "kernel",
    "lowered_by",
    "part",
]
