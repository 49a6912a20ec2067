"""Processes that answer side by side: a lane for usual traces, and one for large ones.

A large trace never waits before a usual one.  What takes too long is ended with its process,
and a new process takes its place.
"""

import asyncio
import contextlib
import os
import struct
import sys
from collections.abc import Awaitable, Callable

from starlette.exceptions import HTTPException

from ..live.background import SURROUNDINGS
from .answering_process import framed

_CODE = f"from {__package__}.answering_process import main; main()"
_START_TIME = 180.0  # s, timeout of a process that opens the map
_BUFFER = 1 << 20  # bytes of an answer that wait to be sent on
_RETRY = 1  # s after which to ask again while all processes are busy


class TooSlow(HTTPException):
    """A request takes longer than its lane allows."""

    def __init__(self, seconds: float) -> None:
        super().__init__(413, f"the trace takes longer than {seconds:g} s")


class Answering:
    """One process."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def start(cls, plan: str) -> "Answering":
        """A process whose map is open.

        Args:
            plan: What `plan_of` gives.
        """
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", _CODE, stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE, limit=_BUFFER, env={**os.environ, **SURROUNDINGS},
        )  # fmt: skip
        found = cls(process)
        try:
            async with asyncio.timeout(_START_TIME):
                await found.ask(plan.encode())
        except BaseException:
            await found.end()
            raise
        return found

    async def ask(self, request: bytes) -> tuple[int, bytes]:
        """Status and body of a request.

        Raises:
            EOFError: The process has ended.
        """
        out, back = self._process.stdin, self._process.stdout
        assert out is not None
        assert back is not None
        try:
            out.write(framed(request))
            await out.drain()
            (size,) = struct.unpack("<I", await back.readexactly(4))
            answer = await back.readexactly(size)
        except (asyncio.IncompleteReadError, OSError) as error:
            raise EOFError from error
        return struct.unpack_from("<H", answer)[0], answer[2:]

    @property
    def has_ended(self) -> bool:
        """Whether it has ended by itself."""
        back = self._process.stdout
        return self._process.returncode is not None or (back is not None and back.at_eof())

    async def end(self) -> None:
        """End it at once."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await self._process.wait()


class Lane:
    """Some processes, and the requests that wait for one.

    Args:
        plan: What each process is told.
        processes: How many.
        waiting: Requests that may wait, at most.
        seconds: That one request may take.
    """

    def __init__(self, plan: str, processes: int, waiting: int, seconds: float) -> None:
        self._plan, self._count, self._most, self._seconds = plan, processes, waiting, seconds
        self._free: asyncio.Queue[Answering | None] = asyncio.Queue()
        self._all: set[Answering] = set()
        self._queue: dict[asyncio.Timeout, Callable[[], Awaitable[bool]] | None] = {}
        self.answered = self.refused = self.left = self.ended = 0

    @property
    def waiting(self) -> int:
        """Requests that wait for a process."""
        return len(self._queue)

    async def start(self) -> None:
        """Start the processes."""
        for one in await asyncio.gather(*(Answering.start(self._plan) for _ in range(self._count))):
            self._all.add(one)
            self._free.put_nowait(one)

    async def ask(
        self, request: bytes, has_left: Callable[[], Awaitable[bool]] | None = None
    ) -> tuple[int, bytes]:
        """Status and body of a request.

        Args:
            request: What a process is asked.
            has_left: Whether its client has left, for whom nothing is answered then.

        Raises:
            TooSlow: It takes too long.
            HTTPException: Too many wait, it takes too much memory, or the client has left.
        """
        if self.waiting >= self._most:
            await self._dismiss()
        if self.waiting >= self._most:
            self.refused += 1
            headers = {"Retry-After": str(_RETRY)}
            raise HTTPException(503, "too many requests wait; ask again", headers=headers)
        try:
            async with asyncio.timeout(None) as place:
                self._queue[place] = has_left
                one = await self._free.get()
        except TimeoutError:  # dismissed
            self.left += 1
            raise HTTPException(503, "the client has left") from None
        finally:
            self._queue.pop(place, None)
        whole = False
        try:
            if one is not None and one.has_ended:  # while it waited
                ended, one = one, None
                await self._drop(ended)
            if has_left is not None and await has_left():
                whole = True
                self.left += 1
                raise HTTPException(503, "the client has left")
            if one is None:  # its place was left by a process that has ended
                one = await Answering.start(self._plan)
                self._all.add(one)
            async with asyncio.timeout(self._seconds):
                answer = await one.ask(request)
            whole = True
            self.answered += 1
            return answer
        except TimeoutError:
            raise TooSlow(self._seconds) from None
        except EOFError:
            raise HTTPException(413, "the trace needs more than one trace may take") from None
        finally:  # also of a request that was cancelled: its answer must not reach the next
            if not whole and one is not None:
                await self._drop(one)
            self._free.put_nowait(one if whole else None)

    async def _dismiss(self) -> None:
        """Have those wait no longer whose clients have left."""
        for place, has_left in list(self._queue.items()):
            if has_left is not None and await has_left() and self._queue.pop(place, None):
                place.reschedule(0.0)

    async def _drop(self, one: Answering) -> None:
        """Count and end a process that has ended, or has to."""
        self._all.discard(one)
        self.ended += 1
        await asyncio.shield(one.end())

    async def close(self) -> None:
        """End the processes."""
        await asyncio.gather(*(one.end() for one in self._all))
