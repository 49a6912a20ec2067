"""Recorded drives that lie beside the mapped roads, and those of who drives no motor vehicle."""

from collections.abc import Sequence

import numpy as np

from .._compile import Records
from ..filter.haste import too_fast_from
from ..graph.network import Roads
from ..observations import Array
from .common_shift import CAP, fit_to_roads
from .finding import Finding

_LOOKED_AT = 0.03  # mean P off the roads, from which on a drive is looked at
_WINDOW = 10.0  # s, over which motion is told by fixes
_STANDS, _FASTEST = 0.7, 60.0  # m/s, between which fixes tell of a motor vehicle's motion
_JUMPS = 1.5  # times the usual speed, beyond which a faster one is a wrong fix
_ON, _FAST_WAY, _FAST = 0.1, 500.0, 0.5  # P off a road that counts; m and share driven too fast
_WAY = 1500.0  # m, below which a drive says too little
_SHIFTED, _OFF = 0.05, 0.5  # shares of the way off the roads, at which places may be moved; are off
_AWAY = 10.0  # m from roads on average, above which places are beside them
_SLOW_WAY, _SLOW_TIME = 1000.0, 600.0  # m and s in motion, the same for who is slow
_FOOT, _FOOT_FAST, _FOOT_OFF = 2.2, 4.0, 0.1  # m/s, median and 95 %; share of the way off roads
_BICYCLE_FAST, _BICYCLE_OFF = 9.0, 0.4


def off_road_findings(
    epochs: Records, rows: Records, first: Sequence[int], roads: Roads
) -> dict[int, Finding]:
    """What is to be said of recorded drives that are not on the mapped roads.

    Args:
        epochs: (n,) EPOCH, drive after drive.
        rows: (n,) ESTIMATE.
        first: (d + 1,) the epoch at which each begins, and n.
        roads: The map.

    Returns:
        By the number of the drive.
    """
    n = first[-1]
    off = rows.view(np.ndarray)["p_off_road"][:n]
    sizes = np.diff(first)
    if not n or not sizes.all():
        return {}
    mean = np.add.reduceat(off, first[:-1]) / sizes
    told = {}
    for drive in np.flatnonzero(mean > _LOOKED_AT).tolist():
        own = slice(first[drive], first[drive + 1])
        edge = rows.view(np.ndarray)["edge"][own]
        if finding := _of_drive(epochs[own].view(np.ndarray), off[own], edge, roads):
            told[drive] = finding
    return told


def _of_drive(epochs: Records, off: Array, edge: Array, roads: Roads) -> Finding | None:
    """What is said of one drive: its P off the roads, and the most probable edge of each epoch."""
    at = np.flatnonzero((epochs["has_fix"] > 0) & (epochs["filled"] == 0))
    if len(at) < 2:
        return None
    time = epochs["time"][at]
    at = at[np.diff(np.floor((time - time[0]) / _WINDOW), prepend=-1.0) > 0.0]
    time, x, y = epochs["time"][at], epochs["fix"][at, 0], epochs["fix"][at, 1]
    lasted, way = np.diff(time), np.hypot(np.diff(x), np.diff(y))
    moves = way > _STANDS * lasted
    usual = float(np.median(way[moves] / lasted[moves])) if moves.any() else 0.0
    moves &= way < max(_FASTEST, _JUMPS * usual) * lasted
    lasted, way, at = lasted[moves], way[moves], at[1:][moves]
    driven = float(way.sum())
    if driven < _SLOW_WAY:
        return None
    share = float((off[at] @ way) / driven)
    pace, fast = np.quantile(way / lasted, (0.5, 0.95)).tolist()
    slow = lasted.sum() > _SLOW_TIME
    if slow and pace < _FOOT and fast < _FOOT_FAST and share > _FOOT_OFF:
        return _no_motor("somebody on foot", pace, _FOOT)
    if driven < _WAY or share < _SHIFTED:
        return None
    fit = fit_to_roads(x, y, roads)
    shift = None if fit is None else fit.shift
    away = CAP if fit is None else fit.away
    sigma = float(np.median(epochs["fix"][at, 2]))  # places that are so coarse lie beside roads
    if away < _AWAY or (shift is None and away < sigma):
        return None
    if shift is None and slow and fast < _BICYCLE_FAST and share > _BICYCLE_OFF:
        return _no_motor("a bicycle", fast, _BICYCLE_FAST)
    if shift is None:
        if share > _OFF and pace > _FASTEST:
            return _flies(pace)
        if share < _OFF:
            return _too_fast(way, way / lasted, off[at], edge[at], roads)
    return _off_roads(share, shift) if shift is not None or share > _OFF else None


def _too_fast(way: Array, speed: Array, off: Array, edge: Array, roads: Roads) -> Finding | None:
    """What is said where most of the way on roads was driven at speeds that are not driven there.

    Args:
        way: (n,) m, of some seconds each.
        speed: (n,) m/s.
        off: (n,) P off the roads.
        edge: (n,) the most probable edge.
        roads: The map.
    """
    on = (off < _ON) & (edge >= 0)
    named = float(way[on].sum())
    limits = [too_fast_from(float(v)) for v in roads.edges.view(np.ndarray)["speed"][edge[on]]]
    beyond = float(way[on][speed[on] > np.array(limits)].sum())
    if beyond < _FAST_WAY or beyond < _FAST * named:
        return None
    return Finding(
        "too fast for its roads", "warning", beyond / named, 0.0, _FAST,
        "most of the way on roads was driven at speeds that nobody drives at there: is it a train, "
        "or another vehicle that runs beside roads? else the map lacks its roads, or the limits "
        "of the map are wrong, or in another unit",
    )  # fmt: skip


def _flies(pace: float) -> Finding:
    """A trip in a plane or a fast train."""
    return Finding(
        "no motor vehicle", "warning", pace, 0.0, _FASTEST,
        "it moves as a plane or a fast train, and off the roads; only motor vehicles are followed, "
        "so that roads which it is said to be on are those that it passed",
    )  # fmt: skip


def _no_motor(who: str, pace: float, least: float) -> Finding:
    """A drive of somebody on foot or on a bicycle."""
    return Finding(
        "no motor vehicle", "warning", pace, least, _FASTEST,
        f"it moves as {who}, and partly off the roads; only motor vehicles are followed: foot and "
        "cycle ways are not in the network, so it is off road there, or on a street beside them",
    )  # fmt: skip


def _off_roads(share: float, shift: tuple[float, float] | None) -> Finding:
    """A drive beside the mapped roads; by which shift it would lie on them, where there is one."""
    most = _OFF if shift is None else _SHIFTED
    if shift is None:
        text = (
            "most of the way lies on no mapped road; is the map of this place, and are coordinates "
            "in WGS 84? another datum or reference system moves all places; else the map lacks "
            "these roads, or this is no motor vehicle, but a train or a boat"
        )
    else:
        east, north = shift
        sides = [(east, "east", "west"), (north, "north", "south")]
        moved = " and ".join(f"{abs(m):.0f} m {a if m > 0.0 else b}" for m, a, b in sides if m)
        text = (
            f"the places lie beside the roads, and on them if all are moved by {moved}; are "
            "coordinates in WGS 84? another datum, reference system or a vendor's offset moves all "
            "places; correct them first"
        )
    return Finding("off roads", "warning", share, 0.0, most, text)
