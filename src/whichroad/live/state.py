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

from ..core.belief import NOW, SPEED, STARTED, Belief, H, Route, X, Y
from ..core.output import Output
from ..localizer import Localizer
from ..records import Distance, SpeedYaw, WheelSpeed, WheelTicks
from ..roadmap import RoadMap

_MAGIC = b"whichroad state 3\n"
_WHOLE = ("size", "clock", "output.", "past.")  # the other fields have a row for each hypothesis
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
    tree: Route | None = None

    @property
    def started(self) -> bool:
        """Whether there was a fix yet."""
        return bool(self.arrays["clock"][STARTED])


def state_of(localizer: Localizer) -> State:
    """A copy of all that a localizer remembers."""
    n = int(localizer._belief.size[0])
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
    waiting, tree = localizer._watch._waiting, localizer._route
    return State(float(arrays["clock"][NOW]), arrays, plain, waiting, tree)


def restore(localizer: Localizer, state: State) -> None:
    """Make a localizer remember what `state` says, and nothing else.

    Settings, vehicle, map and counts of what was skipped stay; what was watched after that
    moment for the diagnosis is forgotten as far as it was not summed up.
    """
    n = int(state.arrays["size"][0])
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
        if localizer._route is not state.tree:  # tidied since, or of another process: begun anew
            localizer._belief.node[:n] = -1
        localizer._past.forget_after(state.time, localizer._belief)
    watch = localizer._watch
    watch._waiting = min(max(state.watched, 0), watch._waiting)


def _arrays(localizer: Localizer) -> list[tuple[str, NDArray[Any]]]:
    """The localizer's own arrays that matter, by name."""
    arrays: list[tuple[str, NDArray[Any]]] = [
        (name, getattr(localizer._belief, name)) for name in Belief._fields if name != "scratch"
    ]
    if localizer._past is not None:
        arrays.append(("past.since", localizer._past.memory.since))
    return arrays + [(f"output.{n}", getattr(localizer._output, n)) for n in Output._fields]


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
    belief = localizer._belief
    age = time - float(belief.clock[NOW])
    if age <= 0.0 or not belief.clock[STARTED]:
        return
    speed, turn = localizer._rate if localizer._rate[0] else (float(belief.clock[SPEED]), 0.0)
    localizer._fill(time, speed * age, turn * min(age, 1.0), False)
    localizer._run()
    away = (_OF_SPEED * abs(speed) + _LEAST_SPEED) * age
    for i in range(int(belief.size[0])):
        heading = float(belief.mean[i, H])
        east, north = away * math.cos(heading), away * math.sin(heading)
        belief.cov[i, X, X] += east * east
        belief.cov[i, X, Y] += east * north
        belief.cov[i, Y, X] += east * north
        belief.cov[i, Y, Y] += north * north
    localizer._reading, localizer._odometer, localizer._began = None, None, None
    localizer._fill(time, 0.0, 0.0, False)
    localizer._run()


def fingerprint(roads: RoadMap) -> str:
    """Tells maps apart: edges of one are nothing in another."""
    arrays = roads.arrays
    sums = [
        zlib.crc32(np.ascontiguousarray(a).tobytes())
        for a in (arrays.first, arrays.x, arrays.y, arrays.rule)
    ]
    return f"{len(roads)}-" + "-".join(f"{s:08x}" for s in sums)


def to_bytes(state: State, about: dict[str, Any]) -> bytes:
    """A state as bytes that tell when they are damaged."""
    head: dict[str, Any] = {"time": state.time, "plain": state.plain, "about": about}
    head["arrays"] = [[k, a.dtype.str, list(a.shape)] for k, a in state.arrays.items()]
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
    for name, kind, shape in head["arrays"]:
        count = int(np.prod(shape)) * np.dtype(kind).itemsize
        arrays[name] = np.frombuffer(content[at : at + count], kind).reshape(shape)
        at += count
    return State(head["time"], arrays, head["plain"]), head["about"]
