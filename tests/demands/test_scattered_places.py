"""Places with noise of a hundred metres from fix to fix, and no word of it."""

import numpy as np
import pyarrow as pa
import pytest

from demands.town import corners, fixes, roads
from whichroad import match, match_many

ROUTE = ("00", "04", "24", "20", "40", "44", "34", "30", "10", "14")


@pytest.mark.parametrize("seed", range(4))
def test_levels_hold_the_vehicle(seed):
    true = fixes(corners(*ROUTE), every=10.0, sigma=0.0)
    hidden = fixes(corners(*ROUTE), every=10.0, sigma=100.0, seed=seed, white=True)
    columns = {name: np.asarray(hidden[name]) for name in ("time", "lat", "lon")}
    result = match(columns, roads())
    points = result.points
    assert len(points) == len(columns["time"])
    answered = points.lat.notna().to_numpy()
    north = 111_195.0 * (points.lat.to_numpy() - true["lat"])[answered]
    east = 72_400.0 * (points.lon.to_numpy() - true["lon"])[answered]
    assert np.mean(np.hypot(north, east) > points.protection_level_m[answered]) < 0.03
    assert (points.p_off_road < 0.999).all()
    (note,) = [n for n in result.summary["notes"] if n.startswith("places scatter by ")]
    trips = {**columns, "drive_id": np.full(len(points), "a")}
    many = match_many(pa.table(trips), roads())
    assert note in many.drives["notes"].to_pylist()[0]
