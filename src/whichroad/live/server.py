"""The live service: inputs, filter, outputs and web server in one event loop."""

import asyncio
import contextlib
import gc
import sys
import time
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import uvicorn
from starlette.routing import BaseRoute

from ..errors import SettingError
from ..observations import Distance, Drive, GeoFix, SpeedYaw, WheelSpeed, WheelTicks
from ..online import Localizer
from .access import is_local
from .app import Service, application
from .broadcaster import Broadcaster
from .checkpoint import EVERY, Checkpoint
from .decode import CanStream, NmeaStream
from .filter_loop import FilterLoop
from .messages import Around, Messages
from .nmea_output import NmeaOutput
from .playback import Player, RecordedObservations
from .recording import Recorder
from .sources import READERS, Address, NmeaInput, read_can
from .traces import Traces
from .web_server import listen, web_server

_TICK = 0.05  # s
_FAST = 0.05  # s between messages while a recording is played as fast as possible
_MOST_ROWS = 20_000  # rows waiting to be recorded, at most


@dataclass(slots=True)
class Plan:
    """What `serve` is to do.

    Attributes:
        localizer: The filter.
        compiled: The file of its map, where that is a compiled one.
        nmea: Where fixes come from.
        can: Where frames come from, and the .dbc that describes them.
        recording: A recorded drive instead of both.
        speed: Times real time; None: as fast as possible.
        laps: How often it is played.
        once: Whether to end with the recording.
        window: s by which observations may be late.
        rate: Messages a second where no fix calls for one.
        clock: `sensor`: observations have their own times; `arrival`: that of their arrival.
        record: Folder of the recording.
        state: File of the checkpoint.
        nmea_outputs: Outputs of NMEA.
        host, port: Of the web; port 0: any that is free.
        token: Asked of everybody.
        pages: Routes of the page.
        report: Takes messages for the operator, a line each.
        ready: Called with the web server's port when it is open.
    """

    localizer: Localizer
    compiled: Path | None = None
    nmea: Sequence[Address] = ()
    can: Sequence[tuple[Address, Path]] = ()
    recording: Drive | None = None
    speed: float | None = 1.0
    laps: int = 1
    once: bool = False
    window: float = 1.0
    rate: float = 10.0
    clock: str = "sensor"
    record: Path | None = None
    state: Path | None = None
    nmea_outputs: Sequence[NmeaOutput] = ()
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
        about = {"map": repr(plan.localizer.roads), "begun": time.time()}
        recorder = None
        if plan.record is not None:
            recorder = Recorder(plan.record, plan.localizer.roads, about)
        warm_up(plan.localizer)
        self.filter_loop = FilterLoop(
            plan.localizer, window=0.0 if plan.recording is not None else plan.window,
            rate=plan.rate, recorder=recorder,
        )  # fmt: skip
        if recorder is not None and plan.recording is None:
            self.filter_loop.recorded = recorder.until
        self.broadcaster = Broadcaster()
        self.buses: dict[str, CanStream] = {}
        self.checkpoint = (
            None if plan.state is None else Checkpoint(plan.state, plan.localizer, self.buses)
        )
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
        plan = self.plan
        self._resume()
        inputs = self._inputs()
        service = Service(self.filter_loop, self.broadcaster, self.player, plan.compiled)
        self._traces = service.traces
        app = application(
            service, pages=plan.pages, local=is_local(plan.host), token=plan.token
        )  # fmt: skip
        server = self._server = web_server(app)
        for output in plan.nmea_outputs:
            await _opened(output.start(), f"--nmea-out {output.host}:{output.port}")
            self.filter_loop.sinks.append(output.send)
        sock = listen(plan.host, plan.port)
        gc.collect()
        gc.freeze()
        tasks = [asyncio.create_task(self._guard(one)) for one in inputs]
        tasks += [asyncio.create_task(self._guard(self._clock()))]
        if self.player is not None:
            self.filter_loop.least = _FAST if plan.speed is None else self.filter_loop.least
            tasks.append(asyncio.create_task(self._guard(self.player.run())))
            if plan.once:
                tasks.append(asyncio.create_task(self._until_end(self.player)))
        plan.ready(sock.getsockname()[1])
        try:
            await server.serve(sockets=[sock])
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._close()
        if self.broken is not None:
            raise self.broken

    def _resume(self) -> None:
        if self.checkpoint is None:
            return
        replay = self.plan.recording is not None
        when, message = self.checkpoint.resume(replay=replay)
        self.plan.report(message)
        if when is not None and replay:
            self.filter_loop.buffer.begin(when)
        elif when is not None:
            self.filter_loop.resume(when, self.checkpoint.age, self.checkpoint.published)

    def _inputs(self) -> list[Coroutine[Any, Any, None]]:
        """The coroutines that bring observations."""
        plan, filter_loop = self.plan, self.filter_loop
        inputs: list[Coroutine[Any, Any, None]] = []
        if plan.recording is not None:
            self.player = Player(
                filter_loop, RecordedObservations(plan.recording, plan.laps), speed=plan.speed
            )
            if filter_loop.buffer.now > 0.0:
                self.player.start_at(filter_loop.buffer.now)
            return inputs
        if plan.can:
            import can  # noqa: F401  # now, as importing it later would hold everything up
        if any(address.kind == "serial" for address in plan.nmea):
            import serial  # noqa: F401
        car, settings = plan.localizer.vehicle, plan.localizer.settings
        deliver = filter_loop.take if plan.clock == "sensor" else self._on_arrival
        for address in plan.nmea:
            health = filter_loop.sensor(_name(address), "gnss")
            offset = car.clock_offset.get("gnss", 0.0)

            def make(
                health: Any = health, offset: float = offset, name: str = _name(address)
            ) -> NmeaInput:
                wheels = None if plan.can else car  # those of a bus come first
                stream = NmeaStream(settings, offset, wheels)
                sensor = partial(filter_loop.sensor, f"{name}, sensors", "wheels")
                return NmeaInput(health, stream, deliver, sensor)

            inputs.append(READERS[address.kind](address, health, make))
        for address, dbc in plan.can:
            health = filter_loop.sensor(_name(address), "wheels")
            offset = car.clock_offset.get("can", car.clock_offset.get("odometry", 0.0))
            stream = self.buses[_name(address)] = CanStream(dbc, car, offset)
            if self.checkpoint is not None:
                stream.resume(self.checkpoint.counted.get(_name(address), {}))
            inputs.append(read_can(address, health, stream, deliver))
        return inputs

    def _on_arrival(self, health: Any, observations: Sequence[Any], arrival: float) -> None:
        """Observations get the time at which they came."""
        when = time.time() - (time.perf_counter() - arrival)
        for one in observations:
            object.__setattr__(one, "time", when)  # made a moment ago, nobody else has it
        self.filter_loop.take(health, observations, arrival)

    async def _clock(self) -> None:
        """Ticks, writes what is recorded, keeps the state."""
        loop = asyncio.get_running_loop()
        kept, job = 0.0, None
        while True:
            await asyncio.sleep(_TICK)
            if self.player is None or not (self.player.paused or self.player.ended.is_set()):
                self.filter_loop.tick()
            if job is not None and not job.done():
                continue
            if job is not None:
                job.result()  # a full disk ends the service rather than the recording alone
            now, recorder = time.monotonic(), self.filter_loop.recorder
            full = recorder is not None and recorder.waiting > _MOST_ROWS
            if now - kept >= EVERY or full:
                kept = now
                jobs = [] if recorder is None else [recorder.taken()]
                if self.checkpoint is not None:
                    jobs.append(self.checkpoint.taken(self.filter_loop.until))
                job = loop.run_in_executor(self.writer, _all, jobs) if jobs else None

    async def _until_end(self, player: Player) -> None:
        await player.ended.wait()
        await asyncio.sleep(0.2)
        self.stop()

    async def _guard(self, work: Coroutine[Any, Any, None]) -> None:
        """Whatever breaks ends the service with its reason."""
        try:
            await work
        except Exception as error:
            self.broken = self.broken or _named(error)
            self.stop()

    def _close(self) -> None:
        self.broadcaster.close()
        if self._traces is not None:
            self._traces.close()
        for output in self.plan.nmea_outputs:
            output.close()
        self.writer.shutdown(wait=True)
        if self.checkpoint is not None:
            self.checkpoint.taken(self.filter_loop.until)()
        if self.filter_loop.recorder is not None:
            self.filter_loop.recorder.close()


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
    double = Localizer(roads, vehicle=car, settings=localizer.settings, lag=lag)
    for i in range(3):
        double.take(GeoFix(float(i), lat, lon, 4.0, 0.0, 4.0))
        double.predict(i + 0.5)


def _all(jobs: list[Callable[[], None]]) -> None:
    for job in jobs:
        job()


def _name(address: Address) -> str:
    """What people read; only the last part of a device's path."""
    if address.kind in ("tcp", "udp", "listen"):
        return f"{address.kind} {address.place}:{address.number}"
    return f"{address.interface or address.kind} {address.place.rsplit('/', 1)[-1]}"


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
