"""The paper's drive from simulated files to a picture and a summary.

Rear-wheel counts on CAN, NMEA with GST, an OpenStreetMap file; 1.5 km without GPS, a
road beside the road, a fork.  Once the files are written, they are all that is known.
"""

import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .evaluate import evaluate
from .matching import match
from .observations import Odometer
from .plots import Window, plot_drive, plot_methods
from .readers import read_drive, read_vehicle
from .roadmap import RoadMap
from .sensors.odometry import motion_of
from .settings import Vehicle
from .simulate import demo_scenes, write_demo
from .tables.schema import seconds_of, times
from .writers import check_folder

if TYPE_CHECKING:
    import pyarrow as pa

    from .observations import Drive

Progress = Callable[[str, int, int], None]

SUMMARY = "summary.json"
_MADE_BY = "whichroad demo"


def _silent(what: str, done: int, total: int) -> None:
    pass


def run_demo(
    out: str | os.PathLike[str], *, force: bool = False, progress: Progress = _silent
) -> dict[str, Any]:
    """Simulate the paper's drive into files, answer it from them, and draw the answer.

    Args:
        out: folder for everything; an earlier demo's is used again.
        force: use a folder that holds something else.
        progress: called with (task, done, total).

    Returns:
        The summary that `summary.json` holds: the headlines as `said`, all
        `figures` against the truth, `seconds` of each step, `files`, and the `picture`.

    Raises:
        WriteError: the folder holds something else, or cannot be written to.
    """
    out = Path(out)
    check_folder(out, SUMMARY, _MADE_BY, "an earlier demo's", force=force)
    stopwatch = _Stopwatch(progress)
    stopwatch("simulating a drive")
    written, _ = write_demo(out, force=True)

    stopwatch("reading its files")
    roads = RoadMap.from_osm(out / "map.osm")
    car = read_vehicle(out / "vehicle.toml")
    (drive,) = read_drive(
        out / "drive.nmea", vehicle=car, can=out / "can.log", dbc=out / "vehicle.dbc"
    )

    stopwatch("matching it")
    result = match(drive, roads, vehicle=car, hypotheses=True, progress=progress)
    result.write(out / "points.parquet", force=True)
    result.write_path(out / "path.parquet", force=True)

    stopwatch("comparing with the truth")
    truth = _read(out / "truth.parquet")
    figures = evaluate(result.to_arrow(), truth).figures()

    stopwatch("drawing")
    masked = _outages(truth)
    alone = _wheels_alone(drive, car, roads, truth, masked)
    pictures = plot_drive(
        result, roads, truth, drive.fixes, out=out, windows=_windows(truth, roads), masked=masked,
        reckoning=alone, title=_title(truth, figures),
    )  # fmt: skip
    pictures[:0] = _methods(drive, car, roads, truth, masked, out)
    stopwatch("")
    summary = {
        "made_by": _MADE_BY,
        "said": _headlines(truth, figures, _drift(alone, truth, roads)),
        "figures": figures,
        "match": result.summary,
        "seconds": stopwatch.seconds,
        "files": [path.name for path in written] + ["points.parquet", "path.parquet"],
        "pictures": [path.name for path in pictures],
        "picture": str(pictures[-1]),
    }
    (out / SUMMARY).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


class _Stopwatch:
    """Reports each step as it begins, and keeps how long each took."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress, self._what, self._since = progress, "", time.perf_counter()

    def __call__(self, what: str) -> None:
        now = time.perf_counter()
        if self._what:
            self.seconds[self._what] = round(now - self._since, 2)
        self._what, self._since = what, now
        if what:
            self._progress(what, 0, 0)


def _read(path: Path) -> "pa.Table":
    import pyarrow.parquet as pq

    return pq.read_table(path)


def _outages(truth: "pa.Table") -> list[tuple[float, float]]:
    """Stretches without GNSS, s from the start."""
    since = seconds_of(truth["time"]) - seconds_of(truth["time"])[0]
    dark = np.concatenate([[False], truth["outage"].to_numpy(zero_copy_only=False), [False]])
    changes = np.flatnonzero(dark[1:] != dark[:-1])
    return [
        (float(since[a]), float(since[min(b, len(since) - 1)]))
        for a, b in changes.reshape(-1, 2).tolist()
    ]


def _windows(truth: "pa.Table", roads: RoadMap) -> list[Window]:
    """The stretches of the paper's Figures 10 and 11."""
    scenes = demo_scenes(roads)
    since = seconds_of(truth["time"]) - seconds_of(truth["time"])[0]
    fork = scenes.junction[0] + 60.0
    places = np.interp([scenes.parallel[0], fork], truth["travelled_m"].to_numpy(), since)
    beside, split = places.tolist()
    return [
        Window("A side lane begins; then GPS is back, and nearer to it", beside - 8, beside + 7),
        Window("A fork of 10 degrees without GPS", split - 2, split + 5),
    ]


def _methods(
    drive: "Drive", car: Vehicle, roads: RoadMap, truth: "pa.Table",
    masked: list[tuple[float, float]], out: Path,
) -> list[Path]:  # fmt: skip
    """Our method above the paper's, both from fixes and the distance driven.

    Both wheels would tell the roads apart within two seconds.  Without their difference
    hypotheses stay alive until GPS is back, as in the paper's Figures 10 and 11.
    """
    assert drive.odometry is not None
    motion = motion_of(drive.odometry, car)
    plain = replace(drive, odometry=Odometer(motion.time, motion.distance))
    answers = [
        (name, match(plain, roads, vehicle=car, hypotheses=True, model=model))
        for name, model in (("whichroad", "default"), ("the paper's method", "paper"))
    ]
    return plot_methods(
        answers, roads, truth, drive.fixes, out=out, windows=_stretches(truth, roads),
        masked=masked,
        title="Which of two roads? Each has a position, a 95 % ellipse and a probability",
    )  # fmt: skip


def _stretches(truth: "pa.Table", roads: RoadMap) -> list[Window]:
    """Where these hypotheses lie beside each other: a parallel road, and behind a fork."""
    scenes = demo_scenes(roads)
    fork = scenes.junction[0] + 60.0
    ends = [scenes.parallel[0] + 110, scenes.parallel[0] + 210, fork - 10, fork + 110]
    since = seconds_of(truth["time"]) - seconds_of(truth["time"])[0]
    a, b, c, d = np.interp(ends, truth["travelled_m"].to_numpy(), since).tolist()
    return [Window("Parallel roads, fixes between them", a, b), Window("A fork without GPS", c, d)]


def _wheels_alone(
    drive: "Drive", car: Vehicle, roads: RoadMap, truth: "pa.Table",
    masked: list[tuple[float, float]],
) -> "pa.Table":  # fmt: skip
    """Equation (1) through the first outage from its true pose on, without map and GNSS."""
    import pyarrow as pa

    assert drive.odometry is not None
    begin, end = masked[0]
    motion = motion_of(drive.odometry, car)
    assert motion.turn is not None
    start = seconds_of(truth["time"])[0]
    row = int(np.searchsorted(seconds_of(truth["time"]), start + begin))
    lat, lon, bearing = (truth[name][row].as_py() for name in ("lat", "lon", "bearing_deg"))
    x, y = roads.plane.from_geodetic(lat, lon)
    inside = (motion.time >= start + begin) & (motion.time <= start + end)
    turn = motion.turn[inside] - motion.turn[inside][0]
    heading = roads.plane.heading(bearing, x, y) + 0.5 * (turn[1:] + turn[:-1])
    step = np.diff(motion.distance[inside])
    lat_deg, lon_deg = roads.plane.to_geodetic(
        x + np.cumsum(step * np.cos(heading)), y + np.cumsum(step * np.sin(heading))
    )
    when = times(motion.time[inside][1:])
    return pa.table({"time": when, "lat": lat_deg, "lon": lon_deg})


def _lengths(truth: "pa.Table") -> tuple[float, float]:
    """How far the drive went, and how far of it without GNSS, km."""
    travelled = truth["travelled_m"].to_numpy()
    dark = truth["outage"].to_numpy(zero_copy_only=False)
    return travelled[-1] / 1000.0, float(np.diff(travelled)[dark[1:]].sum()) / 1000.0


def _title(truth: "pa.Table", figures: dict[str, Any]) -> str:
    length, hidden = _lengths(truth)
    return (
        f"{length:.1f} km, {hidden:.1f} km of it without GPS: on the right road "
        f"{100 * figures['right_edge']:.1f} % of the time, "
        f"{figures['rmse_m']:.1f} m from the truth (RMS)"
    )


def _headlines(truth: "pa.Table", figures: dict[str, Any], drift: float) -> dict[str, str]:
    """The figures that matter, in words."""
    length, hidden = _lengths(truth)

    def both(name: str, scale: float, unit: str, digits: int) -> str:
        whole, dark = scale * figures[name], scale * figures[f"outage_{name}"]
        return f"{whole:.{digits}f}{unit}, without GPS {dark:.{digits}f}{unit}"

    return {
        "driven": f"{length:.1f} km, {hidden:.1f} km of it without GPS",
        "on the right road": both("right_edge", 100, " %", 1),
        "position error (RMS)": both("rmse_m", 1, " m", 1),
        "wheels alone": f"{drift:.0f} m off at the end of the long outage",
        "95 % ellipse holds truth": both("inside_95", 100, " %", 1),
        "ANEES (1 is consistent)": both("anees", 1, "", 2),
    }


def _drift(alone: "pa.Table", truth: "pa.Table", roads: RoadMap) -> float:
    """How far wheels alone are from the truth where they end, m."""
    row = int(np.searchsorted(seconds_of(truth["time"]), seconds_of(alone["time"])[-1]))
    ends = ((alone, -1), (truth, row))
    lat, lon = (
        np.array([table[name][at].as_py() for table, at in ends]) for name in ("lat", "lon")
    )
    x, y = roads.plane.from_geodetic(lat, lon)
    return float(np.hypot(x[1] - x[0], y[1] - y[0]))
