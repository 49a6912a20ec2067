"""A drive answered on line: by `whichroad.Localizer`, one reading after another."""

from typing import Any, NamedTuple

import pyarrow as pa

from whichroad import Localizer, RoadMap, Settings, Vehicle
from whichroad.diagnosis.finding import Finding
from whichroad.online import Estimate
from whichroad.readers import drive_from_table

from ..readings import observations

ON_LINE = "online"  # in place of a lag


class Answer(NamedTuple):
    """As much of an answer as is asked of the result of `match`."""

    points: pa.Table
    diagnosis: tuple[Finding, ...]  # at the end of the drive

    def to_arrow(self) -> pa.Table:
        """Its points."""
        return self.points


def answer(table: Any, roads: RoadMap, vehicle: Vehicle, settings: Settings | None) -> Answer:
    """Estimates after each moment of a drive, as the points of `match`.

    Args:
        table: The drive, as `match` takes it.
        roads: The map.
        vehicle: The car.
        settings: None: as they are by default.
    """
    (drive,) = drive_from_table(table, vehicle=vehicle, settings=settings)
    localizer = Localizer(roads, vehicle=vehicle, settings=settings)
    rows: dict[float, dict[str, Any]] = {}  # of one moment the last estimate stands
    for observation in observations(drive):
        estimate = localizer.update(observation)
        if estimate.answered:
            rows[observation.time] = row_of(estimate)
    return Answer(pa.Table.from_pylist(list(rows.values())), localizer.diagnosis)


def row_of(estimate: Estimate) -> dict[str, Any]:
    """An estimate as a point of `match`."""
    pose, cov = estimate.pose, estimate.cov
    assert pose is not None
    assert cov is not None
    roads: dict[int, float] = {}
    for one in estimate.hypotheses:
        if one.edge is not None:
            roads[one.edge] = roads.get(one.edge, 0.0) + one.p
    return {
        "time": round(1e6 * estimate.time), "lat": pose.lat, "lon": pose.lon,
        "cov_ee_m2": cov[0, 0], "cov_en_m2": cov[0, 1], "cov_nn_m2": cov[1, 1],
        "protection_level_m": estimate.protection_level, "status": estimate.status,
        "alternatives": [{"edge_id": edge, "p": p} for edge, p in roads.items()],
    }  # fmt: skip
