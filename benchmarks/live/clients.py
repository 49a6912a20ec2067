"""Two hundred WebSockets, one of which never reads."""

import selectors
import subprocess
import sys
import time

from .. import Figure, Options
from .latency import ms
from .process import (
    Feed,
    Listener,
    Listening,
    Receiver,
    Served,
    ahead,
    can_options,
    latencies,
    quantile,
    shake,
)
from .world import world

MOST = 200
_CROWD = "from benchmarks.live.clients import crowd; import sys; crowd(int(sys.argv[1]))"


def clients(options: Options) -> list[Figure]:
    """Latency of one listener without and among 199 others and one that is stalled.

    Service and listener go before other processes where that is permitted: what the service
    adds is measured, not what else the machine does.
    """
    seconds = options.more.get("seconds", 20.0)
    with world() as here:
        receiver = Receiver()
        sources = ("--nmea", f"tcp://127.0.0.1:{receiver.port}", *can_options(here))
        with Served(*here.options(), *sources, first=ahead()) as served:
            feed = Feed(here, receiver.send)
            served.answered()
            alone = hear(served.port, feed, 0.5 * seconds)
            stalled = shake(served.port, 4096)
            others = subprocess.Popen([sys.executable, "-c", _CROWD, str(served.port)])
            end = time.monotonic() + 30.0
            while served.get("/health")["listeners"] < MOST - 1 and time.monotonic() < end:
                time.sleep(0.1)
            most = served.get("/health")["listeners"]
            among = hear(served.port, feed, seconds)
            feed.stop()
            health = served.get("/health")
            others.kill()
            others.wait()
            stalled.close()
        receiver.close()
    delay = ms(quantile(among, 0.99) - quantile(alone, 0.99))
    n = len(among)
    return [
        Figure("listeners", float(most), f">= {MOST - 1}"),
        Figure("sentence in to estimate out, alone, p99", ms(quantile(alone, 0.99)), "", "ms", n),
        Figure("the same among them, p99", ms(quantile(among, 0.99)), "", "ms", n),
        Figure("delayed by", delay, "<= 10", "ms", n),
        Figure("dropped, the stalled one", float(health["dropped"]), "1..1", "", MOST),
        Figure("listeners in the end", float(health["listeners"]), f">= {MOST - 2}"),
    ]


def hear(port, feed, seconds):
    """Latencies of a listener for so long."""
    listening, begin = Listening(port, seconds, ahead()), time.perf_counter()
    heard = listening.heard()
    return latencies({k: at for k, at in feed.sent.items() if at > begin}, heard)


def crowd(port):
    """Listeners that read and answer pings, until they are killed."""
    watch = selectors.DefaultSelector()
    for _ in range(MOST - 2):
        one = Listener(port)
        watch.register(one.socket, selectors.EVENT_READ, one)
    while True:
        for key, _ in watch.select():
            if not key.data.read():
                watch.unregister(key.data.socket)
            key.data.heard.clear()
