"""The drives: manoeuvres that maps do not draw, and towns.

Each takes a random generator and says with a flag whether it is the manoeuvre or its control:
the same streets, and as far as can be the same drive, without what is hard.
"""

import numpy as np

from .motion import LANE, Motion, Stretch, drive, joined, path, standing
from .streets import Plan

_CRUISE = 11.0  # m/s
_RADIUS_LEAST = 5.5  # m, of a turn in a narrow street
_RADIUS, _SWING = 5.0, 3.5  # m, of a U-turn; right of the middle where it begins
_YARD, _ASIDE = 75.0, 14.0  # m, into the yard, between its ways in and out
_CUTS = (0.0, 0.0, 0.6, 1.5, 3.0)  # m, by which an end of a street is drawn short


def u_turn(random: np.random.Generator, turned: bool = True) -> Plan:
    """A U-turn within the street, or past it into the street at its end."""
    end = 700.0
    lines = [
        _line((0, 0), (end, 0)), _line((end, 0), (end, 300)), _line((0, 0), (0, 300)),
        *_prolonged(end),
    ]  # fmt: skip
    x = random.uniform(300.0, 500.0)
    if not turned:
        on = [Stretch(0, _line((5, 0), (end, 0))), Stretch(2, _line((end, 0), (end, 290)))]
        return Plan(lines, drive(path(on, random), 12.0, lateral=2.0))
    angle = np.linspace(0.0, np.pi, 25)
    bend = np.column_stack([np.sin(angle), 1.0 - np.cos(angle)]) * _RADIUS + [x, -_SWING]
    there = np.vstack([_line((5, -LANE), (x - 40, -LANE), (x - 15, -_SWING)), bend[:13]])
    far = bend[-1, 1]
    back = np.vstack([bend[12:], _line((x - 15, far), (x - 40, LANE), (5, LANE))])
    aside = _line((5, LANE), (LANE, 8), (LANE, 290))
    legs = [Stretch(0, there, 0.0), Stretch(1, back, 0.0), Stretch(4, aside, 0.0)]
    return Plan(lines, drive(path(legs, random, 1.5, 1.0, 0.2), 12.0, lateral=2.0))


def yard(random: np.random.Generator, mapped: bool = False) -> Plan:
    """Into a yard, 40 s at rest there, and out again."""
    x, side = random.uniform(250.0, 350.0), random.choice([-1.0, 1.0])
    deep, out = side * _YARD, x + _ASIDE
    lines = [
        _line((0, 0), (x, 0)), _line((x, 0), (out, 0)), _line((out, 0), (700, 0)),
        _line((x, 0), (x, deep), (out, deep), (out, 0)),
        _line((700, 0), (700, 300)), _line((0, 0), (0, 300)), *_prolonged(700.0),
    ]  # fmt: skip
    rest = (x, 0.8 * deep)
    into = [Stretch(0, _line((5, 0), (x, 0))), Stretch(6, _line((x, 0), rest), 0.0)]
    away = [
        Stretch(6, _line(rest, (x, deep), (out, deep), (out, 0)), 0.0),
        Stretch(4, _line((out, 0), (690, 0))),
    ]
    legs = [drive(path(leg, random, 3.5, 3.0), _CRUISE) for leg in (into, away)]
    missing = frozenset() if mapped else frozenset([3])
    return Plan(lines, joined(standing(legs[0], 40.0), legs[1]), missing)


def side_street(random: np.random.Generator, mapped: bool = False) -> Plan:
    """Into a side street at a right angle, and 250 m along it."""
    x, side = random.uniform(350.0, 450.0), random.choice([-1.0, 1.0])
    lines = [
        _line((0, 0), (x, 0)), _line((x, 0), (900, 0)), _line((x, 0), (x, 300 * side)),
        _line((900, 0), (900, 300)), _line((0, 0), (0, 300)), *_prolonged(900.0),
    ]  # fmt: skip
    legs = [Stretch(0, _line((5, 0), (x, 0))), Stretch(4, _line((x, 0), (x, 250 * side)))]
    motion = drive(path(legs, random, 3.5, 3.0), _CRUISE)
    return Plan(lines, motion, frozenset() if mapped else frozenset([2]))


def backwards(random: np.random.Generator, metres: float, cruise: float) -> Plan:
    """Past a junction, `metres` back, and on: straight or into the street passed; 0: on at once."""
    cross = 200.0
    lines = [
        _line((0, 0), (cross, 0)), _line((cross, 0), (500, 0)), _line((cross, 0), (cross, -250)),
        _line((0, 0), (-300, 40)), _line((0, 0), (0, 150)),
    ]  # fmt: skip
    stop = random.uniform(340.0, 380.0) if metres > 200.0 else random.uniform(230.0, 290.0)
    begin = stop - metres
    into = [
        Stretch(7, lines[3][::-1]), Stretch(0, lines[0]),
        Stretch(2, _line((cross, 0), (stop, 0))),
    ]  # fmt: skip
    motion = standing(drive(path(into, random), _CRUISE), 3.0)
    if metres:
        legs = [Stretch(2, _line((stop, -LANE), (max(begin, cross), -LANE)), 0.0)]
        if begin < cross:
            legs.append(Stretch(0, _line((cross, -LANE), (begin, -LANE)), 0.0))
        back = drive(path(legs, random, wander=0.0), cruise, backwards=True)
        motion = standing(joined(motion, back), 3.0)
    aside = random.random() < 0.5 and begin < cross - 20.0
    on = [Stretch(0, _line((begin, 0), (cross, 0)))] if begin < cross else []
    last = _line((cross, 0), (cross, -240)) if aside else _line((max(begin, cross), 0), (495, 0))
    on.append(Stretch(4 if aside else 2, last))
    return Plan(lines, joined(motion, drive(path(on, random), _CRUISE)))


def backed_out(random: np.random.Generator) -> Plan:
    """Backwards out of a drive that the map lacks, on to a street, and on along it."""
    x = random.uniform(300.0, 400.0)
    lines = [
        _line((0, 0), (800, 0)), _line((800, 0), (800, 300)), _line((0, 0), (0, 300)),
        *_prolonged(800.0),
    ]  # fmt: skip
    deep = random.uniform(12.0, 25.0)
    tail = _line((x, -deep), (x, -8), (x - 1, -5), (x - 4, -2.5), (x - 8, -LANE), (x - 14, -LANE))
    back = drive(path([Stretch(0, tail, 0.0)], random, 1.0, 1.0, 0.0), 2.0, backwards=True)
    last = [Stretch(0, _line((x - 14, 0), (800, 0))), Stretch(2, _line((800, 0), (800, 290)))]
    away = drive(path(last, random), _CRUISE)
    return Plan(lines, joined(standing(_at_start(back), 20.0), back, away))


def three_points(random: np.random.Generator) -> Plan:
    """Round within a narrow street: across it, backwards, and off the other way."""
    end = 700.0
    lines = [_line((0, 0), (end, 0)), _line((end, 0), (end, 300)), _line((0, 0), (0, 300))]
    lines += _prolonged(end)
    x = random.uniform(300.0, 500.0)
    across = np.vstack([_line((5, -LANE), (x, -LANE)), _bow((x, 3.75), -90.0, -20.0)])
    tail = _bow((x + 10.3, 0.0), 160.0, 220.0)
    off = np.vstack([_bow((x + 1.9, -7.1), 40.0, 90.0), _line((x - 12, LANE), (5, LANE))])
    aside = _line((5, LANE), (LANE, 8), (LANE, 290))
    legs = [
        drive(path([Stretch(0, across, 0.0)], random, 1.0, 0.5, 0.0), _CRUISE),
        drive(path([Stretch(0, tail, 0.0)], random, 0.5, 0.5, 0.0), 1.5, backwards=True),
        drive(path([Stretch(1, off, 0.0), Stretch(4, aside, 0.0)], random, 1.0, 1.0, 0.0), _CRUISE),
    ]
    return Plan(lines, joined(*legs))


def _bow(middle: tuple[float, float], begin: float, end: float) -> np.ndarray:
    """An arc about a point, between two directions in degrees."""
    angle = np.radians(np.linspace(begin, end, 13))
    return np.column_stack([np.cos(angle), np.sin(angle)]) * _RADIUS_LEAST + middle


def _at_start(leg: Motion) -> Motion:
    """A vehicle at rest where a leg begins."""
    return Motion(
        *(column[:2] for column in (leg.time, leg.x, leg.y, leg.heading, leg.rolled, leg.code))
    )


def town(random: np.random.Generator, turns: int = 25) -> Plan:
    """A walk about a town of irregular blocks, with stops before junctions."""
    n, block = 9, 110.0
    grid = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2)
    nodes = block * grid + random.uniform(-18.0, 18.0, (n * n, 2))
    streets = [pair for pair in _neighbours(n) if random.random() > 0.12]
    diagonals = [(k, k + n + 1) for k in range(n * (n - 1)) if k % n < n - 1]
    streets += [pair for pair in diagonals if random.random() < 0.07]
    legs = _walk(nodes, streets, turns, random)
    way = path(legs, random, 5.0)
    ends = np.cumsum(np.hypot(*np.diff([leg.line[[0, -1]] for leg in legs], axis=1)[:, 0].T))
    stops = [(end - 12.0, random.uniform(3.0, 30.0)) for end in ends[:-1] if random.random() < 0.25]
    return Plan([nodes[list(pair)] for pair in streets], drive(way, 13.0, stops))


def gaps(random: np.random.Generator, cut: bool = True) -> Plan:
    """A walk about blocks whose streets are drawn up to 3 m short of the junctions."""
    n, block = 5, 120.0
    nodes = block * np.array([(k // n, k % n) for k in range(n * n)], float)
    streets = _neighbours(n)
    motion = drive(path(_walk(nodes, streets, 16, random), random, 5.0), 12.0)
    lines = []
    for pair in streets:
        a, b = nodes[list(pair)]
        short = random.choice(_CUTS, 2)[:, None] * (b - a) / block
        lines.append(np.array([a + short[0], b - short[1]] if cut else [a, b]))
    return Plan(lines, motion)


def _line(*points: tuple[float, float]) -> np.ndarray:
    return np.array(points, float)


def _prolonged(end: float) -> list[np.ndarray]:
    """Streets that go on straight from both ends of the main one."""
    return [_line((0, 0), (-300, 0)), _line((end, 0), (end + 300, 0))]


def _neighbours(n: int) -> list[tuple[int, int]]:
    """Pairs of neighbours of an n by n grid, row by row."""
    across = [(k, k + 1) for k in range(n * n) if k % n < n - 1]
    return across + [(k, k + n) for k in range(n * (n - 1))]


def _walk(
    nodes: np.ndarray, streets: list[tuple[int, int]], turns: int, random: np.random.Generator
) -> list[Stretch]:
    """Streets one after another: half of the time straight on, no sharp turn back."""
    leaving: dict[int, list[tuple[int, int]]] = {}  # of a node: code, where it leads
    for k, (a, b) in enumerate(streets):
        leaving.setdefault(a, []).append((2 * k, b))
        leaving.setdefault(b, []).append((2 * k + 1, a))
    legs: list[Stretch] = []
    while len(legs) < 0.8 * turns:
        at, legs = int(random.choice(list(leaving))), []
        ahead = np.zeros(2)
        while len(legs) < turns:
            way = {c: _towards(nodes[b] - nodes[at]) for c, b in leaving[at]}
            open_ = [(c, b) for c, b in leaving[at] if not legs or way[c] @ ahead > -0.15]
            if not open_:
                break
            likes = np.array([1.5 if way[c] @ ahead > 0.9 else 0.55 for c, _ in open_])
            code, to = open_[random.choice(len(open_), p=likes / likes.sum())]
            legs.append(Stretch(code, nodes[[at, to]]))
            at, ahead = to, way[code]
    return legs


def _towards(step: np.ndarray) -> np.ndarray:
    return step / np.hypot(*step)


def moment(motion: Motion, random: np.random.Generator) -> float:
    """When a fault begins, s: within the middle of a drive."""
    return float(random.uniform(0.35, 0.6) * motion.time[-1])
