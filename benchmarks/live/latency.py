"""From the sentence's sending to the message's arrival, in real time, process to process."""

from .. import Figure, Options
from .process import Feed, Listening, Receiver, Served, ahead, can_options, latencies, quantile
from .world import world


def latency(options: Options) -> list[Figure]:
    """10 Hz GNSS over TCP, 100 Hz wheels over CAN, one WebSocket; then the same before others."""
    seconds = options.more.get("seconds", 20.0)
    figures = measured(seconds, (), "")
    if ahead():
        figures += measured(seconds, ahead(), ", chrt -f 10")
    return figures


def measured(seconds: float, first: tuple[str, ...], how: str) -> list[Figure]:
    """Rows of one service, started behind the command `first`."""
    with world() as here:
        receiver = Receiver()
        sources = ("--nmea", f"tcp://127.0.0.1:{receiver.port}", *can_options(here))
        with Served(*here.options(), *sources, first=first) as served:
            feed = Feed(here, receiver.send)
            served.answered()
            heard = Listening(served.port, seconds, first).heard()
            feed.stop()
            own = served.get("/health")
        receiver.close()
    found = latencies(feed.sent, heard)
    n = len(found)
    wheels = next(s for s in own["sensors"] if s["kind"] == "wheels")
    return [
        Figure(f"sentence in to estimate out, p50{how}", ms(quantile(found, 0.5)), "", "ms", n),
        Figure(f"sentence in to estimate out, p99{how}", ms(quantile(found, 0.99)), "<= 5", "ms",
               n),
        Figure(f"the same as the service sees it, p99{how}", own["latency_ms"]["p99"], "", "ms", n),
        Figure(f"wheel readings taken{how}", wheels["rate_hz"], ">= 95", "1/s", wheels["count"]),
        Figure(f"observations refused{how}", float(sum(own["skipped"].values())), "<= 0", "", n),
    ]  # fmt: skip


def ms(seconds):
    """Milliseconds."""
    return None if seconds is None else 1e3 * seconds
