"""Tables that were interpolated to every second: rows between fixes are no fixes."""

import numpy as np
import pyarrow as pa
import pytest

from demands.town import corners, fixes, roads
from whichroad import match, match_many

ROUTE = ("00", "04", "24", "20", "40", "44", "34", "30", "10", "14")


def lined(every: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """A drive of which each so many seconds was measured, and the places of all."""
    table = {k: np.asarray(v) for k, v in fixes(corners(*ROUTE), speed=11.0).items()}
    true = np.column_stack([table["lat"], table["lon"]])
    row = np.arange(len(table["time"]))
    for name in ("lat", "lon"):
        table[name] = np.interp(row, row[::every], table[name][::every])
    return table, true


@pytest.mark.parametrize("every", [8, 20])
@pytest.mark.parametrize("lag", [None, "full"])
def test_rows_between_fixes_are_no_fixes(every, lag):
    table, true = lined(every)
    result = match(table, roads(), lag=lag)
    points = result.points
    between = np.arange(len(points)) % every > 0
    level = points.protection_level_m
    assert np.median(level[between]) > 1.4 * np.median(level[~between])
    north = 111_195.0 * (points.lat.to_numpy() - true[:, 0])
    east = 111_195.0 * np.cos(np.radians(49.4)) * (points.lon.to_numpy() - true[:, 1])
    assert np.mean(np.hypot(north, east) > level) < 0.02
    (note,) = result.summary["notes"]
    assert note.startswith("places of ")
    assert not [f for f in result.diagnosis if f.what == "gnss: repeated"]
    trips = {**table, "drive_id": np.full(len(table["lat"]), "a")}
    many = match_many(pa.table(trips), roads(), lag=lag)
    assert many.points["lat"].to_pylist() == points.lat.tolist()
    assert many.drives["notes"].to_pylist() == [[note]]
