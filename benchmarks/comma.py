"""Real wheels on a real map: GNSS for the first 300 m, then none.

One kilometre in San Francisco with four wheel speeds, a u-blox receiver and a
post-processed truth.  The drift is the error at the end less the error when the fixes
stopped, so that the antenna's place and the truth's own offset do not count.

The recording has no sigmas.  What a user knows of such a receiver stands in its data
sheet: 2.5 m (half of the fixes) and 0.05 m/s (half of the speeds), which is SIGMA and
SIGMA_SPEED.  Without them the default of 5 m is assumed and the speed is not used; that
is measured too.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

import whichroad
from whichroad.observations import ASSUMED, Drive, Fixes, WheelSpeeds

from . import Figure, Options

GNSS_M = 300.0  # m with fixes
SIGMA = 2.1  # m per axis: 2.5 m hold half of the fixes
SIGMA_SPEED = 0.1  # m/s: 0.05 m/s hold half; rounded up
EARTH = 6371008.8


def columns(path: Path) -> dict[str, np.ndarray]:
    """A CSV file of numbers as columns."""
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names}


def load(options: Options) -> Drive:
    """The drive as records, wheels and fixes, with what the receiver's maker promises."""
    wheels = columns(options.need("comma_sf", "comma_wheels.csv"))
    fix = columns(options.need("comma_sf", "comma_ublox.csv"))
    n = len(fix["t"])
    fixes = Fixes(
        time=fix["t"],
        lat_deg=fix["lat"],
        lon_deg=fix["lon"],
        cov_ee=np.full(n, SIGMA**2),
        cov_en=np.zeros(n),
        cov_nn=np.full(n, SIGMA**2),
        speed=fix["speed"],
        sigma_speed=np.full(n, SIGMA_SPEED),
        bearing_deg=fix["bearing_deg"],
        sigma_bearing_deg=np.full(n, np.inf),
        flags=np.full(n, ASSUMED, np.uint8),
    )
    return Drive("comma_sf", fixes, WheelSpeeds(wheels["t"], wheels["rl"], wheels["rr"]))


def knowing_nothing(drive: Drive) -> Drive:
    """The same with the default sigma, and no use of the receiver's speed."""
    assert drive.fixes is not None
    n = len(drive.fixes)
    variance = np.full(n, whichroad.Settings().default_sigma_m ** 2)
    fixes = replace(drive.fixes, cov_ee=variance, cov_nn=variance, sigma_speed=np.full(n, np.inf))
    return replace(drive, fixes=fixes)


def error(lat: np.ndarray, lon: np.ndarray, true_lat: float, true_lon: float) -> np.ndarray:
    """East and north error, m."""
    east = (lon - true_lon) * math.cos(math.radians(true_lat))
    return np.radians(np.array([east, lat - true_lat])) * EARTH


def drift(
    drive: Drive, roads: whichroad.RoadMap, truth: dict[str, np.ndarray], options: Options
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Mask the fixes after GNSS_M and see where the end is put.

    Returns:
        Error when masked and at the end (east, north, m), covariance reported at the end
        (m²), distance masked (m).
    """
    wheels = drive.odometry
    assert isinstance(wheels, WheelSpeeds)
    assert drive.fixes is not None
    speed = 0.5 * (wheels.left + wheels.right)
    gone = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(wheels.time))])
    begin = float(np.interp(GNSS_M, gone, wheels.time))
    first = min(wheels.time[0], drive.fixes.time[0])
    points = whichroad.match(
        drive,
        roads,
        mask=[(begin - first, math.inf)],
        model=options.more.get("model", "default"),
        settings=options.settings(),
    ).points
    time = points["time"].astype("datetime64[us, UTC]").astype("int64").to_numpy() / 1e6
    end = float(min(time[-1], truth["t"][-1]))

    def error_at(t: float) -> np.ndarray:
        at = [np.interp(t, time, points[name]) for name in ("lat", "lon")]
        true = [np.interp(t, truth["t"], truth[name]) for name in ("lat", "lon")]
        return error(at[0], at[1], true[0], true[1])

    last = points.iloc[int(np.searchsorted(time, end)) - 1]
    cov = np.array([[last.cov_ee_m2, last.cov_en_m2], [last.cov_en_m2, last.cov_nn_m2]])
    masked = float(np.interp(end, wheels.time, gone) - GNSS_M)
    options.say(
        f"{masked:.0f} m masked; error when masked {np.round(error_at(begin), 2)}, at the end"
        f" {np.round(error_at(end), 2)} m (east, north); status {last.status}, P {last.p_road:.3f}"
    )
    return error_at(begin), error_at(end), cov, masked


def run(options: Options) -> list[Figure]:
    """With what the receiver's maker promises, and without."""
    truth = columns(options.need("comma_sf", "comma_truth_20hz.csv"))
    roads = whichroad.RoadMap.from_edges(options.need("comma_sf", "comma_sf_osm_clip.geojson"))
    drive = load(options)
    figures = []
    for what, one, goal in (("", drive, "<= 2"), (", sigmas unknown", knowing_nothing(drive), "")):
        begin, end, cov, masked = drift(one, roads, truth, options)
        moved = end - begin
        figures += [
            Figure(f"drift since the mask began{what}", float(np.hypot(*moved)), goal, "m"),
            Figure(
                f"drift in its own ellipse (95 %: 5.99){what}",
                float(moved @ np.linalg.solve(cov, moved)),
                "<= 5.99",
                "chi2",
            ),
            Figure(f"error at the end{what}", float(np.hypot(*end)), "", "m"),
            Figure(
                f"reported sigma at the end{what}", float(math.sqrt(np.trace(cov) / 2)), "", "m"
            ),
        ]
    return [*figures, Figure("distance masked", masked, "", "m")]
