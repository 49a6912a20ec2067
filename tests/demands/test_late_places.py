"""Places that lag behind the speeds of their rows: these are right."""

import numpy as np
import pyarrow as pa
import pytest

from demands.town import corners, fixes, roads
from whichroad import match, match_many

ROUTE = ("00", "04", "24", "20", "40", "44", "34", "30", "10", "14")


def table() -> dict[str, np.ndarray]:
    """A drive at 4 to 14 m/s, with the speeds of its receiver."""
    made = {k: np.asarray(v) for k, v in fixes(corners(*ROUTE), speed=1.0, sigma=2.0).items()}
    speed = 9.0 + 5.0 * np.sin(np.arange(400) / 9.0)
    at = np.cumsum(speed)
    at = at[at < len(made["time"]) - 1]
    n = len(at)
    moved = {
        name: np.interp(at, np.arange(len(made["lat"])), made[name]) for name in ("lat", "lon")
    }
    return {"time": made["time"][:n], **moved, "accuracy_m": np.full(n, 3.0),
            "speed_mps": speed[:n]}  # fmt: skip


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("seconds", [2, 4, 6])
def test_places_are_answered_for_the_time_of_their_speeds(seconds, lag):
    true = table()
    late = {**true}
    for name in ("lat", "lon"):
        late[name] = np.concatenate([np.full(seconds, true[name][0]), true[name][:-seconds]])
    result = match(late, roads(), lag=lag)
    points = result.points
    assert len(points) == len(true["time"])
    north = 111_195.0 * (points.lat.to_numpy() - true["lat"])
    east = 111_195.0 * np.cos(np.radians(49.4)) * (points.lon.to_numpy() - true["lon"])
    assert np.mean(np.hypot(north, east) > points.protection_level_m) < 0.01
    assert not [f for f in result.diagnosis if f.what.startswith("gnss speed")]
    (note,) = [n for n in result.summary["notes"] if n.startswith("places of ")]
    assert note.startswith(f"places of {seconds} of {len(points)} rows are not known: places lag")
    many = match_many(pa.table({**late, "drive_id": np.full(len(points), "a")}), roads(), lag=lag)
    assert many.points["lat"].to_pylist() == points.lat.tolist()
    assert note in many.drives["notes"].to_pylist()[0]
