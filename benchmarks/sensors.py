"""A gyro beside an odometer or a speed, through 1.5 km without GNSS in Heidelberg.

The drives are those of `outage`, which stand for 60 s longer where they stand without GNSS.  Their
wheels are replaced by an odometer with a scale error of 1 % rms a drive, or by a speed with the
same error.  The gyro has a constant bias, which nobody is told, and white noise of 0.1 deg/s.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from whichroad.epochs import build_timeline
from whichroad.observations import Odometer, OdometryLog, SpeedYawRate, WithGyro, YawRates
from whichroad.recorded import localize_recorded
from whichroad.simulate import SimulatedDrive, simulate_drive

from . import Figure, Options, town

SEEDS = range(7000, 7016)
_SCALE = 0.01  # rms a drive
_NOISE = math.radians(0.1)  # rad/s, white
_BIASES = (0.0, 0.2, 0.5)  # deg/s
_STOP_S, _STANDS = 60.0, 0.1  # s, m/s
_BESIDE = ("odometer", "speed")
_GOALS = {"odometer": {"right edge within 10 m": ">= 96", "position RMSE": "<= 4.5"},
          "speed": {"position RMSE": "<= 3.8", "ANEES of the pose": "0.8..1.2"}}  # fmt: skip


def sensed(drive: SimulatedDrive, beside: str, bias: float | None) -> OdometryLog:
    """What the sensors say of a drive; no gyro where its bias (deg/s) is None."""
    truth, draw = drive.truth, np.random.default_rng([drive.seed, 77])
    scale = 1.0 + _SCALE * draw.standard_normal()
    way = Odometer(truth.time, truth.travelled * scale)
    if bias is None:
        return way
    turn = np.gradient(np.unwrap(truth.heading), truth.time) + math.radians(bias)
    turn += _NOISE * draw.standard_normal(len(turn))
    if beside == "speed":
        return SpeedYawRate(truth.time, np.gradient(way.distance, truth.time), turn)
    return WithGyro(way, YawRates(truth.time, turn))


def with_stop(drive: SimulatedDrive) -> SimulatedDrive:
    """The drive, which stands for a minute longer where it stands without GNSS, if it does."""
    truth, (begin, end) = drive.truth, drive.outages[0]
    speed = np.gradient(truth.travelled, truth.time)
    inside = (truth.time > begin + 1.0) & (truth.time < end - 1.0)
    at = int(np.argmin(np.where(inside, speed, np.inf)))
    if speed[at] > _STANDS:
        return drive
    step = float(np.median(np.diff(truth.time)))
    more = step * np.arange(1, round(_STOP_S / step) + 1)
    then = float(truth.time[at])
    columns = {}
    for name in truth.__dataclass_fields__:
        column = getattr(truth, name)
        added = np.full(len(more), column[at]) if name != "stopped" else np.ones(len(more), bool)
        columns[name] = np.insert(column, at + 1, added)
    columns["time"] = np.concatenate(
        [truth.time[: at + 1], then + more, truth.time[at + 1 :] + _STOP_S]
    )
    fixes = drive.drive.fixes
    assert fixes is not None
    late = replace(fixes, time=np.where(fixes.time > then, fixes.time + _STOP_S, fixes.time))
    outages = tuple(
        (a + _STOP_S * (a > then), b + _STOP_S * (b > then)) for a, b in drive.outages
    )  # fmt: skip
    return replace(
        drive, truth=replace(truth, **columns), outages=outages,
        drive=replace(drive.drive, fixes=late),
    )  # fmt: skip


def run(options: Options) -> list[Figure]:
    """The epochs within the outages, for each sensor and each bias of the gyro."""
    return list(_figures(options))


def _figures(options: Options) -> Iterator[Figure]:
    seeds = options.seeds or SEEDS
    town._open(options.need("maps", "heidelberg.osm.pbf"))
    roads, allowed = town._world["roads"], town._world["allowed"]
    length = options.more.get("metres", town.LENGTH_M)
    cases = [("odometer", None), *((b, g) for b in _BESIDE for g in _BIASES)]
    found: dict[tuple[str, float | None], dict[int, town.Score]] = {case: {} for case in cases}
    for seed in seeds:
        drive = simulate_drive(
            roads, seed=seed, length_m=length, scenario="outage", allowed=allowed
        )
        drive = with_stop(drive)
        for case in cases:
            recording = replace(drive.drive, odometry=sensed(drive, *case))
            timeline = build_timeline(recording, roads.plane, drive.vehicle)
            recorded = localize_recorded(
                roads, timeline, vehicle=drive.vehicle, settings=options.settings()
            )
            found[case][seed] = town.score(drive, recorded, timeline.epochs, True)
        options.say(f"seed {seed}: done")
    for (beside, bias), scores in found.items():
        title = f"{beside} alone" if bias is None else f"{beside} and gyro, bias {bias:g} deg/s"
        for figure in town.figures(scores, seeds, {} if bias is None else _GOALS[beside])[:5]:
            yield replace(figure, figure=f"{title}: {figure.figure}")
