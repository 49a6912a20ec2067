"""What looking back gains: drives in Heidelberg, filtered, with a lag of 10 s, and in full.

The same simulated drives as `town`, with wheels or with GNSS alone (`--preset gnss`,
`gnss10` for one fix in ten seconds, `gnssurban`, `urban`); the first 20 s and all standstill
are left out.
"""

from dataclasses import replace
from typing import Any

import numpy as np

import whichroad
from whichroad.epochs import build_timeline
from whichroad.lookback.smoothing import Lag
from whichroad.observations import Drive
from whichroad.recorded import Recorded, localize_recorded
from whichroad.simulate import SimulatedDrive, drivable, simulate_drive

from . import Figure, Options, interval, seeds_text, share
from .town import CHI2_95, WARM_UP_S, right_edges

SEEDS = range(1000, 1032)
LENGTH_M = 5000.0
LAGS = {"filtered": None, "10 s": "10", "full": "full"}
LEAST_P = 1e-4  # of the true road, in the log score
# sums over the epochs of a drive
EPOCHS, STRICT, RIGHT, LOG, SQUARED, NEES, INSIDE = range(7)


def thinned(drive: Drive, preset: str) -> Drive:
    """The drive as it is, or its fixes alone, one in so many seconds."""
    if not preset.startswith("gnss") or drive.fixes is None:
        return drive
    every = float(preset.removeprefix("gnss") or 1.0)
    fixes = drive.fixes
    kept, last = [], -np.inf
    for i, t in enumerate(fixes.time):
        if t - last >= every - 1e-6:
            kept.append(i)
            last = t
    columns = {name: getattr(fixes, name)[kept] for name in fixes.__slots__}
    return replace(drive, odometry=None, fixes=type(fixes)(**columns))


def score(drive: SimulatedDrive, time: np.ndarray, recorded: Recorded, plane: Any) -> np.ndarray:
    """Sums over one drive, in the order of the names above."""
    truth, rows = drive.truth, recorded.output.rows
    at = np.minimum(np.searchsorted(time, truth.time - 1e-3), len(time) - 1)
    keep = ~truth.stopped & (truth.time > truth.time[0] + WARM_UP_S) & (rows.live[at] > 0)
    keep &= np.abs(time[at] - truth.time) < 0.02
    k, right = at[keep], right_edges(drive, rows.edge[at])[keep]
    edge, v = truth.edge[keep], rows[k]
    p = (v.alt_p * (v.alt_edge == edge[:, None])).sum(axis=1)
    scale = plane.scale(truth.x, truth.y)[keep]
    error = np.column_stack([v.x - truth.x[keep], v.y - truth.y[keep]])
    error /= scale[:, None]
    cov = v.cov[:, [0, 1, 1, 3]].reshape(-1, 2, 2)
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[..., None])[..., 0])
    return np.array(
        [
            len(k), (v.edge == edge).sum(), right.sum(),
            -np.log(np.maximum(p, LEAST_P)).sum(), (error**2).sum(), nees.sum(),
            (nees < CHI2_95).sum(),
        ]
    )  # fmt: skip


def run(options: Options) -> list[Figure]:
    """Filter, lag and full smoothing of the same drives."""
    roads = whichroad.RoadMap.from_osm(options.need("maps", "heidelberg.osm.pbf"))
    allowed = drivable(roads.arrays, np.random.default_rng(0))
    preset = options.more.get("preset", "good")
    scenario = "urban" if preset.endswith("urban") else preset
    scenario = "good" if scenario.startswith("gnss") else scenario
    seeds = options.seeds or SEEDS
    rows: dict[str, list[np.ndarray]] = {name: [] for name in LAGS}
    for seed in seeds:
        drive = simulate_drive(
            roads, seed=seed, length_m=options.more.get("metres", LENGTH_M), scenario=scenario,
            allowed=allowed,
        )  # fmt: skip
        timeline = build_timeline(
            thinned(drive.drive, preset.removesuffix("urban")), roads.plane, drive.vehicle
        )
        for name, lag in LAGS.items():
            recorded = localize_recorded(
                roads, timeline, vehicle=drive.vehicle, settings=options.settings(),
                lag=Lag.of(lag),
            )  # fmt: skip
            rows[name].append(score(drive, timeline.epochs.time, recorded, roads.plane))
        options.say(f"seed {seed}: " + ", ".join(_line(n, r[-1]) for n, r in rows.items()))
    tables = {name: np.array(r) for name, r in rows.items()}
    return [f for name, t in tables.items() for f in _figures(name, t, seeds)] + _reached(tables)


def _line(name: str, row: np.ndarray) -> str:
    right, rmse = 100 * row[STRICT] / row[EPOCHS], np.sqrt(row[SQUARED] / row[EPOCHS])
    return f"{name} {right:.2f} %, {rmse:.2f} m"


def _figures(name: str, table: np.ndarray, seeds: range) -> list[Figure]:
    def figure(what: str, column: int, unit: str, factor: float, root: bool = False) -> Figure:
        def value(t: np.ndarray) -> float:
            ratio = factor * share(t) / 100.0
            return float(np.sqrt(ratio)) if root else ratio

        pairs = table[:, [column, EPOCHS]]
        text = f"{name}: {what}"
        return Figure(
            text, value(pairs), "", unit, len(pairs), interval(value, pairs), seeds_text(seeds)
        )

    return [
        figure("right edge, strictly", STRICT, "%", 100.0),
        figure("right edge within 10 m", RIGHT, "%", 100.0),
        figure("-log P(true edge)", LOG, "nat", 1.0),
        figure("position RMSE", SQUARED, "m", 1.0, root=True),
        figure("ANEES of the position", NEES, "", 0.5),
        figure("truth in the 95 % ellipse", INSIDE, "%", 100.0),
    ]


def _reached(tables: dict[str, np.ndarray]) -> list[Figure]:
    """What the lag gains, of what full smoothing gains; no goal where that gains nothing."""
    sums = {name: t.sum(axis=0) / t[:, EPOCHS].sum() for name, t in tables.items()}
    found = []
    columns = (
        ("right edges, strictly", STRICT, 100.0, "%"),
        ("right within 10 m", RIGHT, 100.0, "%"),
        ("-log P(true edge)", LOG, -1.0, "nat"),
    )
    for what, column, better, unit in columns:
        start, lag, full = (better * sums[name][column] for name in LAGS)
        n = len(tables["full"])
        if full > start:
            ratio = 100.0 * (lag - start) / (full - start)
            found.append(Figure(f"10 s of the full gain, {what}", ratio, ">= 95", "%", n))
        else:
            found.append(Figure(f"lost by looking back in full, {what}", start - full, "", unit, n))
    return found
