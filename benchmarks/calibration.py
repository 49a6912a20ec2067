"""Calibrating simulated cars from their own drives in Heidelberg.

Every car has its own wheels, track width, antenna and clock, and nothing in it is as its user
believes.  One fleet of 50 drives gives the errors, many small ones the coverage of intervals.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from whichroad import Vehicle, calibrate
from whichroad.calibration import Calibration
from whichroad.observations import Drive, Fixes, WheelCounts
from whichroad.simulate import PRESETS, simulate_drive

from . import Figure, Options, seeds_text, town

SEEDS = range(7400, 7420)  # one car each
_FLEET = 50  # drives of the first car
_EACH = 12  # drives of every car
_LENGTH = 8000.0  # m
_MOST = 1000  # drives a car


def fleet(car: int, count: int) -> tuple[list[Drive], dict[str, float]]:
    """Drives of a car, and what is to be found of it where the user believes the default car."""
    draw = np.random.default_rng([car, 5])
    scale, ratio = 1.0 + 0.02 * draw.standard_normal(), 1.0 + 5e-4 * draw.standard_normal()
    track, ahead = 1.5 * (1.0 + 0.02 * draw.standard_normal()), float(draw.uniform(0.0, 2.5))
    late = float(draw.uniform(-0.2, 0.2))
    usual = Vehicle()
    sim = replace(
        PRESETS["good"], metres_per_tick=usual.metres_per_tick_left * scale, scale_sigma=0.0,
        differential_sigma=0.0, track_width=track, track_sigma=0.0, antenna_forward=ahead,
    )  # fmt: skip
    drives = []
    for number in range(count):
        seed = car * _MOST + number
        roads, allowed = town._world["roads"], town._world["allowed"]
        made = simulate_drive(roads, seed=seed, length_m=_LENGTH, scenario=sim, allowed=allowed)
        log, fixes = made.drive.odometry, made.drive.fixes
        assert isinstance(log, WheelCounts)
        assert isinstance(fixes, Fixes)
        log = replace(log, left=log.left * np.sqrt(ratio), right=log.right / np.sqrt(ratio))
        fixes = replace(fixes, time=fixes.time + late)
        drives.append(replace(made.drive, odometry=log, fixes=fixes))
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
