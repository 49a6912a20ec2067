"""One call from a car's drives to the car: estimates, intervals, held-out evidence, TOML."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DriveError
from ..observations import Drive
from ..readers import read_drive, read_vehicle, vehicle_beside
from ..readers.dates import Writing
from ..roadmap import RoadMap, open_map
from ..roadmap.extent import are_near
from ..settings import Settings, Vehicle, to_toml
from ..wording import counted
from .by_statistics import Values, noise_of, settle
from .drives_run import Bench
from .quantities import (
    ACROSS,
    GNSS_SIGMA,
    GNSS_TIME,
    GNSS_WHITE,
    SIGMAS,
    UNITS,
    WIDEST,
    Quantity,
    named,
    values_of,
    with_values,
)

_HELD_OUT = 4  # one drive in so many
_LEAST_HELD_OUT = 8  # drives, from which on some are held out
_ON_MAP = 0.9  # share of a drive's fixes near the map's roads, at least
_SEPARATED = 2.0  # standard errors, by which held-out evidence must prefer a sigma
_FEW = (
    f"fewer than {_LEAST_HELD_OUT} drives: none is held out, and no sigma of receiver or map is "
    "taken over"
)
_ONE = (
    "a single drive gives no intervals, so that nothing is taken over: give more drives of the car"
)
_NOT_TOLD = (
    "lane_sigma and relative_sigma: the data cannot tell them from map_sigma; they are as before"
)


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibrated car, and what it rests on."""

    vehicle: Vehicle
    quantities: tuple[Quantity, ...]
    drives: int  # that the estimates rest on
    held_out: int  # that the evidence rests on
    gain: float  # nats a held-out drive of the whole car; nan without held-out drives
    gain_sigma: float  # its standard error
    left_out: Mapping[str, int]  # reason -> drives that were not used
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Quantity:
        return next(one for one in self.quantities if one.name == name)

    def to_toml(self) -> str:
        """`vehicle.toml`, with what was found as comments."""
        lines = [
            f"# calibrated from {counted(self.drives, 'drive')}, {self.held_out} more held out"
        ]
        lines += [f"# {one}" for one in self.quantities]
        lines += [f"# {note}" for note in self.notes]
        return "\n".join(lines) + "\n" + to_toml(self.vehicle)


def calibrate(
    drives: Any,
    roads: RoadMap | str | Path,
    *,
    vehicle: Vehicle | str | Path | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    progress: Callable[[str], None] | None = None,
    **reading: Any,
) -> Calibration:
    """Find what one car's sensors are like from its drives, of which no truth is known.

    Odometer, gyro, antenna, clock and receiver are estimated by the statistics of `diagnose`,
    the drives filtered anew until the numbers rest.  A quarter of the drives is held out: by how
    much each number raises their evidence is told.  A sigma of the receiver or of the map is taken
    over only where that evidence prefers it.

    Args:
        drives: Drives of one car with odometry and fixes: `Drive` records, or paths of logs and
            tables as `read_drive` takes them.
        roads: A `RoadMap`, or what `match` takes as one.
        vehicle: The car as it is thought to be, or the path of its vehicle.toml.
        settings: The model's numbers.
        threads: How many drives are filtered at a time; None: one for each core.
        progress: Called with what is done.
        **reading: As `read_drive` takes it: `dbc`, `crs`, `id`, `columns`, `tz`,
            `dates`.

    Returns:
        The car, and each number with its interval and its held-out evidence.

    Raises:
        ReadError: A file could not be understood, or there is no such zone or order of dates.
        MapError: No drive is near the map, or the map is not one.
        DriveError: No drive has both fixes and odometry, or too little was driven.
    """
    Writing.of(reading.get("tz"), reading.get("dates"))
    if isinstance(vehicle, str | Path):
        vehicle = read_vehicle(vehicle)
    start = vehicle or vehicle_beside(drives) or Vehicle()
    road_map, settings = open_map(roads, crs=reading.get("crs")), settings or Settings()
    found = _drives(drives, start, settings, reading)
    used, left_out = _usable(found, road_map)
    tell = progress or (lambda _: None)
    bench = Bench(used, road_map, start, settings, threads or os.cpu_count() or 1)
    held = _held_out(len(used))
    chosen = [k for k in range(len(used)) if k not in held]
    log = used[chosen[0]].odometry
    assert log is not None
    result = settle(bench, start, chosen, named(log), tell)
    known = _known(start, settings)
    told = {name: 0.0 <= result.half.get(name, math.inf) <= WIDEST[name] for name in result.values}
    kept = {name: value for name, value in result.values.items() if told[name]}

    def car(values: Values) -> Vehicle:
        made = with_values(start, values, log)
        tuned = replace(settings, **start.noise)
        return replace(made, noise=start.noise | noise_of(values, tuned))

    def evidence(values: Values) -> np.ndarray:
        return np.array(bench.evidence(car(values), held))

    def gain(more: np.ndarray) -> tuple[float, float]:
        if len(held) < 2:
            return math.nan, math.nan
        return float(more.mean()), float(more.std(ddof=1) / math.sqrt(len(more)))

    tell("held-out evidence")
    whole = evidence(kept)
    gains: dict[str, tuple[float, float]] = dict.fromkeys(result.values, (math.nan, math.nan))
    for name in kept:
        rest = {other: number for other, number in kept.items() if other != name}
        gains[name] = gain(whole - evidence(rest))
    for name in SIGMAS & kept.keys():
        raised, sigma = gains[name]
        if not raised > _SEPARATED * sigma:  # nor where nothing is held out
            told[name] = False
            del kept[name]
    quantities = tuple(
        Quantity(
            name, UNITS[name], known[name], kept.get(name, known[name]), value,
            value - result.half.get(name, math.inf), value + result.half.get(name, math.inf),
            told[name], gains[name][0], gains[name][1],
        )
        for name, value in result.values.items()
    )  # fmt: skip
    total = gain(evidence(kept) - evidence({}))
    notes = (_NOT_TOLD, *(() if held else (_FEW,)), *((_ONE,) if len(chosen) == 1 else ()))
    return Calibration(car(kept), quantities, len(chosen), len(held), *total, left_out, notes)


def _known(start: Vehicle, settings: Settings) -> Values:
    """All numbers as they were thought to be."""
    tuned = replace(settings, **start.noise)
    return values_of(start, start) | {
        GNSS_SIGMA: 1.0,
        GNSS_TIME: tuned.gnss_time,
        GNSS_WHITE: tuned.gnss_white_ratio,
        ACROSS: math.hypot(tuned.map_sigma, tuned.relative_sigma, tuned.lane_sigma),
    }


def _drives(
    drives: Any, vehicle: Vehicle, settings: Settings, reading: Mapping[str, Any]
) -> list[Drive]:
    if isinstance(drives, Drive):
        return [drives]
    if isinstance(drives, Sequence) and drives and all(isinstance(d, Drive) for d in drives):
        return list(drives)
    return read_drive(drives, vehicle=vehicle, settings=settings, **reading)


def _usable(drives: Sequence[Drive], roads: RoadMap) -> tuple[list[Drive], dict[str, int]]:
    """Drives with fixes on the map and odometry of the first kind; of others the reasons."""
    used: list[Drive] = []
    left_out: dict[str, int] = {}
    for drive in drives:
        reason = None
        if drive.odometry is None or len(drive.odometry.time) < 2:
            reason = "no odometry"
        elif drive.fixes is None or not len(drive.fixes):
            reason = "no fixes"
        elif used and type(drive.odometry) is not type(used[0].odometry):
            reason = "odometry of another kind than that of the first drive"
        elif are_near(drive.fixes.lat_deg, drive.fixes.lon_deg, roads).mean() < _ON_MAP:
            reason = "fixes off the map"
        if reason is None:
            used.append(drive)
        else:
            left_out[reason] = left_out.get(reason, 0) + 1
    if not used:
        why = ", ".join(f"{reason}: {count}" for reason, count in left_out.items())
        raise DriveError(
            f"calibrate: none of {len(drives)} drives can be used ({why}); drives of one car with "
            "fixes and odometry on the map were expected"
        )
    return used, left_out


def _held_out(drives: int) -> list[int]:
    """Every fourth drive, where there are enough."""
    if drives < _LEAST_HELD_OUT:
        return []
    return list(range(_HELD_OUT - 1, drives, _HELD_OUT))
