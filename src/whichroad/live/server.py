"""The live service: inputs, filter, outputs and web server in one event loop."""

import asyncio
import contextlib
import gc
import sys
import time
from collections import Counter
from collections.abc import Callable, Coroutine, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
from starlette.routing import BaseRoute

from ..errors import SettingError
from ..observations import Distance, Drive, GeoFix, SpeedYaw, WheelSpeed, WheelTicks
from ..online import Localizer
from ..roadmap.extent import are_near
from ..wording import by_reason
from .access import is_local
from .app import Service, application
from .checkpoint import EVERY
from .messages import Around, Messages
from .playback import Player, RecordedObservations
from .traces import Traces
from .vehicle_run import Fitted, Input, VehicleRun
from .web_server import listen, web_server

_TICK = 0.05  # s
_AGAIN = 0.5  # s, after which a task that has not ended is cancelled again
_FAST = 0.05  # s between messages while a recording is played as fast as possible


@dataclass(slots=True)
class Plan:
    """What `serve` is to do.

    Attributes:
        vehicles: At least one, all on one map.
        compiled: The file of the map, where that is a compiled one.
        recording: A recorded drive, played for the first vehicle instead of its inputs.
        speed: Times real time; None: as fast as possible.
        laps: How often it is played.
        once: Whether to end with the recording, or with standard input.
        window: s by which observations may be late.
        rate: Messages a second where no fix calls for one.
        clock: `sensor`: observations have their own times; `arrival`: that of their arrival.
        host, port: Of the web; port 0: any that is free.
        token: Asked of everybody.
        pages: Routes of the page.
        report: Takes messages for the operator, a line each.
        ready: Called with the web server's port when it is open.
    """

    vehicles: Sequence[Fitted]
    compiled: Path | None = None
    recording: Drive | None = None
    speed: float | None = 1.0
    laps: int = 1
    once: bool = False
    window: float = 1.0
    rate: float = 10.0
    clock: str = "sensor"
    host: str = "127.0.0.1"
    port: int = 8080
    token: str | None = None
    pages: Sequence[BaseRoute] = ()
    report: Callable[[str], None] = field(default=lambda line: None)
    ready: Callable[[int], None] = field(default=lambda port: None)


def serve(plan: Plan) -> None:
    """Run the service until it is interrupted, or the recording is over.

    Raises:
        SettingError: A port cannot be opened.
        WriteError: The recording or the checkpoint cannot be written.
        ReadError: The .dbc cannot be read.
    """
    sys.setswitchinterval(0.0005)  # a thread that draws tiles must not hold the filter up
    with contextlib.suppress(ImportError, OSError, ValueError):  # as many sockets as may be
        import resource

        most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(Run(plan).run())


class Run:
    """One run of the service.

    Args:
        plan: What is to be done.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        for one in plan.vehicles:
            warm_up(one.localizer)
        self.vehicles = [
            VehicleRun(
                one, window=plan.window, rate=plan.rate, played=plan.recording is not None,
                report=plan.report,
            )
            for one in plan.vehicles
        ]  # fmt: skip
        self.filter_loop = self.vehicles[0].filter_loop
        self.writer = ThreadPoolExecutor(1)
        self.player: Player | None = None
        self.broken: BaseException | None = None
        self._server: uvicorn.Server | None = None
        self._traces: Traces | None = None

    def stop(self) -> None:
        """End soon; from the loop's own thread."""
        if self._server is not None:
            self._server.should_exit = True

    async def run(self) -> None:
        """Serve until stopped."""
        plan, first = self.plan, self.vehicles[0]
        for vehicle in self.vehicles:
            vehicle.resume()
        inputs = self._inputs()
        others = {
            str(one.fitted.name): (one.filter_loop, one.broadcaster) for one in self.vehicles[1:]
        }
        service = Service(
            self.filter_loop, first.broadcaster, self.player, plan.compiled, others
        )  # fmt: skip
        self._traces = service.traces
        app = application(
            service, pages=plan.pages, local=is_local(plan.host), token=plan.token
        )  # fmt: skip
        server = self._server = web_server(app)
        for vehicle in self.vehicles:
            for output in vehicle.fitted.nmea_outputs:
                await _opened(output.start(), f"--nmea-out {output.host}:{output.port}")
                vehicle.filter_loop.sinks.append(output.send)
        sock = listen(plan.host, plan.port)
        gc.collect()
        gc.freeze()
        tasks = [asyncio.create_task(self._guard(begin())) for begin in inputs]
        if plan.once or self.player is not None:
            tasks.append(asyncio.create_task(self._until_end(list(tasks))))
        tasks += [asyncio.create_task(self._guard(self._clock()))]
        if self.player is not None:
            self.filter_loop.least = _FAST if plan.speed is None else self.filter_loop.least
            tasks.append(asyncio.create_task(self._guard(self.player.run())))
        plan.ready(sock.getsockname()[1])
        try:
            await server.serve(sockets=[sock])
        finally:
            await _ended(tasks)
            self._close()
        if self.broken is not None:
            raise self.broken

    def _inputs(self) -> list[Input]:
        """What brings observations."""
        plan, filter_loop = self.plan, self.filter_loop
        if plan.recording is not None:
            self.player = Player(
                filter_loop, RecordedObservations(plan.recording, plan.laps), speed=plan.speed
            )
            played = filter_loop.sensor("recording", "file")
            played.skipped_why = Counter(plan.recording.skipped)
            if filter_loop.buffer.now > 0.0:
                self.player.start_at(filter_loop.buffer.now)
            return []
        if any(one.can for one in plan.vehicles):
            import can  # noqa: F401  # now, as importing it later would hold everything up
        if any(address.kind == "serial" for one in plan.vehicles for address in one.nmea):
            import serial  # noqa: F401
        by_arrival = plan.clock == "arrival"
        return [one for vehicle in self.vehicles for one in vehicle.inputs(by_arrival)]

    async def _clock(self) -> None:
        """Ticks, writes what is recorded, keeps the state."""
        loop = asyncio.get_running_loop()
        kept, job = 0.0, None
        while True:
            await asyncio.sleep(_TICK)
            if self.player is None or not (self.player.paused or self.player.ended.is_set()):
                for vehicle in self.vehicles:
                    vehicle.filter_loop.tick()
            if job is not None and not job.done():
                continue
            if job is not None:
                job.result()
            now = time.monotonic()
            if now - kept >= EVERY or any(vehicle.full for vehicle in self.vehicles):
                kept = now
                jobs = [job for vehicle in self.vehicles for job in vehicle.jobs()]
                job = loop.run_in_executor(self.writer, _all, jobs) if jobs else None

    async def _until_end(self, inputs: "list[asyncio.Task[None]]") -> None:
        """The recording has ended, or standard input: no other input ends."""
        if self.player is not None:
            await self.player.ended.wait()
        else:
            await asyncio.wait(inputs, return_when=asyncio.FIRST_COMPLETED)
        self._tell_skipped()
        if not self.plan.once:
            return
        await asyncio.sleep(0.2)
        self.stop()

    def _tell_skipped(self) -> None:
        """What the readers of the inputs and the filters did not take, in a line."""
        counts = Counter[str]()
        for loop in (vehicle.filter_loop for vehicle in self.vehicles):
            counts += Counter(loop.health()["skipped"])
        if counts:
            self.plan.report(f"skipped: {by_reason(counts)}")

    async def _guard(self, work: Coroutine[Any, Any, None]) -> None:
        """Whatever breaks ends the service with its reason."""
        try:
            await work
        except Exception as error:
            self.broken = self.broken or _named(error)
            self.stop()

    def _close(self) -> None:
        if self._traces is not None:
            self._traces.close()
        for vehicle in self.vehicles:
            vehicle.disconnect()
        self.writer.shutdown(wait=True)
        for vehicle in self.vehicles:
            vehicle.keep()


async def _ended(tasks: Iterable["asyncio.Task[None]"]) -> None:
    """Cancel tasks until all have ended: one that is about to go on may miss it once."""
    left = set(tasks)
    while left:
        for task in left:
            task.cancel()
        _, left = await asyncio.wait(left, timeout=_AGAIN)


def warm_up(localizer: Localizer) -> None:
    """Have every kernel ready before the first observation: one like it is driven elsewhere."""
    roads, car, lag = localizer.roads, localizer.vehicle, localizer.lag
    double = Localizer(roads, vehicle=car, settings=localizer.settings, lag=lag)
    x, y, _ = roads.at(0, 0.5 * float(roads.arrays.edges.length[0]))
    lat, lon = roads.plane.to_geodetic(x, y)
    kinds = (WheelTicks, WheelSpeed, SpeedYaw)
    readings: list[Any] = [kind(0.1 * i, i, i) for kind in kinds for i in range(5)]
    readings += [Distance(0.1 * i, float(i)) for i in range(5)]
    for number, reading in enumerate(readings):
        when = 1.0 + 0.1 * number
        double.take(replace(reading, time=when))
        if number % 2:
            fix = GeoFix(when, lat, lon, 4.0, 0.0, 4.0, 5.0, 0.3, 90.0, 5.0)
            double.take(fix)
            Messages(roads).estimate(double.predict(when + 0.1), Around(fix=fix))
            _ = None if lag is None else (double.lagged(), double.decided_until)
    are_near(np.array([lat]), np.array([lon]), roads)
    double = Localizer(roads, vehicle=car, settings=localizer.settings, lag=lag)
    for i in range(3):
        double.take(GeoFix(float(i), lat, lon, 4.0, 0.0, 4.0))
        double.predict(i + 0.5)


def _all(jobs: list[Callable[[], None]]) -> None:
    for job in jobs:
        job()


def _named(error: Exception) -> Exception:
    if isinstance(error, OSError):
        return SettingError(f"{error.strerror or error}; an input or output cannot be opened")
    return error


async def _opened(work: Coroutine[Any, Any, None], what: str) -> None:
    try:
        await work
    except OSError as error:
        raise SettingError(
            f"{what} cannot be opened ({error.strerror}); a free address was expected"
        ) from None
