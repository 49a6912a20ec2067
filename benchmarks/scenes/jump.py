"""A position 200 m beside the truth: when the receiver is wrong, and when the filter is.

`jump`: fixes that jump and stay away for half a minute to five minutes must not be
followed, and the return must not upset.  `carried`: the car rides a ferry (wheels still,
GNSS as usual) or a train (no GNSS either); `start`: a start pose 200 m off.  There the
fixes are right and must win.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from whichroad.observations import StartPose, WheelCounts
from whichroad.settings import Settings
from whichroad.simulate import GOOD, Jump, SimulatedDrive, simulate_drive

from .. import Figure, Options
from ..town import right_edges
from .drives import SURE, Answer, Row, Table, answer, each, read_town, world

SEEDS = range(10_000, 10_300)
APART_M = 200.0
STAYS_S = (30.0, 300.0)
EVENT_M = 1500.0  # m driven where it happens
AFTER_M = 4500.0
RECOVERY_S = 60.0  # a drive that ends sooner after the event tells nothing of it
CARRIED_M = (200.0, 600.0)
CLOSE_M = 20.0  # an error below this is a filter that knows where it is


def _world_error(drive: SimulatedDrive, said: Answer) -> NDArray[np.float64]:
    truth = drive.truth
    apart = np.hypot(said.rows.x - truth.x, said.rows.y - truth.y)
    error: NDArray[np.float64] = apart / world["roads"].plane.scale(truth.x, truth.y)
    return error


def _simulate(seed: int, jumps: tuple[Jump, ...] = (), **more: object) -> SimulatedDrive:
    return simulate_drive(
        world["roads"], seed=seed, length_m=EVENT_M + AFTER_M, allowed=world["allowed"],
        scenario=GOOD, pulls=jumps, **more,
    )  # fmt: skip


def jumping(seed: int, random: np.random.Generator, settings: Settings) -> Row:
    """The receiver is wrong."""
    direction, stays = random.uniform(-np.pi, np.pi), random.uniform(*STAYS_S)
    away = APART_M * np.cos(direction), APART_M * np.sin(direction)
    drive = _simulate(seed, (Jump(EVENT_M, *away, stays),))
    said, truth = answer(world["roads"], drive, settings), drive.truth
    false = drive.fix_truth.time[drive.false_fix]
    if len(false) == 0:
        return {}
    since = truth.time - truth.time[0]
    during = (since >= false[0]) & (since <= false[-1] + 1.0)
    error, right = _world_error(drive, said), right_edges(drive, said.rows.edge)
    moving = during & ~truth.stopped
    after = np.flatnonzero(since > false[-1] + 1.0)
    sure_wrong = moving & ~right & (said.rows.p_edge > SURE)
    sigma = np.sqrt(said.rows.cov[:, 0] + said.rows.cov[:, 3])
    return {
        "stays_s": float(false[-1] - false[0]),
        "epochs": float(moving.sum()),
        "right": float((moving & right).sum()),
        "sure_wrong": float(sure_wrong.sum()),
        "error_max": float(error[during].max()),
        "followed": float(error[during].max() > 0.5 * APART_M),
        "hidden": float((error[during] > 4.0 * sigma[during] + CLOSE_M).any()),
        **(_recovery(drive, error, int(after[0])) if len(after) else {}),
    }


def _recovery(drive: SimulatedDrive, error: NDArray[np.float64], begin: int) -> Row:
    """From an epoch on: how far and how long until the error is small for good."""
    truth = drive.truth
    if truth.time[-1] - truth.time[begin] < RECOVERY_S:
        return {}
    far = np.flatnonzero(error[begin:] > CLOSE_M)
    back = begin + (int(far[-1]) if len(far) else 0)
    never = len(far) > 0 and back == len(truth) - 1
    return {
        "recovered": float(not never),
        "after_m": np.inf if never else float(truth.travelled[back] - truth.travelled[begin]),
        "after_s": np.inf if never else float(truth.time[back] - truth.time[begin]),
    }


def carried(seed: int, random: np.random.Generator, settings: Settings, *, dark: bool) -> Row:
    """The wheels stand while the car is carried on, with GNSS or without."""
    end = EVENT_M + random.uniform(*CARRIED_M)
    drive = _simulate(seed, outages_m=((EVENT_M, end),) if dark else ())
    drive = replace(drive, drive=replace(drive.drive, odometry=_stand(drive, EVENT_M, end)))
    said, truth = answer(world["roads"], drive, settings), drive.truth
    error, right = _world_error(drive, said), right_edges(drive, said.rows.edge)
    after = truth.travelled > end
    sure_wrong = after & ~truth.stopped & ~right & (said.rows.p_edge > SURE)
    return {
        "epochs": float((after & ~truth.stopped).sum()),
        "sure_wrong": float(sure_wrong.sum()),
        **_recovery(drive, error, int(np.argmax(after))),
    }


def _stand(drive: SimulatedDrive, begin: float, end: float) -> WheelCounts:
    """The counts of wheels that do not turn between two places, m driven."""
    counts, travelled = drive.drive.odometry, drive.truth.travelled
    assert isinstance(counts, WheelCounts)
    still = (travelled[1:] > begin) & (travelled[1:] <= end)

    def without(count: NDArray[np.float64]) -> NDArray[np.float64]:
        return count - np.concatenate([[0.0], np.cumsum(np.diff(count) * still)])

    return WheelCounts(counts.time, without(counts.left), without(counts.right))


def started(seed: int, random: np.random.Generator, settings: Settings) -> Row:
    """A start pose that is wrong and sure of itself."""
    drive = _simulate(seed)
    truth, direction = drive.truth, random.uniform(-np.pi, np.pi)
    x = float(truth.x[0] + APART_M * np.cos(direction))
    y = float(truth.y[0] + APART_M * np.sin(direction))
    lat, lon, bearing = world["roads"].plane.pose(x, y, float(truth.heading[0]))
    said = answer(world["roads"], drive, settings, StartPose(lat, lon, bearing))
    error, right = _world_error(drive, said), right_edges(drive, said.rows.edge)
    sure_wrong = ~truth.stopped & ~right & (said.rows.p_edge > SURE)
    return {
        "epochs": float((~truth.stopped).sum()),
        "sure_wrong": float(sure_wrong.sum()),
        **_recovery(drive, error, 0),
    }


EVENTS: dict[str, Callable[..., Row]] = {
    "false jump": jumping,
    "ferry": partial(carried, dark=False),
    "train": partial(carried, dark=True),
    "false start": started,
}


def one(seed: int, *, settings: Settings) -> Row:
    """Every event, on the same route."""
    row: Row = {}
    for k, (name, event) in enumerate(EVENTS.items()):
        found = event(seed, np.random.default_rng([seed, 79, k]), settings)
        row |= {f"{name} {key}": v for key, v in found.items()}
    return row


def run(options: Options) -> list[Figure]:
    """All seeds."""
    seeds = options.seeds or SEEDS
    work = partial(one, settings=options.settings())
    rows = each(work, seeds, options, read_town, [options.need("maps", "heidelberg.osm.pbf")])
    table, key = Table(rows, seeds), "false jump "
    figures = [
        table.share("false jump: right road meanwhile", key + "right", key + "epochs"),
        table.share("false jump: confidently wrong", key + "sure_wrong", key + "epochs"),
        table.share("false jump: drives that follow it", key + "followed"),
        table.share("false jump: error beyond 4 sigma + 20 m", key + "hidden"),
        table.quantile("false jump: largest error, median", key + "error_max", 0.5),
        table.quantile("false jump: largest error, 95 %", key + "error_max", 0.95),
    ]
    for name in EVENTS:
        key = name + " "
        figures += [
            table.share(f"{name}: recovered after it", key + "recovered"),
            table.quantile(f"{name}: error < 20 m after, median", key + "after_s", 0.5, "", "s"),
            table.quantile(f"{name}: the same, 95 %", key + "after_s", 0.95, "", "s"),
            table.quantile(f"{name}: the same, driven, 95 %", key + "after_m", 0.95),
        ]
        if name != "false jump":
            figures.append(
                table.share(f"{name}: confidently wrong", key + "sure_wrong", key + "epochs")
            )
    return figures
