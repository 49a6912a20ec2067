"""From the sentence's sending to the message's arrival, in real time, process to process."""

import threading

from .. import Figure, Options
from .process import Feed, Listener, Receiver, Served, can_options, latencies, quantile
from .world import world


def latency(options: Options) -> list[Figure]:
    """10 Hz GNSS over TCP, 100 Hz wheels over CAN, one WebSocket."""
    seconds = options.more.get("seconds", 20.0)
    with world() as here:
        receiver = Receiver()
        sources = ("--nmea", f"tcp://127.0.0.1:{receiver.port}", *can_options(here))
        with Served(*here.options(), *sources) as served:
            feed = Feed(here, receiver.send)
            served.answered()
            listener = Listener(served.port)
            done = threading.Event()
            threading.Timer(seconds, done.set).start()
            while not done.is_set() and listener.read():
                pass
            feed.stop()
            own = served.get("/health")
        receiver.close()
    found = latencies(feed.sent, listener.heard)
    n = len(found)
    wheels = next(s for s in own["sensors"] if s["kind"] == "wheels")
    return [
        Figure("sentence in to estimate out, p50", ms(quantile(found, 0.5)), "", "ms", n),
        Figure("sentence in to estimate out, p99", ms(quantile(found, 0.99)), "<= 5", "ms", n),
        Figure("the same as the service sees it, p99", own["latency_ms"]["p99"], "", "ms", n),
        Figure("wheel readings taken", wheels["rate_hz"], ">= 95", "1/s", wheels["count"]),
        Figure("observations refused", float(sum(own["skipped"].values())), "<= 0", "", n),
    ]


def ms(seconds):
    """Milliseconds."""
    return None if seconds is None else 1e3 * seconds
