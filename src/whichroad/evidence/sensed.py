"""What further sensors say, as the filter takes it: from degrees to the plane, from names to rows.

A drive has one `Sensed`: it knows the sensors, the map, and which of their errors still last.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .._compile import Ints32
from ..errors import ReadError, SettingError, WhichroadError
from ..filter.evidence import evidence_kinds as kinds
from ..filter.evidence.evidence_kinds import CLASSES, EVIDENCE, NO_EVIDENCE, SENSORS
from ..filter.gnss.silence import SPARSE
from ..geodesy.angles import heading_of, radians
from ..observations import Array, Drive, SensorReading
from ..roadmap import RoadMap
from ..roadmap.attribute_names import known_name
from ..roadmap.levels import profile
from ..sensors.gnss import LEAST_SIGMA, ellipse
from ..sensors.kinds import (
    Attribute,
    Bearing,
    Elevation,
    Evidence,
    Heading,
    Lateral,
    Position,
    Range,
    Sensor,
    Speed,
)
from ..sensors.lasting import Lasting
from .elevations import Gains

Row = tuple[Any, ...]  # the fields of EVIDENCE
BESIDE = 0.5  # s from a fix, up to which a reading comes with it
BETWEEN = "reading of a sensor between sparse fixes"
_FARTHEST = 1e6  # m, of a range
_HEIGHTS = "heights over the ground"  # beside the attributes
_STAYS = 600.0  # s for which an error that stays, and is not learnt, is taken to last
_NEVER = 1e-6  # least likelihood of an attribute, over the largest


class Sensed:
    """Makes evidence of readings, in the order of time.

    Args:
        sensors: Up to 16.
        roads: The map, for its plane and its attributes.

    Raises:
        SettingError: One is no sensor, or two have the same name.
    """

    def __init__(self, sensors: Iterable[Sensor], roads: RoadMap) -> None:
        self.sensors, self.roads = checked(sensors), roads
        self.skipped: dict[str, int] = {}  # reason -> readings or rows
        self.lasting = Lasting()
        self._biased: tuple[int, str] | None = None  # whose error that stays is learnt
        self._heard: set[str] = set()  # sensors of which there was a reading
        self._attributes: dict[str, dict[Any, int]] = {}  # column -> class of each value
        self._classes = NO_EVIDENCE.classes
        self._first, self._start = NO_EVIDENCE.first, NO_EVIDENCE.start  # until they are used
        self._piece: Ints32 | None = None  # the map's piece of each that is told apart
        self._gains: dict[int, Gains] = {}  # of sensors of heights

    @property
    def names(self) -> tuple[str, ...]:
        """What the sensors are called."""
        return tuple(sensor.name for sensor in self.sensors)

    @property
    def columns(self) -> dict[str, str]:
        """All columns that the sensors read, by the alias that has readers keep them."""
        return columns_of(self.sensors)

    def within(
        self, told: Sequence[SensorReading], streams: Sequence[Array]
    ) -> list[SensorReading]:
        """The readings between the first and the last time of fixes and odometry."""
        low, high = min(s[0] for s in streams), max(s[-1] for s in streams)
        kept = [one for one in told if low <= one.time <= high]
        if len(kept) < len(told):
            self._skip("reading of a sensor outside of the drive", len(told) - len(kept))
        return kept

    def beside(self, told: Sequence[SensorReading], time: Array) -> list[SensorReading]:
        """Those that come with fixes, at their times, where seldom fixes alone move the vehicle.

        Routes join such fixes; what is said between them has no place on these.

        Args:
            told: In the order of time.
            time: Of the fixes, (n,) s, likewise.
        """
        if len(time) < 2 or np.median(np.diff(time)) <= SPARSE:
            return list(told)
        at = np.array([one.time for one in told])
        after = np.searchsorted(time, at).clip(1, len(time) - 1)
        nearest = np.where(time[after] - at < at - time[after - 1], time[after], time[after - 1])
        kept = [
            replace(one, time=fix)
            for one, fix in zip(told, nearest.tolist(), strict=True)
            if abs(one.time - fix) <= BESIDE
        ]
        if len(kept) < len(told):
            self._skip(BETWEEN, len(told) - len(kept))
        return kept

    def rows(self, reading: SensorReading, metres: float, place: tuple[float, ...]) -> list[Row]:
        """What a reading says, as rows of `filter.evidence.evidence_kinds.EVIDENCE`.

        Args:
            reading: At or after the one before.
            metres: Driven since the beginning.
            place: x, y (plane) about where the vehicle is, for true north.

        Raises:
            ReadError: No sensor has its name, it holds no numbers, or a sensor fails or gives
                what is no evidence.
        """
        found: list[Row] = []
        known = False
        for number, sensor in enumerate(self.sensors):
            if reading.sensor and reading.sensor != sensor.name:
                continue
            values = _numbers(reading, sensor.columns)
            known = known or bool(reading.sensor)
            if not any(map(math.isfinite, values.values())):
                continue
            self._heard.add(sensor.name)
            try:
                for evidence in sensor.rows({"time": reading.time, **values}):
                    row = self._row(number, evidence, reading.time, metres, place)
                    if row is not None:
                        found.append(row)
            except WhichroadError:
                raise
            except Exception as error:
                raise ReadError(
                    f"sensor {sensor.name}: rows raised {type(error).__name__} ({error}); a list "
                    "of evidence was expected; correct its class"
                ) from error
        if reading.sensor and not known:
            raise ReadError(
                f"reading: of a sensor {reading.sensor!r}; one of "
                f"{', '.join(self.names) or 'none'} was expected; "
                "give it by sensors="
            )
        return found

    def reported(self, drive: Drive) -> Drive:
        """The drive, with what was skipped and which sensors were not heard."""
        silent = [
            f"sensor {one.name}: not heard; numbers in a column {' or '.join(one.columns)} of the "
            "drive's tables were expected"
            for one in self.sensors
            if one.name not in self._heard
        ]
        return replace(drive, skipped=drive.skipped | self.skipped, notes=(*drive.notes, *silent))

    def evidence(self, rows: Sequence[Row]) -> kinds.Evidence:
        """Rows as the filter takes them, with the classes of roads that they are about."""
        table = np.array(list(rows), EVIDENCE).view(np.recarray)
        if not self._attributes:
            return NO_EVIDENCE._replace(rows=table)
        return kinds.Evidence(table, self._first, self._start, self._classes)

    def kept(self) -> list[Any]:
        """All that it remembers, as numbers and text."""
        gains = [[k, *gains.kept()] for k, gains in self._gains.items()]
        return [self.lasting.kept(), self._biased, gains]

    def restore(self, kept: list[Any]) -> None:
        """Remember that and nothing else."""
        self.lasting.restore(kept[0])
        self._biased = None if kept[1] is None else (int(kept[1][0]), str(kept[1][1]))
        for number, *gains in kept[2]:
            self._gains_of(int(number)).restore(gains)

    def _gains_of(self, number: int) -> Gains:
        """Those of a sensor; the heights of roads are known from then on."""
        if not self._gains:
            self._tell_heights()
        return self._gains.setdefault(number, Gains())

    def _tell_heights(self) -> None:
        """Make the heights of roads over the ground one of the classes of roads."""
        found = profile(self.roads)
        rows = [row[found.piece] for row in self._classes] if self._attributes else []
        self._first, self._start, self._piece = found.first, found.start, found.piece
        self._attributes[_HEIGHTS] = {}
        self._classes = np.array([*rows, found.height])

    def _skip(self, why: str, count: int = 1) -> None:
        self.skipped[why] = self.skipped.get(why, 0) + count

    def _row(
        self, number: int, evidence: Evidence, time: float, metres: float,
        place: tuple[float, ...],
    ) -> Row | None:  # fmt: skip
        """One row; None: it says nothing new, or is impossible."""
        make = _MAKERS.get(type(evidence))
        if make is None:
            raise ReadError(
                f"sensor {self.sensors[number].name}: rows gave {str(evidence)[:60]!r}; Heading, "
                "Speed, Position, Lateral, Range, Bearing, Attribute or Elevation of "
                "whichroad.sensors was expected"
            )
        made, name = make(self, evidence, place), self.sensors[number].name
        numbers = (made.value, made.bias, *made.sigmas)
        if not all(map(math.isfinite, numbers)) or min(made.sigmas) <= 0.0 or made.bias < 0.0:
            self._skip(f"{name}: impossible value or sigma")
            return None
        kind, where = type(evidence).__name__, (0.0, 0.0)
        if isinstance(evidence, Range | Bearing):
            where = (evidence.lat_deg, evidence.lon_deg)
        elif isinstance(evidence, Attribute):
            kind += evidence.name
        elif isinstance(evidence, Elevation):
            gains = self._gains_of(number).of(evidence, time, metres)
            column = list(self._attributes).index(_HEIGHTS)
            made = made._replace(column=column, log_likelihood=(*gains, 0.0))
        lasts = (evidence.lasts_s, evidence.lasts_m)
        if made.bias > 0.0:
            self._biased = self._biased or (number, kind)
            if self._biased != (number, kind):  # it is not learnt
                lasts = (max(evidence.lasts_s, _STAYS), evidence.lasts_m)
                sigma = math.hypot(made.sigmas[0], made.bias)
                made = made._replace(sigmas=(sigma, sigma), bias=0.0)
        share = self.lasting.share((number, kind, *where), time, metres, lasts)
        if share == 0.0:  # nothing new since the reading before
            return None
        return (
            made.kind, number, made.value, tuple(sigma * sigma for sigma in made.sigmas),
            made.bias**2, share, made.axis, *made.at, made.arm, made.on_map, made.relative,
            made.column, tuple(share * one for one in made.log_likelihood),
        )  # fmt: skip

    def class_of(self, name: str, value: Any) -> tuple[int, int]:
        """Row of the classes of roads that is about an attribute, and the class of a value.

        Raises:
            SettingError: The map has no such attribute, or more values are told apart than can be.
        """
        column = known_name(self.roads.ways, name)
        if column not in self._attributes:
            if not self._attributes:
                pieces = self.roads.pieces
                self._first = np.ascontiguousarray(pieces.first, np.int32)
                self._start = np.ascontiguousarray(pieces.start, np.float64)
            self._attributes[column] = {}
            more = np.full((1, len(self._start)), CLASSES - 1, np.uint8)
            known = self._classes.reshape(-1, more.shape[1])
            self._classes = np.concatenate([known, more])
        values = self._attributes[column]
        at = list(self._attributes).index(column)
        if value not in values:
            if len(values) == CLASSES - 1:
                raise SettingError(
                    f"attribute {name}: {value!r} beside {', '.join(map(repr, values))}; at most "
                    f"{CLASSES - 1} values were expected; name the others by `otherwise`"
                )
            values[value] = len(values)
            same = np.array([one == value for one in self.roads.at_pieces(column)], bool)
            self._classes[at, same if self._piece is None else same[self._piece]] = values[value]
        return at, values[value]


class _Made(NamedTuple):
    """What becomes a row of EVIDENCE; sigmas before they are divided by the share that is new."""

    kind: int
    value: float = 0.0
    sigmas: tuple[float, float] = (1.0, 1.0)
    bias: float = 0.0
    axis: float = 0.0
    at: tuple[float, float] = (0.0, 0.0)
    arm: tuple[float, float] = (0.0, 0.0)
    on_map: bool = False
    relative: bool = False
    column: int = 0
    log_likelihood: tuple[float, ...] = (0.0,) * CLASSES


def _numbers(reading: SensorReading, columns: Sequence[str]) -> dict[str, float]:
    """Those values of a reading that are of these columns."""
    try:
        return {n: float(reading.values[n]) for n in columns if n in reading.values}
    except (TypeError, ValueError):
        raise ReadError(
            f"reading: its values are {str(reading.values)[:80]}; numbers by the names "
            f"{', '.join(columns)} were expected; leave out what is not known"
        ) from None


def _heading(sensed: Sensed, one: Heading, place: tuple[float, ...]) -> _Made:
    turn = sensed.roads.plane.convergence(place[0], place[1])
    sigma = radians(one.sigma_deg)
    value, bias = heading_of(one.bearing_deg, turn), radians(one.bias_sigma)
    return _Made(kinds.HEADING, value, (sigma, sigma), bias)


def _speed(sensed: Sensed, one: Speed, place: tuple[float, ...]) -> _Made:
    return _Made(kinds.SPEED, one.speed_mps, (one.sigma_mps, one.sigma_mps))


def _lateral(sensed: Sensed, one: Lateral, place: tuple[float, ...]) -> _Made:
    return _Made(kinds.LATERAL, one.offset_m, (one.sigma_m, one.sigma_m), one.bias_sigma)


def _position(sensed: Sensed, one: Position, place: tuple[float, ...]) -> _Made:
    x, y = sensed.roads.plane.from_geodetic(float(one.lat_deg), float(one.lon_deg))
    if one.cov_m2 is None:
        sigmas, axis = (one.sigma_m, one.sigma_m), 0.0
    else:
        major, minor, angle = (float(v[0]) for v in ellipse(*(np.array([c]) for c in one.cov_m2)))
        sigmas = (max(major, LEAST_SIGMA), max(minor, LEAST_SIGMA))
        axis = angle + sensed.roads.plane.convergence(x, y)
    value = 0.0 * (x + y)  # not finite where the place is not
    return _Made(kinds.POSITION, value, sigmas, 0.0, axis, (x, y), (one.forward_m, one.left_m))


def _range(sensed: Sensed, one: Range, place: tuple[float, ...]) -> _Made:
    at = sensed.roads.plane.from_geodetic(float(one.lat_deg), float(one.lon_deg))
    value = one.distance_m if 0.0 <= one.distance_m <= _FARTHEST else math.nan
    return _Made(
        kinds.RANGE, value + 0.0 * sum(at), (one.sigma_m, one.sigma_m), one.bias_sigma, at=at,
        arm=(one.forward_m, one.left_m), on_map=one.on_map,
    )  # fmt: skip


def _bearing(sensed: Sensed, one: Bearing, place: tuple[float, ...]) -> _Made:
    at = sensed.roads.plane.from_geodetic(float(one.lat_deg), float(one.lon_deg))
    sigma = radians(one.sigma_deg)
    value = -radians(one.bearing_deg)
    if not one.relative:
        value = heading_of(one.bearing_deg, sensed.roads.plane.convergence(*at))
    return _Made(
        kinds.BEARING, value + 0.0 * sum(at), (sigma, sigma), radians(one.bias_sigma), at=at,
        arm=(one.forward_m, one.left_m), on_map=one.on_map, relative=one.relative,
    )  # fmt: skip


def _elevation(sensed: Sensed, one: Elevation, place: tuple[float, ...]) -> _Made:
    sigma = min(one.sigma_m, one.drift_m, one.drift_s)
    return _Made(kinds.ELEVATION, one.height_m, (one.sigma_m, sigma))


def _attribute(sensed: Sensed, one: Attribute, place: tuple[float, ...]) -> _Made:
    least = _NEVER * max(one.otherwise, *one.likelihoods.values(), 0.0)
    logs = [math.log(max(one.otherwise, least)) if least > 0.0 else math.nan] * CLASSES
    column = 0
    for value, likelihood in one.likelihoods.items():
        column, at = sensed.class_of(one.name, value)
        logs[at] = math.log(max(likelihood, least)) if least > 0.0 else math.nan
    return _Made(kinds.ATTRIBUTE, sum(logs), column=column, log_likelihood=tuple(logs))


_MAKERS: dict[type, Callable[[Sensed, Any, tuple[float, ...]], _Made]] = {
    Heading: _heading, Speed: _speed, Lateral: _lateral, Position: _position, Range: _range,
    Bearing: _bearing, Attribute: _attribute, Elevation: _elevation,
}  # fmt: skip


def columns_of(sensors: Iterable[Sensor]) -> dict[str, str]:
    """All columns that sensors read, by the alias that has readers keep them."""
    return {f"+{name}": name for sensor in sensors for name in sensor.columns}


def checked(sensors: Iterable[Sensor]) -> tuple[Sensor, ...]:
    """The sensors, each of which has what a sensor has.

    Raises:
        SettingError: One is no sensor, two have the same name, or there are too many.
    """
    given = tuple(sensors) if isinstance(sensors, Iterable) else (sensors,)
    for one in given:
        if isinstance(one, type) or not isinstance(one, Sensor) or isinstance(one.columns, str):
            raise SettingError(
                f"sensors: {str(one)[:60]!r} is none; an object with a name, columns and a method "
                "rows was expected, as in docs/tutorials/add-a-sensor.md"
            )
    names = [one.name for one in given]
    if len(set(names)) < len(names) or len(names) > SENSORS:
        raise SettingError(
            f"sensors: {', '.join(names)}; at most {SENSORS} of different names were expected"
        )
    return given
