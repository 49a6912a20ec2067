"""Drives of one car through the filter, with the car as it is thought to be."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from statistics import median
from typing import NamedTuple

from ..diagnosis.finding import Finding
from ..diagnosis.statistics import ConsistencyStatistics, rows_of
from ..epochs import build_timeline
from ..observations import Drive, Odometer, SpeedYawRate, WithGyro
from ..recorded import localize_recorded
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .across import Sums, across_sums

GNSS = "gnss"  # the role whose clock is calibrated against that of the odometry


class Answer(NamedTuple):
    """What the filter says of one drive."""

    statistics: ConsistencyStatistics
    evidence: float  # nats
    findings: tuple[Finding, ...]
    across: Sums


class Bench:
    """Runs drives on a map by threads; the kernels release the interpreter's lock.

    Args:
        drives: Read with the car's clocks as they were thought to be.
        roads: The map.
        read_with: The car that they were read with.
        settings: The model's numbers, before those of a car.
        threads: How many drives are filtered at a time.
    """

    def __init__(
        self, drives: Sequence[Drive], roads: RoadMap, read_with: Vehicle, settings: Settings,
        threads: int,
    ) -> None:  # fmt: skip
        self.drives, self.roads, self.read_with = list(drives), roads, read_with
        self.settings, self.threads = settings, threads

    def run(self, vehicle: Vehicle, chosen: Sequence[int]) -> list[Answer]:
        """Filter some drives with a car; its `[noise]` overrides the settings."""
        tuned = replace(self.settings, **vehicle.noise)
        late = clock_of(vehicle) - clock_of(self.read_with)

        def one(number: int) -> Answer:
            drive = self.drives[number]
            if drive.fixes is not None and late:
                drive = replace(drive, fixes=replace(drive.fixes, time=drive.fixes.time + late))
            timeline = build_timeline(drive, self.roads.plane, vehicle, clocks=False)
            recorded = localize_recorded(self.roads, timeline, vehicle=vehicle, settings=tuned)
            log = drive.odometry
            by_time = isinstance(log, SpeedYawRate)
            by_time |= isinstance(log, WithGyro) and isinstance(log.distance, Odometer)
            statistics = ConsistencyStatistics(tuned, vehicle, by_time=by_time)
            across = across_sums(timeline.epochs, recorded.output, self.roads, vehicle)
            statistics.take(rows_of(timeline.epochs, recorded.output))
            return Answer(statistics, recorded.evidence, recorded.diagnosis, across)

        with ThreadPoolExecutor(self.threads) as pool:
            return list(pool.map(one, chosen))

    def delay(self, chosen: Sequence[int]) -> float:
        """How late fixes are by the distances that both tell, s; the median of some drives."""
        drives = (self.drives[number] for number in chosen)
        return median(build_timeline(d, self.roads.plane, self.read_with).delay for d in drives)

    def evidence(self, vehicle: Vehicle, chosen: Sequence[int]) -> list[float]:
        """Log-likelihood of some drives, nats each."""
        return [answer.evidence for answer in self.run(vehicle, chosen)]


def clock_of(vehicle: Vehicle) -> float:
    """Seconds added to the times of fixes."""
    return vehicle.clock_offset.get(GNSS, 0.0)
