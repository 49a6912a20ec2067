"""Do the settings fit the data?  Running sums that tell, and which one does not.

The filter's own innovations, a second apart, see hardly more than the white part of the
GNSS error.  What is looked at here are fixes up to two minutes apart, less what the wheels
say was driven in between: half of the squared difference grows with the lag L as

    D(L) = w² + σ² (1 − exp(−L / T))     in units of the reported variance,

with white error w, slow error σ, its time T (`gnss_time`), and what the wheels err
themselves.  The other sums are of the odometer's scale and turns as the filter corrects
them, and of the map's error as it sees it.  What the sums are in drives that do fit was
found by simulation; the bands leave fewer than one in a hundred of such drives outside.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .core.epoch import CLOCK, Epochs
from .core.output import (
    V_GNSS_SCALE,
    V_H,
    V_MAP_X,
    V_MAP_Y,
    V_SPEED,
    V_X,
    V_Y,
    Output,
)
from .records import Array
from .settings import Settings, Vehicle

LAGS = (2.0, 10.0, 40.0, 120.0)  # s spent moving
_REACH = 1.25  # a pair may be that much longer than its lag
_TURNS = 1  # the lag at which turns are looked at
_BREAK = 0.5  # rad, a change of heading in one epoch that no wheel has seen
_WARM = 30.0  # s of moving before anything counts
_WHEELS = 1e-3  # m² per m driven, variance of what wheels and heading say was driven
_BENT = 9.0  # the same for each (gain of turns − 1)²: headings are wrong after a turn
_MOST = 20.0  # times what is expected a pair may say
_GRID = np.geomspace(1 / 16, 16, 65)  # of σ² and T over what the settings say
_ABOVE, _BELOW = 0.3, 0.6  # log σ² over and under the scale that the filter has learnt
_WEIGHT = 0.04  # of log D for each pair and 1/s of lag, beside these

_ENOUGH = 3000.0  # s of moving from which on the bands are as they are
_LEAST = 600.0  # and below which there is no verdict
_TIME = 1.55  # T over the setting, or under it
_SURELY = 3.5  # the same where the sigma's being too large would explain it as well
_SIGMA = 1.18  # σ over what is reported, T being right
_SIGMA_TOO = 1.25  # the same where T is not
_SMALL = 0.7  # σ below which the receiver says too much
_FEW_TURNS = 20.0  # rad², as the sum of squares
_SCALE = 4.0  # sigmas of the settings' scale and drift
_GAIN = 0.035  # of turns
_MAP = 1.25  # mean square map error over what the settings say


class Row(NamedTuple):
    """What is looked at of one epoch, or columns of n epochs."""

    time: Any  # s
    arc: Any  # odometer m since the epoch before
    turn: Any  # rad
    speed: Any  # m/s, from here on what the filter says
    heading: Any  # rad
    scale: Any  # of the GNSS errors; 0: nothing is said yet
    x: Any  # plane m
    y: Any
    map_x: Any  # the same in the map's frame
    map_y: Any
    has_fix: Any
    fix_x: Any  # plane m
    fix_y: Any
    major: Any  # m, reported sigmas
    minor: Any


_SAID = np.array([V_SPEED, V_H, V_GNSS_SCALE, V_X, V_Y, V_MAP_X, V_MAP_Y])
_BLOCK = 512  # epochs that are looked at together on line


@dataclass(frozen=True, slots=True)
class Finding:
    """A setting, or a sensor, that does not fit the data."""

    what: str  # `gnss sigma`, `gnss_time`, `map_sigma`, `wheels: scale`, ...
    level: str  # "warning": answers may be wrong; "information": they are only too careful
    statistic: float
    low: float  # where settings that fit are expected
    high: float
    advice: str

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"{self.what}: {self.statistic:.3g}, {self.low:.3g} to {self.high:.3g} was expected; "
            f"{self.advice}"
        )


def diagnose(answer: Any) -> list[Finding]:
    """Say which settings do not fit the data.

    Args:
        answer: A `Result`, a `Localizer`, or a recorded drive as `localize_recorded` gives it.

    Returns:
        Findings, empty where everything fits, or too little was driven to tell (ten minutes
        of driving with wheels and fixes; GNSS alone cannot tell).
    """
    return list(answer.diagnosis)


def rows_of(epochs: Epochs, output: Output) -> Array:
    """Columns of `Row` for every epoch, (n, 15)."""
    odometer = np.column_stack([epochs.time, epochs.arc, epochs.turn])
    fix = np.column_stack([epochs.has_fix, epochs.fix[:, :4]])
    return np.hstack([odometer, output.value[:, _SAID], fix])


class _Fixes(NamedTuple):
    """Fixes taken while moving, of the last lag."""

    moving: Array  # s spent moving
    error: Array  # complex m: fix less what was driven
    heading: Array  # rad, not wrapped
    turn: Array  # rad by the odometer
    arc: Array  # m
    breaks: Array  # how often the heading was thought to be another


class Watch:
    """Running sums over a drive; what they remember does not grow.

    Args:
        settings: What is to be judged.
        vehicle: For its antenna.
    """

    def __init__(self, settings: Settings, vehicle: Vehicle) -> None:
        self.settings = settings
        self._antenna = complex(vehicle.antenna_forward, vehicle.antenna_left)
        self._track = vehicle.track_width
        self._block, self._waiting = np.zeros((_BLOCK, len(Row._fields))), 0
        self._last: Array | None = None  # row
        self._driven = 0j  # m, by the odometer as the filter corrects it
        self._state = np.zeros(5)  # moving s, heading, turn, arc, breaks
        self._recent = _Fixes(*(np.zeros(0, complex if i == 1 else float) for i in range(6)))
        self._pairs = np.zeros((len(LAGS), 4))  # number, D, m driven over variance, lag
        self._turning = np.zeros(5)  # sums of turn², turn arc, arc², turn heading, arc heading
        self._errors = np.zeros(3)  # fixes, scale², map error² over the setting's
        self._metres = np.zeros(2)  # by the filter, by the odometer

    def look(self, epochs: Epochs, output: Output) -> None:
        """Add the one epoch that there is, as on line; it is looked at later."""
        row = self._block[self._waiting]
        row[0], row[1], row[2] = epochs.time[0], epochs.arc[0], epochs.turn[0]
        row[3:10] = output.value[0, _SAID]
        row[10] = epochs.has_fix[0]
        row[11:] = epochs.fix[0, :4]
        self._waiting += 1
        if self._waiting == _BLOCK:
            self._flush()

    def _flush(self) -> None:
        waiting, self._waiting = self._waiting, 0
        self.take(self._block[:waiting])

    def take(self, rows: Array) -> None:
        """Add epochs, in time order, columns as `Row` says."""
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
        gone = np.column_stack(
            [
                since * (np.abs(table.speed) > 0.05), swing, table.turn, np.abs(table.arc),
                np.abs(swing - table.turn) > limit,
            ]
        )  # fmt: skip
        state = self._state + np.cumsum(gone, axis=0)
        cell = np.floor(np.append(self._state[0], state[:, 0]))
        self._driven, self._state = complex(driven[-1]), state[-1]
        warm = state[:, 0] > _WARM
        self._metres += [np.abs(step[warm]).sum(), gone[warm, 3].sum()]
        seen = np.flatnonzero((table.has_fix > 0) & warm)
        fresh = np.diff(cell[seen + 1], prepend=cell[0]) > 0
        seen = seen[fresh]  # one a second at most, none while standing
        at = Row(*rows[seen].T)
        place = at.fix_x + 1j * at.fix_y - self._antenna * np.exp(1j * at.heading)
        self._pair(_Fixes(state[seen, 0], place - driven[seen], *state[seen, 1:].T), at)

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
            if number == _TURNS:
                swing, turn, arc = (every[i][b] - every[i][a] for i in (2, 3, 4))
                self._turning += [turn @ turn, turn @ arc, arc @ arc, turn @ swing, arc @ swing]
        off = 0.5 * ((table.map_x - table.x) ** 2 + (table.map_y - table.y) ** 2)
        self._errors += [
            len(reported), (table.scale**2).sum(), off.sum() / self.settings.map_sigma**2
        ]  # fmt: skip
        if len(every.moving):
            keep = every.moving >= every.moving[-1] - (_REACH * LAGS[-1] + 1.0)
            self._recent = _Fixes(*(column[keep] for column in every))

    def _expected(self, lag: Array) -> Array:
        s = self.settings
        return s.gnss_white_ratio**2 + 1.0 - np.exp(-lag / s.gnss_time)

    def findings(self) -> tuple[Finding, ...]:
        """What does not fit, so far.

        Wheels first: fixes are judged by them, and by the map that corrects them, so that
        of GNSS nothing is said as long as those do not fit.
        """
        self._flush()
        if self._errors[0] == 0 or self._state[0] - _WARM < _LEAST:
            return ()
        return tuple(self._wheels() or self._map() or self._gnss())

    def _wider(self, band: float) -> float:
        """The band about 1 (a ratio), wider for drives that are shorter."""
        return float(band ** math.sqrt(max(1.0, _ENOUGH / (self._state[0] - _WARM))))

    def errors(self) -> tuple[float, float, float, float]:
        """GNSS errors: w², σ², T (of σ² and T: over what the settings say); σ² if T is right.

        The most probable ones given D(L), and given that the filter's own scale is seldom
        less than it should be.
        """
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
        return w2, float(_GRID[j]), float(_GRID[i]), float(_GRID[right])

    def _wheel_errors(self) -> Array:
        """What wheels err in the sums of D, one a lag."""
        gain, _ = self._turns()
        variance = _WHEELS + _BENT * (gain - 1.0) ** 2
        return np.asarray(0.5 * variance * self._pairs[:, 2])

    def _turns(self) -> tuple[float, float]:
        """Turns as the filter corrects them over those of the odometer, and drift, rad/m."""
        tt, ta, aa, th, ah = self._turning
        if tt < _FEW_TURNS or tt * aa <= ta * ta:
            return 1.0, 0.0
        rest = tt * aa - ta * ta
        return float((th * aa - ah * ta) / rest), float((ah * tt - th * ta) / rest)

    def _gnss(self) -> list[Finding]:
        found = []
        seen, wheels = self._pairs[:, 1].sum(), self._wheel_errors().sum()
        if seen == 0.0 or wheels > 0.5 * seen:
            return []  # fixes as good as the wheels are not judged by them
        white, size, time, size_if_right = self.errors()
        band = self._wider(_TIME)
        if time > 1.0 and white <= size_if_right * self.settings.gnss_white_ratio**2:
            band = self._wider(_SURELY)
        time_off = not 1.0 / band <= time <= band
        if time_off:
            right = time * self.settings.gnss_time
            found.append(
                Finding(
                    "gnss_time", "warning", right, self.settings.gnss_time / band,
                    self.settings.gnss_time * band,
                    f"GNSS errors last {right:.0f} s of driving; set gnss_time to that",
                )
            )  # fmt: skip
        sigma = math.sqrt(size if time_off else size_if_right)
        high, low = self._wider(_SIGMA_TOO if time_off else _SIGMA), self._wider(_SMALL)
        if sigma > high:
            found.append(
                Finding(
                    "gnss sigma", "warning", sigma, low, high,
                    f"GNSS errors are {sigma:.1f} times what is reported; the filter allows for "
                    "what it sees of that, but make the reported sigmas larger",
                )
            )  # fmt: skip
        elif sigma < low and not time_off:
            found.append(
                Finding(
                    "gnss sigma", "information", sigma, low, high,
                    f"GNSS errors are {sigma:.1f} times what is reported; smaller sigmas would "
                    "let the filter decide sooner",
                )
            )  # fmt: skip
        return found

    def _wheels(self) -> list[Finding]:
        found = []
        s, (said, counted) = self.settings, self._metres
        scale = said / counted if counted > 0.0 else 1.0
        band = _SCALE * s.scale_sigma
        scale_off = abs(scale - 1.0) > band
        if scale_off:
            found.append(
                Finding(
                    "wheels: scale", "warning", scale, 1.0 - band, 1.0 + band,
                    f"a metre of the odometer is {scale:.3f} m; correct metres_per_tick (tyres?) "
                    "or the speed's unit",
                )
            )  # fmt: skip
        gain, drift = self._turns()
        band = max(_GAIN, 2.5 * s.turn_noise)
        if abs(gain - 1.0) > band and not (scale_off and abs(gain - scale) < 1.5 * band):
            width = self._track / gain
            found.append(
                Finding(
                    "wheels: track width", "warning", gain, 1.0 - band, 1.0 + band,
                    f"a turn by the wheels is {gain:.3f} of what it seems, at least; set "
                    f"track_width to {width:.2f} m or beyond, or correct the yaw rate",
                )
            )  # fmt: skip
        band = _SCALE * s.drift_sigma
        if abs(drift) > band:
            found.append(
                Finding(
                    "wheels: left against right", "warning", drift, -band, band,
                    f"straight on, the heading drifts by {1000.0 * drift:.2f} rad a km; correct "
                    "metres_per_tick of one side (tyres?) or the yaw rate's offset",
                )
            )  # fmt: skip
        return found

    def _map(self) -> list[Finding]:
        """The map's error as the filter sees it, which it holds for smaller than it is."""
        cells = self._metres[0] / self.settings.map_length
        if cells < 5.0:
            return []
        high = 0.6 + (_MAP - 0.6) * math.sqrt(max(1.0, 90.0 / cells))
        square = self._errors[2] / self._errors[0]
        if square <= high:
            return []
        larger = self.settings.map_sigma * math.sqrt(2.0 * square)
        return [
            Finding(
                "map_sigma", "warning", math.sqrt(square), 0.0, math.sqrt(high),
                f"the map is {self.settings.map_sigma * math.sqrt(square):.1f} m off as far as "
                f"can be seen; set map_sigma to about {larger:.0f} m",
            )
        ]  # fmt: skip


def findings_of(
    epochs: Epochs, output: Output, mode: int, settings: Settings, vehicle: Vehicle
) -> tuple[Finding, ...]:
    """What does not fit in a recorded drive; nothing is said where time alone moves it."""
    if mode == CLOCK:
        return ()
    watch = Watch(settings, vehicle)
    watch.take(rows_of(epochs, output))
    return watch.findings()
