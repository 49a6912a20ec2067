"""Random bytes, half-open sockets and slow writers on each port; the true stream goes on."""

import os
import random
import socket
import threading
import time

from .. import Figure, Options
from .latency import ms
from .process import Feed, Listening, Served, can_options, latencies, quantile
from .world import world

_SENDERS = 4  # of each kind and port


def rubbish(options: Options) -> list[Figure]:
    """Whether every fix is still served, and how late."""
    seconds = options.more.get("seconds", 20.0)
    ports = [free_port() for _ in range(2)]
    with world() as here:
        sources = ("--nmea", f"listen://127.0.0.1:{ports[0]}", "--nmea")
        sources += (f"udp://127.0.0.1:{ports[1]}", *can_options(here))
        options_ = (*here.options(), *sources, "--nmea-out", "tcp://127.0.0.1:0")
        with Served(*options_, out=True) as served:
            true = knock(ports[0])
            feed = Feed(here, true.sendall)
            served.answered()
            stop = threading.Event()
            threads = [
                threading.Thread(target=work, args=(port, stop, number))
                for port in (served.port, ports[0], served.out)
                for work in (random_bytes, half_open, slow)
                for number in range(_SENDERS)
            ]
            threads += [
                threading.Thread(target=random_datagrams, args=(ports[1], stop, number))
                for number in range(_SENDERS)
            ]
            for thread in threads:
                thread.start()
            listening, begin = Listening(served.port, seconds), time.perf_counter()
            heard = listening.heard()
            until = time.perf_counter()
            stop.set()
            for thread in threads:
                thread.join()
            lives = served.process.poll() is None and served.get("/health") is not None
            memory = served.memory()
            feed.stop()
            true.close()
    sent = {k: at for k, at in feed.sent.items() if begin < at < until - 0.5}
    found = latencies(sent, heard, 0)
    return [
        Figure("the service lives", float(lives), ">= 1", "", len(threads)),
        Figure("fixes of the true stream served", 100.0 * len(found) / max(len(sent), 1),
               ">= 100", "%", len(sent)),
        Figure("sentence in to estimate out meanwhile, p99", ms(quantile(found, 0.99)), "", "ms",
               len(found)),
        Figure("resident memory", memory, "", "MB"),
    ]  # fmt: skip


def free_port():
    """A port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def knock(port):
    """A connection, as soon as there is somebody."""
    for _ in range(200):
        try:
            one = socket.create_connection(("127.0.0.1", port))
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return one
        except ConnectionRefusedError:
            time.sleep(0.05)
    raise RuntimeError("nobody listens")


def random_bytes(port, stop, number):
    """Noise, also dressed as requests and sentences, as fast as it is taken."""
    rng = random.Random(number)
    heads = (
        b"",
        b"GET /ws HTTP/1.1\r\n",
        b"POST /match HTTP/1.1\r\nHost: localhost\r\n",
        b"$GPGGA,",
    )
    while not stop.is_set():
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1.0) as one:
                one.sendall(rng.choice(heads))
                for _ in range(rng.randrange(1, 50)):
                    if stop.wait(0.002):
                        break
                    one.sendall(os.urandom(rng.randrange(1, 4000)))
        except OSError:
            stop.wait(0.02)


def random_datagrams(port, stop, number):
    """Noise by UDP."""
    rng = random.Random(number)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        while not stop.wait(0.002):
            one.sendto(os.urandom(rng.randrange(1, 1400)), ("127.0.0.1", port))


def half_open(port, stop, number):
    """Connections that begin, and say no more."""
    held = []
    while not stop.wait(0.2):
        try:
            one = socket.create_connection(("127.0.0.1", port), timeout=1.0)
            one.sendall((b"", b"GET / HTTP/1.1\r\nHost: loc", b"$GPGGA,12")[number % 3])
            held.append(one)
        except OSError:
            pass
        if len(held) > 50:
            held.pop(0).close()
    for one in held:
        one.close()


def slow(port, stop, number):
    """A request, or a sentence, byte by byte."""
    text = b"GET /estimate HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 1000
    while not stop.is_set():
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=1.0) as one:
                for letter in text:
                    if stop.wait(0.05):
                        break
                    one.sendall(bytes((letter,)))
        except OSError:
            stop.wait(0.1)
