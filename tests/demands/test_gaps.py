"""Clocks that jump: a reading decades before the others ends, and the drive is answered."""

import numpy as np
import pytest

from demands.town import corners, fixes, roads
from whichroad import match
from whichroad.observations import Drive, Fixes, SpeedYawRate


def drive(early: float) -> Drive:
    """Along a row, with speeds at 10 Hz; one fix and one speed long before them."""
    table = fixes(corners("20", "24"), speed=10.0, sigma=2.0)
    first, (place, *_) = table["time"][0], zip(table["lat"], table["lon"], strict=True)
    when, lat, lon = (
        np.concatenate([[one], table[name]])
        for one, name in ((early, "time"), (place[0], "lat"), (place[1], "lon"))
    )
    n = len(when)
    told, zero, none = np.full(n, 4.0), np.zeros(n), np.full(n, np.inf)
    seen = Fixes(
        when, lat, lon, told, zero, told, zero, none, zero, none, np.zeros(n, np.uint8)
    )  # fmt: skip
    time = np.concatenate([[early], np.arange(first, seen.time[-1], 0.1)])
    speed = np.full(len(time), 10.0)
    return Drive("gap", seen, SpeedYawRate(time, speed, np.zeros(len(time))))


@pytest.mark.parametrize("early", [1.0, 1.4e9, 1.6e9 - 7200.0])
def test_a_reading_long_before_the_others_does_not_stop_the_drive_from_being_answered(early):
    result = match(drive(early), roads())
    points = result.points
    last = points.iloc[-1]
    assert last.status == "on_road"
    assert roads().attributes(int(last.edge_id))["name"] == "Row 2"
