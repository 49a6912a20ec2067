"""Three-hour drives with settings that fit, and with ones that do not: is it noticed, and named?

The mis-specified ones are those of the figures: GNSS errors 1.5 times what the receiver
says, three times as slow, both, each about a world that is exactly as modelled and about
the simulator's own, whose receiver says a little more than it errs; and a car whose wheels
are not what its user believes.  Warnings count as fired, informations do not.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import whichroad
from whichroad.epochs import build_timeline
from whichroad.observations import Drive
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings
from whichroad.simulate import GOOD, SimulationSettings, simulate_drive

from .. import Figure, Options
from ..honesty import chosen
from .drives import Row, Table, each, read_town, world

SEEDS = range(10_000, 10_100)
HOURS = 3.0
_KM_PER_HOUR = 40.0  # at least what is driven
_FITS = Settings()
MODELLED = replace(  # Settings' own numbers
    GOOD,
    gnss_bias_low=GOOD.gnss_reported,
    gnss_bias_high=GOOD.gnss_reported,
    gnss_white=_FITS.gnss_white_ratio * GOOD.gnss_reported,
    gnss_time=_FITS.gnss_time,
)


def _larger(world_: SimulationSettings) -> SimulationSettings:
    return replace(
        world_,
        gnss_bias_low=1.5 * world_.gnss_bias_low,
        gnss_bias_high=1.5 * world_.gnss_bias_high,
        gnss_white=1.5 * world_.gnss_white,
    )


def _slower(world_: SimulationSettings) -> SimulationSettings:
    return replace(world_, gnss_time=3.0 * world_.gnss_time)


class Case(NamedTuple):
    """A world, what the user believes of the car, and what should be said."""

    world: SimulationSettings
    factors: dict[str, float]  # on the vehicle's numbers
    named: str  # one of the findings; empty: none


_TICKS = {"metres_per_tick_left": 1.08, "metres_per_tick_right": 1.08}
CASES = {
    "exactly as modelled": Case(MODELLED, {}, ""),
    "modelled, sigma x1.5": Case(_larger(MODELLED), {}, "gnss sigma"),
    "modelled, tau x3": Case(_slower(MODELLED), {}, "gnss_time"),
    "modelled, sigma x1.5, tau x3": Case(_slower(_larger(MODELLED)), {}, "gnss_time"),
    "well specified": Case(GOOD, {}, ""),
    "sigma x1.5": Case(_larger(GOOD), {}, "gnss sigma"),
    "tau x3": Case(_slower(GOOD), {}, "gnss_time"),
    "sigma x1.5, tau x3": Case(_slower(_larger(GOOD)), {}, "gnss_time"),
    "wheels 8 % smaller": Case(GOOD, _TICKS, "wheels: scale"),
    "track 10 % wider": Case(GOOD, {"track_width": 0.9}, "wheels: track width"),
    "map sigma x3": Case(replace(GOOD, map_sigma=3.0 * GOOD.map_sigma), {}, "map_sigma"),
}


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


def one(seed: int, *, hours: float, settings: Settings, names: tuple[str, ...]) -> Row:
    """Each of these cases once."""
    row: Row = {}
    for name in names:
        case = CASES[name]
        drive = simulate_drive(
            world["roads"], seed=seed, scenario=case.world, allowed=world["allowed"],
            length_m=1000.0 * _KM_PER_HOUR * hours,
        )  # fmt: skip
        truly = drive.vehicle
        vehicle = replace(truly, **{k: f * getattr(truly, k) for k, f in case.factors.items()})
        short = cut(drive.drive, 3600.0 * hours)
        timeline = build_timeline(short, world["roads"].plane, vehicle)
        recorded = localize_recorded(world["roads"], timeline, vehicle=vehicle, settings=settings)
        found = whichroad.diagnose(recorded)
        warnings = {f.what for f in found if f.level == "warning"}
        row[f"{name} hours"] = float(np.ptp(timeline.epochs.time) / 3600.0)
        row[f"{name} scale"] = float(recorded.output.rows.gnss_scale.mean())
        row[f"{name} fired"] = float(bool(warnings))
        row[f"{name} told"] = float(len(found) > len(warnings))
        row[f"{name} named"] = float(case.named in warnings or not (case.named or warnings))
    return row


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    names = tuple(chosen(options.more.get("classes"), dict(CASES), ",".join(CASES)))
    work = partial(one, hours=HOURS, settings=options.settings(), names=names)
    map_file = options.need("maps", "heidelberg.osm.pbf")
    table = Table(each(work, seeds, options, read_town, [map_file]), seeds)
    figures = []
    for name in names:
        case = CASES[name]
        goal = "" if case.factors or "map" in name else ">= 95" if case.named else "<= 1"
        figures += [
            table.share(f"{name}: fires", f"{name} fired", None, goal),
            table.share(f"{name}: an information", f"{name} told"),
            table.share(f"{name}: named {case.named or 'nothing'}", f"{name} named"),
            table.quantile(f"{name}: learnt scale, median", f"{name} scale", 0.5, "", ""),
        ]
    figures.append(table.quantile("hours, least", f"{names[0]} hours", 0.0, "", "h"))
    return figures
