"""All that a localizer remembers, as a value: to go back by seconds, or to outlive a crash."""

import json
import struct
import zlib
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, NamedTuple

from ..errors import MapError, ReadError, SettingError
from ..filter.lookback.history import MOTION, REFERENCE
from ..filter.state import EPOCH, FILTER, HYPOTHESIS, Path
from ..filter.summary.estimate import ESTIMATE
from ..observations import (
    Distance,
    GeoFix,
    SensorReading,
    SpeedYaw,
    StartPose,
    WheelSpeed,
    WheelTicks,
)  # fmt: skip
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle

_NAME = b"whichroad localizer "
_MAGIC = _NAME + b"1\n"
_NUMBERS = struct.Struct("<II")  # check sum of all that follows, length of the JSON
_READINGS = {kind.__name__: kind for kind in (WheelTicks, WheelSpeed, Distance, SpeedYaw)}
_OBSERVED: dict[str, Any] = {kind.__name__: kind for kind in (GeoFix, SensorReading)}

Reading = WheelTicks | WheelSpeed | Distance | SpeedYaw


class Made(NamedTuple):
    """What a localizer was made with."""

    map: str  # fingerprint
    lag: float | None
    vehicle: Vehicle
    settings: Settings
    start: StartPose | None
    sensors: tuple[str, ...] = ()  # names of further ones

    def check(self, other: "Made") -> None:
        """See that a localizer that was made so can take what this one knew.

        Raises:
            MapError: It was made with another map.
            SettingError: It was made with another lag or vehicle, or with other sensors.
        """
        if self.map != other.map:
            raise MapError(
                f"localizer's state: it belongs to the map {self.map}; one of {other.map} was "
                "expected, because edges are known by their numbers; begin with a new Localizer"
            )
        if self.lag != other.lag:
            raise SettingError(
                f"localizer's state: it was stored with lag={self.lag}; {other.lag} was expected"
            )
        if self.sensors != other.sensors:
            stored, here = (", ".join(one.sensors) or "none" for one in (self, other))
            raise SettingError(
                f"localizer's state: it was stored with the further sensors {stored}; {here} was "
                "expected, as this localizer has; give sensors= the same ones, in their order"
            )
        wrong = [
            field.name for field in fields(Vehicle)
            if getattr(self.vehicle, field.name) != getattr(other.vehicle, field.name)
        ]  # fmt: skip
        if wrong:
            stored, here = (getattr(one.vehicle, wrong[0]) for one in (self, other))
            raise SettingError(
                f"localizer's state: it is of another vehicle, with {wrong[0]}={stored}; {here} "
                "was expected, as this localizer has; make it with the same vehicle, or tell "
                "Localizer.from_bytes(..., vehicle=...) that the numbers have changed"
            )


class Odometry(NamedTuple):
    """What a localizer knows of the last odometry and fix."""

    odometer: tuple[float, float, float] | None  # time, distance and turn since the last reading
    rate: tuple[float, float]  # m/s, rad/s
    interval: float  # s, usually between readings
    began: float | None  # when the first fix came, until the next reading
    reading: Reading | None  # the last one
    far_fix: tuple[float, float]  # time of the last fix, m it is away if not believed
    mode: int  # WHEELS, DISTANCE or CLOCK
    gyro: list[list[float]]  # what `sensors.gyro_turns.GyroTurns` keeps
    sensed: list[Any]  # and `Sensing`,
    clocks: list[Any]  # and `set_back.Clocks`,
    band: list[Any]  # whether the vehicle may creep, and `sensors.dead_band.DeadBand`
    glitches: list[float]  # what `sensors.glitches.Glitches` keeps,
    steps: list[Any]  # and `sensors.even_steps.EvenSteps`


@dataclass(frozen=True, slots=True)
class State:
    """What a localizer knows at one moment.

    Attributes:
        time: s since 1970, by the filter's clock.
        count: How many hypotheses lived.
        tables: Records of the filter by name, as bytes; of the hypotheses those that live; from
            before what is in `observed`.
        odometry: What is known of the last readings.
        made: What the localizer was made with.
        skipped: Observations refused until then, by reason.
        observed: What was taken last, before which odometry of its time may go in.
        watched: How many epochs waited to be looked at for the diagnosis; -1: not kept.
        path: Tree of the edges by which hypotheses came; None: it was another process's.
    """

    time: float
    count: int
    tables: dict[str, bytes]
    odometry: Odometry
    made: Made
    skipped: dict[str, int]
    observed: tuple[GeoFix | SensorReading, ...] = ()
    watched: int = -1
    path: Path | None = None

    def to_bytes(self) -> bytes:
        """The state as bytes that tell when they are damaged."""
        reading = self.odometry.reading
        kept = self.odometry._asdict() | {
            "reading": None if reading is None else [type(reading).__name__, asdict(reading)]
        }
        made = self.made._asdict() | {
            "vehicle": asdict(self.made.vehicle), "settings": asdict(self.made.settings),
            "start": None if self.made.start is None else asdict(self.made.start),
        }  # fmt: skip
        head = {
            "records": _RECORDS, "time": self.time, "count": self.count, "odometry": kept,
            "made": made, "skipped": self.skipped,
            "tables": {name: len(table) for name, table in self.tables.items()},
            "observed": [_as_lists(one) for one in self.observed],
        }  # fmt: skip
        text = json.dumps(head, default=float).encode()  # numbers of NumPy
        content = text + b"".join(self.tables.values())
        size = struct.pack("<I", len(text))
        return _MAGIC + _NUMBERS.pack(zlib.crc32(size + content), len(text)) + content

    @classmethod
    def from_bytes(cls, data: bytes) -> "State":
        """The state that these bytes hold.

        Raises:
            ReadError: They are damaged, of another version, or no bytes.
        """
        if not isinstance(data, bytes | bytearray):
            raise ReadError(
                f"localizer's state: a {type(data).__name__} was given; the bytes that "
                "Localizer.to_bytes gave were expected; Path.read_bytes reads them from a file"
            )
        begin = len(_MAGIC) + _NUMBERS.size
        if data.startswith(_NAME) and len(data) >= begin and not data.startswith(_MAGIC):
            raise _other_version()
        if not data.startswith(_MAGIC) or len(data) < begin:
            raise _damaged(len(data))
        check, size = _NUMBERS.unpack_from(data, len(_MAGIC))
        if zlib.crc32(data[begin - 4 :]) != check:
            raise _damaged(len(data))
        head = json.loads(data[begin : begin + size])
        if head["records"] != _RECORDS:
            raise _other_version()
        tables, at = {}, begin + size
        for name, length in head["tables"].items():
            tables[name] = data[at : at + length]
            at += length
        return cls(
            head["time"], head["count"], tables, _odometry(head["odometry"]), _made(head["made"]),
            head["skipped"], tuple(_OBSERVED[kind](**one) for kind, one in head["observed"]),
        )  # fmt: skip


def _odometry(kept: dict[str, Any]) -> Odometry:
    """What `State.to_bytes` made of an `Odometry`."""
    reading, odometer = kept["reading"], kept["odometer"]
    return Odometry(
        **kept
        | {
            "odometer": None if odometer is None else tuple(odometer),
            "rate": tuple(kept["rate"]),
            "far_fix": tuple(kept["far_fix"]),
            "reading": None if reading is None else _READINGS[reading[0]](**reading[1]),
        }
    )


def _as_lists(observed: GeoFix | SensorReading) -> list[Any]:
    """A fix or a further reading as what it is, and its fields."""
    if isinstance(observed, SensorReading):
        observed = replace(observed, values=dict(observed.values))
    return [type(observed).__name__, asdict(observed)]


def _made(kept: dict[str, Any]) -> Made:
    """What `State.to_bytes` made of a `Made`."""
    start = kept["start"]
    return Made(
        **kept
        | {
            "vehicle": Vehicle(**kept["vehicle"]),
            "settings": Settings(**kept["settings"]),
            "start": None if start is None else StartPose(**start),
            "sensors": tuple(kept["sensors"]),
        }
    )


def fingerprint(roads: RoadMap) -> str:
    """Tells maps apart: edges of one are nothing in another."""
    vertices, edges = roads.arrays.vertices, roads.arrays.edges
    sums = [
        zlib.crc32(column.tobytes())
        for column in (edges.first_vertex, vertices.x, vertices.y, edges.rule)
    ]
    return f"{len(edges)}-" + "-".join(f"{s:08x}" for s in sums)


def _records() -> str:
    """Tells versions apart: fields of the records, and of what a localizer is made with."""
    known = [repr(d.descr) for d in (HYPOTHESIS, FILTER, EPOCH, ESTIMATE, MOTION, REFERENCE)]
    kinds = (Settings, Vehicle, StartPose, State)
    known += [field.name for kind in kinds for field in fields(kind)]
    known += [*Odometry._fields, *Made._fields]
    return f"{zlib.crc32(' '.join(known).encode()):08x}"


_RECORDS = _records()


def _damaged(length: int) -> ReadError:
    return ReadError(
        f"localizer's state: {length:,} bytes that are damaged or something else; what "
        "Localizer.to_bytes gave was expected; begin with a new Localizer"
    )


def _other_version() -> ReadError:
    return ReadError(
        "localizer's state: bytes of another version of whichroad; what Localizer.to_bytes of "
        "this version gave was expected; begin with a new Localizer"
    )
