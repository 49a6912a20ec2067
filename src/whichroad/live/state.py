"""All that a localizer remembers, as a value: to go back by a second, or to outlive a crash.

The localizer owns its belief; this room alone takes it out and puts it back.
"""

import json
import math
import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..filter.estimate import ESTIMATE
from ..filter.history import MOTION
from ..filter.state import FILTER, HYPOTHESIS, H, Path, X, Y
from ..observations import Distance, SpeedYaw, WheelSpeed, WheelTicks
from ..online import Localizer
from ..roadmap import RoadMap

_MAGIC = b"whichroad state 4\n"
_WHOLE = ("state", "output.", "past.")  # the other tables have a row for each hypothesis
_READINGS = {kind.__name__: kind for kind in (WheelTicks, WheelSpeed, Distance, SpeedYaw)}
_LEAST_SPEED = 0.5  # m/s that a vehicle may have taken up unseen
_OF_SPEED = 0.3  # share of the distance since then that is uncertain


@dataclass(frozen=True, slots=True)
class State:
    """What a localizer knows at one moment.

    Attributes:
        time: s since 1970.
        arrays: Copies of the living rows of the belief and of the last output.
        plain: Everything else, as JSON could say it.
        watched: How many epochs the watch holds that it has not looked at; -1: not kept.
        tree: Of the edges by which hypotheses came; None: it was another process's.
    """

    time: float
    arrays: dict[str, NDArray[Any]]
    plain: dict[str, Any]
    watched: int = -1
    tree: Path | None = None

    @property
    def started(self) -> bool:
        """Whether there was a fix yet."""
        return bool(self.arrays["state"]["started"][0])


def state_of(localizer: Localizer) -> State:
    """A copy of all that a localizer remembers."""
    n = int(localizer._state["count"])
    arrays = {
        name: array.copy() if name.startswith(_WHOLE) else array[:n].copy()
        for name, array in _arrays(localizer)
    }
    reading = localizer._reading
    plain = {
        "odometer": localizer._odometer,
        "rate": localizer._rate,
        "interval": localizer._interval,
        "began": localizer._began,
        "reading": None
        if reading is None
        else [type(reading).__name__, *(getattr(reading, f) for f in reading.__slots__)],
        "mode": localizer._mode,
        "far_fix": localizer._far_fix,
    }
    waiting, tree = localizer._watch._waiting, localizer._path
    return State(float(localizer._state["time"]), arrays, plain, waiting, tree)


def restore(localizer: Localizer, state: State) -> None:
    """Make a localizer remember what `state` says, and nothing else.

    Settings, vehicle, map and counts of what was skipped stay; what was watched after that
    moment for the diagnosis is forgotten as far as it was not summed up.
    """
    n = int(state.arrays["state"]["count"][0])
    for name, array in _arrays(localizer):
        if name.startswith(_WHOLE):
            array[:] = state.arrays[name]
        else:
            array[:n] = state.arrays[name]
    plain, reading = state.plain, state.plain["reading"]
    localizer._odometer = _floats(plain["odometer"])
    localizer._rate = (plain["rate"][0], plain["rate"][1])
    localizer._interval = plain["interval"]
    localizer._began = plain["began"]
    localizer._reading = None if reading is None else _READINGS[reading[0]](*reading[1:])
    localizer._mode = plain["mode"]
    localizer._far_fix = (plain["far_fix"][0], plain["far_fix"][1])
    if localizer._past is not None:
        if localizer._path is not state.tree:  # tidied since, or of another process: begun anew
            localizer._belief.hyp["path_entry"][:n] = -1
        localizer._past.forget_after(state.time, localizer._belief)
    watch = localizer._watch
    watch._waiting = min(max(state.watched, 0), watch._waiting)


def _arrays(localizer: Localizer) -> list[tuple[str, NDArray[Any]]]:
    """The localizer's own tables that matter, by name."""
    tables = dict(localizer._belief._asdict())
    if localizer._past is not None:
        tables["past.since"] = localizer._past.history.since
    tables |= {f"output.{name}": table for name, table in localizer._output._asdict().items()}
    return [(name, table.view(np.ndarray)) for name, table in tables.items()]


def _floats(values: Any) -> tuple[float, float, float] | None:
    return None if values is None else (values[0], values[1], values[2])


def bridge(localizer: Localizer, time: float) -> None:
    """Bring a localizer that slept to a later time, less sure by what it cannot know.

    It goes on at the speed that was, through the roads that may follow; the place along the
    heading becomes uncertain by a share of that way.  Odometer readings before are forgotten:
    the next one is the first.

    Args:
        localizer: Its state was restored.
        time: When it wakes up, s.
    """
    known = localizer._state
    age = time - float(known["time"])
    if age <= 0.0 or not known["started"]:
        return
    speed, turn = localizer._rate if localizer._rate[0] else (float(known["speed"]), 0.0)
    localizer._fill(time, speed * age, turn * min(age, 1.0), False)
    localizer._run()
    away = (_OF_SPEED * abs(speed) + _LEAST_SPEED) * age
    mean, cov = localizer._belief.hyp["mu"], localizer._belief.hyp["cov"]
    for i in range(int(known["count"])):
        heading = float(mean[i, H])
        east, north = away * math.cos(heading), away * math.sin(heading)
        cov[i, X, X] += east * east
        cov[i, X, Y] += east * north
        cov[i, Y, X] += east * north
        cov[i, Y, Y] += north * north
    localizer._reading, localizer._odometer, localizer._began = None, None, None
    localizer._fill(time, 0.0, 0.0, False)
    localizer._run()


def fingerprint(roads: RoadMap) -> str:
    """Tells maps apart: edges of one are nothing in another."""
    vertices, edges = roads.arrays.vertices, roads.arrays.edges
    sums = [
        zlib.crc32(column.tobytes())
        for column in (edges.first_vertex, vertices.x, vertices.y, edges.rule)
    ]
    return f"{len(roads)}-" + "-".join(f"{s:08x}" for s in sums)


def _kind(dtype: np.dtype[Any]) -> str:
    """A type in a word; of records that of their fields."""
    if dtype.names is None:
        return dtype.str
    return f"{zlib.crc32(repr(dtype.descr).encode()):08x}"


_RECORDS = {_kind(dtype): dtype for dtype in (HYPOTHESIS, FILTER, ESTIMATE, MOTION)}


def to_bytes(state: State, about: dict[str, Any]) -> bytes:
    """A state as bytes that tell when they are damaged."""
    head: dict[str, Any] = {"time": state.time, "plain": state.plain, "about": about}
    head["arrays"] = [[k, _kind(a.dtype), list(a.shape)] for k, a in state.arrays.items()]
    text = json.dumps(head).encode()
    body = b"".join(np.ascontiguousarray(a).tobytes() for a in state.arrays.values())
    content = struct.pack("<I", len(text)) + text + body
    return _MAGIC + struct.pack("<I", zlib.crc32(content)) + content


def from_bytes(data: bytes) -> tuple[State, dict[str, Any]] | None:
    """The state and what was said about it, or None where the bytes are not whole."""
    begin = len(_MAGIC) + 4
    if not data.startswith(_MAGIC) or len(data) < begin + 4:
        return None
    content = data[begin:]
    if zlib.crc32(content) != struct.unpack("<I", data[len(_MAGIC) : begin])[0]:
        return None
    size = struct.unpack("<I", content[:4])[0]
    head = json.loads(content[4 : 4 + size])
    arrays, at = {}, 4 + size
    kinds = {kind for _, kind, _ in head["arrays"]}
    if not kinds <= {*_RECORDS, "<f8"}:  # records of another version
        return None
    for name, kind, shape in head["arrays"]:
        dtype = _RECORDS.get(kind) or np.dtype(kind)
        count = int(np.prod(shape)) * dtype.itemsize
        arrays[name] = np.frombuffer(content[at : at + count], dtype).reshape(shape)
        at += count
    return State(head["time"], arrays, head["plain"]), head["about"]
