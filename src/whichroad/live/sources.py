"""Where fixes and lines of readings come from: serial ports, TCP, UDP, standard input.

A source that is lost is taken up again, first after a moment, then more patiently.  Bytes
are never collected: what the filter cannot take in time is left to the sender, or dropped.
"""

import asyncio
import contextlib
import os
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from ..errors import SettingError
from ..observations import Observation
from .addresses import Address
from .decode import NmeaStream
from .health import Health
from .reading_lines import ReadingLines
from .senders import OneSender

Deliver = Callable[[Health, Sequence[Observation], float], None]

QUIET = 0.03  # s of silence that end a burst
_DEAD = 15.0  # s without a byte, after which a connection is renewed
FIRST, _MOST = 0.2, 5.0  # s, first and longest wait between two tries
_MOST_BYTES = 500_000  # bytes per second, at most; 460,800 baud are 46,000
_TOO_FAST = "piece of data that came too fast"
_MOST_PEERS = 16  # peers of a listening port, at most


class NmeaInput:
    """One stream of NMEA bytes into the filter.

    Args:
        health: Of the input.
        stream: A decoder of its own.
        deliver: Takes the fixes.
        sensors: Gives the health of the wheels and the gyro that a receiver reads, once there are
            any.

    Attributes:
        useful: When a fix came out last, on the clock of `time.perf_counter`.
        port: Decides which sender of its port is listened to; None: it has a port of its own.
        peer: The address of that sender.
    """

    def __init__(
        self,
        health: Health,
        stream: NmeaStream | ReadingLines,
        deliver: Deliver,
        sensors: Callable[[], Health] | None = None,
    ) -> None:
        self.useful = 0.0
        self.port: OneSender | None = None
        self.peer = "an unknown address"
        self._sensors = sensors or (lambda: health)
        self._health, self._stream, self._deliver = health, stream, deliver
        self._counted: Counter[str] = Counter()  # what the decoder had skipped
        self._quiet: asyncio.TimerHandle | None = None
        self._arrival = 0.0
        self._allowance, self._filled = float(_MOST_BYTES), time.perf_counter()

    def __str__(self) -> str:
        return self.peer

    def feed(self, data: bytes, arrival: float | None = None) -> None:
        """Take bytes that came at `arrival` (now unless given)."""
        now = time.perf_counter()
        self._arrival = now if arrival is None else arrival
        self._health.open()
        self._allowance += (now - self._filled) * _MOST_BYTES
        self._allowance, self._filled = min(self._allowance, _MOST_BYTES), now
        if len(data) > self._allowance:
            self._health.skipped_why[_TOO_FAST] += 1
            return
        self._allowance -= len(data)
        fixes = self._stream.feed(data)
        self._count()
        sensed = self._stream.sensed()
        if sensed and self.port is not None and not self.port.hears(self):
            self._health.refused += len(sensed)
        elif sensed:
            wheels = self._sensors()
            wheels.open()
            self._deliver(wheels, sensed, self._arrival)
        readings = self._stream.readings()
        if readings and (self.port is None or self.port.hears(self)):
            self._deliver(self._health, readings, self._arrival)
        self._pass_on(fixes)
        if self._quiet is not None:
            self._quiet.cancel()
        self._quiet = asyncio.get_running_loop().call_later(QUIET, self._flush)

    @property
    def exhausted(self) -> float:
        """Seconds that a sender who can wait should be left waiting."""
        return 0.0 if self._allowance > 65_536 else 0.1

    def end(self) -> None:
        """Nothing follows: what waits for more is passed on now."""
        if self._quiet is not None:
            self._quiet.cancel()
        self._flush()

    def _flush(self) -> None:
        self._pass_on(self._stream.flush())
        self._count()

    def _count(self) -> None:
        """Add what the decoder has skipped since the last call."""
        if self._stream.skipped != self._counted.total():
            now = self._stream.skipped_why
            self._health.skipped_why += now - self._counted
            self._counted = now

    def _pass_on(self, fixes: Sequence[Observation]) -> None:
        if fixes and self.port is not None and not self.port.takes(self):
            self._health.refused += len(fixes)
        elif fixes:
            self.useful = time.perf_counter()
            self._health.receiver = self._stream.receiver
            self._deliver(self._health, fixes, self._arrival)


def reason_of(error: Exception) -> str:
    """Why a source cannot be opened or read, without its path."""
    number = getattr(error, "errno", None)
    if number is not None and number > 0:
        return os.strerror(number)
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def _cannot_open(address: Address, error: OSError) -> SettingError:
    return SettingError(
        f"{address.kind}://{address.place}:{address.number} cannot be opened ({reason_of(error)}); "
        "a free address of this machine was expected; choose another"
    )


async def _drain(reader: asyncio.StreamReader, into: NmeaInput) -> str:
    """Take what a connection sends until it ends, breaks or is silent for too long; why."""
    try:
        while data := await asyncio.wait_for(reader.read(1 << 14), _DEAD):
            into.feed(data)
            if into.exhausted:
                await asyncio.sleep(into.exhausted)
    except TimeoutError:
        return f"nothing came for {_DEAD:g} s"
    except OSError as error:
        return reason_of(error)
    return "the other side has closed the connection"


async def read_tcp(address: Address, health: Health, make: Callable[[], NmeaInput]) -> None:
    """Read from a server, for ever."""
    wait = FIRST
    while True:
        writer = None
        try:
            reader, writer = await asyncio.open_connection(
                address.place, address.number, limit=1 << 16
            )
            _keep_alive(writer.get_extra_info("socket"))
            health.open()
            wait = FIRST
            why = await _drain(reader, make())
        except OSError as error:
            why = reason_of(error)
        finally:
            if writer is not None:
                writer.close()
        health.lose(why)
        await asyncio.sleep(wait)
        wait = min(2.0 * wait, _MOST)


def _keep_alive(sock: Any) -> None:
    if sock is not None:
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)


def _one_peer_less(peers: dict[Any, NmeaInput]) -> Any:
    """The peer idle for longest, where there are too many: it is to be dropped."""
    return None if len(peers) < _MOST_PEERS else min(peers, key=lambda one: peers[one].useful)


def _of_peer(made: NmeaInput, port: OneSender, address: Sequence[Any] | None) -> NmeaInput:
    """An input of one sender of a port."""
    made.port = port
    if address:
        made.peer = f"{address[0]}:{address[1]}"
    return made


async def listen_tcp(address: Address, health: Health, make: Callable[[], NmeaInput]) -> None:
    """Let receivers connect to us, for ever; each has a decoder, one of them is listened to."""
    peers: dict[asyncio.StreamWriter, NmeaInput] = {}
    served: set[Any] = set()
    port = OneSender(health.name, health.troubles)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        served.add(asyncio.current_task())
        if (idle := _one_peer_less(peers)) is not None:
            del peers[idle]
            idle.transport.abort()
        into = peers[writer] = _of_peer(make(), port, writer.get_extra_info("peername"))
        try:
            await _drain(reader, into)
        finally:
            into.end()  # later it would hold the port again
            port.leaves(into)
            peers.pop(writer, None)
            writer.transport.abort()
            served.discard(asyncio.current_task())

    try:
        server = await asyncio.start_server(serve, address.place, address.number, limit=1 << 16)
    except OSError as error:
        raise _cannot_open(address, error) from None
    try:
        await asyncio.Event().wait()
    finally:
        server.close()
        for writer in peers:
            writer.transport.abort()  # its task ends by itself: one that is cancelled is logged
        if served:
            await asyncio.wait(served)


async def read_udp(address: Address, health: Health, make: Callable[[], NmeaInput]) -> None:
    """Take datagrams, for ever; each sender has a decoder, one of them is listened to."""
    senders: dict[Any, NmeaInput] = {}
    port = OneSender(health.name, health.troubles)

    class Datagrams(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: Any) -> None:
            into = senders.get(addr)
            if into is None:
                if (idle := _one_peer_less(senders)) is not None:
                    dropped = senders.pop(idle)
                    dropped.end()  # later it would hold the port again
                    port.leaves(dropped)
                into = senders[addr] = _of_peer(make(), port, addr)
            into.feed(data if data.endswith(b"\n") else data + b"\r\n")

    try:
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            Datagrams, local_addr=(address.place, address.number)
        )
    except OSError as error:
        raise _cannot_open(address, error) from None
    try:
        await asyncio.Event().wait()
    finally:
        transport.close()


async def read_serial(address: Address, health: Health, make: Callable[[], NmeaInput]) -> None:
    """Read a serial port in a thread of its own, for ever; it may be unplugged and plugged in."""
    import serial

    into = make()

    def work(stop: threading.Event, pass_on: Callable[[bytes, float], None]) -> None:
        wait = FIRST
        while not stop.is_set():
            try:
                with serial.Serial(address.place, address.number, timeout=0.2) as port:
                    wait = FIRST
                    health.open()
                    while not stop.is_set():
                        if data := port.read(max(1, port.in_waiting)):
                            pass_on(data, time.perf_counter())
            except TypeError:  # closed under a read
                health.lose("the port was closed")
            except (serial.SerialException, OSError) as error:
                health.lose(reason_of(error))
            stop.wait(wait)
            wait = min(2.0 * wait, 1.0)

    await in_thread(work, into.feed)


async def read_standard_input(
    address: Address, health: Health, make: Callable[[], NmeaInput]
) -> None:
    """Read what is piped in, in a thread of its own, until it ends."""
    into = make()

    def work(stop: threading.Event, pass_on: Callable[[bytes, float], None]) -> None:
        health.open()
        data = b"more"
        while data and not stop.is_set():
            try:
                data = os.read(0, 1 << 14)
            except OSError as error:
                health.lose(reason_of(error))
                return
            pass_on(data, time.perf_counter())
            stop.wait(len(data) / _MOST_BYTES)

    def take(data: bytes, arrival: float) -> None:
        if data:
            into.feed(data, arrival)
        else:
            into.end()
            health.link = "ended"

    await in_thread(work, take)


async def in_thread(
    work: Callable[[threading.Event, Callable[[Any, float], None]], None],
    take: Callable[[Any, float], None],
    look: Callable[[], None] = lambda: None,
) -> None:
    """Run `work` in a thread; what it passes on is taken here, in the loop.

    Args:
        work: Ends soon after its event is set.
        take: Takes what was passed on, and when that came.
        look: Called now and then meanwhile.
    """
    loop, stop = asyncio.get_running_loop(), threading.Event()

    def pass_on(what: Any, arrival: float) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: we are going
            loop.call_soon_threadsafe(take, what, arrival)

    thread = threading.Thread(target=work, args=(stop, pass_on), daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            await asyncio.sleep(0.5)
            look()
    finally:
        stop.set()


READERS = {
    "tcp": read_tcp, "listen": listen_tcp, "udp": read_udp, "serial": read_serial,
    "standard": read_standard_input,
}  # fmt: skip
