"""Buses in Helsinki: fixes hidden for a minute, the odometer and the map go on alone.

Six trips of one line.  The odometer counts in steps of five metres and is 0.2 to 1.4 %
off, which the filter learns on the way; nothing measures the heading.  There is no truth
but the fixes that were hidden, so that the ellipses compared with them hold the fix's own
noise too, which is set to 4 m.

The windows are a minute in every two, after the first kilometre and on the part of the
line that the map shows; each trip is driven four times, with the windows 30 s later each.

Between 2,990 and 3,270 m, at a stop below a station, the receivers of five trips fall 30 to
100 m behind for half a minute.  What was hidden there is wrong itself; it counts, and the
figures without it stand beside.
"""

from datetime import datetime

import numpy as np
import pyarrow as pa
import pyarrow.csv

import whichroad
from whichroad.observations import ASSUMED, Array, Drive, Fixes, Odometer

from . import Figure, Options, interval

SIGMA = 4.0  # m per axis, of every fix
MAPPED = 6350.0  # odometer metres; the map ends there
HIDDEN, PERIOD = 60.0, 120.0  # s
LEARNT = 1000.0  # odometer metres before the first window
STATION = (2990.0, 3270.0)  # odometer metres; the fixes lag behind
PHASES = (0.0, 30.0, 60.0, 90.0)  # s
CRS = "EPSG:3067"
INSIDE = 5.991


def trips(options: Options) -> list[tuple[Drive, Array]]:
    """Each trip on the mapped part, and its fixes' places in CRS, (n, 2) m."""
    from pyproj import Transformer

    table = pyarrow.csv.read_csv(
        options.need("hsl", "obs_dev.csv"),
        convert_options=pa.csv.ConvertOptions(column_types={"tst": pa.string()}),
    )
    to_degrees = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
    names = table["jrnid"].to_numpy(zero_copy_only=False)
    stamps = table["tst"].to_pylist()
    seconds = np.array(
        [datetime.fromisoformat(s.replace("Z", "+00:00")).timestamp() for s in stamps]
    )
    place = np.column_stack([table["X"].to_numpy(), table["Y"].to_numpy()])
    odometer = table["odo"].to_numpy().astype(float)
    made = []
    for name in dict.fromkeys(names):
        rows = np.flatnonzero(names == name)
        rows = rows[np.unique(seconds[rows], return_index=True)[1]]
        rows = rows[odometer[rows] - odometer[rows[0]] <= MAPPED]
        time, n = seconds[rows], len(rows)
        lon, lat = to_degrees.transform(*place[rows].T)
        none, unknown = np.zeros(n), np.full(n, np.inf)
        fixes = Fixes(
            time=time,
            lat_deg=lat,
            lon_deg=lon,
            cov_ee=np.full(n, SIGMA**2),
            cov_en=none,
            cov_nn=np.full(n, SIGMA**2),
            speed=none,
            sigma_speed=unknown,
            bearing_deg=none,
            sigma_bearing_deg=unknown,
            flags=np.full(n, ASSUMED, np.uint8),
        )
        made.append((Drive(str(name)[:6], fixes, Odometer(time, odometer[rows])), place[rows]))
    return made


def hidden(
    drive: Drive, place: Array, phase: float, roads: whichroad.RoadMap, options: Options
) -> Array:
    """Of each hidden fix: distance of the estimate (m), its chi-square, odometer (m)."""
    from pyproj import Transformer

    assert drive.fixes is not None
    assert isinstance(drive.odometry, Odometer)
    since = drive.fixes.time - drive.fixes.time[0]
    gone = drive.odometry.distance - drive.odometry.distance[0]
    first = float(np.interp(LEARNT, gone, since)) + phase
    begins = np.arange(first, since[-1] - HIDDEN, PERIOD)
    points = whichroad.match(
        drive,
        roads,
        mask=[(float(b), float(b) + HIDDEN) for b in begins],
        model=options.more.get("model", "default"),
        settings=options.settings(),
    ).points
    time = points["time"].astype("datetime64[us, UTC]").astype("int64").to_numpy() / 1e6
    inside = ((since[:, None] >= begins) & (since[:, None] <= begins + HIDDEN)).any(axis=1)
    said = points.iloc[np.searchsorted(time, drive.fixes.time[inside] - 1e-3)]
    x, y = Transformer.from_crs("EPSG:4326", CRS, always_xy=True).transform(
        said["lon"], said["lat"]
    )
    error = np.column_stack([x, y]) - place[inside]
    ee, en, nn = (said[name].to_numpy() for name in ("cov_ee_m2", "cov_en_m2", "cov_nn_m2"))
    ee, nn = ee + SIGMA**2, nn + SIGMA**2
    chi2 = nn * error[:, 0] ** 2 - 2.0 * en * error[:, 0] * error[:, 1] + ee * error[:, 1] ** 2
    far = np.hypot(error[:, 0], error[:, 1])
    return np.column_stack([far, chi2 / (ee * nn - en**2), gone[inside]])


def held(rows: Array) -> float:
    """Share of the hidden fixes in their ellipse, %."""
    return 100.0 * float((rows[:, 1] < INSIDE).mean())


def run(options: Options) -> list[Figure]:
    """Median distance and coverage, over all hidden fixes and by trip."""
    roads = whichroad.RoadMap.from_edges(options.need("hsl", "link.csv"), crs=CRS)
    each = []
    for drive, place in trips(options):
        rows = np.concatenate([hidden(drive, place, phase, roads, options) for phase in PHASES])
        each.append(rows)
        options.say(
            f"{drive.drive_id}: {len(rows)} hidden fixes, median {np.median(rows[:, 0]):.1f} m, "
            f"95 % {np.quantile(rows[:, 0], 0.95):.0f} m, {held(rows):.0f} % inside"
        )
    rows = np.concatenate(each)
    n = len(rows)
    station = (rows[:, 2] > STATION[0]) & (rows[:, 2] < STATION[1])
    share = np.array([((r[:, 1] < INSIDE).sum(), len(r)) for r in each], float)
    medians = np.array([[np.median(r[:, 0])] for r in each])
    return [
        Figure(
            "median distance to the hidden fixes", float(np.median(rows[:, 0])), "<= 8", "m", n,
            interval(lambda v: float(v.mean()), medians),
        ),
        Figure(
            "hidden fixes in the 95 % ellipse", held(rows), "90..98", "%", n,
            interval(lambda v: 100.0 * float(v[:, 0].sum() / v[:, 1].sum()), share),
        ),
        Figure("distance that 95 % stay below", float(np.quantile(rows[:, 0], 0.95)), "", "m", n),
        Figure(
            "median distance, without the station", float(np.median(rows[~station, 0])), "", "m",
            int((~station).sum()),
        ),
        Figure("in the ellipse, without the station", held(rows[~station]), "", "%",
               int((~station).sum())),
        Figure("worst trip: median distance", float(medians.max()), "", "m"),
        Figure("worst trip: in the ellipse", min(held(r) for r in each), "", "%"),
    ]  # fmt: skip
