"""Start the processes and the web server of `whichroad serve`, and end them."""

import asyncio
import contextlib
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from ..answers.requests import MOST_POINTS
from ..live.access import is_local
from ..live.traces import Traces
from ..live.web_server import listen, web_server
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .answering_process import plan_of
from .endpoints import MANY, Endpoints
from .workers import Lane

_LONGEST_REQUEST = 131_072  # bytes of a request's head: OSRM's addresses hold the trace
_WAITING, _WAITING_LARGE = 256, 8  # requests that wait, at most
_USUAL_TIME, _LARGE_TIME = 3.0, 120.0  # s that one request may take; slower ones count as large


@dataclass(slots=True)
class Plan:
    """What is to be served.

    Attributes:
        roads: The map.
        compiled: The file that it is of, where that is a compiled one.
        vehicle: The car.
        settings: The model's numbers.
        workers: Processes for usual traces; 0: one for each processor.
        most: Points of a trace, at most.
        host, port: Of the web; port 0: any that is free.
        token: Asked of everybody.
        ready: Called with the port when it is open.
    """

    roads: RoadMap
    compiled: Path | None = None
    vehicle: Vehicle = field(default_factory=Vehicle)
    settings: Settings = field(default_factory=Settings)
    workers: int = 0
    most: int = MOST_POINTS
    host: str = "127.0.0.1"
    port: int = 5000
    token: str | None = None
    ready: Callable[[int], None] = field(default=lambda port: None)


def serve(plan: Plan) -> None:
    """Answer until interrupted.

    Raises:
        SettingError: The port cannot be opened.
        WriteError: The map cannot be compiled into a temporary file.
    """
    with contextlib.suppress(KeyboardInterrupt), tempfile.TemporaryDirectory() as folder:
        if plan.compiled is None:
            plan.compiled = Path(folder) / "roads.map"
            plan.roads.save(plan.compiled)
        asyncio.run(_run(plan, plan.compiled))


async def _run(plan: Plan, compiled: Path) -> None:
    def lane(processes: int, waiting: int, seconds: float, last: bool) -> Lane:
        most = plan.most if last else min(plan.most, MANY)
        told = plan_of(compiled, plan.vehicle, plan.settings, most, last)
        return Lane(told, processes, waiting, seconds)

    usual = lane(plan.workers or os.cpu_count() or 1, _WAITING, _USUAL_TIME, False)
    large = lane(1, _WAITING_LARGE, _LARGE_TIME, True)
    traces = Traces(plan.roads, plan.vehicle, plan.settings, compiled)
    sock = listen(plan.host, plan.port)
    try:
        await asyncio.gather(usual.start(), large.start())
        app = Endpoints(usual, large, traces).application(is_local(plan.host), plan.token)
        server = web_server(app)
        server.config.h11_max_incomplete_event_size = _LONGEST_REQUEST
        plan.ready(sock.getsockname()[1])
        await server.serve(sockets=[sock])
    finally:
        traces.close()
        sock.close()
        await asyncio.gather(usual.close(), large.close())
