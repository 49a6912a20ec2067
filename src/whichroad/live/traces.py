"""`POST /match`: traces matched in a process of their own, one at a time.

The body goes to a file as it comes, the worker writes the answer to another one, and that is
sent.  So the filter never waits, and memory is given back when the worker ends.
"""

import asyncio
import contextlib
import json
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from ..page.compressed import takes_gzip
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .background import SURROUNDINGS
from .refusals import BODY_TIME
from .trace_options import TraceOptions, trace_options
from .trace_worker import ANSWER, BODY, REFUSAL, REQUEST, request

LARGEST_TRACE = 16 * 1024 * 1024  # bytes
_KINDS = {
    "text/csv": ".csv",
    "application/json": ".json",
    "application/geo+json": ".json",
    "application/gpx+xml": ".gpx",
    "application/vnd.apache.arrow.stream": ".arrow",
    "text/plain": ".nmea",
}
_NAME = "whichroad-traces-"  # begin of the names of folders; the process's number follows
_MATCH_TIME = 120.0  # s, timeout of the worker
_ANSWER_TIME = 120.0  # s, timeout of the answer's delivery
_PIECE = 65_536  # bytes of the answer that are sent at once
_WRITTEN = 262_144  # bytes of the body that are written at once
_WORKER = (  # importing what it needs is done at low priority too
    f"from {__package__}.background import give_way; give_way(); "
    f"from {__package__}.trace_worker import main; main()"
)
_RETRY = 2  # s after which to ask again while another trace is matched


class Asked(NamedTuple):
    """A request: the body's format, how it is matched, and for which car."""

    suffix: str
    options: TraceOptions
    vehicle: Vehicle
    settings: Settings
    gzip: bool


class Traces:
    """Matches posted traces on the service's map.

    Args:
        roads: The map.
        vehicle: The car, where a request asks for no other.
        settings: The model's numbers, likewise.
        compiled: The file that `roads` is of, if it is one; None: it is written when needed.
    """

    def __init__(
        self, roads: RoadMap, vehicle: Vehicle, settings: Settings, compiled: Path | None = None
    ) -> None:
        self._roads, self._vehicle, self._settings = roads, vehicle, settings
        self._compiled = compiled
        self._stamp = None if compiled is None else _stamp(compiled)
        self._current: object | None = None  # marks the trace that is being matched
        self._folder: Path | None = None
        self._making = threading.Lock()  # of that folder
        self._worker: asyncio.subprocess.Process | None = None

    async def answer(
        self, request: Request, vehicle: Vehicle | None = None, settings: Settings | None = None
    ) -> Response:
        """The handler of the endpoint.

        Args:
            request: With the trace as its body.
            vehicle: The car; None: the service's.
            settings: The model's numbers; None: the service's.

        Raises:
            HTTPException: It is refused.
        """
        _kind_of(request)
        if self._current is not None:
            headers = {"Retry-After": str(_RETRY)}
            raise HTTPException(429, "another trace is being matched", headers=headers)
        return _Matching(self, self.asked(request, vehicle, settings))

    def asked(
        self, request: Request, vehicle: Vehicle | None = None, settings: Settings | None = None
    ) -> Asked:
        """What a request asks for, as `answer` takes it.

        Raises:
            HTTPException: It is refused.
        """
        kind = _kind_of(request)
        gzip = takes_gzip(request.headers.get("accept-encoding", ""))
        options = trace_options(request.query_params)
        car, numbers = vehicle or self._vehicle, settings or self._settings
        return Asked(kind, options, car, numbers, gzip)

    def close(self) -> None:
        """End what is being done, and remove what was written."""
        if self._worker is not None and self._worker.returncode is None:
            self._worker.kill()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    async def run(self, asked: Asked, receive: Receive, send: Send) -> None:
        """Take a body, match it and send the answer.

        Raises:
            HTTPException: The trace cannot be matched.
            ClientDisconnect: The client has left.
        """
        if self._current is not None:
            raise HTTPException(429, "another trace is being matched")
        self._current = mine = object()
        folder = None
        try:
            folder = await asyncio.to_thread(self._new_folder)
            await self._spool_body(folder, receive)
            text = request(
                asked.suffix, asked.options, await self._map(), asked.vehicle, asked.settings,
                gzip=asked.gzip,
            )  # fmt: skip
            await self._work(folder, text, receive)
            with (folder / ANSWER).open("rb") as file:
                await self._send(file, send, asked.gzip)
        finally:
            if folder is not None:
                await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)
            if self._current is mine:
                self._current = None

    @contextlib.asynccontextmanager
    async def written(self, asked: Asked, body: bytes) -> AsyncIterator[Path]:
        """A folder with a request and its body for another process, and removed after it."""
        folder = await asyncio.to_thread(self._new_folder)
        try:
            text = request(
                asked.suffix, asked.options, await self._map(), asked.vehicle, asked.settings,
                gzip=asked.gzip,
            )  # fmt: skip
            (folder / REQUEST).write_text(text, encoding="utf-8")
            (folder / BODY).write_bytes(body)
            yield folder
        finally:
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)

    async def _send(self, file: BinaryIO, send: Send, gzip: bool) -> None:
        """Send an answer piece by piece, as fast as it is taken; with the last, be free again."""
        left = os.fstat(file.fileno()).st_size
        headers: list[Any] = [
            (b"content-type", b"application/json"), (b"content-length", str(left).encode()),
            (b"vary", b"accept-encoding"),
        ]  # fmt: skip
        if gzip:
            headers.append((b"content-encoding", b"gzip"))
        async with asyncio.timeout(_ANSWER_TIME):
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            while left:
                piece = await asyncio.to_thread(file.read, _PIECE)
                left -= len(piece)
                if not left:
                    self._current = None
                await send({"type": "http.response.body", "body": piece, "more_body": left > 0})

    def _new_folder(self) -> Path:
        """A folder for one trace, within one for all of this service."""
        with self._making:
            if self._folder is None:
                _remove_left(_place())
                made = tempfile.mkdtemp(prefix=f"{_NAME}{os.getpid()}-", dir=_place())
                self._folder = Path(made)
        return Path(tempfile.mkdtemp(dir=self._folder))

    async def _spool_body(self, folder: Path, receive: Receive) -> None:
        waiting = bytearray()
        with (folder / BODY).open("wb") as file:
            try:
                async with asyncio.timeout(BODY_TIME):
                    more = True
                    while more:
                        message = await receive()
                        if message["type"] == "http.disconnect":
                            raise ClientDisconnect
                        waiting += message.get("body", b"")
                        more = message.get("more_body", False)
                        if len(waiting) >= _WRITTEN or not more:
                            await asyncio.to_thread(file.write, bytes(waiting))
                            waiting.clear()
            except TimeoutError:
                raise HTTPException(408, "the body did not come in time") from None

    async def _work(self, folder: Path, asked: str, receive: Receive) -> None:
        """Run the worker until it has ended, or the client has left."""
        (folder / REQUEST).write_text(asked, encoding="utf-8")
        worker = self._worker = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _WORKER, str(folder),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL, env={**os.environ, **SURROUNDINGS},
        )  # fmt: skip
        ended, left = asyncio.create_task(worker.wait()), asyncio.create_task(_left(receive))
        try:
            done, _ = await asyncio.wait(
                (ended, left), timeout=_MATCH_TIME, return_when=asyncio.FIRST_COMPLETED
            )
        finally:
            left.cancel()
            with contextlib.suppress(ProcessLookupError):
                worker.kill()
            await ended
            await asyncio.gather(left, return_exceptions=True)
            self._worker = None
        if ended not in done:
            if left in done:
                raise ClientDisconnect
            raise HTTPException(413, f"the trace takes longer than {_MATCH_TIME:g} s")
        refusal = folder / REFUSAL
        if refusal.exists():
            said = json.loads(refusal.read_text("utf-8"))
            raise HTTPException(said["status"], said["error"])
        if worker.returncode:
            if worker.returncode < 0:  # the system has ended it
                raise HTTPException(413, "the trace needs more memory than one trace may take")
            raise HTTPException(500, "internal error of the service; please report it")

    async def _map(self) -> Path:
        """A compiled file of the map that the service has."""
        if self._compiled is None or _stamp(self._compiled) != self._stamp:
            assert self._folder is not None
            compiled = self._folder / "roads.map"
            await asyncio.to_thread(self._roads.save, compiled)
            self._compiled, self._stamp = compiled, _stamp(compiled)
        return self._compiled


def _kind_of(request: Request) -> str:
    """The format of a body, as a suffix.

    Raises:
        HTTPException: It is none that is taken.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in _KINDS:
        raise HTTPException(415, f"one of {', '.join(_KINDS)} was expected")
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise HTTPException(415, "a body without a content encoding was expected")
    return _KINDS[kind]


class _Matching(Response):
    """A response that is made while it is sent."""

    def __init__(self, traces: Traces, asked: Asked) -> None:
        super().__init__()
        self._traces, self._asked = traces, asked

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._traces.run(self._asked, receive, send)


def _place() -> Path:
    """Where files are written: on a disk, as the usual place may be memory."""
    disk = Path("/var/tmp")
    given = any(name in os.environ for name in ("TMPDIR", "TEMP", "TMP"))
    return disk if not given and os.access(disk, os.W_OK) else Path(tempfile.gettempdir())


def _remove_left(place: Path) -> None:
    """Remove what services that were killed have left."""
    for folder in place.glob(f"{_NAME}*-*"):
        pid = folder.name[len(_NAME) :].partition("-")[0]
        if pid.isdecimal() and not _lives(int(pid)):
            shutil.rmtree(folder, ignore_errors=True)


def _lives(pid: int) -> bool:
    """Whether there is a process of that number, as far as the system tells."""
    if os.name != "posix":
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _stamp(path: Path) -> tuple[int, int] | None:
    """Tells whether a file was replaced."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


async def _left(receive: Receive) -> None:
    """Wait until the client leaves."""
    while (await receive())["type"] != "http.disconnect":
        pass
