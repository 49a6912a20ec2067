"""Three-hour drives with settings that fit, and with ones that do not: is it noticed?

The mis-specified ones are those of the figures: GNSS errors 1.5 times what the receiver
says, three times as slow, both; and a car whose wheels are not what its user believes.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import whichroad
from whichroad.core.output import V_CHI2
from whichroad.epochs import build_timeline
from whichroad.localizer import localize_recorded
from whichroad.records import Drive
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings
from whichroad.simulate import GOOD, SimulationSettings, drivable, simulate_drive

from .. import Figure, Options
from .drives import Row, Table, each, world

SEEDS = range(10_000, 10_100)
HOURS = 3.0
_KM_PER_HOUR = 40.0  # at least what is driven
LARGE = replace(
    GOOD,
    gnss_bias_low=1.5 * GOOD.gnss_bias_low,
    gnss_bias_high=1.5 * GOOD.gnss_bias_high,
    gnss_white=1.5 * GOOD.gnss_white,
)
SLOW = 3.0 * GOOD.gnss_time
MODELLED = replace(  # white half of the bias, bias as reported, one minute: Settings' own numbers
    GOOD,
    gnss_bias_low=GOOD.gnss_reported,
    gnss_bias_high=GOOD.gnss_reported,
    gnss_white=0.5 * GOOD.gnss_reported,
    gnss_time=60.0,
)
# simulations, and factors on what the user believes of the car
CASES: dict[str, tuple[SimulationSettings, dict[str, float]]] = {
    "well specified": (GOOD, {}),
    "exactly as modelled": (MODELLED, {}),
    "sigma x1.5": (LARGE, {}),
    "tau x3": (replace(GOOD, gnss_time=SLOW), {}),
    "sigma x1.5, tau x3": (replace(LARGE, gnss_time=SLOW), {}),
    "wheels 8 % smaller": (GOOD, {"metres_per_tick_left": 1.08, "metres_per_tick_right": 1.08}),
    "track 10 % wider": (GOOD, {"track_width": 0.9}),
    "map sigma x3": (replace(GOOD, map_sigma=3.0 * GOOD.map_sigma), {}),
}
WELL = ("well specified", "exactly as modelled")
MIS_SPECIFIED = ("sigma x1.5", "tau x3", "sigma x1.5, tau x3")


def prepare(map_file: Path) -> None:
    """The map of this process."""
    world["roads"] = RoadMap.from_osm(map_file)
    world["allowed"] = drivable(world["roads"].arrays, np.random.default_rng(0))


def cut(drive: Drive, seconds: float) -> Drive:
    """The beginning of a drive."""
    fixes, odometry = drive.fixes, drive.odometry
    assert fixes is not None
    assert odometry is not None
    end = odometry.time[0] + seconds

    def part(log: Any) -> Any:
        kept = log.time <= end
        return replace(log, **{name: getattr(log, name)[kept] for name in log.__slots__})

    return replace(drive, fixes=part(fixes), odometry=part(odometry))


def one(seed: int, *, hours: float, settings: Settings) -> Row:
    """Every case once."""
    row: Row = {}
    for name, (scenario, believed) in CASES.items():
        drive = simulate_drive(
            world["roads"], seed=seed, scenario=scenario, allowed=world["allowed"],
            length_m=1000.0 * _KM_PER_HOUR * hours,
        )  # fmt: skip
        truly = drive.vehicle
        vehicle = replace(truly, **{k: f * getattr(truly, k) for k, f in believed.items()})
        short = cut(drive.drive, 3600.0 * hours)
        timeline = build_timeline(short, world["roads"].plane, vehicle)
        recorded = localize_recorded(world["roads"], timeline, vehicle=vehicle, settings=settings)
        fixed = np.flatnonzero(timeline.epochs.has_fix)[10:]
        chi2 = recorded.output.value[fixed, V_CHI2]
        row[f"{name} hours"] = float(np.ptp(timeline.epochs.time) / 3600.0)
        row[f"{name} chi2"] = float(chi2.mean() / 2.0)
        row[f"{name} echo"] = float(np.corrcoef(chi2[1:], chi2[:-1])[0, 1])
        verdict = fired(recorded)
        if verdict is not None:
            row[f"{name} fired"] = float(bool(verdict))
    return row


def fired(recorded: Any) -> list[str] | None:
    """What the self-diagnosis objects to; None where the package has none."""
    diagnose: Callable[..., Any] | None = getattr(whichroad, "diagnose", None)
    found = getattr(recorded, "diagnosis", None)
    if found is None and diagnose is not None:
        found = diagnose(recorded)
    return None if found is None else list(found)


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    work = partial(one, hours=HOURS, settings=options.settings())
    map_file = options.need("maps", "heidelberg.osm.pbf")
    table = Table(each(work, seeds, options, prepare, [map_file]), seeds)
    figures = []
    for name in CASES:
        goal = "<= 1" if name in WELL else ">= 95" if name in MIS_SPECIFIED else ""
        figures += [
            table.share(f"{name}: fires", f"{name} fired", None, goal),
            table.quantile(f"{name}: chi2 of fixes, median", f"{name} chi2", 0.5, "", ""),
            table.quantile(f"{name}: the same, 5 %", f"{name} chi2", 0.05, "", ""),
            table.quantile(f"{name}: the same, 95 %", f"{name} chi2", 0.95, "", ""),
            table.quantile(f"{name}: its echo after 1 s", f"{name} echo", 0.5, "", ""),
        ]
    figures.append(table.quantile("hours, least", "well specified hours", 0.0, "", "h"))
    return figures
