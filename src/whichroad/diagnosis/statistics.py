"""Consistency statistics of a drive: running sums from which `findings` judges the settings.

The filter's own innovations, a second apart, see hardly more than the white part of the
GNSS error.  The statistics are differences of fixes up to two minutes apart, less the
odometer's displacement in between: half of the squared difference grows with the lag L as

    D(L) = w² + σ² (1 − exp(−L / T))     in units of the reported variance,

with white error w, slow error σ, its time T (`gnss_time`), and what the wheels err
themselves.  The difference follows the change of velocity where a clock is late, and that
of the heading where the antenna is elsewhere.  The other sums are of the odometer's scale
and turns as the filter corrects them, and of the map's error as it sees it.
"""

import math
import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..filter.summary.estimate import Output
from ..observations import Array
from ..settings import Settings, Vehicle

Chosen = NDArray[Any]

LAGS = (2.0, 10.0, 40.0, 120.0)  # s spent moving
_REACH = 1.25  # longest interval of a pair over its nominal lag
_MIDDLE = 1  # index of the lag at which turns and clocks are estimated
_BREAK = 0.5  # rad, largest change of heading in one epoch beside that of the odometry
_WARM = 30.0  # s of moving before anything counts
_WHEELS = 1e-3  # m² per m driven, variance of the displacement by wheels and heading
_BENT = 9.0  # the same per squared error of the turns' gain
_FEW_TURNS = 20.0  # rad², least sum of squared turns
_MOST = 20.0  # most that a pair may count, times its expectation
_GRID = np.geomspace(1 / 16, 16, 65)  # σ² and T over those of the settings
_ABOVE, _BELOW = 0.3, 0.6  # log σ² over and under the scale that the filter has learnt
_FEWEST_TIMES = 100.0  # pairs that show how times scatter
_WEIGHT = 0.04  # weight of log D for each pair and 1/s of lag


class Row(NamedTuple):
    """What the statistics need of one epoch, or columns of n epochs."""

    time: Any  # s
    arc: Any  # odometer m since the epoch before
    turn: Any  # rad
    speed: Any  # m/s, from here on the filter's estimate
    heading: Any  # rad
    scale: Any  # of the GNSS errors; 0: not estimated yet
    x: Any  # plane m
    y: Any
    map_x: Any  # the same in the map's frame
    map_y: Any
    has_fix: Any
    fix_x: Any  # plane m
    fix_y: Any
    major: Any  # m, reported sigmas
    minor: Any


_ESTIMATED = ("speed", "heading", "gnss_scale", "x", "y", "map_x", "map_y")
_ROW = struct.Struct(f"={len(Row._fields)}d")
_SUMS = ("_state", "_pairs", "_turning", "_shifting", "_errors", "_metres", "_times")  # of a drive
_BLOCK = 2048  # epochs that are accumulated together on line


class GnssErrors(NamedTuple):
    """GNSS errors as estimated from fixes far apart."""

    white: float  # w², over the reported variance
    size: float  # σ², over the reported variance
    time: float  # T, over the setting's
    size_if_right: float  # σ², if T is that of the settings


class Shift(NamedTuple):
    """Errors of the clocks' offset and of the lever arm, as estimated from fixes."""

    late: float  # s, fixes after the odometer
    antenna: complex  # m, ahead + i left
    sigma_late: float
    sigma_antenna: float


class Times(NamedTuple):
    """How fixes scatter along the way from one to the next, as times that are not theirs make."""

    sigma: float  # s, that would explain it
    along: float  # m
    later: float  # m, the same after a longer time: what wheels err adds up, times do not
    across: float  # m


def rows_of(epochs: Records, output: Output) -> Array:
    """Columns of `Row` for every epoch, (n, 15)."""
    odometer = [epochs.time, epochs.arc, epochs.turn]
    estimate = [output.rows[name] for name in _ESTIMATED]
    return np.column_stack([*odometer, *estimate, epochs.has_fix, epochs.fix[:, :4]])


class _Fixes(NamedTuple):
    """Fixes taken while moving, of the last lag."""

    moving: Array  # s spent moving
    error: Array  # complex m: fix less what was driven
    ahead: Array  # complex unit vector
    speed: Array  # m/s
    heading: Array  # rad, not wrapped
    turn: Array  # rad by the odometer
    arc: Array  # m
    breaks: Array  # how often the heading was thought to be another
    clock: Array  # s, also while standing


class ConsistencyStatistics:
    """Running sums over a drive; their memory does not grow.

    Args:
        settings: What is to be judged.
        vehicle: For its antenna.
        by_time: Whether the heading drifts by the second, as a gyro's does, not by the metre.
    """

    def __init__(self, settings: Settings, vehicle: Vehicle, *, by_time: bool = False) -> None:
        self.settings, self.vehicle, self.by_time = settings, vehicle, by_time
        self._antenna = complex(vehicle.antenna_forward, vehicle.antenna_left)
        self._block, self._waiting = np.zeros((_BLOCK, len(Row._fields))), 0
        self._last: Array | None = None  # row
        self._driven = 0j  # m, by the odometer as the filter corrects it
        self._state = np.zeros(6)  # moving s, heading, turn, arc, breaks, clock s
        self._cell = 0.0  # second of moving of the last fix that counts
        self._recent = _Fixes(*(np.zeros(0, complex if i in (1, 2) else float) for i in range(9)))
        self._pairs = np.zeros((len(LAGS), 4))  # number, D, m driven over variance, lag
        self._turning = np.zeros(5)  # sums of turn², turn arc, arc², turn heading, arc heading
        self._shifting = np.zeros(7, complex)  # v²+, v+u, u²+, v+e, u+e, e²+; +: weighted; pairs
        # fixes, scale², map error² over the setting's, logarithms of reported variances
        self._errors = np.zeros(4)
        self._metres = np.zeros(2)  # by the filter, by the odometer
        # pairs of the two shortest lags: number, and sums of a², av, v², c², u² of differences
        # along the way, of speed, and across the way, and of speeds
        self._times = np.zeros((2, 6))

    def accumulate(self, epoch: Sequence[float], estimate: Sequence[float]) -> None:
        """Add an epoch, as on line; it is accumulated later.

        Args:
            epoch: Time, arc, turn, the five numbers of its fix, and 1 where it has one.
            estimate: Of it: x, y, heading, map_x, map_y, speed, gnss_scale.
        """
        time, arc, turn, fix_x, fix_y, major, minor, _, fixed = epoch
        x, y, heading, map_x, map_y, speed, scale = estimate
        _ROW.pack_into(
            self._block.data, self._waiting * _ROW.size, time, arc, turn, speed, heading, scale,
            x, y, map_x, map_y, fixed, fix_x, fix_y, major, minor,
        )  # fmt: skip
        self._waiting += 1
        if self._waiting == _BLOCK:
            self._flush()

    @property
    def waiting(self) -> int:
        """How many epochs were added that are not accumulated yet."""
        return self._waiting

    def forget_after(self, waiting: int) -> None:
        """Forget the last epochs that wait, so that no more than so many do."""
        self._waiting = min(max(waiting, 0), self._waiting)

    def together(self, others: "Sequence[ConsistencyStatistics]") -> "ConsistencyStatistics":
        """The sums of several drives of one car, these included.

        Args:
            others: Of the same settings and car.
        """
        out = ConsistencyStatistics(self.settings, self.vehicle, by_time=self.by_time)
        for one in (self, *others):
            one._flush()
            for name in _SUMS:
                setattr(out, name, getattr(out, name) + getattr(one, name))
        return out

    def _flush(self) -> None:
        waiting, self._waiting = self._waiting, 0
        self.take(self._block[:waiting])

    def take(self, rows: Array) -> None:
        """Add epochs, in time order, columns as in `Row`."""
        rows = rows[rows[:, 5] > 0.0]
        if not len(rows):
            return
        table = Row(*rows.T)
        before = Row(*(rows[0] if self._last is None else self._last))
        self._last = rows[-1].copy()
        since = np.diff(table.time, prepend=before.time)
        swing = np.diff(np.unwrap(np.append(before.heading, table.heading)))
        step = table.speed * since
        middle = table.heading - 0.5 * swing
        driven = self._driven + np.cumsum(step * np.exp(1j * middle))
        limit = _BREAK if self._state[2] or table.turn.any() else math.pi / 2 + _BREAK
        change = np.column_stack(
            [
                since * (np.abs(table.speed) > 0.05), swing, table.turn, np.abs(table.arc),
                np.abs(swing - table.turn) > limit, since,
            ]
        )  # fmt: skip
        state = self._state + np.cumsum(change, axis=0)
        cell = np.floor(np.append(self._state[0], state[:, 0]))  # s of moving
        self._driven, self._state = complex(driven[-1]), state[-1]
        warm = state[:, 0] > _WARM
        counted = np.abs(step) * (table.arc != 0.0)  # who creeps below an odometer's least speed
        self._metres += [counted[warm].sum(), change[warm, 3].sum()]
        seen = np.flatnonzero((table.has_fix > 0) & warm)
        first_in_cell = np.diff(cell[seen + 1], prepend=self._cell) > 0
        seen = seen[first_in_cell]  # one a second at most, none while standing
        self._cell = float(cell[seen[-1] + 1]) if len(seen) else self._cell
        at = Row(*rows[seen].T)
        ahead = np.exp(1j * at.heading)
        error = at.fix_x + 1j * at.fix_y - self._antenna * ahead - driven[seen]
        self._pair(_Fixes(state[seen, 0], error, ahead, at.speed, *state[seen, 1:].T), at)

    def _pair(self, fixes: _Fixes, table: Row) -> None:
        """Pair each fix with one of each lag before."""
        every = _Fixes(*(np.append(a, b) for a, b in zip(self._recent, fixes, strict=True)))
        first = len(self._recent.moving)
        reported = 0.5 * (table.major**2 + table.minor**2)
        at = np.arange(first, len(every.moving))
        for number, lag in enumerate(LAGS):
            back = np.searchsorted(every.moving, fixes.moving - lag + 1e-3, side="right") - 1
            apart = every.moving[at] - every.moving[np.maximum(back, 0)]
            near = (back >= 0) & (apart <= _REACH * lag + 1.0)
            near &= every.breaks[at] == every.breaks[np.maximum(back, 0)]
            a, b = back[near], at[near]
            variance = reported[near]
            driven = (every.arc[b] - every.arc[a]) / variance
            expected = self._expected(apart[near]) + 0.5 * _WHEELS * driven
            seen = 0.25 * np.abs(every.error[b] - every.error[a]) ** 2 / variance
            self._pairs[number] += [
                len(a), np.minimum(seen, _MOST * expected).sum(), driven.sum(), apart[near].sum(),
            ]  # fmt: skip
            if number <= _MIDDLE:
                self._add_times(number, every, a, b)
            if number == _MIDDLE:
                over = every.clock if self.by_time else every.arc
                swing, turn, arc = (x[b] - x[a] for x in (every.heading, every.turn, over))
                self._turning += [turn @ turn, turn @ arc, arc @ arc, turn @ swing, arc @ swing]
                self._add_shift(every, a, b, variance, seen < _MOST * expected)
        off = 0.5 * ((table.map_x - table.x) ** 2 + (table.map_y - table.y) ** 2)
        self._errors += [
            len(reported), (table.scale**2).sum(), off.sum() / self.settings.map_sigma**2,
            np.log(np.maximum(reported, 1e-12)).sum(),
        ]  # fmt: skip
        if len(every.moving):
            keep = every.moving >= every.moving[-1] - (_REACH * LAGS[-1] + 1.0)
            self._recent = _Fixes(*(column[keep] for column in every))

    def _add_shift(
        self, fixes: _Fixes, a: Chosen, b: Chosen, variance: Array, plausible: Chosen
    ) -> None:  # fmt: skip
        """Differences between fixes a and b, of errors, velocities and directions."""
        a, b, weight = a[plausible], b[plausible], 1.0 / variance[plausible]
        velocity = fixes.speed * fixes.ahead
        v, u, e = (x[b] - x[a] for x in (velocity, fixes.ahead, fixes.error))
        self._shifting += [
            (weight * (x.conj() * y)).sum()
            for x, y in ((v, v), (v, u), (u, u), (v, e), (u, e), (e, e))
        ] + [len(a)]

    def _add_times(self, lag: int, fixes: _Fixes, a: Chosen, b: Chosen) -> None:
        """Differences between fixes a and b, along and across the way."""
        off = (fixes.error[b] - fixes.error[a]) * fixes.ahead[b].conj()
        along, across, faster = off.real, off.imag, fixes.speed[b] - fixes.speed[a]
        self._times[lag] += [
            len(a), along @ along, along @ faster, faster @ faster, across @ across,
            fixes.speed[b] @ fixes.speed[b],
        ]  # fmt: skip

    def times(self) -> Times:
        """How the times of fixes scatter; a delay that is always the same is none of it."""
        self._flush()
        n, aa, av, vv, cc, uu = self._times.T
        if n.min() < _FEWEST_TIMES or uu.min() <= 0.0:
            return Times(0.0, 0.0, 0.0, 0.0)
        along = 0.5 * np.maximum(aa - av * av / np.maximum(vv, 1e-9), 0.0) / n
        metres, later = np.sqrt(along).tolist()
        return Times(metres / math.sqrt(uu[0] / n[0]), metres, later, math.sqrt(0.5 * cc[0] / n[0]))

    def _expected(self, lag: Array) -> Array:
        s = self.settings
        return s.gnss_white_ratio**2 + 1.0 - np.exp(-lag / s.gnss_time)

    @property
    def moving(self) -> float:
        """Seconds spent moving that count, after all waiting epochs are accumulated."""
        self._flush()
        return float(self._state[0] - _WARM) if self._errors[0] else 0.0

    @property
    def metres(self) -> float:
        """Metres driven."""
        return float(self._metres[0])

    @property
    def scale(self) -> float:
        """Metres for each metre of the odometer, as the filter has learnt."""
        filtered, counted = self._metres
        return float(filtered / counted) if counted > 0.0 else 1.0

    @property
    def map_error(self) -> float:
        """Mean square of the map's error, as the filter estimates it, over that of the settings."""
        return float(self._errors[2] / self._errors[0])

    @property
    def reported(self) -> float:
        """Geometric mean of the sigmas that fixes report, m."""
        return math.exp(0.5 * float(self._errors[3] / self._errors[0]))

    @property
    def hidden(self) -> bool:
        """Whether what the wheels err hides what the fixes do."""
        return bool(self._wheel_errors().sum() >= 0.5 * self._pairs[:, 1].sum())

    def errors(self) -> GnssErrors:
        """The most probable ones given D(L), and that the learnt scale is seldom too small."""
        number, seen, _, lag = self._pairs.T
        used = number > 0
        n = number[used]
        level = np.maximum((seen - self._wheel_errors())[used] / n, 1e-3)
        lags = lag[used] / n / self.settings.gnss_time
        learnt = self._errors[1] / self._errors[0]
        time, size = np.meshgrid(_GRID, _GRID, indexing="ij")
        slow = size[..., None] * (1.0 - np.exp(-lags / time[..., None]))
        if used[0]:
            white = np.maximum(level[0] - slow[..., :1], 0.01)
        else:
            white = np.full((1, 1, 1), self.settings.gnss_white_ratio**2)
        weight = _WEIGHT * n / np.array(LAGS)[used]
        miss = (np.log(level / (white + slow)) ** 2 * weight).sum(axis=-1)
        least = np.minimum(white[..., 0] / self.settings.gnss_white_ratio**2, learnt)
        least = np.sqrt(least * learnt)  # what is learnt is never less than 1
        miss += (np.maximum(np.log(size / learnt), 0.0) / _ABOVE) ** 2
        miss += (np.minimum(np.log(size / least), 0.0) / _BELOW) ** 2
        i, j = np.unravel_index(np.argmin(miss), miss.shape)
        right = int(np.argmin(miss[len(_GRID) // 2]))
        w2 = float(np.broadcast_to(white, (*miss.shape, 1))[i, j, 0])
        return GnssErrors(w2, float(_GRID[j]), float(_GRID[i]), float(_GRID[right]))

    def _wheel_errors(self) -> Array:
        """What wheels err in the sums of D, one a lag."""
        gain, _ = self.turns()
        variance = _WHEELS + _BENT * (gain - 1.0) ** 2
        return np.asarray(0.5 * variance * self._pairs[:, 2])

    @property
    def turned(self) -> bool:
        """Whether the odometry turned so much that `turns` can tell."""
        tt, ta, aa, _, _ = self._turning
        return bool(tt >= _FEW_TURNS and tt * aa > ta * ta)

    @property
    def steered(self) -> bool:
        """Whether the odometry measures turns; else headings are the fixes' own, which lag."""
        return bool(self._turning[0] > 0.0)

    @property
    def counted(self) -> float:
        """Metres by the odometry alone."""
        return float(self._metres[1])

    def turns(self) -> tuple[float, float]:
        """Turns as the filter corrects them over those of the odometer, and drift.

        Drift is in rad/m, or in rad/s where it is by time.
        """
        tt, ta, aa, th, ah = self._turning
        if not self.turned:
            return 1.0, 0.0
        rest = tt * aa - ta * ta
        return float((th * aa - ah * ta) / rest), float((ah * tt - th * ta) / rest)

    def shift(self) -> Shift:
        """Regress differences of fixes on those of velocity and of the direction ahead."""
        vv, vu, uu, ve, ue, ee, n = self._shifting
        rest = (vv * uu - abs(vu) ** 2).real
        if n.real < 100.0 or rest <= 1e-6 * (vv * uu).real:
            return Shift(0.0, 0j, math.inf, math.inf)
        late = (uu * ve - vu * ue) / rest
        antenna = (vv * ue - vu.conjugate() * ve) / rest
        variance = LAGS[_MIDDLE] * ee.real / (2.0 * n.real * rest)  # of one in so many seconds
        left = max(1.0 - float((antenna.conjugate() * ue).real / ee.real), 0.0)  # by the antenna
        return Shift(
            float(-late.real),
            complex(antenna),
            math.sqrt(variance * uu.real),
            math.sqrt(variance * left * vv.real),
        )
