"""Calibrating simulated cars from their own drives in Heidelberg.

Every car has its own wheels, track width, antenna and clock, and nothing in it is as its user
believes.  One fleet of 50 drives gives the errors, many small ones the coverage of intervals.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from whichroad import RoadMap, Vehicle, calibrate, match
from whichroad.calibration import Calibration
from whichroad.calibration.drives_run import clock_of
from whichroad.observations import Array, Drive, Fixes, WheelCounts
from whichroad.simulate import PRESETS, SimulatedDrive, simulate_drive

from . import Figure, Options, interval, seeds_text, town

SEEDS = range(7400, 7420)  # one car each
_FLEET = 50  # drives of the first car
_EACH = 12  # drives of every car
_LENGTH = 8000.0  # m
_MOST = 1000  # drives a car
_OUTAGES = 4  # drives with outages of each car


def fleet(
    car: int, count: int, off: float | None = None, **more: Any
) -> tuple[list[Drive], dict[str, float]]:
    """Drives of a car, and what is to be found of it where the user believes the default car.

    Args:
        car: Its seed.
        count: Of its drives.
        off: Of its scale; None: drawn.
        more: For the drives' scenario.
    """
    made, truth = _made(car, range(count), off, more)
    return [drive for drive, _ in made], truth


def _made(
    car: int, numbers: range, off: float | None, more: dict[str, Any]
) -> tuple[list[tuple[Drive, SimulatedDrive]], dict[str, float]]:
    """Drives of a car with what is true of them."""
    draw = np.random.default_rng([car, 5])
    scale, ratio = 1.0 + 0.02 * draw.standard_normal(), 1.0 + 5e-4 * draw.standard_normal()
    track, ahead = 1.5 * (1.0 + 0.02 * draw.standard_normal()), float(draw.uniform(0.0, 2.5))
    late = float(draw.uniform(-0.2, 0.2))
    scale = scale if off is None else 1.0 + off
    usual = Vehicle()
    sim = replace(
        PRESETS["good"], metres_per_tick=usual.metres_per_tick_left * scale, scale_sigma=0.0,
        differential_sigma=0.0, track_width=track, track_sigma=0.0, antenna_forward=ahead, **more,
    )  # fmt: skip
    drives = []
    for number in numbers:
        seed = car * _MOST + number
        roads, allowed = town._world["roads"], town._world["allowed"]
        made = simulate_drive(roads, seed=seed, length_m=_LENGTH, scenario=sim, allowed=allowed)
        log, fixes = made.drive.odometry, made.drive.fixes
        assert isinstance(log, WheelCounts)
        assert isinstance(fixes, Fixes)
        log = replace(log, left=log.left * np.sqrt(ratio), right=log.right / np.sqrt(ratio))
        fixes = replace(fixes, time=fixes.time + late)
        drives.append((replace(made.drive, odometry=log, fixes=fixes), made))
    across = float(np.sqrt(sim.map_sigma**2 + sim.relative_sigma**2 + sim.street_sigma**2
                           + sim.lane_sigma**2))  # fmt: skip
    return drives, {
        "odometer scale": scale, "right over left": ratio, "track width": track,
        "antenna forward": ahead, "gnss clock offset": -late, "errors across the road": across,
    }  # fmt: skip


def run(options: Options) -> list[Figure]:
    """Errors of one large fleet, and how often the intervals of small ones hold the truth."""
    town._open(options.need("maps", "heidelberg.osm.pbf"))
    cars = options.seeds or SEEDS
    drives, truth = fleet(cars[0], options.more.get("drives", _FLEET))
    found = calibrate(drives, town._world["roads"])
    options.say(found.to_toml())
    held: dict[str, list[bool]] = {name: [] for name in truth}
    for car in cars[1:]:
        few, true = fleet(car, _EACH)
        small = calibrate(few, town._world["roads"])
        for name, inside in _inside(small, true).items():
            held[name].append(inside)
        options.say(f"car {car}: done")
    return _figures(found, truth, held, seeds_text(cars))


def outages(options: Options) -> list[Figure]:
    """Outages of 1.5 km of cars whose scale is 3 % off: calibrated, known, and as believed."""
    town._open(options.need("maps", "heidelberg.osm.pbf"))
    roads = town._world["roads"]
    cars = options.seeds or range(7500, 7504)
    sums: dict[str, list[Array]] = {name: [] for name in ("known", "calibrated", "believed")}
    for car in cars:
        drives, truth = fleet(car, _EACH, 0.03)
        usual = Vehicle()
        vehicles = {
            "known": _known_car(usual, truth),
            "calibrated": calibrate(drives, roads).vehicle,
            "believed": usual,
        }
        numbers = range(_MOST // 2, _MOST // 2 + options.more.get("drives", _OUTAGES))
        made, _ = _made(car, numbers, 0.03, {"outage_length": 1500.0, "outage_every": 3000.0})
        for drive, simulated in made:
            for name, vehicle in vehicles.items():
                sums[name].append(_errors(drive, simulated, vehicle, roads))
        options.say(f"car {car}: done")
    rms = {name: _rmse(np.array(rows)) for name, rows in sums.items()}
    nees = {name: _anees(np.array(rows)) for name, rows in sums.items()}
    count, seeds = len(sums["known"]), seeds_text(cars)
    return [
        Figure("calibrated: RMSE over that of a known car", rms["calibrated"] / rms["known"],
               "0..1.1", "", count, None, seeds),
        Figure("calibrated: ANEES of the position", nees["calibrated"], "0.9..1.2", "", count,
               interval(_anees, np.array(sums["calibrated"])), seeds),
        *(Figure(f"{name}: RMSE", value, "", "m", count, interval(_rmse, np.array(sums[name])),
                 seeds) for name, value in rms.items()),
        Figure("known: ANEES", nees["known"], "", "", count, None, seeds),
        Figure("believed: ANEES", nees["believed"], "", "", count, None, seeds),
    ]  # fmt: skip


def _known_car(usual: Vehicle, truth: dict[str, float]) -> Vehicle:
    """The car as it is."""
    step = usual.metres_per_tick_left * truth["odometer scale"]
    half = float(np.sqrt(truth["right over left"]))
    return replace(
        usual, metres_per_tick_left=step / half, metres_per_tick_right=step * half,
        track_width=truth["track width"], antenna_forward=truth["antenna forward"],
        clock_offset={**usual.clock_offset, "gnss": truth["gnss clock offset"]},
    )  # fmt: skip


def _errors(drive: Drive, simulated: SimulatedDrive, vehicle: Vehicle, roads: RoadMap) -> Array:
    """Epochs in the outages while moving, sums of squared errors (m²) and of the NEES."""
    truth = simulated.truth
    assert drive.fixes is not None
    fixes = replace(drive.fixes, time=drive.fixes.time + clock_of(vehicle))
    points = match(replace(drive, fixes=fixes), roads, vehicle=vehicle).to_arrow()
    time = points["time"].cast("int64").to_numpy() / 1e6
    inside = np.any([(time > a) & (time < b) for a, b in simulated.outages], axis=0)
    inside &= points["lat"].is_valid().to_numpy()
    row = np.minimum(np.searchsorted(truth.time, time - 1e-3), len(truth.time) - 1)
    inside &= (np.abs(truth.time[row] - time) < 0.01) & ~truth.stopped[row]
    points, row = points.filter(pa.array(inside)), row[inside]
    true = np.column_stack(roads.plane.to_geodetic(truth.x[row], truth.y[row]))
    east = (points["lon"].to_numpy() - true[:, 1]) * 111319.5 * np.cos(np.radians(true[:, 0]))
    north = (points["lat"].to_numpy() - true[:, 0]) * 111200.0
    ee, en, nn = (points[n].to_numpy() for n in ("cov_ee_m2", "cov_en_m2", "cov_nn_m2"))
    nees = (nn * east**2 - 2.0 * en * east * north + ee * north**2) / (ee * nn - en**2)
    return np.array([len(row), np.sum(east**2 + north**2), np.sum(nees)])


def _rmse(rows: Array) -> float:
    return float(np.sqrt(rows[:, 1].sum() / rows[:, 0].sum()))


def _anees(rows: Array) -> float:
    return float(rows[:, 2].sum() / rows[:, 0].sum() / 2.0)


def _inside(found: Calibration, truth: dict[str, float]) -> dict[str, bool]:
    known = {one.name for one in found.quantities}
    return {n: found[n].low <= v <= found[n].high for n, v in truth.items() if n in known}


def _figures(
    found: Calibration, truth: dict[str, float], held: dict[str, list[bool]], seeds: str
) -> list[Figure]:
    used = found.drives + found.held_out

    def off(name: str, relative: bool) -> float:
        error = abs(found[name].estimate - truth[name])
        return 100.0 * error / truth[name] if relative else error

    rows: list[tuple[str, Any, str, str]] = [
        ("odometer scale", True, "<= 0.1", "%"), ("track width", True, "<= 0.5", "%"),
        ("gnss clock offset", False, "<= 0.02", "s"),
        ("errors across the road", True, "<= 10", "%"),
        ("right over left", True, "", "%"), ("antenna forward", False, "", "m"),
    ]  # fmt: skip
    figures = [
        Figure(f"{name}: error", off(name, relative), goal, unit, used, None, seeds)
        for name, relative, goal, unit in rows
    ]
    figures.append(
        Figure("held-out evidence a drive", found.gain, "", "nats", found.held_out,
               (found.gain - 2 * found.gain_sigma, found.gain + 2 * found.gain_sigma), seeds)
    )  # fmt: skip
    for name, inside in held.items():
        if inside:
            figures.append(
                Figure(f"{name}: 95 % interval holds", 100.0 * float(np.mean(inside)), "90..99",
                       "%", len(inside), None, seeds)
            )  # fmt: skip
    return figures
