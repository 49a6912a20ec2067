"""What each decision of a drive was about: fork, parallel road, roundabout, unmapped street, ..."""

import numpy as np

from .drivers import Truth
from .maps import Chart
from .nets import Net

FORK = np.radians(30.0)  # exits closer to each other than this are a fork
BESIDE = (2.0, 30.0)  # m, from the car to a parallel road
AHEAD = 50.0  # m beyond the decision, where roads beside are looked for
_ALIGNED = np.radians(15.0)


def situations(net: Net, chart: Chart, truth: Truth) -> tuple[np.ndarray, list[frozenset[str]]]:
    """When decisions were passed, and what they were.

    Args:
        net: The truth.
        chart: The map; invented streets make decisions too.
        truth: The drive.

    Returns:
        (d,) times, ascending, and the kinds of each.
    """
    change = np.flatnonzero(np.diff(truth.code)) + 1
    times, kinds = [], []
    for k in change:
        before, after = int(truth.code[k - 1]), int(truth.code[k])
        node = net.ends(after)[0]
        if chart.degree.get(node, 0) < 3:
            continue
        kind = set()
        if net.streets[before >> 1].ring or net.streets[after >> 1].ring:
            kind.add("roundabout")
        if _forks(net, before, after):
            kind.add("fork")
        if chart.road_of_code[after] < 0:
            kind.add("unmapped street")
        if node in chart.false_nodes:
            kind.add("invented street")
        kind |= _beside(chart, truth, int(k), after)
        times.append(float(truth.time[k]))
        kinds.append(frozenset(kind or {"junction"}))
    return np.array(times), kinds


def _forks(net: Net, before: int, after: int) -> bool:
    """Whether another exit leaves in nearly the direction of the one that was taken."""
    taken = _course(net.line(after))
    others = [e for e in net.leaving[net.ends(after)[0]] if e >> 1 not in (before >> 1, after >> 1)]
    return any(abs(_turn(_course(net.line(e)) - taken)) < FORK for e in others)


def _course(line: np.ndarray) -> float:
    """Direction of the first 20 m of a line, rad."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    x, y = (np.interp(min(20.0, along[-1]), along, line[:, i]) - line[0, i] for i in (0, 1))
    return float(np.arctan2(y, x))


def _turn(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _beside(chart: Chart, truth: Truth, k: int, after: int) -> set[str]:
    """Whether a street runs beside the one that was taken, and with what lane counts."""
    import shapely

    at = int(np.searchsorted(truth.travel, truth.travel[k] + AHEAD))
    if at >= len(truth):
        return set()
    here = np.array([truth.x[at], truth.y[at]])
    own = int(truth.code[at]) >> 1
    found = set()
    for j in chart.tree.query(shapely.Point(here), "dwithin", BESIDE[1]):
        if j in (own, after >> 1):
            continue
        s = chart.lines[j].project(shapely.Point(here))
        p = np.array(chart.lines[j].interpolate(s).coords[0])
        a, b = (np.array(chart.lines[j].interpolate(s + d).coords[0]) for d in (-10.0, 10.0))
        away = float(np.hypot(*(p - here)))
        course = float(np.arctan2(*(b - a)[::-1]))
        slant = abs((course - truth.heading[at] + np.pi / 2) % np.pi - np.pi / 2)
        if away >= BESIDE[0] and slant < _ALIGNED and 1.0 < s < chart.lines[j].length - 1.0:
            found.add("parallel")
            found.add("parallel < 15 m" if away < 15.0 else "parallel >= 15 m")
            if chart.lanes[j] != chart.lanes[own]:
                found.add("parallel, other lanes")
    return found
