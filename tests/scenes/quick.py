"""Records whose fields are quick to read and to write, for kernels that run as plain Python.

NumPy looks a field of a record up by its name each time, which takes most of the time of a
kernel that is not compiled.  Here it is looked up once.  The values are NumPy's, in its memory.
"""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whichroad._compile import Records


class Quick:
    """A record: its fields are attributes, and items, as NumPy has them."""

    __slots__ = ("_fields", "dtype")

    def __init__(self, record: NDArray[Any]) -> None:
        self.dtype = record.dtype
        self._fields = [_field(record[name]) for name in record.dtype.names or ()]

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)

    def __setitem__(self, name: str, value: Any) -> None:
        setattr(self, name, value)


def quick(records: Records) -> list[Any]:
    """Each of the records of an array, (n,); what is written is written there.

    Args:
        records: As `whichroad.graph.network.records` makes them.
    """
    rows = records.view(np.ndarray)
    return [_class_of(rows.dtype)(rows[k : k + 1].reshape(())) for k in range(len(rows))]


def _field(values: NDArray[Any]) -> Any:
    """A field: a record, records, or an array; of a number one without dimensions."""
    if values.dtype.names is None:
        return values
    return quick(values) if values.ndim else quick(values.reshape(1))[0]


@functools.cache
def _class_of(dtype: np.dtype[Any]) -> type[Quick]:
    """A class with these fields and no others."""
    names = dtype.names or ()
    fields = {
        name: _numbers(k) if dtype[name].base.names is None else _records(k)
        for k, name in enumerate(names)
    }
    return type("QuickRecord", (Quick,), {"__slots__": (), **fields})


def _numbers(place: int) -> property:
    def give(record: Quick) -> Any:
        return record._fields[place][()]

    def take(record: Quick, value: Any) -> None:
        record._fields[place][()] = value

    return property(give, take)


def _records(place: int) -> property:
    """Their own fields are written, not they."""
    return property(lambda record: record._fields[place])
