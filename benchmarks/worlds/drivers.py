"""Drivers of SUMO: where each car was at 10 Hz, in which lane and how far across it.

SUMO moves the front bumper.  The middle of the rear axle follows it as a drawn point follows:
it always moves towards the bumper, so that the rear wheels never slip sideways.
"""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .nets import Net, call

STEP = 0.1  # s
SECONDS = 600.0  # of each drive
PROBES = 24  # cars of a world that are recorded
OTHERS = 40  # cars in their way
WHEELBASE = 3.6  # m, rear axle to front bumper
_SHORTEST = 120.0  # s; shorter drives are left out
_LEAST = 500.0  # m
_ASIDE = 40.0  # m beside the line of its road: the drive's roads were not found
_CORNER = 20.0  # m of lines, that a car may cut in so much travel
_JUMP = 4.0  # m in a step: SUMO moved the car, nobody drove
_SKIPPED = 5  # most streets that SUMO drives through within a step
_WINDOW = 30.0  # m ahead, where the next row's place on the route is looked for
_LEAP = 0.2  # m beside the line, that a leap of 1 m along it costs
_TURNED = 5.0  # m beside the line, that a right angle to it costs
_GRID = 0.5  # m, between points of a path
_ROUNDING = 3.0  # m, sigma of the smoothing of corners
_SIDEWAYS = 4.0  # m/s², of a car in a bend
_BRAKING = 5.0  # m/s²
_PULLING = 3.0  # m/s²


@dataclass(frozen=True, slots=True)
class Truth:
    """One drive, (n,) at 10 Hz."""

    time: np.ndarray  # s
    x: np.ndarray  # m, middle of the rear axle
    y: np.ndarray
    heading: np.ndarray  # rad, unwrapped
    travel: np.ndarray  # m
    code: np.ndarray  # directed road

    def __len__(self) -> int:
        return len(self.time)

    @property
    def speed(self) -> np.ndarray:
        """m/s, (n,)."""
        return np.gradient(self.travel, self.time)


def make_drives(net: Net, seed: int) -> list[Truth]:
    """The drives of a world, kept as a file beside the net's between runs."""
    kept = net.file.with_suffix(".npz")
    if not kept.exists():
        table = net.file.with_suffix(".fcd.csv")
        random = np.random.default_rng([seed, 77])
        trips = net.file.with_suffix(".rou.xml")
        trips.write_text(_trips(net, random), encoding="utf-8")
        call(
            "sumo", "-n", str(net.file), "-r", str(trips), "--fcd-output", str(table),
            "--fcd-output.attributes", "x,y,angle,lane", "--precision", "3",
            "--device.fcd.explicit", ",".join(f"probe{k}" for k in range(PROBES)),
            "--step-length", str(STEP), "--end", str(SECONDS), "--lateral-resolution", "0.8",
            "--ignore-route-errors", "--time-to-teleport", "150", "--collision.action", "none",
            "--no-step-log", "--no-warnings", "--seed", str(int(random.integers(1, 2**31 - 1))),
        )  # fmt: skip
        drives = _read(table, net)
        np.savez(kept, *[np.column_stack(_columns(d)) for d in drives])
        table.unlink()
    with np.load(kept) as stored:
        return [_truth(stored[name]) for name in stored.files]


def _columns(d: Truth) -> list[np.ndarray]:
    return [d.time, d.x, d.y, d.heading, d.travel, d.code]


def _truth(rows: np.ndarray) -> Truth:
    *rest, code = rows.T
    return Truth(*rest, code.astype(np.int64))


def _trips(net: Net, random: np.random.Generator) -> str:
    """Cars by chance places, some with stops, and drivers of several kinds."""
    edges = sorted(e for e, c in net.code.items() if c in net.following)
    length = {e: _length(net.line(net.code[e])) for e in edges}
    weight = np.array([length[e] for e in edges])
    weight /= weight.sum()
    out = ["<routes>"]
    for k in range(8):
        out.append(
            f'<vType id="d{k}" length="4.6" sigma="{random.uniform(0.2, 0.8):.2f}" '
            f'speedFactor="normc({random.uniform(0.85, 1.15):.2f},0.1,0.5,1.5)" '
            f'accel="{random.uniform(1.2, 3.2):.2f}" decel="{random.uniform(2.5, 4.5):.2f}" '
            f'latAlignment="{random.choice(["center", "right", "arbitrary", "nice"])}" '
            f'lcSigma="{random.uniform(0, 0.3):.2f}" lcSpeedGain="{random.uniform(0.5, 3):.2f}" '
            f'lcSublane="{random.uniform(0.3, 2):.2f}" '
            f'maxSpeedLat="{random.uniform(0.5, 1.2):.2f}"/>'
        )
    for k in range(PROBES + OTHERS):
        name = f"probe{k}" if k < PROBES else f"other{k}"
        via = [str(e) for e in random.choice(edges, size=9, p=weight)]
        stops = "".join(
            f'<stop edge="{e}" duration="{random.uniform(10, 90):.0f}" parking="false"/>'
            for e in via[1:-1]
            if random.random() < 0.2 and length[e] > 60.0
        )
        out.append(
            f'<trip id="{name}" type="d{random.integers(8)}" depart="{0.05 * k:.2f}" '
            f'from="{via[0]}" to="{via[-1]}" via="{" ".join(via[1:-1])}" departLane="best" '
            f'departPos="random_free">{stops}</trip>'
        )
    return "\n".join([*out, "</routes>"])


def _length(line: np.ndarray) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _read(table: Path, net: Net) -> list[Truth]:
    """Drives of SUMO's table of positions."""
    rows: dict[str, list[tuple[float, float, float, float, str]]] = {}
    with table.open(encoding="utf-8", newline="") as file:
        for r in csv.DictReader(file, delimiter=";"):
            if r["vehicle_id"]:
                rows.setdefault(r["vehicle_id"], []).append(
                    (float(r["timestep_time"]), float(r["vehicle_x"]), float(r["vehicle_y"]),
                     float(r["vehicle_angle"]), r["vehicle_lane"])
                )  # fmt: skip
    drives = []
    for one in rows.values():
        numbers = np.array([r[:4] for r in one])
        code = _codes([r[4].rpartition("_")[0] for r in one], net)
        part = _whole_part(numbers, code)
        short = (part.stop - part.start) * STEP < _SHORTEST
        if short or _length(numbers[part, 1:3]) < 0.5 * _LEAST:
            continue
        route = _route(code[part], net)
        heading = np.radians(90.0 - numbers[part.start, 3])
        drive = drivable(numbers[part, 1:3], heading)
        forward = float(np.diff(drive.travel).min()) > -0.05
        if route and forward and drive.travel[-1] > _LEAST:
            code_, route_m = roads_along(drive, route, net)
            part = without_shortcuts(drive.travel, route_m)
            drive = _slice(replace(drive, code=code_), part)
            long = drive.travel[-1] > _LEAST and drive.time[-1] > _SHORTEST
            if long and float(off_line(drive, net).max()) < _ASIDE:
                drives.append(drive)
    return drives


def without_shortcuts(travel: np.ndarray, route: np.ndarray) -> slice:
    """The longest part of a drive that follows its route's lines.

    SUMO's junctions reach far up the legs of an acute angle; its cars turn there, tens of metres
    before the node: no road is there that a car could turn on.

    Args:
        travel: (n,) m driven.
        route: (n,) m along the lines of the route.
    """
    grid = np.arange(0.0, travel[-1], 1.0)
    rows = np.searchsorted(travel, grid)
    skipped = np.zeros(len(grid), bool)
    reach = int(_CORNER)
    gained = route[rows][reach:] - route[rows][:-reach] - _CORNER
    for k in np.flatnonzero(gained > _CORNER):
        skipped[k : k + reach] = True
    cut = rows[skipped]
    at = np.concatenate([[0], cut, [len(travel)]])
    k = int(np.argmax(travel[np.minimum(at[1:], len(travel) - 1)] - travel[at[:-1]]))
    return slice(int(at[k]), int(at[k + 1]))


def _slice(drive: Truth, part: slice) -> Truth:
    """A part of a drive, its time and its distance from 0 on."""
    time, travel = drive.time[part], drive.travel[part]
    return Truth(
        time - time[0], drive.x[part], drive.y[part], drive.heading[part], travel - travel[0],
        drive.code[part],
    )  # fmt: skip


def off_line(drive: Truth, net: Net) -> np.ndarray:
    """Distance of each row from the line of its road, (n,) m."""
    import shapely

    lines = np.array([shapely.LineString(s.line) for s in net.streets], dtype=object)
    return np.asarray(shapely.distance(lines[drive.code >> 1], shapely.points(drive.x, drive.y)))


def _route(code: np.ndarray, net: Net) -> list[int]:
    """The roads driven in order, with those that are shorter than a step; empty: not found."""
    seen = code[np.concatenate([[True], np.diff(code) != 0])].tolist()
    route = seen[:1]
    for target in seen[1:]:
        paths = [[route[-1]]]
        while paths and paths[0][-1] != target:
            path = paths.pop(0)
            if len(path) < _SKIPPED + 2:
                paths += [[*path, c] for c in net.following.get(path[-1], [])]
        if not paths:
            return []
        route += paths[0][1:]
    return route


def roads_along(drive: Truth, route: list[int], net: Net) -> tuple[np.ndarray, np.ndarray]:
    """The road of each row, by the geometry of the streets driven.

    SUMO's junctions have a size, and hide streets shorter than that.  The map's are points.  So a
    row's road is where the nearest point of the route's lines is, never going back.

    Args:
        drive: The drive.
        route: Directed roads in order.
        net: Their lines.

    Returns:
        (n,) directed roads, and (n,) metres along the route's lines.
    """
    lines = [net.line(c) for c in route]
    a = np.concatenate([p[:-1] for p in lines])
    d = np.concatenate([np.diff(p, axis=0) for p in lines])
    which = np.repeat(np.arange(len(route)), [len(p) - 1 for p in lines])
    length = np.hypot(*d.T).clip(1e-6)
    begins = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    course = np.arctan2(d[:, 1], d[:, 0])
    code, along = np.empty(len(drive), np.int64), np.empty(len(drive))
    progress, low = 0.0, 0
    ahead = float(length[which == 0].sum())  # where it may be at first
    for k in range(len(drive)):
        high = max(int(np.searchsorted(begins, progress + ahead, "right")), low + 1)
        part = slice(low, high)
        w = np.array([drive.x[k], drive.y[k]]) - a[part]
        back = ((progress - begins[part]) / length[part]).clip(0.0, 1.0)
        t = ((w * d[part]).sum(1) / length[part] ** 2).clip(back, 1.0)
        away = np.hypot(*(w - t[:, None] * d[part]).T)
        here = begins[part] + t * length[part]
        leap = (here - progress) * (k > 0)
        cost = away + _LEAP * leap + _TURNED * (1.0 - np.cos(course[part] - drive.heading[k]))
        best = int(np.argmin(cost))
        progress, low = float(here[best]), low + best
        ahead = _WINDOW if away[best] < 0.5 * _WINDOW else 4.0 * _WINDOW
        code[k], along[k] = route[which[low]], progress
    return code, along


def _codes(edges: list[str], net: Net) -> np.ndarray:
    """The directed road of each row; inside of a junction the nearer one in time."""
    known = np.array([net.code.get(e, -1) for e in edges])
    at = np.flatnonzero(known >= 0)
    if not len(at):
        return known
    here = np.arange(len(known))
    after = np.searchsorted(at, here).clip(0, len(at) - 1)
    before = (after - 1).clip(0)
    nearer = np.abs(at[after] - here) <= np.abs(here - at[before])
    return known[np.where(nearer, at[after], at[before])]


def _whole_part(numbers: np.ndarray, code: np.ndarray) -> slice:
    """The longest part that drives on: without turning round, gaps and jumps of SUMO."""
    step = np.hypot(*np.diff(numbers[:, 1:3], axis=0).T)
    turned = (code[1:] ^ code[:-1]) == 1
    near = int(4.0 / STEP)  # turning round takes so long
    turned = np.convolve(turned, np.ones(2 * near + 1), "same")[: len(turned)] > 0
    cut = turned | (step > _JUMP) | (np.diff(numbers[:, 0]) > 1.5 * STEP) | (code[1:] < 0)
    at = np.concatenate([[0], np.flatnonzero(cut) + 1, [len(code)]])
    k = int(np.argmax(np.diff(at)))
    return slice(int(at[k]), int(at[k + 1]))


def drivable(front: np.ndarray, heading: float) -> Truth:
    """A drive as a car can drive it: corners rounded, and slow enough in them; no roads yet.

    Args:
        front: (n, 2) m, middle of the front bumper, every `STEP`.
        heading: rad, at the first row.
    """
    step = np.hypot(*np.diff(front, axis=0).T)
    step[step < 2e-3] = 0.0
    along = np.concatenate([[0.0], np.cumsum(step)])
    grid = np.arange(0.0, along[-1] + _GRID, _GRID)
    keep = np.concatenate([[True], step > 0.0])
    path = np.column_stack([_rounded(np.interp(grid, along[keep], front[keep, i])) for i in (0, 1)])
    bend = np.unwrap(np.arctan2(*np.gradient(path, axis=0).T[::-1]))
    curvature = np.abs(np.gradient(bend, _GRID))
    limit = np.sqrt(_SIDEWAYS / np.interp(along[1:], grid, curvature).clip(1e-4))
    speed = np.minimum(step / STEP, limit)
    for order, most in (
        (range(1, len(speed)), _PULLING),
        (range(len(speed) - 2, -1, -1), _BRAKING),
    ):
        for k in order:
            before = speed[k - order.step]
            speed[k] = min(speed[k], (before**2 + 2.0 * most * step[k]) ** 0.5)
    moving = step > 0.0
    lasts = np.full(len(step), STEP)
    lasts[moving] = np.maximum(step[moving] / speed[moving].clip(0.05), STEP)
    when = np.concatenate([[0.0], np.cumsum(lasts)])
    time = np.arange(0.0, when[-1], STEP)
    s = np.interp(time, when, along)
    bumper = np.column_stack([np.interp(s, grid, path[:, i]) for i in (0, 1)])
    return Truth(time, *rear_axle(bumper, heading), np.full(len(time), -1))


def _rounded(values: np.ndarray) -> np.ndarray:
    """Smoothed along the way, the ends kept."""
    half = int(4 * _ROUNDING / _GRID)
    k = np.arange(-half, half + 1) * _GRID
    weight = np.exp(-0.5 * (k / _ROUNDING) ** 2)
    head = 2 * values[0] - values[half:0:-1]
    tail = 2 * values[-1] - values[-2 : -half - 2 : -1]
    return np.convolve(np.concatenate([head, values, tail]), weight / weight.sum(), "valid")


def rear_axle(
    front: np.ndarray, heading: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The middle of the rear axle behind a bumper that is known.

    Args:
        front: (n, 2) m, middle of the front bumper.
        heading: rad, at the first row.

    Returns:
        x, y (m), heading (rad, unwrapped) and distance travelled (m, less in reverse), (n,).
    """
    substeps = 8
    n = len(front)
    fine = np.linspace(0, n - 1, substeps * (n - 1) + 1)
    fx = np.interp(fine, np.arange(n), front[:, 0]).tolist()
    fy = np.interp(fine, np.arange(n), front[:, 1]).tolist()
    ux, uy = float(np.cos(heading)), float(np.sin(heading))
    x, y, travel = fx[0] - WHEELBASE * ux, fy[0] - WHEELBASE * uy, 0.0
    out = np.empty((n, 5))
    for k, (px, py) in enumerate(zip(fx, fy, strict=True)):
        dx, dy = px - x, py - y
        d = (dx * dx + dy * dy) ** 0.5
        vx, vy = dx / d, dy / d
        new_x, new_y = px - WHEELBASE * vx, py - WHEELBASE * vy
        travel += 0.5 * ((new_x - x) * (ux + vx) + (new_y - y) * (uy + vy))
        x, y, ux, uy = new_x, new_y, vx, vy
        if k % substeps == 0:
            out[k // substeps] = x, y, ux, uy, travel
    return out[:, 0], out[:, 1], np.unwrap(np.arctan2(out[:, 3], out[:, 2])), out[:, 4]
