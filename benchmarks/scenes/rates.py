"""GNSS alone, with an odometer or with wheels, as often as receivers give it: 1 to 20 Hz.

Every drive in Heidelberg is simulated once with fixes at 20 Hz.  Lower rates leave fixes out, so
that the rates see the same receiver.  An answer is scored at
its fix.  The first 20 s and standstill are left out.
"""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from whichroad.lookback.smoothing import Lag
from whichroad.observations import Drive, Fixes, Odometer, WheelCounts
from whichroad.settings import Settings
from whichroad.simulate import GOOD, SimulatedDrive, simulate_drive

from .. import Figure, Options
from ..town import right_edges
from .consistency import WARM_UP_S, errors
from .drives import Answer, Mask, Row, Table, answer, each, read_town, world

SEEDS = range(10_000, 10_100)
LENGTH_M = 3000.0
RATES = (1, 2, 5, 10, 20)  # Hz
COLUMNS = ("course and speed", "positions", "odometer, course and speed", "wheels")
LAGS = {"filtered": None, "smoothed": Lag.of("full")}
_FASTEST = 20  # Hz
_LEAST_P = 1e-6


def thinned(drive: SimulatedDrive, rate: int, columns: str) -> SimulatedDrive:
    """The drive of a receiver that reports so often, alone, with a distance or with wheels."""
    fixes = drive.drive.fixes
    assert fixes is not None
    every = slice(None, None, _FASTEST // rate)
    kept = Fixes(*(getattr(fixes, name)[every] for name in Fixes.__dataclass_fields__))
    if columns == "positions":
        n = len(kept.time)
        none, never = np.full(n, np.nan), np.full(n, np.inf)
        kept = replace(
            kept, speed=none, sigma_speed=never, bearing_deg=none, sigma_bearing_deg=never
        )
    odometer: Odometer | WheelCounts | None = None
    if columns.startswith("odometer"):
        wheels, car = drive.drive.odometry, drive.vehicle
        assert isinstance(wheels, WheelCounts)
        left, right = car.metres_per_tick_left, car.metres_per_tick_right
        odometer = Odometer(wheels.time, 0.5 * (wheels.left * left + wheels.right * right))
    elif columns == "wheels":
        odometer = drive.drive.odometry
    return replace(drive, drive=Drive(drive.drive.drive_id, kept, odometer))


def _with_fix(drive: SimulatedDrive) -> Mask:
    """The times of the truth at which there is a fix, and so an answer that is not older."""
    assert drive.drive.fixes is not None
    fixes, time = drive.drive.fixes.time, drive.truth.time
    last = fixes[np.searchsorted(fixes, time + 1e-3).clip(1) - 1]
    return np.asarray(np.abs(time - last) < 2e-3)


def _log_scores(drive: SimulatedDrive, said: Answer) -> NDArray[np.float64]:
    """Logarithm of P that the edge is right, or wrong, whichever it is, nats, (n,)."""
    right, p = said.rows.edge == drive.truth.edge, said.rows.p_edge
    return np.log(np.maximum(np.where(right, p, 1.0 - p), _LEAST_P))


def one(seed: int, *, length_m: float, settings: Settings) -> Row:
    """One drive at each rate, with course and speed and without."""
    whole = simulate_drive(
        world["roads"], seed=seed, length_m=length_m, scenario=replace(GOOD, gnss_rate=_FASTEST),
        allowed=world["allowed"],
    )  # fmt: skip
    row: Row = {}
    for columns, rate, lag in product(COLUMNS, RATES, LAGS):
        drive = thinned(whole, rate, columns)
        said = answer(world["roads"], drive, settings, lag=LAGS[lag])
        truth, name = drive.truth, f"{columns} {rate} {lag} "
        keep = ~truth.stopped & (truth.time > truth.time[0] + WARM_UP_S) & said.started
        keep &= _with_fix(drive)
        error, weighed = errors(world["roads"], drive, said, "world")
        right = right_edges(drive, said.rows.edge)
        row[name + "epochs"] = float(keep.sum())
        row[name + "right"] = float((keep & right).sum())
        row[name + "off"] = float((keep & (said.rows.edge < 0)).sum())
        row[name + "sure"] = float((keep & (said.rows.p_edge >= 0.999)).sum())
        row[name + "wrong"] = float((keep & ~right & (said.rows.p_edge >= 0.999)).sum())
        row[name + "nees"] = float(weighed[keep].sum())
        row[name + "log"] = float(_log_scores(drive, said)[keep].sum())
        row[name + "squared"] = float((error[keep] ** 2).sum())
    return row


def run(options: Options) -> list[Figure]:
    """All seeds: right edges, false off-road, ANEES and RMSE and log P(edge) of each rate."""
    seeds = options.seeds or SEEDS
    work = partial(one, length_m=options.more.get("metres", LENGTH_M), settings=options.settings())
    map_file = options.need("maps", "heidelberg.osm.pbf")
    table = Table(each(work, seeds, options, read_town, [map_file]), seeds)
    figures = []
    for columns, lag, rate in product(COLUMNS, LAGS, RATES):
        what, key = f"{columns}, {rate} Hz, {lag}: ", f"{columns} {rate} {lag} "
        below = key + "epochs"
        figures += [
            table.share(what + "right edge", key + "right", below, ">= 99"),
            table.share(what + "edge is off-road", key + "off", below),
            table.share(what + "wrong of P >= 0.999", key + "wrong", key + "sure", "", "per mille",
                        1000.0),
            table.share(what + "ANEES", key + "nees", below, "0.7..1.3", "", 0.5),
            table.share(what + "log P(edge)", key + "log", below, "", "nats", 1.0),
            table.root(what + "RMSE", key + "squared", below),
        ]  # fmt: skip
    return figures
