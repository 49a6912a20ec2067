"""One drive's answer beside its truth, in one compiled call: a row of numbers a drive."""

import math
from typing import NamedTuple

import numpy as np

from whichroad._compile import Ints32, Matrix, Records, Vector, by_numba, kernel
from whichroad.filter.summary.estimate import ALTERNATIVES
from whichroad.simulate.vectorised import Line, Truth

WARM_UP = 20.0  # s after the start that no figure of the pose counts
SLACK = 10.0  # m of travel within which a road counts as the driven one
DECLARED = 0.999
LEVELS = (1.3862943611198906, 4.605170185988091, 5.991464547107979, 9.210340371976182)
NEAR, FAR = 30.0, 100.0  # m beyond the branch point, where decisions are read
_AWAY = 50.0  # m on a street that is not mapped, from which on P(off road) is asked for
ALARM = 10.0  # m, alert limit of the Stanford diagram


class Row(NamedTuple):
    """One drive.  `right_*`, `p_*` and `log_*` are -1, 0 where there was nothing to read."""

    epochs: float
    declared: float  # 1: some road had P >= 0.999 beyond the branch point
    wrong: float  # 1: and it was not the driven one
    seconds: float  # from the branch point to the declaration
    metres: float
    named: float  # the road declared
    right_near: float  # decision at NEAR: whether the most probable road is driven
    p_near: float  # its probability
    true_near: float  # probability of the driven road
    brier_near: float
    right_far: float
    p_far: float
    true_far: float
    brier_far: float
    right_end: float
    p_end: float
    true_end: float
    brier_end: float
    posed: float  # epochs that the figures of the pose count
    nees: float  # sum over them
    inside_50: float
    inside_90: float
    inside_95: float
    inside_99: float
    squared: float  # m²
    mapped: float  # the same in the map's frame
    map_nees: float
    map_inside_50: float
    map_inside_90: float
    map_inside_95: float
    map_inside_99: float
    map_squared: float
    level_epochs: float  # epochs with a protection level
    misleading: float  # error above the level
    hazardous: float  # and above the alert limit, the level being below it
    unavailable: float  # level above the alert limit
    level_sum: float  # m
    away: float  # epochs on a street that is not mapped
    off_away: float  # sum of P(off road) there
    home: float  # epochs on mapped roads
    off_home: float
    unseen: float  # largest probability that the alternatives leave out
    error: float  # m, at the decision at FAR, or at the last one
    level: float  # m, protection level there; 0: none
    test_declared: float  # the exact test of positions alone, see `oracle`
    test_wrong: float
    test_seconds: float


@kernel
def _chances(rows: Records, k: int, road_of: Ints32, roads: Ints32, chances: Vector) -> int:
    """Probability of each road among the alternatives; returns how many roads."""
    n = 0
    for a in range(ALTERNATIVES):
        edge = rows[k].alt_edge[a]
        if edge < -1:
            break
        road = road_of[edge] if edge >= 0 else -1
        found = -1
        for i in range(n):
            if roads[i] == road:
                found = i
        if found < 0:
            found = n
            roads[n] = road
            chances[n] = 0.0
            n += 1
        chances[found] += rows[k].alt_p[a]
    return n


@kernel
def _driven(line: Line, place: int, road: int, slack: float) -> bool:
    """Whether a road is driven within `slack` m of a point of the line."""
    k = place
    while k >= 0 and line.along[k] > line.along[place] - slack:
        if line.road[k] == road:
            return True
        k -= 1
    k = place
    while k < len(line.road) and line.along[k] < line.along[place] + slack:
        if line.road[k] == road:
            return True
        k += 1
    return False


@kernel
def _road_before(line: Line, decision: float) -> int:
    """The road that leads to the branch point."""
    k = 0
    while k < len(line.along) - 1 and line.along[k] < decision:
        k += 1
    return int(line.road[max(k - 2, 0)])


@kernel
def _decide(
    row: Vector, at: int, line: Line, place: int, n: int, roads: Ints32, chances: Vector
) -> None:
    """Four numbers of a decision: right, P of the most probable road, of the true one, Brier."""
    top = 0
    true = 0.0
    brier = 1.0
    for i in range(n):
        if chances[i] > chances[top]:
            top = i
        p = chances[i]
        if roads[i] == line.road[place]:
            true = p
            brier += (1.0 - p) ** 2 - 1.0
        else:
            brier += p * p
    row[at] = 1.0 if roads[top] == line.road[place] else 0.0
    row[at + 1] = chances[top]
    row[at + 2] = true
    row[at + 3] = brier


@kernel
def _pose(row: Vector, at: int, ex: float, ey: float, xx: float, xy: float, yy: float) -> None:
    """Count an error of position: NEES, ellipses, square."""
    nees = (yy * ex * ex - 2 * xy * ex * ey + xx * ey * ey) / (xx * yy - xy * xy)
    row[at] += 1
    row[at + 1] += nees
    for i in range(4):
        row[at + 2 + i] += nees < LEVELS[i]
    row[at + 6] += ex * ex + ey * ey


@by_numba
def score_drive(
    row: Vector, rows: Records, truth: Truth, time: Vector, line: Line, road_of: Ints32,
    decision: float, evaluated_to: float, roads: Ints32, chances: Vector,
) -> None:  # fmt: skip
    """Fill a `Row` from what the filter said.

    Args:
        row: (len(Row._fields),) filled.
        rows: What the filter said, (n,) ESTIMATE.
        truth: At least n rows.
        time: (n,) s.
        line: What was driven.
        road_of: (E,) road of each edge.
        decision: Branch point, m along the line.
        evaluated_to: End of the stretch where declarations count, m along the line.
        roads: (ALTERNATIVES,) scratch.
        chances: (ALTERNATIVES,) scratch.
    """
    n = len(time)
    row[:] = 0.0
    row[0] = n
    row[6] = row[10] = row[14] = -1.0
    passed = -1.0
    hidden_from = -1.0
    before = 0.0
    begun = -1.0
    last = -1
    at = -1
    before_it = _road_before(line, decision)
    for k in range(n):
        if rows[k].live == 0:
            continue
        if begun < 0.0:
            begun = time[k]
        place = truth.place[k]
        along = line.along[place]
        said = rows[k]
        if along >= decision and along <= evaluated_to:
            if passed < 0.0:
                passed = time[k]
            count = _chances(rows, k, road_of, roads, chances)
            rest = 1.0
            for i in range(count):
                rest -= chances[i]
            row[41] = max(row[41], rest)
            for i in range(count):
                named = roads[i]
                # whoever has just passed it may well be thought just before it
                elsewhere = along > decision + NEAR or named != before_it
                if row[1] == 0.0 and chances[i] >= DECLARED and named >= 0 and elsewhere:
                    row[1] = 1.0
                    row[2] = 0.0 if _driven(line, place, named, SLACK) else 1.0
                    row[3] = time[k] - passed
                    row[4] = along - decision
                    row[5] = named
            if before < decision + NEAR <= along:
                _decide(row, 6, line, place, count, roads, chances)
            if before < decision + FAR <= along:
                _decide(row, 10, line, place, count, roads, chances)
                at = k
            if truth.speed[k] > 0.5 and evaluated_to - along > SLACK:
                last = k
        before = along
        if truth.speed[k] == 0.0 or time[k] < begun + WARM_UP:
            continue
        _pose(
            row, 18, said.x - truth.x[k], said.y - truth.y[k],
            said.cov[0], said.cov[1], said.cov[3],
        )  # fmt: skip
        if line.hidden[place] == 0:
            _pose(
                row, 25, said.map_x - truth.map_x[k], said.map_y - truth.map_y[k],
                said.map_cov[0], said.map_cov[1], said.map_cov[2],
            )  # fmt: skip
        error = math.hypot(said.x - truth.x[k], said.y - truth.y[k])
        level = said.protection_level
        row[32] += 1
        row[33] += error > level
        row[34] += error > ALARM and level <= ALARM
        row[35] += level > ALARM
        row[36] += level
        if line.hidden[place]:
            if hidden_from < 0.0:
                hidden_from = along
            if along > hidden_from + _AWAY and decision - along > 20.0:
                row[37] += 1
                row[38] += said.p_off_road
        elif hidden_from < 0.0 or along > decision + _AWAY:
            row[39] += 1
            row[40] += said.p_off_road
    if last >= 0:
        count = _chances(rows, last, road_of, roads, chances)
        _decide(row, 14, line, truth.place[last], count, roads, chances)
        k = at if at >= 0 else last
        said = rows[k]
        row[42] = math.hypot(said.x - truth.x[k], said.y - truth.y[k])
        row[43] = said.protection_level


def new_scratch() -> tuple[Matrix, Ints32, Vector]:
    """Row and scratch for `score_drive`."""
    return (
        np.zeros(len(Row._fields)), np.zeros(ALTERNATIVES, np.int32), np.zeros(ALTERNATIVES),
    )  # fmt: skip
