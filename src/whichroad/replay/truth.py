"""The truth of a drive beside its estimates: the error, and the ellipse towards the truth."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DriveError
from ..evaluate.input_tables import Table, read_table
from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import Array
from .timeline import rounded

if TYPE_CHECKING:
    from .recorded_messages import RecordedMessages

_CHI_95 = 2.4477  # a 2-D Gaussian holds 95 % within so many sigma
_GAP = 5.0  # s between two places of the truth from which on nothing is known between them


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the vehicle was: (n,) each, times rising."""

    time: Array  # s since 1970
    lat: Array  # degrees
    lon: Array

    def at(self, time: Array) -> tuple[Array, Array]:
        """Latitude and longitude at some times, NaN outside of the truth and in its gaps."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        known = (time >= self.time[0]) & (time <= self.time[-1])
        known &= self.time[after] - self.time[after - 1] <= _GAP
        lat, lon = (np.interp(time, self.time, of) for of in (self.lat, self.lon))
        return np.where(known, lat, np.nan), np.where(known, lon, np.nan)

    def beside(self, recorded: "RecordedMessages", at: NDArray[np.int64]) -> dict[str, Any]:
        """Columns for some epochs of a drive: place, error, and the ellipse towards the truth.

        Args:
            recorded: The drive.
            at: (m,) its epochs.

        Returns:
            `lat`, `lon`, `error` and `bound` (m) with None where they are not known, `inside`:
            the share of all epochs at which the 95 % ellipse holds the truth, and `rms`, m.

        Raises:
            DriveError: The truth is of another time.
        """
        c = recorded.columns
        lat, lon = self.at(recorded.time)
        north = METRES_PER_DEGREE * (lat - c["lat"])
        east = METRES_PER_DEGREE * (lon - c["lon"]) * np.cos(radians(c["lat"]))
        error = np.hypot(north, east)
        turn = np.arctan2(east, north) - radians(c["ellipse_bearing_deg"])
        inverse = (np.cos(turn) / c["ellipse_major_m"]) ** 2
        inverse += (np.sin(turn) / c["ellipse_minor_m"]) ** 2
        bound = _CHI_95 / np.sqrt(inverse)
        known = np.isfinite(error) & np.isfinite(bound)
        if not known.any():
            raise DriveError(
                "truth: no time of it is one of the drive's; the truth of this drive was expected"
            )
        return {
            "lat": rounded(lat[at], 7), "lon": rounded(lon[at], 7),
            "error": rounded(error[at], 2), "bound": rounded(bound[at], 2),
            "inside": round(float(np.mean(error[known] <= bound[known])), 4),
            "rms": round(float(np.sqrt(np.mean(error[known] ** 2))), 2),
        }  # fmt: skip


def read_truth(path: Path) -> Truth:
    """The truth from a table with `time`, `lat` and `lon`, as `whichroad evaluate` takes it.

    Raises:
        ReadError: It is no such table.
        DriveError: It has fewer than two places.
    """
    table = Table(read_table(path), str(path))
    time, lat, lon = table.times(), table.numbers("lat"), table.numbers("lon")
    known = np.isfinite(time) & np.isfinite(lat) & np.isfinite(lon)
    order = np.argsort(time[known], kind="stable")
    if len(order) < 2:
        raise DriveError(f"{path}: {len(order)} places; two at least were expected")
    return Truth(*(values[known][order] for values in (time, lat, lon)))
