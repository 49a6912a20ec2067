"""Real wheels on a real map: GNSS for the first 300 m, then none.

One kilometre in San Francisco with four wheel speeds, a u-blox receiver and a
post-processed truth.  The drift is the error at the end less the error when the fixes
stopped, so that the antenna's place and the truth's own offset do not count.
"""

import math
from pathlib import Path

import numpy as np

import whichroad
from whichroad.records import ASSUMED, Drive, Fixes, WheelSpeeds

from . import Figure, Options

GNSS_M = 300.0  # m with fixes
EARTH = 6371008.8


def columns(path: Path) -> dict[str, np.ndarray]:
    """A CSV file of numbers as columns."""
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names}


def load(options: Options) -> Drive:
    """The drive as records, wheels and fixes."""
    wheels = columns(options.need("comma_sf", "comma_wheels.csv"))
    fix = columns(options.need("comma_sf", "comma_ublox.csv"))
    n = len(fix["t"])
    unknown = np.full(n, np.inf)
    variance = np.full(n, whichroad.Settings().default_sigma_m ** 2)  # none is reported
    fixes = Fixes(
        time=fix["t"],
        lat_deg=fix["lat"],
        lon_deg=fix["lon"],
        cov_ee=variance,
        cov_en=np.zeros(n),
        cov_nn=variance,
        speed=fix["speed"],
        sigma_speed=unknown,
        bearing_deg=fix["bearing_deg"],
        sigma_bearing_deg=unknown,
        flags=np.full(n, ASSUMED, np.uint8),
    )
    return Drive("comma_sf", fixes, WheelSpeeds(wheels["t"], wheels["rl"], wheels["rr"]))


def error(lat: np.ndarray, lon: np.ndarray, true_lat: float, true_lon: float) -> np.ndarray:
    """East and north error, m."""
    east = (lon - true_lon) * math.cos(math.radians(true_lat))
    return np.radians(np.array([east, lat - true_lat])) * EARTH


def run(options: Options) -> list[Figure]:
    """Mask the fixes after 300 m and see where the end is put."""
    drive = load(options)
    truth = columns(options.need("comma_sf", "comma_truth_20hz.csv"))
    roads = whichroad.RoadMap.from_edges(options.need("comma_sf", "comma_sf_osm_clip.geojson"))
    wheels = drive.odometry
    assert isinstance(wheels, WheelSpeeds)
    assert drive.fixes is not None
    speed = 0.5 * (wheels.left + wheels.right)
    gone = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(wheels.time))])
    begin = float(np.interp(GNSS_M, gone, wheels.time))
    first = min(wheels.time[0], drive.fixes.time[0])
    model = options.more.get("model", "default")
    points = whichroad.match(
        drive, roads, mask=[(begin - first, math.inf)], model=model, settings=options.settings()
    ).points
    time = points["time"].astype("datetime64[us, UTC]").astype("int64").to_numpy() / 1e6
    end = float(min(time[-1], truth["t"][-1]))

    def error_at(t: float) -> np.ndarray:
        at = [np.interp(t, time, points[name]) for name in ("lat", "lon")]
        true = [np.interp(t, truth["t"], truth[name]) for name in ("lat", "lon")]
        return error(at[0], at[1], true[0], true[1])

    drift = error_at(end) - error_at(begin)
    last = points.iloc[int(np.searchsorted(time, end)) - 1]
    cov = np.array([[last.cov_ee_m2, last.cov_en_m2], [last.cov_en_m2, last.cov_nn_m2]])
    masked = float(np.interp(end, wheels.time, gone) - GNSS_M)
    options.say(
        f"{masked:.0f} m masked; error when masked {np.round(error_at(begin), 2)}, at the end"
        f" {np.round(error_at(end), 2)} m (east, north); status {last.status}, P {last.p_road:.3f}"
    )
    return [
        Figure("drift since the mask began", float(np.hypot(*drift)), "<= 5", "m"),
        Figure(
            "drift in its own ellipse (95 %: 5.99)",
            float(drift @ np.linalg.solve(cov, drift)),
            "<= 5.99",
            "chi2",
        ),
        Figure("error at the end", float(np.hypot(*error_at(end))), "", "m"),
        Figure("reported sigma at the end", float(math.sqrt(np.trace(cov) / 2)), "", "m"),
        Figure("distance masked", masked, "", "m"),
    ]
