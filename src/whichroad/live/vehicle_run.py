"""One vehicle of the service: its filter, its inputs and outputs, what is kept of it on disk."""

import math
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ..observations import GeoFix
from ..online import Localizer
from ..readers.names import told_of
from .addresses import Address
from .broadcaster import Broadcaster
from .can_bus import read_can
from .checkpoint import Checkpoint
from .decode import CanStream, NmeaStream
from .filter_loop import FilterLoop
from .health import Health
from .nmea_output import NmeaOutput
from .reading_lines import ReadingLines
from .recording import Recorder, folder_of, make_folder
from .sources import READERS, Deliver, NmeaInput
from .troubles import Troubles

_DELAYED = 10.0  # s by which a fix may be late; one more behind is of another clock
_LATE = "time running backwards"
Input = Callable[[], Coroutine[Any, Any, None]]  # begins to read a source, for ever
MOST_ROWS = 20_000  # rows waiting to be recorded, at most


@dataclass(slots=True)
class Fitted:
    """A vehicle and what it is fitted with.

    Attributes:
        localizer: The filter.
        name: Of the vehicle, as `?vehicle=` names it; None: it is the only one.
        nmea: Where fixes come from.
        can: Where frames come from, and the .dbc that describes them.
        readings: Where lines of JSON with readings of further sensors come from.
        record: Folder of the recording.
        state: File of the checkpoint.
        nmea_outputs: Outputs of NMEA.
    """

    localizer: Localizer
    name: str | None = None
    nmea: Sequence[Address] = ()
    can: Sequence[tuple[Address, Path]] = ()
    readings: Sequence[Address] = ()
    record: Path | None = None
    state: Path | None = None
    nmea_outputs: Sequence[NmeaOutput] = ()


class VehicleRun:
    """A vehicle while the service runs.

    Args:
        fitted: The vehicle.
        window: s by which observations may be late.
        rate: Messages a second where no fix calls for one.
        played: Whether its observations come from a recording.
        report: Takes a line for the operator.

    Raises:
        WriteError: The recording or the checkpoint cannot be written.
    """

    def __init__(
        self, fitted: Fitted, *, window: float, rate: float, played: bool = False,
        report: Callable[[str], None] = lambda line: None,
    ) -> None:  # fmt: skip
        self.fitted, self._played = fitted, played
        self.troubles = Troubles(report, fitted.name)
        self.filter_loop = FilterLoop(
            fitted.localizer, window=0.0 if played else window, rate=rate, vehicle=fitted.name,
            troubles=self.troubles,
        )  # fmt: skip
        self._newest: dict[Any, float] = {}  # own time of the last fix of an input, s
        self._folder = fitted.record
        if fitted.record is not None:
            make_folder(fitted.record)
        self.broadcaster = Broadcaster()
        self.buses: dict[str, CanStream] = {}
        self.checkpoint = (
            None if fitted.state is None else Checkpoint(fitted.state, fitted.localizer, self.buses)
        )

    def resume(self) -> None:
        """Take up the stored state and its recording, where there are; else begin them."""
        when = None
        if self.checkpoint is not None:
            when, message = self.checkpoint.resume(replay=self._played)
            self.troubles.report(message)
            if when is not None and self._played:
                self.filter_loop.buffer.begin(when)
            elif when is not None:
                self.filter_loop.resume(when, self.checkpoint.age, self.checkpoint.published)
        if self.fitted.record is not None:
            self._open_recording(self.fitted.record, resumed=when is not None)

    def _open_recording(self, folder: Path, *, resumed: bool) -> None:
        """Go on with a recording whose state was taken up; another drive gets its own folder."""
        localizer = self.fitted.localizer
        chosen = folder_of(folder, resumed=resumed)
        if chosen != folder:
            self.troubles.report(f"{folder}: holds an earlier drive; recording in {chosen}")
        about = {"map": repr(localizer.roads), "begun": time.time()}
        columns = tuple(localizer.sensor_columns.values())
        recorder = Recorder(chosen, localizer.roads, about, columns)
        self._folder = chosen
        self.filter_loop.recorder = recorder
        if not self._played:
            self.filter_loop.recorded = recorder.until

    def inputs(self, by_arrival: bool) -> list[Input]:
        """What brings observations, with the sensors' times or those of arrival."""
        fitted, filter_loop = self.fitted, self.filter_loop
        car, settings = fitted.localizer.vehicle, fitted.localizer.settings
        columns = fitted.localizer.sensor_columns
        told = told_of(columns)
        deliver = self._on_arrival if by_arrival else filter_loop.take

        def beside(at: float) -> bool:
            return filter_loop.odometry_beside(time.time() if by_arrival else at)

        def stood(at: float) -> float:
            return filter_loop.heard.stood(time.time() if by_arrival else at)

        inputs: list[Input] = []
        for address in fitted.nmea:
            health = filter_loop.sensor(name_of(address), "gnss")
            offset = car.clock_offset.get("gnss", 0.0)

            def make(
                health: Any = health, offset: float = offset, name: str = name_of(address)
            ) -> NmeaInput:
                wheels = None if fitted.can else car  # those of a bus come first
                stream = NmeaStream(settings, offset, wheels, told, beside, stood)
                sensor = partial(filter_loop.sensor, f"{name}, sensors", "wheels")
                return NmeaInput(health, stream, deliver, sensor)

            inputs.append(partial(READERS[address.kind], address, health, make))
        for address, dbc in fitted.can:
            health = filter_loop.sensor(name_of(address), "wheels")
            offset = car.clock_offset.get("can", car.clock_offset.get("odometry", 0.0))
            stream = self.buses[name_of(address)] = CanStream(dbc, car, offset, columns)
            if self.checkpoint is not None:
                stream.resume(self.checkpoint.counted.get(name_of(address), {}))
            inputs.append(partial(read_can, address, health, stream, deliver))
        for address in fitted.readings:
            health = filter_loop.sensor(name_of(address), "readings")
            lines = partial(self._lines, health, deliver)
            inputs.append(partial(READERS[address.kind], address, health, lines))
        return inputs

    def _lines(self, health: Health, deliver: Deliver) -> NmeaInput:
        """A decoder of lines of JSON for one peer; any number of peers may send readings."""
        localizer = self.fitted.localizer
        offset = localizer.vehicle.clock_offset.get("readings", 0.0)
        lines = ReadingLines(localizer.sensors, offset)
        return NmeaInput(health, lines, deliver)

    def _on_arrival(self, health: Any, observations: Sequence[Any], arrival: float) -> None:
        """Observations get the time at which they came."""
        when = time.time() - (time.perf_counter() - arrival)
        # a fix behind the one before would be taken for newer than that
        newest = self._newest.get(health, -math.inf)
        kept = [
            one for one in observations
            if not isinstance(one, GeoFix) or one.time > newest or one.time < newest - _DELAYED
        ]  # fmt: skip
        if len(kept) < len(observations):
            health.skipped_why[_LATE] += len(observations) - len(kept)
        for one in kept:
            if isinstance(one, GeoFix):
                self._newest[health] = one.time
            object.__setattr__(one, "time", when)  # made a moment ago, nobody else has it
        if kept:
            self.filter_loop.take(health, kept, arrival)

    @property
    def full(self) -> bool:
        """Whether so much waits to be recorded that it must be written now."""
        recorder = self.filter_loop.recorder
        return recorder is not None and recorder.waiting > MOST_ROWS

    def jobs(self) -> list[Callable[[], None]]:
        """What is to be written now, as calls for another thread."""
        recorder, checkpoint = self.filter_loop.recorder, self.checkpoint
        jobs: list[Callable[[], None]] = []
        if recorder is not None:
            jobs.append(partial(self._record, recorder, recorder.taken()))
        if checkpoint is not None:
            jobs.append(partial(self._store, checkpoint.taken(self.filter_loop.until)))
        return jobs

    def _record(self, recorder: Recorder, write: Callable[[], None]) -> None:
        """Write rows of the recording; a full disk costs them, not the estimates."""
        folder = self._folder
        assert folder is not None
        self._attempt(
            write, "--record", folder, "what comes meanwhile is not recorded",
            lambda: f"the recording goes on; {recorder.lost:,} rows are missing in it",
        )  # fmt: skip

    def _store(self, write: Callable[[], None]) -> None:
        """Write the state; a full disk leaves the one before."""
        path = self.fitted.state
        assert path is not None
        self._attempt(
            write, "--state", path, "the file keeps the state before",
            lambda: "the state is stored again",
        )  # fmt: skip

    def _attempt(
        self, write: Callable[[], None], option: str, path: Path, meanwhile: str,
        again: Callable[[], str],
    ) -> None:  # fmt: skip
        what = f"{option} {path.name}"
        try:
            write()
        except OSError as error:
            reason = error.strerror or str(error)
            self.troubles.begin(what, reason, (
                f"{path}: cannot be written ({reason}); {meanwhile}, and localizing goes on; it is "
                "tried again until there is space or a right to write"
            ))  # fmt: skip
        else:
            self.troubles.end(what, f"{path}: {again()}")

    def disconnect(self) -> None:
        """Close what goes out."""
        self.broadcaster.close()
        for output in self.fitted.nmea_outputs:
            output.close()

    def keep(self) -> None:
        """Write what is kept on disk; nothing more follows."""
        recorder, checkpoint = self.filter_loop.recorder, self.checkpoint
        if checkpoint is not None:
            self._store(checkpoint.taken(self.filter_loop.until))
        if recorder is not None:
            self._record(recorder, recorder.close)


def name_of(address: Address) -> str:
    """What people read; only the last part of a device's path."""
    if address.kind in ("tcp", "udp", "listen"):
        return f"{address.kind} {address.place}:{address.number}"
    return f"{address.interface or address.kind} {address.place.rsplit('/', 1)[-1]}"
