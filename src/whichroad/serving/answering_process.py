"""A process that answers requests one after the other, as frames on its standard streams.

A frame is its length (4 bytes) and its content.  A request's first byte is its kind; an answer
begins with the HTTP status (2 bytes).  The process ends with its standard input.
"""

import gc
import json
import os
import struct
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO

from ..answers import AnswerError, osrm_match, trace_attributes, trace_route
from ..errors import WhichroadError
from ..live.background import give_way, limit_memory, one_thread
from ..live.trace_worker import ANSWER, Refused, check_body, match_trace, prepare
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle

OSRM, ATTRIBUTES, ROUTE, TABLES = b"o", b"a", b"r", b"t"  # kinds of requests
TOO_MANY_POINTS = 0  # in place of a status: the trace has more points than this process takes
MOST_MEMORY = 512 * 1024 * 1024  # bytes that requests may take, where the system can limit it
_VALHALLA = {ATTRIBUTES: trace_attributes, ROUTE: trace_route}


def plan_of(roads: Path, vehicle: Vehicle, settings: Settings, most: int, last: bool) -> str:
    """What the process is told when it starts, as text.

    Args:
        roads: The compiled map.
        vehicle: The car.
        settings: The model's numbers.
        most: Points of a trace, at most.
        last: Whether every other process goes first.
    """
    told = {"map": str(roads), "vehicle": asdict(vehicle), "settings": asdict(settings)}
    return json.dumps({**told, "most": most, "last": last})


def framed(content: bytes) -> bytes:
    """The content with its length before it."""
    return struct.pack("<I", len(content)) + content


class Answerer:
    """Answers requests on one map.

    Args:
        roads: The map.
        vehicle: The car.
        settings: The model's numbers.
        most: Points of a trace, at most.
    """

    def __init__(self, roads: RoadMap, vehicle: Vehicle, settings: Settings, most: int) -> None:
        self._roads = roads
        self._how: dict[str, Any] = {"vehicle": vehicle, "settings": settings, "most": most}

    def answer(self, request: bytes) -> tuple[int, bytes]:
        """Status and body; TOO_MANY_POINTS is the status of a trace that is too long.

        Args:
            request: The kind, and for OSRM the coordinates, a line feed and the options; for
                tables the folder that `trace_worker` reads.
        """
        try:
            if request[:1] == TABLES:
                return 200, self._tables(Path(os.fsdecode(request[1:])))
            return 200, _json(self._asked(request[:1], request[1:]))
        except AnswerError as error:
            return TOO_MANY_POINTS if error.too_many else error.status, _json(error.answer)
        except MemoryError:
            return 413, _json({"error": "the trace needs more memory than one trace may take"})
        except Refused as refused:
            status = TOO_MANY_POINTS if refused.status == 413 else refused.status
            return status, _json({"error": refused.why})
        except WhichroadError as error:
            return 400, _json({"error": str(error)})
        except Exception:
            return 500, _json({"error": "internal error of the service; please report it"})

    def _asked(self, kind: bytes, body: bytes) -> dict[str, Any]:
        if kind != OSRM:
            return _VALHALLA[kind](self._roads, body, **self._how)
        coordinates, _, options = body.decode("latin-1").partition("\n")
        return osrm_match(self._roads, coordinates, options, **self._how)

    def _tables(self, folder: Path) -> bytes:
        """The answer of `POST /match`.

        Raises:
            Refused: It cannot be matched, or (413) not here.
        """
        check_body(folder)
        match_trace(folder, self._roads, self._how["most"])
        return (folder / ANSWER).read_bytes()


def _json(answer: dict[str, Any]) -> bytes:
    text = json.dumps(answer, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.encode(errors="backslashreplace")  # half a surrogate pair stays JSON's escape


def answer_all(answerer: Answerer, requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer until the requests end."""
    while len(head := requests.read(4)) == 4:
        body = requests.read(struct.unpack("<I", head)[0])
        status, answer = answerer.answer(body)
        answers.write(framed(struct.pack("<H", status) + answer))
        answers.flush()


def _warm(answerer: Answerer, roads: RoadMap) -> None:
    """Have every kernel ready: the first road is driven."""
    x, y, first = roads.edge_lines(*_whole_edge(roads))
    lat, lon = roads.plane.to_geodetic(x[: first[1]], y[: first[1]])
    places = ";".join(f"{b},{a}" for a, b in zip(lat[[0, -1]], lon[[0, -1]], strict=True))
    answerer.answer(OSRM + f"{places}\nsteps=true&annotations=true".encode())


def _whole_edge(roads: RoadMap) -> tuple[Any, Any, Any]:
    import numpy as np

    return np.array([0]), np.array([0.0]), roads.arrays.edges.length[:1].astype(float)


def main() -> None:
    """Answer on the map that the first frame names; the first answer says that it is open."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the service ends its processes itself
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what is printed by mistake does not reach the answers
    told = json.loads(requests.read(struct.unpack("<I", requests.read(4))[0]))
    if told["last"]:
        give_way(always=True)
    else:
        prepare()
    one_thread()
    roads = RoadMap.open(told["map"])
    vehicle, settings = Vehicle(**told["vehicle"]), Settings(**told["settings"])
    answerer = Answerer(roads, vehicle, settings, told["most"])
    _warm(answerer, roads)
    gc.collect()
    gc.freeze()  # what stays is not looked at again
    limit_memory(MOST_MEMORY)
    answers.write(framed(struct.pack("<H", 200)))
    answers.flush()
    answer_all(answerer, requests, answers)
