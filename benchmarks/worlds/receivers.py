"""Receivers: errors of fixes that are drawn, or replayed from real drives.

A sound receiver has a smooth slow error, steps where satellites come and go, and white noise, and
reports their size within about a tenth.  Its error goes on while the car stands.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from .. import Skipped
from .drivers import Truth
from .faults import Event, during, has

ANTENNA = 1.1  # m ahead of the rear axle, on its middle line; the filter is told


@dataclass(slots=True)
class Fixes:
    """What a receiver reports, (n,); x and y are metres in the net's plane."""

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray
    cov: np.ndarray  # (n, 3) ee, en, nn; m²
    speed: np.ndarray  # m/s, NaN: not reported
    bearing_deg: np.ndarray


def receive(
    truth: Truth, events: list[Event], suite: str, data: Path, random: np.random.Generator
) -> Fixes:
    """Fixes of a drive.

    Args:
        truth: The drive.
        events: Faults of the receiver.
        suite: Which sensors there are: of `faults.SUITES`, or `BY_NAME`.
        data: The folder of real data.
        random: Of this drive.
    """
    [faulty] = random.spawn(1)  # what faults draw leaves the rest as it is
    period = 0.1 if suite == "fast" else 1.0
    time = np.arange(truth.time[0] + random.uniform(0.0, 0.1), truth.time[-1], period)
    heading = np.interp(time, truth.time, truth.heading)
    position = np.column_stack(
        [
            np.interp(time, truth.time, v) + ANTENNA * f(heading)
            for v, f in ((truth.x, np.cos), (truth.y, np.sin))
        ]
    )
    speed = np.interp(time, truth.time, truth.speed)
    error, cov = _error(time, random)
    for name in FILES:
        if has(events, name):
            error, cov = _replay(time, replayed(name, data), faulty)
    error += _canyon(time, heading, speed, events, faulty)
    error += _pulled_in(time, events, faulty) + _standstill(time, speed, events, faulty)
    error += _pulled_away(time, events, faulty)
    velocity = speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    velocity += random.normal(0.0, 0.08, velocity.shape)
    measured = position + error
    if has(events, "lag"):
        measured, velocity = _lagged(time, measured, velocity, float(faulty.uniform(0.5, 2.0)))
    _repeat(time, measured, velocity, events)
    if has(events, "sigma"):
        cov = cov / faulty.uniform(2.0, 3.0) ** 2
    fixes = Fixes(time, *measured.T, cov, np.hypot(*velocity.T), _bearing(velocity))
    _columns(fixes, events, suite, random, faulty)
    silent = during(time, events, "outage") | _before_jump(time, events)
    silent |= random.random(len(time)) < 0.003
    keep = ~silent & ~np.isnan(measured[:, 0])
    late = 1.0 if has(events, "late") else 0.0
    return Fixes(
        fixes.time[keep] + late, fixes.x[keep], fixes.y[keep], fixes.cov[keep], fixes.speed[keep],
        fixes.bearing_deg[keep],
    )  # fmt: skip


def _repeat(
    time: np.ndarray, measured: np.ndarray, velocity: np.ndarray, events: list[Event]
) -> None:
    """Fill gaps with the last fix, in place."""
    for event in events:
        if event.name in ("frozen", "frozen_zero"):
            rows = np.flatnonzero((time >= event.begin) & (time < event.end))
            if len(rows):
                measured[rows] = measured[rows[0]]
                velocity[rows] = velocity[rows[0]] if event.name == "frozen" else 0.0
        elif event.name == "every_third":
            rows = 3 * (np.arange(len(time)) // 3)
            measured[:], velocity[:] = measured[rows], velocity[rows]


def _bearing(velocity: np.ndarray) -> np.ndarray:
    """Course over ground; none where the car is too slow to have one."""
    course = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1])) % 360.0
    return np.where(np.hypot(*velocity.T) > 1.0, course, np.nan)


def smooth(time: np.ndarray, scale: float, random: np.random.Generator) -> np.ndarray:
    """A smooth process of unit variance that forgets within about `scale` seconds, (n, 2)."""
    coarse = np.arange(time[0] - 4 * scale, time[-1] + 4 * scale, scale / 8)
    white = random.normal(size=(len(coarse), 2))
    kernel = np.exp(-0.5 * (np.arange(-24, 25) / 6.0) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    slow = np.column_stack([np.convolve(white[:, i], kernel, "same") for i in (0, 1)])
    return np.column_stack([np.interp(time, coarse, slow[:, i]) for i in (0, 1)])


def _steps(time: np.ndarray, mean: float, random: np.random.Generator) -> np.ndarray:
    """Constant between changes that come about every `mean` seconds, unit variance, (n, 2)."""
    at = time[0] + np.cumsum(random.exponential(mean, int(8 + 3 * (time[-1] - time[0]) / mean)))
    return random.normal(size=(len(at) + 1, 2))[np.searchsorted(at, time)]


def _error(time: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A sound receiver's errors, (n, 2), and the covariances that it reports, (n, 3)."""
    slow = random.uniform(0.8, 2.2) * random.uniform(0.8, 1.25, 2)
    step, white = random.uniform(0.2, 0.8), random.uniform(0.3, 1.0)
    error = slow * smooth(time, float(random.uniform(60, 300)), random)
    error += step * _steps(time, 150.0, random) + white * random.normal(size=error.shape)
    sigma = np.sqrt(slow**2 + step**2 + white**2) * random.lognormal(0.0, 0.1)
    sigma = np.round(sigma * random.lognormal(0.0, 0.05, error.shape), 1)
    return error, np.column_stack([sigma[:, 0] ** 2, np.zeros(len(time)), sigma[:, 1] ** 2])


def _replay(
    time: np.ndarray, series: list["Series"], random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """One of some series from a chance place on, with a second for a second."""
    error, cov = series[int(random.integers(len(series)))]
    at = int(random.integers(len(error))) + time - time[0]
    k = _there_and_back(at.astype(int), len(error))
    share = (at % 1.0)[:, None]
    after = _there_and_back(at.astype(int) + 1, len(error))
    return (1.0 - share) * error[k] + share * error[after], cov[k]


def _there_and_back(k: np.ndarray, n: int) -> np.ndarray:
    """Places in a series that is played forth and back, so that its ends do not jump."""
    k = k % (2 * n)
    return np.where(k < n, k, 2 * n - 1 - k)


def _canyon(
    time: np.ndarray, heading: np.ndarray, speed: np.ndarray, events: list[Event],
    random: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Reflected signals that come and go; mostly across the street, as walls stand beside it."""
    error = np.zeros((len(time), 2))
    if not has(events, "canyon"):
        return error
    inside = during(time, events, "canyon")
    period = float(np.median(np.diff(time)))
    slow = smooth(time, 25.0, random)
    reflected = False
    across = along = 0.0
    for k in np.flatnonzero(inside):
        mean = 6.0 if reflected else 9.0
        if random.random() < period / mean:
            reflected = not reflected
            across = float(random.choice([-1.0, 1.0]) * random.uniform(8.0, 40.0))
            along = float(random.normal(0.0, 6.0))
        c, s = np.cos(heading[k]), np.sin(heading[k])
        error[k] = 4.0 * slow[k]
        if reflected:
            error[k] += along * np.array([c, s]) + across * np.array([-s, c])
            across *= 1.0 - 0.02 * period * min(speed[k], 10.0)
    return error


def _pulled_in(time: np.ndarray, events: list[Event], random: np.random.Generator) -> np.ndarray:
    """A receiver that found its satellites again, at first in a wrong place."""
    error = np.zeros((len(time), 2))
    for e in events:
        if e.name == "jump":
            size, course = random.uniform(15.0, 80.0), random.uniform(0, 2 * np.pi)
            after = time - e.begin
            lasts = (e.end - e.begin) / 3.0  # at the end 5 % are left
            fade = np.where((after > 0) & (time <= e.end), np.exp(-after / lasts), 0.0)
            error += size * fade[:, None] * np.array([np.cos(course), np.sin(course)])
    return error


def _pulled_away(time: np.ndarray, events: list[Event], random: np.random.Generator) -> np.ndarray:
    """A receiver that follows false signals, at a constant speed, until they end."""
    error = np.zeros((len(time), 2))
    for e in events:
        if e.name == "pulled":
            speed, course = np.exp(random.uniform(0.0, np.log(10.0))), random.uniform(0, 2 * np.pi)
            way = np.where(time <= e.end, speed * (time - e.begin).clip(0.0), 0.0)
            error += way[:, None] * np.array([np.cos(course), np.sin(course)])
    return error


def _before_jump(time: np.ndarray, events: list[Event]) -> np.ndarray:
    """No satellites for some seconds before they are found again."""
    silent = np.zeros(len(time), bool)
    for e in events:
        if e.name == "jump":
            silent |= (time > e.begin - 8.0) & (time <= e.begin)
    return silent


def _standstill(
    time: np.ndarray, speed: np.ndarray, events: list[Event], random: np.random.Generator
) -> np.ndarray:
    """A random walk while the car stands, forgotten within seconds when it drives."""
    error = np.zeros((len(time), 2))
    if not has(events, "standstill"):
        return error
    period = float(np.median(np.diff(time)))
    at, drift = np.zeros(2), np.zeros(2)
    for k in range(len(time)):
        if speed[k] < 0.1:
            drift += random.normal(0.0, 0.15, 2) * period**0.5
            drift = np.clip(drift, -1.5, 1.5)
            at = np.clip(at + drift * period, -42.0, 42.0)
        else:
            drift = np.zeros(2)
            at = at * np.exp(-period / 6.0)
        error[k] = at
    return error


def _lagged(
    time: np.ndarray, position: np.ndarray, velocity: np.ndarray, lag: float
) -> tuple[np.ndarray, np.ndarray]:
    """The receiver's own filter: it believes in constant velocity and corrects it slowly."""
    period = float(np.median(np.diff(time)))
    blend = 1.0 - np.exp(-period / lag)
    place, going = position[0].copy(), velocity[0].copy()
    out, out_velocity = np.empty_like(position), np.empty_like(velocity)
    for k in range(len(time)):
        place = place + going * period if k else place
        place = place + blend * (position[k] - place)
        going = going + blend * (velocity[k] - going)
        out[k], out_velocity[k] = place, going
    return out, out_velocity


def _columns(
    fixes: Fixes, events: list[Event], suite: str, random: np.random.Generator,
    faulty: np.random.Generator,
) -> None:  # fmt: skip
    """Speed and course as the receiver writes them, or not at all."""
    doppler = random.random() < 0.5
    about_speed = (
        "speed_spike", "speed_kmh", "speed_stuck", "speed_10", "course_stuck", "course_reversed",
    )  # fmt: skip
    if any(has(events, name) for name in about_speed):
        doppler = True
    if suite in ("yaw", "fixes") or (suite in ("wheels", "odometer") and not doppler):
        fixes.speed[:] = np.nan
        fixes.bearing_deg[:] = np.nan
    for e in events:
        if e.name == "speed_spike":
            k = min(int(np.searchsorted(fixes.time, e.begin)), len(fixes.time) - 1)
            fixes.speed[k] = faulty.uniform(40.0, 171.0)
    if has(events, "speed_kmh"):
        fixes.speed *= 3.6
    if has(events, "speed_stuck"):
        fixes.speed[:] = 0.0
    if has(events, "speed_10"):
        fixes.speed[:] = 10.0
    if has(events, "course_stuck"):
        fixes.bearing_deg[:] = 0.0
    if has(events, "course_reversed"):
        fixes.bearing_deg[:] = (fixes.bearing_deg + 180.0) % 360.0


# --- errors of real drives ------------------------------------------------------------------------

_EARTH = 6_371_000.0

FILES = {
    "nagoya": ("nagoya/reference_first_half.csv", "nagoya/rover_1Hz_spp_first_half.pos"),
    "kubicka": ("kubicka/tracks-00-49.tar.gz",),
    "comma": ("comma_sf/comma_truth_20hz.csv", "comma_sf/comma_ublox.csv"),
}
"""Faults that are replayed, and the real data that they need."""

Series = tuple[np.ndarray, np.ndarray]  # (n, 2) error, m; (n, 3) covariance, m²


@cache
def replayed(name: str, data: Path) -> list[Series]:
    """Series of errors at 1 Hz of real drives, east and north.

    Raises:
        Skipped: The data is not here.
    """
    missing = [data / file for file in FILES[name] if not (data / file).exists()]
    if missing:
        raise Skipped(f"{missing[0]} is not here; set WHICHROAD_DATA or --data")
    return {"nagoya": _nagoya, "kubicka": _kubicka, "comma": _comma}[name](data)


def absent(data: Path) -> set[str]:
    """Faults that cannot be replayed here."""
    return {name for name in FILES if not all((data / file).exists() for file in FILES[name])}


def _metres(lat: np.ndarray, lon: np.ndarray, lat0: float, lon0: float) -> np.ndarray:
    east = np.radians(lon - lon0) * np.cos(np.radians(lat0)) * _EARTH
    return np.column_stack([east, np.radians(lat - lat0) * _EARTH])


def _every_second(time: np.ndarray, table: np.ndarray) -> np.ndarray:
    grid = np.arange(time[0], time[-1])
    return np.column_stack([np.interp(grid, time, c) for c in table.T])


def _nagoya(data: Path) -> list[Series]:
    """Fix minus post-processed reference, with RTKLIB's covariances."""
    truth = np.genfromtxt(
        data / "nagoya" / "reference_first_half.csv", delimiter=",", skip_header=1
    )
    rows = []
    for line in (data / "nagoya" / "rover_1Hz_spp_first_half.pos").read_text().splitlines():
        if line.startswith("%") or not line.strip():
            continue
        word = line.split()
        h, m, s = (float(v) for v in word[1].split(":"))
        sdn, sde, _, sdne = (float(v) for v in word[7:11])
        rows.append((h * 3600 + m * 60 + s, float(word[2]), float(word[3]),
                     sde**2, np.sign(sdne) * sdne**2, sdn**2))  # fmt: skip
    fix = np.array(rows)
    time = fix[:, 0] + 86_400.0 * np.floor(truth[0, 0] / 86_400.0)
    lat0, lon0 = truth[0, 2], truth[0, 3]
    true = _metres(truth[:, 2], truth[:, 3], lat0, lon0)
    at = np.column_stack([np.interp(time, truth[:, 0], c) for c in true.T])
    error = _metres(fix[:, 1], fix[:, 2], lat0, lon0) - at
    inside = (time >= truth[0, 0]) & (time <= truth[-1, 0])
    both = _every_second(time[inside], np.column_stack([error, fix[:, 3:]])[inside])
    return [(both[:, :2], both[:, 2:])]


def _comma(data: Path) -> list[Series]:
    """A u-blox against a post-processed truth, one minute; its mean offset kept."""
    fix = np.genfromtxt(data / "comma_sf" / "comma_ublox.csv", delimiter=",", names=True)
    true = np.genfromtxt(data / "comma_sf" / "comma_truth_20hz.csv", delimiter=",", names=True)
    lat0, lon0 = float(true["lat"][0]), float(true["lon"][0])
    xy = _metres(true["lat"], true["lon"], lat0, lon0)
    at = np.column_stack([np.interp(fix["t"], true["t"], c) for c in xy.T])
    error = _every_second(fix["t"], _metres(fix["lat"], fix["lon"], lat0, lon0) - at)
    return [(error, np.tile([9.0, 0.0, 9.0], (len(error), 1)))]


_TRACKS = (0, 1, 3, 5, 7, 8, 9, 10, 12, 13, 16, 17, 18)  # whole, not shifted, no loops


def _kubicka(data: Path) -> list[Series]:
    """Distances of fixes from the routes of real drives: one drive's for east, another's north.

    The component along the road is not known; the ones across are, over all directions.  A
    constant part is the lane's and the map's, and is left out.
    """
    import tarfile

    across = []
    with tarfile.open(data / "kubicka" / "tracks-00-49.tar.gz") as tar:
        for number in _TRACKS:
            name = f"{number:08d}/{number:08d}"
            table = {
                end: np.loadtxt(_member(tar, f"{name}.{end}"), ndmin=2)
                for end in ("track", "nodes", "arcs", "route")
            }
            found = _across(table)
            across.append(found - np.median(found))
    pairs = zip(across, across[1:] + across[:1], strict=True)
    series = []
    for a, b in pairs:
        n = min(len(a), len(b))
        series.append((np.column_stack([a[:n], b[:n]]), np.tile([25.0, 0.0, 25.0], (n, 1))))
    return series


def _member(tar: object, name: str) -> list[str]:
    file = next(tar.extractfile(m) for m in tar if m.name.endswith(name))
    return list(file.read().decode().splitlines())


def _across(table: dict[str, np.ndarray]) -> np.ndarray:
    """Signed distances of a track's fixes from its route, every second, m."""
    track = table["track"][:, :3]
    lon0, lat0 = track[0, :2]
    nodes = _metres(table["nodes"][:, 1], table["nodes"][:, 0], lat0, lon0)
    arcs = table["arcs"][table["route"][:, 0].astype(int)].astype(int)
    a, b = nodes[arcs[:, 0]], nodes[arcs[:, 1]]
    d = b - a
    length = np.hypot(*d.T)
    a, d, length = a[length > 0.01], d[length > 0.01], length[length > 0.01]
    out, near = [], 0
    for p in _metres(track[:, 1], track[:, 0], lat0, lon0):
        part = slice(max(near - 60, 0), near + 200)
        w = p - a[part]
        t = ((w * d[part]).sum(1) / length[part] ** 2).clip(0.0, 1.0)
        away = np.hypot(*(w - t[:, None] * d[part]).T)
        k = int(np.argmin(away))
        near = max(near - 60, 0) + k
        side = d[near, 0] * w[k, 1] - d[near, 1] * w[k, 0]
        out.append(float(np.copysign(away[k], side)))
    error = np.clip(np.array(out), -150.0, 150.0)
    return _every_second(track[:, 2], error[:, None])[:, 0]
