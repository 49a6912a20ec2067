"""A recorded drive with wheels and a gyro: what measures each step, and the gyro in gaps."""

from collections import deque
from typing import NamedTuple, TypeVar

import numpy as np

from ..filter.vetting.windows import BY_WHEELS, GYRO_ALONE, HEARD_AGAIN
from ..observations import Array, Fixes, YawRates
from .gyro_turns import turns_at
from .takeover import Takeover

_GAP = 2.0  # s without wheels, after which a gyro alone tells the turn
_STEP = 1.0  # s between the rows that are added then
_USUAL, _GATHERS = 8.0, 15.0  # m/s, and s in which a slow vehicle gathers that speed

Rate = TypeVar("Rate", float, Array)


class Steered(NamedTuple):
    """Motion of which each step was measured by one of the two."""

    time: Array  # (n,) s
    distance: Array  # (n,) m, cumulative
    turn: Array  # (n,) rad, cumulative
    by: Array  # (n,) what measured the step to each row, as `filter.vetting.windows` counts it
    takeover: Takeover


def beside_wheels(
    time: Array, distance: Array, turn: Array, gyro: YawRates, track_width: float,
    fixes: Fixes | None,
) -> Steered:  # fmt: skip
    """Choose what measures the turn, step by step, as it is chosen on line.

    Args:
        time: (n,) s, of the wheels.
        distance: (n,) m, cumulative.
        turn: (n,) rad, cumulative, by the wheels.
        gyro: Its true rates.
        track_width: m.
        fixes: Those that may be used; None: there are none.
    """
    whole, gap, ends = _with_gaps(time, gyro.time)
    far, by_wheels = (np.interp(whole, time, one) for one in (distance, turn))
    silent = np.flatnonzero(gap & ~ends)
    before = np.searchsorted(time, whole[silent]) - 1
    begin = np.searchsorted(time, time[before] - 1.0).clip(0, (before - 1).clip(0))
    speed = (distance[before] - distance[begin]) / np.maximum(time[before] - time[begin], 1e-3)
    far[silent] = distance[before] + driven_on(speed, whole[silent] - time[before])[0]
    turned, near = turns_at(whole, gyro)
    takeover, taken = Takeover(track_width), np.zeros((len(whole), 3))
    taken[0, 2] = BY_WHEELS
    rows = np.column_stack([whole, *(np.diff(x, prepend=x[0]) for x in (far, by_wheels, turned))])
    heard = near & np.concatenate([[False], near[:-1]])
    located = deque(_of_fixes(fixes))
    for k, (when, arc, w, g) in enumerate(rows.tolist()):
        while located and located[0][0] <= when:
            _, lat, lon, sigma = located.popleft()
            takeover.fixed(lat, lon, sigma)
        if gap[k]:
            takeover.mute(when - rows[k - 1, 0])
            taken[k] = arc, g, HEARD_AGAIN if ends[k] else GYRO_ALONE
        elif k:
            taken[k] = takeover.moved(when, arc, w, g if heard[k] else None)
    return Steered(whole, far[0] + np.cumsum(taken[:, 0]), np.cumsum(taken[:, 1]), taken[:, 2],
                   takeover)  # fmt: skip


def driven_on(speed: Rate, seconds: Rate) -> tuple[Rate, Rate]:
    """Metres that a vehicle drives unseen, and its speed (m/s) then.

    It goes on as it was; one that stands or is slow will soon drive as is usual in towns.

    Args:
        speed: m/s, when it was last seen.
        seconds: Since then.
    """
    missing = np.maximum(_USUAL - speed, 0.0)
    kept = np.exp(-seconds / _GATHERS)
    metres = (speed + missing) * seconds - missing * _GATHERS * (1.0 - kept)
    return metres, speed + missing * (1.0 - kept)


def _of_fixes(fixes: Fixes | None) -> list[list[float]]:
    """Time and place of each (s, degrees), and its sigma, m."""
    if fixes is None:
        return []
    sigma = np.sqrt(0.5 * (fixes.cov_ee + fixes.cov_nn))
    rows: list[list[float]] = np.column_stack(
        [fixes.time, fixes.lat_deg, fixes.lon_deg, sigma]
    ).tolist()
    return rows


def _with_gaps(time: Array, gyro: Array) -> tuple[Array, np.ndarray, np.ndarray]:
    """Times of the wheels, and more where they are silent beside the gyro; which steps these are.

    A step that ends at a reading of the wheels after a gap belongs to the gap, and is told apart.
    """
    ends = np.append(time[1:], max(float(gyro[-1]), float(time[-1])))
    pieces, gaps = [], []
    for begin, end, reading in zip(
        time.tolist(), ends.tolist(), range(1, len(time) + 1), strict=True
    ):
        last = reading == len(time)
        if end - begin <= _GAP:
            continue
        count = int((end - begin) / _STEP)
        added = np.linspace(begin, end, count + 1)[1 : None if last else -1]
        heard = np.searchsorted(gyro, added - 0.5) < np.searchsorted(gyro, added + 0.5)
        if not heard.all():
            continue
        pieces.append(added)
        gaps.append(end)
    whole = np.sort(np.concatenate([time, *pieces]))
    ends = np.isin(whole, gaps) & np.isin(whole, time)
    return whole, ~np.isin(whole, time) | ends, ends
