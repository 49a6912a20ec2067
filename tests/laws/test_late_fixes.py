"""A late fix is moved to the present by the motion of the most probable hypothesis.

What it is surer of than that motion is lost.
"""

import copy
import math

import numpy as np
import pytest

import whichroad
from laws.public import CAR, DISTANCE, START, convergence, degrees, readings, road_map
from scenes import Truth, drive_along
from whichroad.filter.state import K
from whichroad.online.late_fixes import motion_since

STEM = [[0.0, 0.0], [300.0, 0.0]]
LEFT = [[300.0, 0.0], [500.0, 120.0]]
RIGHT = [[300.0, 0.0], [500.0, -120.0]]
LATE = 0.5  # s
# no U-turns and no off-road hypotheses
NO_OTHERS = whichroad.Settings(u_turn_rate=0.0, off_road_start=0.0, off_road_leave=0.0)


def fix_at(
    x: float, y: float, time: float, *, bearing: float | None = None, more: float = 0.0
) -> whichroad.GeoFix:
    lon, lat = degrees(x, y)
    course = {} if bearing is None else {"bearing_deg": bearing, "sigma_bearing_deg": 6.0}
    return whichroad.GeoFix(
        START + time, float(lat), float(lon), 9.0 + more, 0.0, 9.0 + more, **course
    )


def past_the_fork(truth: Truth, share: float) -> list[whichroad.Localizer]:
    """The on-line filter at epochs behind the fork, after one fix that favours a branch.

    Args:
        truth: The drive.
        share: Lateral position of that fix: 0 midway between the branches, 1 on the true one.
    """
    online = whichroad.Localizer(road_map([STEM, LEFT, RIGHT]), vehicle=CAR, settings=NO_OTHERS)
    found = []
    for k, reading in enumerate(readings(truth, DISTANCE)):
        x, y, time = float(truth.x[k]), float(truth.y[k]), float(truth.time[k])
        online.update(reading)
        if k % 10 == 0 and (x < 285.0 or 335.0 < x < 345.0):
            online.update(fix_at(x, share * y, time, bearing=90.0 if k == 0 else None))
        if k % 10 == 5 and 345.0 < x < 450.0:
            found.append(copy.deepcopy(online))
    return found


def moved_along(online: whichroad.Localizer, x: float, y: float, way: float) -> tuple[float, float]:
    """A position moved on by a way (m by the odometer) along the most probable hypothesis."""
    now = online.estimate()
    best = max(now.hypotheses, key=lambda h: h.p)
    lon, lat = degrees(x, y)
    heading = math.radians(90.0 - best.pose.bearing_deg) + float(convergence(lon, lat))
    rows = online._filter.belief.hyp[: online._filter.count]
    metres = float(rows["mu"][np.argmax(rows["weight"]), K]) * way
    return x + metres * math.cos(heading), y + metres * math.sin(heading)


@pytest.mark.parametrize(
    ("branch", "share"),
    [
        (LEFT, 1 / 12),  # the most probable hypothesis is neither the first nor the last row
        (RIGHT, 1 / 12),
        (RIGHT, 1 / 20),  # the first row is on the other branch
    ],
)
def test_a_late_fix_is_moved_by_the_most_probable_hypothesis(branch, share: float):
    """Its estimate equals that of a punctual fix at the position moved by the delay.

    That one has the error of this motion besides.
    """
    truth = drive_along([STEM[0], *branch], margin=20.0)
    seen = past_the_fork(truth, share)
    for online in seen:
        before = online.estimate()
        bearings = [h.pose.bearing_deg for h in before.hypotheses if h.p > 0.02]
        assert max(bearings) - min(bearings) > 40.0  # else all hypotheses would move it alike
        now = before.time - START
        place = float(np.interp(now, truth.time, truth.x)), 0.0
        late, prompt = copy.deepcopy(online), copy.deepcopy(online)
        a = late.update(fix_at(*place, now - LATE))
        way = float(np.diff(np.interp([now - LATE, now], truth.time, truth.s))[0])
        since = motion_since(online._filter, START + now - LATE, (0.0, math.inf))
        assert 0.1 < since.sigma < 2.0
        b = prompt.update(fix_at(*moved_along(online, *place, way), now, more=since.sigma**2))
        assert a.time == b.time
        assert [a.pose.x, a.pose.y] == pytest.approx([b.pose.x, b.pose.y], abs=1e-3)
        assert [h.p for h in a.hypotheses] == pytest.approx([h.p for h in b.hypotheses], abs=1e-5)
    assert len(seen) >= 5
