"""What UBX says beside fixes, as readings for sensors that ask for it.

satellites    in use, of NAV-PVT; 0 where it has no fix
height_m      of the antenna over the sea, of NAV-PVT
antennas_deg  true bearing from the base to the rover on the vehicle, of NAV-RELPOSNED, with
              antennas_sigma_deg
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..observations import SensorReading
from .checks import Bools

RELPOSNED = np.dtype({  # the fields that are used; places in the payload of version 1
    "names": ["itow", "heading", "accuracy", "flags"],
    "formats": ["<u4", "<i4", "<u4", "<u4"],
    "offsets": [4, 24, 52, 60],
    "itemsize": 64,
})  # fmt: skip
_VALID = 1 << 8 | 1 << 2 | 1  # heading, relative position, fix
_WEEK = 604_800.0  # s, of the receiver's time of week
_NEAR = 5.0  # s from an epoch, within which its time holds for a heading


def has_place(pvt: NDArray[np.void]) -> Bools:
    """Whether epochs have a fix, and a place and height that the receiver does not call invalid."""
    return np.asarray((pvt["flags"] & 1 == 1) & (pvt["flags3"] & 1 == 0))


class UbxTold:
    """Messages in, readings out.

    Args:
        wanted: Names of columns that are asked for.
    """

    def __init__(self, wanted: Iterable[str]) -> None:
        self._wanted = frozenset(wanted)
        self._epoch: tuple[float, float] | None = None  # time of week and time of the last one, s

    def of_epochs(
        self, pvt: NDArray[np.void], time: NDArray[np.float64], dated: Bools
    ) -> list[SensorReading]:
        """Satellites and heights.

        Args:
            pvt: (n,) fields of NAV-PVT.
            time: (n,) s since 1970.
            dated: (n,) whether the receiver knows the time.
        """
        rows = zip(time.tolist(), pvt["satellites"].tolist(), (1e-3 * pvt["height"]).tolist(),
                   (pvt["flags"] & 1).tolist(), has_place(pvt).tolist(), pvt["itow"].tolist(),
                   dated.tolist(), strict=True)  # fmt: skip
        made = []
        for at, count, height, fix, high, itow, known in rows:
            if not known:
                continue
            self._epoch = (1e-3 * itow, at)
            values = {"satellites": float(count * fix)} | ({"height_m": height} if high else {})
            made += self._reading(at, values)
        return made

    def of_headings(self, messages: NDArray[np.void]) -> Iterator[SensorReading]:
        """Headings, at the times of their weeks by the last epoch.

        Args:
            messages: (n,) of `RELPOSNED`.
        """
        for one in messages:
            if self._epoch is None or int(one["flags"]) & _VALID != _VALID:
                continue
            after = (1e-3 * int(one["itow"]) - self._epoch[0] + 0.5 * _WEEK) % _WEEK - 0.5 * _WEEK
            if abs(after) <= _NEAR:
                values = {
                    "antennas_deg": 1e-5 * int(one["heading"]),
                    "antennas_sigma_deg": 1e-5 * int(one["accuracy"]),
                }
                yield from self._reading(self._epoch[1] + after, values)

    def _reading(self, time: float, values: dict[str, Any]) -> list[SensorReading]:
        told = {name: value for name, value in values.items() if name in self._wanted}
        return [SensorReading(time, told)] if told else []
