"""GNSS in a city: does the ellipse that the filter gives a fix hold its error?

RTKLIB's single-point fixes in Nagoya come with a full covariance, too wide under an open
sky and too narrow between towers.  The filter learns on line how much larger the errors
are.  Asked is the covariance that it gives a fix *before* it has seen that fix: the
reported one times the learnt factor, for the slow and the white error together.

There is no map of the place: the vehicle drives off the roads of a map whose only street
lies far away.  The odometry is made from the reference: its speed and yaw rate at 5 Hz,
with the scale, drift and noise of a real car drawn anew for each seed.
"""

import math

import numpy as np
import pyarrow as pa

import whichroad
from whichroad.epochs import build_timeline
from whichroad.observations import Array, Drive, SpeedYawRate
from whichroad.readers import read_drive
from whichroad.recorded import localize_recorded

from . import Figure, Options, interval, seeds_text

LEAP = 18.0  # s, GPS time ahead of UTC
GPS_EPOCH = 315_964_800.0
INSIDE = -2.0 * math.log(0.05)  # chi-square of two degrees that 95 % stay below
SEEDS = range(8)


def reference(options: Options) -> dict[str, Array]:
    """The post-processed truth: time (s UTC), lat, lon, heading (rad), east and north m/s."""
    path = options.need("nagoya", "reference_first_half.csv")
    t = np.genfromtxt(path, delimiter=",", skip_header=1)
    return {
        "time": GPS_EPOCH + 604_800.0 * t[:, 1] + t[:, 0] - LEAP,
        "lat": t[:, 2],
        "lon": t[:, 3],
        "heading": np.unwrap(np.radians(90.0 - t[:, 10])),
        "east": t[:, 11],
        "north": t[:, 12],
    }


def odometry(truth: dict[str, Array], seed: int) -> SpeedYawRate:
    """Speed and yaw rate of a car with a scale, a drift and noise of its own."""
    random = np.random.default_rng(seed)
    time, heading = truth["time"], truth["heading"]
    step = float(np.median(np.diff(time)))
    speed = truth["east"] * np.cos(heading) + truth["north"] * np.sin(heading)
    speed = np.where(np.abs(speed) < 0.05, 0.0, speed)  # a wheel that stands says so
    yaw = np.gradient(heading, time) * (speed != 0.0)
    metres = np.abs(speed) * step
    scale, drift = 1.0 + 0.01 * random.normal(), 3e-4 * random.normal()
    noise = 8e-4 * np.sqrt(metres) * random.normal(size=len(time)) / step
    along = 0.01 * np.sqrt(metres) * random.normal(size=len(time)) / step
    return SpeedYawRate(time, scale * speed + along, yaw + drift * speed + noise)


def empty_map(truth: dict[str, Array]) -> whichroad.RoadMap:
    """One short street, 8 km to the north."""
    lat, lon = float(truth["lat"][0]) + 0.072, float(truth["lon"][0])
    line = f"LINESTRING ({lon} {lat}, {lon + 0.001} {lat})"
    return whichroad.RoadMap.from_edges(pa.table({"geometry": [line]}), crs="EPSG:4326")


def adapted(
    drive: Drive, truth: dict[str, Array], roads: whichroad.RoadMap, options: Options
) -> dict[str, Array]:
    """What the filter thought of each fix just before it came, and whether it was so.

    Returns:
        For each fix: chi-square of its true error under the reported covariance, factor
        on the covariance learnt before it, chi-square of the pose's error after it.
    """
    settings = options.settings()
    timeline = build_timeline(drive, roads.plane, whichroad.Vehicle())
    output = localize_recorded(
        roads, timeline, vehicle=whichroad.Vehicle(), settings=settings
    ).output.rows
    at = np.flatnonzero(timeline.epochs.has_fix)
    fix, time = timeline.epochs.fix[at], timeline.epochs.time[at]
    x, y = roads.plane.from_geodetic(truth["lat"], truth["lon"])
    true = np.column_stack([np.interp(time, truth["time"], x), np.interp(time, truth["time"], y)])
    error = fix[:, :2] - true
    c, s = np.cos(fix[:, 4]), np.sin(fix[:, 4])
    major = (error[:, 0] * c + error[:, 1] * s) / fix[:, 2]
    minor = (error[:, 1] * c - error[:, 0] * s) / fix[:, 3]
    before = output.gnss_scale[np.maximum(at - 1, 0)] ** 2
    white = 1.0 + settings.gnss_white_ratio**2
    pose = np.column_stack([output.x[at], output.y[at]]) - true
    xx, xy, yy = output.cov[at][:, [0, 1, 3]].T
    nees = (yy * pose[:, 0] ** 2 - 2 * xy * pose[:, 0] * pose[:, 1] + xx * pose[:, 1] ** 2) / (
        xx * yy - xy**2
    )
    return {
        "reported": major**2 + minor**2,
        "factor": np.where(before > 0.0, before, 1.0) * white,
        "nees": nees,
        "error": np.hypot(pose[:, 0], pose[:, 1]),
    }


def run(options: Options) -> list[Figure]:
    """Coverage of the fixes after the first third, on which nothing may be tuned."""
    truth = reference(options)
    [fixes] = read_drive([options.need("nagoya", "rover_1Hz_spp_first_half.pos")])
    roads = empty_map(truth)
    seeds = options.seeds or SEEDS
    rows, nees, far = [], [], []
    for seed in seeds:
        drive = Drive("nagoya", fixes.fixes, odometry(truth, seed))
        said = adapted(drive, truth, roads, options)
        third = len(said["reported"]) // 3
        inside = said["reported"] / said["factor"] < INSIDE
        rows.append(
            (
                100.0 * inside[third:].mean(),
                100.0 * inside[:third].mean(),
                100.0 * (said["reported"] < INSIDE)[third:].mean(),
                float(np.median(said["factor"][third:])),
                float(np.quantile(said["factor"][third:], 0.9)),
            )
        )
        nees.append(said["nees"].mean() / 2.0)
        far.append(float(np.sqrt(np.mean(said["error"] ** 2))))
    table = np.array(rows)
    text, n = seeds_text(seeds), len(table)

    def figure(name: str, column: int, goal: str, unit: str) -> Figure:
        values = table[:, [column]]
        return Figure(
            name,
            float(values.mean()),
            goal,
            unit,
            n,
            interval(lambda v: float(v.mean()), values),
            text,
        )

    return [
        figure("fixes of the rest in their adapted 95 % ellipse", 0, "93..97", "%"),
        figure("median area, adapted over reported", 3, "<= 1.5", ""),
        figure("fixes of the first third", 1, "", "%"),
        figure("fixes of the rest in the reported 95 % ellipse", 2, "", "%"),
        figure("area exceeded by a tenth, adapted over reported", 4, "", ""),
        Figure("pose: ANEES at the fixes", float(np.mean(nees)), "", "", n, seeds=text),
        Figure("pose: rms error", float(np.mean(far)), "", "m", n, seeds=text),
    ]
