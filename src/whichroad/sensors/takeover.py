"""Wheels and a gyro beside each other: which of them measures the turn, and which is wrong.

Wheels do, for the drift of a gyro is not known while both are used.  A gyro takes over where wheels
do what no car does, or turn otherwise than the gyro and the fixes.  Where the two differ and no fix
tells which is right, neither is used: the road gives the turn.
"""

import cmath
import math
from collections import deque
from typing import Any, NamedTuple

from ..filter.vetting.windows import BY_GYRO, BY_WHEELS, UNTURNED
from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from .standing_turn import StandingTurn
from .usual_difference import UsualDifference

WHEELS, GYRO = 0, 1
_EVERY = 0.95  # s from anchor to anchor, at least;
_WITHOUT = 1.5  # without a fix
_LONGEST = 15.0  # s between two anchors that are compared
_RECENT = 8.0  # s over which turns are compared without fixes
_DIFFER, _DISPUTE = 0.4, 0.5  # rad by which turns differ; without fixes
_SETTLED = 0.15  # rad, below which a dispute is over
_CURVED, _HARDEST = 0.45, 14.0  # 1/m, m/s²: what no car does
_MOVES, _SOON = 1.0, 0.3  # m, of a second, and of the last readings
_TICKS = 0.08  # rad by which counts are rounded, so that no less is wrong
_SAME, _STUCK = 1e-6, 2.0  # rad/s between readings, and s, of a gyro that is stuck,
_UNLIKE = 0.15  # rad by which the wheels turn otherwise meanwhile
_REFUSED, _MOST, _LEAST = 3.0, 6.0, -3.0  # of a score
_TURNS = 0.4  # rad, through which two agree
_FORGET = 30.0  # s over which sums are kept while both are believed
_STANDS = 0.02  # share of the other wheel's way that a wheel which stands makes at most

Taken = tuple[float, float, int]  # arc, m; turn, rad; what measures it (`filter.vetting.windows`)


class Anchor(NamedTuple):
    """What was summed up until a moment."""

    time: float  # s
    turned: tuple[float, float]  # rad, by wheels, by the gyro
    place: tuple[complex, complex]  # m, dead-reckoned by each
    fix: complex | None  # m
    sigma: float  # m, of the fix
    way: float  # m, driven


class Takeover:
    """Who measures the turn of a vehicle with wheels and a gyro, reading by reading.

    Args:
        track_width: Of the wheels, m.

    Attributes:
        fix: Place (m) and sigma (m) of the last fix since the last anchor; None: none came.
    """

    def __init__(self, track_width: float) -> None:
        self._track = track_width
        self._anchors: deque[Anchor] = deque(maxlen=32)
        self._turned, self._place = [0.0, 0.0], [0j, 0j]
        self._second = [0.0, 0.0, 0.0, 0.0]  # s, arc, and turns of each since the last anchor
        self._part: deque[tuple[float, ...]] = deque(maxlen=16)  # s, m, rad, rad of the last
        # readings, and the m and rad that were taken
        self.fix: tuple[complex, float] | None = None
        self._origin: tuple[float, float, float] | None = None  # degrees; cosine of the first
        self._time = -math.inf
        self._score, self.wrong = [0.0, 0.0], [False, False]
        self.disputed = False
        self.seconds = [0.0, 0.0]  # for which each was wrong,
        self.silent = [0.0, 0.0]  # or silent while the other was heard
        self.sums = [0.0, 0.0, 0.0]  # of turns: wheels², wheels times gyro, gyro², rad²
        self._constant = [math.inf, 0.0]  # rate of the gyro, rad/s, and s for which it was that
        self._usual, self._way = UsualDifference(), 0.0  # m, driven
        self._standing = StandingTurn()

    def fixed(self, lat_deg: float, lon_deg: float, sigma: float) -> None:
        """Take a fix, its sigma in m."""
        if self._origin is None:
            self._origin = (lat_deg, lon_deg, math.cos(radians(lat_deg)))
        lat, lon, narrow = self._origin
        east = math.remainder(lon_deg - lon, 360.0) * narrow
        self.fix = (METRES_PER_DEGREE * complex(east, lat_deg - lat), sigma)

    def moved(self, time: float, arc: float, wheels: float, gyro: float | None) -> Taken:
        """Take what was measured since the reading before.

        Args:
            time: s.
            arc: By the wheels, m.
            wheels: Turn by the wheels, rad.
            gyro: Turn by the gyro; None: it was not heard.
        """
        dt, self._time = time - self._time, time
        if gyro is None or not 0.0 < dt <= _WITHOUT:
            if gyro is None and self._constant[0] < math.inf and dt <= _LONGEST:
                self.silent[GYRO] += dt
            self._begin()
            return arc, wheels, BY_WHEELS
        stands = arc == 0.0 and wheels == 0.0 and not any(self.wrong)
        if self._standing.take(dt, stands, gyro):
            self._begin()  # it is no dispute
        self._sum_up(dt, arc, wheels, gyro)
        if self._second[0] >= (_EVERY if self.fix is not None else _WITHOUT):
            self._judge(time)
        taken = self._taken(dt, arc, wheels, gyro)
        self._part.append((dt, arc, wheels, gyro, taken[0], taken[1]))
        whole = self._standing.given(dt)
        return (taken[0], taken[1] + whole, BY_WHEELS) if whole else taken

    def _taken(self, dt: float, arc: float, wheels: float, gyro: float) -> Taken:
        """What is taken of a reading."""
        if self.wrong[WHEELS] and not self.wrong[GYRO]:
            return self._alive(arc, wheels, gyro), gyro, BY_GYRO
        part = self._part
        while part and sum(abs(one[1]) for one in part) - abs(part[0][1]) + abs(arc) > _SOON:
            part.popleft()
        past = [sum(column) for column in zip(*part, strict=True)] if part else [0.0] * 6
        t, far, w, g = (a + b for a, b in zip(past[:4], (dt, arc, wheels, gyro), strict=True))
        sound = abs(w - g) <= _TICKS or not _impossible(t, far, w, _SOON)
        if self.wrong[GYRO] or sound or _impossible(t, far, g, _SOON):
            return arc, wheels, UNTURNED if self.disputed else BY_WHEELS
        self._count(WHEELS, _REFUSED)
        self.wrong[WHEELS] = True  # and what was given of these wheels is taken back
        return self._alive(far, w, g) - past[4], g - past[5], BY_GYRO

    def mute(self, seconds: float) -> None:
        """Wheels were silent beside the gyro for so many seconds."""
        self.silent[WHEELS] += seconds

    def kept(self) -> list[Any]:
        """What it knows, as numbers."""
        places = [[p.real, p.imag] for p in self._place]
        fix = None if self.fix is None else [self.fix[0].real, self.fix[0].imag, self.fix[1]]
        anchors = [
            [a.time, *a.turned, *(n for p in a.place for n in (p.real, p.imag)), a.sigma, a.way]
            + ([] if a.fix is None else [a.fix.real, a.fix.imag])
            for a in self._anchors
        ]  # fmt: skip
        return [
            self._time, self._turned, places, self._second, list(map(list, self._part)), fix,
            self._origin, self._score, self.wrong, self.disputed, self.seconds, self.silent,
            self.sums, self._constant, self._usual.kept(), self._way,
            self._standing.kept(), anchors,
        ]  # fmt: skip

    def restore(self, kept: list[Any]) -> None:
        """Know again what `kept` gave."""
        copied: list[Any] = [list(one) if isinstance(one, list) else one for one in kept]
        (
            self._time, self._turned, places, self._second, part, fix, origin, self._score,
            self.wrong, self.disputed, self.seconds, self.silent, self.sums, self._constant,
            usual, self._way, standing, anchors,
        ) = copied  # fmt: skip
        self._part = deque(map(tuple, part), maxlen=16)
        self._origin = None if origin is None else (origin[0], origin[1], origin[2])
        self._usual.restore(usual)
        self._standing.restore(standing)
        self._anchors.clear()
        for time, w, g, wx, wy, gx, gy, sigma, way, *at in anchors:
            place = complex(*at) if at else None
            two = (complex(wx, wy), complex(gx, gy))
            self._anchors.append(Anchor(time, (w, g), two, place, sigma, way))
        self._place = [complex(*p) for p in places]
        self.fix = None if fix is None else (complex(fix[0], fix[1]), fix[2])

    def _begin(self) -> None:
        """Compare from now on only."""
        self._anchors.clear()
        self._part.clear()
        self._second, self.fix, self.disputed = [0.0, 0.0, 0.0, 0.0], None, False

    def _sum_up(self, dt: float, arc: float, wheels: float, gyro: float) -> None:
        for who, turn in enumerate((wheels, gyro)):
            self._place[who] += cmath.rect(arc, self._turned[who] + 0.5 * turn)
            self._turned[who] += turn
        for k, value in enumerate((dt, arc, wheels, gyro)):
            self._second[k] += value
        rate, lasted = self._constant
        same = abs(gyro / dt - rate) < _SAME
        self._constant = [rate, lasted + dt] if same else [gyro / dt, 0.0]

    def _alive(self, arc: float, wheels: float, gyro: float) -> float:
        """The arc; where one wheel stands, that of the other one beside the gyro's turn."""
        half = 0.5 * self._track
        left, right = arc - half * wheels, arc + half * wheels
        if abs(left) < _STANDS * abs(right):
            return arc + half * wheels - half * gyro
        if abs(right) < _STANDS * abs(left):
            return arc - half * wheels + half * gyro
        return arc

    def _judge(self, time: float) -> None:
        """Keep an anchor, and decide who is believed."""
        since, arc, wheels, gyro = self._second
        self._way += arc
        fix, sigma = self.fix or (None, math.inf)
        self._second, self.fix = [0.0, 0.0, 0.0, 0.0], None
        self._anchors.append(
            Anchor(time, (self._turned[0], self._turned[1]), (self._place[0], self._place[1]),
                   fix, sigma, self._way)
        )  # fmt: skip
        if fix is not None and not any(self.wrong):
            self._usual.take(since, arc, wheels - gyro)
        kept = 1.0 if any(self.wrong) else math.exp(-since / _FORGET)
        for k, product in enumerate((wheels * wheels, wheels * gyro, gyro * gyro)):
            self.sums[k] = kept * self.sums[k] + product
        impossible = [_impossible(since, arc, turn) for turn in (wheels, gyro)]
        if impossible[WHEELS] != impossible[GYRO] and abs(wheels - gyro) > _TICKS:
            self._count(WHEELS if impossible[WHEELS] else GYRO, _REFUSED)
        self._by_fixes(since)
        self._dispute(time)
        for who in (WHEELS, GYRO):
            if self._score[who] >= _REFUSED:
                self.wrong[who] = True
            elif self._score[who] <= _LEAST:
                self.wrong[who] = False
            self.seconds[who] += since if self.wrong[who] else 0.0

    def _count(self, who: int, seconds: float) -> None:
        self._score[who] = min(max(self._score[who] + seconds, _LEAST), _MOST)

    def _by_fixes(self, since: float) -> None:
        """Compare turns of both with those of the fixes, where these are far enough apart."""
        last = self._anchors[-1]
        middle = self._far_from(last)
        first = self._far_from(middle) if middle is not None else None
        if first is None or middle is None:
            return
        ways = zip(_places(first), _places(middle), _places(last), strict=True)
        legs = [(m - a, b - m) for a, m, b in ways]
        wheels, gyro, fixes = (cmath.phase(after * before.conjugate()) for before, after in legs)
        unsure = 2.0 * _error(first, last) / min(map(abs, legs[2]))
        if abs(_wrap(wheels - gyro)) > _DIFFER:
            by = [abs(_wrap(turn - fixes)) for turn in (wheels, gyro)]
            for who in (WHEELS, GYRO):
                if by[who] > 0.5 + unsure and by[1 - who] < 0.25 + unsure:
                    self._count(who, 3.0 * since if by[who] > 1.0 + unsure else since)
        elif abs(wheels) > _TURNS and abs(_wrap(wheels - gyro)) < 0.5 * _DIFFER:
            self._count(WHEELS, -2.0 * since)
            self._count(GYRO, -2.0 * since)

    def _far_from(self, last: Anchor) -> Anchor | None:
        """The newest anchor whose fix is far enough from that of another one."""
        for one in reversed(self._anchors):
            if one.time >= last.time or one.fix is None or last.fix is None:
                continue
            if last.time - one.time > _LONGEST:
                return None
            if abs(last.fix - one.fix) >= 5.0 * _error(one, last) + 5.0:
                return one
        return None

    def _dispute(self, time: float) -> None:
        """Whether the two differ while nothing tells who is right."""
        recent = next((one for one in self._anchors if time - one.time <= _RECENT), None)
        assert recent is not None
        last = self._anchors[-1]
        off = [b - a for a, b in zip(recent.turned, last.turned, strict=True)]
        usual = self._usual.over(last.time - recent.time, last.way - recent.way)
        apart = abs(off[WHEELS] - off[GYRO] - usual)
        stuck = self._constant[1] > _STUCK and apart > _UNLIKE
        if stuck and self._score[WHEELS] < _REFUSED and not self.wrong[WHEELS]:
            self._count(GYRO, _REFUSED)
        if any(self.wrong) or max(self._score) >= _REFUSED:
            self.disputed = False
        elif apart > _DISPUTE:
            self.disputed = True
        elif apart < _SETTLED:
            self.disputed = False


def _wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def _places(one: Anchor) -> tuple[complex, complex, complex]:
    """By wheels, by the gyro, by the fix."""
    return (*one.place, one.fix if one.fix is not None else 0j)


def _error(a: Anchor, b: Anchor) -> float:
    """Of the way between two fixes, m: errors a few seconds apart are alike."""
    return 0.8 * math.hypot(a.sigma, b.sigma) + 1.0


def _impossible(seconds: float, arc: float, turn: float, least: float = _MOVES) -> bool:
    """Whether no car turns so."""
    if abs(arc) < least:
        return False
    turned = abs(turn) - _TICKS
    return turned > _CURVED * abs(arc) or turned * abs(arc) > _HARDEST * seconds * seconds
