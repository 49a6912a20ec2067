"""Latency of estimates while `/match` takes traces, against the same without; what is refused."""

import json
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np

from .. import Figure, Options
from .latency import ms
from .process import Feed, Listening, Receiver, Served, ahead, can_options, latencies, quantile
from .world import world

SIZES = (6_000, 60_000, 200_000)
KINDS = {
    "csv": "text/csv",
    "json": "application/json",
    "arrow": "application/vnd.apache.arrow.stream",
}
_POST = "from benchmarks.live.matching import post; import sys; post(*sys.argv[1:])"


def matching(options: Options) -> list[Figure]:
    """Ten fixes and a hundred wheel readings a second; one client posts again and again."""
    seconds = options.more.get("seconds", 20.0)
    with world(30_000.0) as here:
        bodies = {
            (kind, rows): body_file(here, kind, rows) for kind in KINDS for rows in SIZES
        }  # fmt: skip
        receiver = Receiver()
        sources = ("--nmea", f"tcp://127.0.0.1:{receiver.port}", *can_options(here))
        with Served(*here.options(), *sources, first=ahead()) as served:
            feed = Feed(here, receiver.send)
            served.answered()
            time.sleep(3.0)
            quiet = interval(served, feed, seconds)
            found, answers = {}, {}
            for (kind, rows), path in bodies.items():
                command = [sys.executable, "-c", _POST, str(served.port), str(path), KINDS[kind]]
                client = subprocess.Popen(
                    ["nice", "-n", "19", *command, str(seconds)], stdout=subprocess.PIPE, text=True
                )
                found[kind, rows] = interval(served, feed, seconds)
                answers[kind, rows] = json.loads(client.communicate()[0])
                options.say(f"{kind} {rows}: {answers[kind, rows]}")
            again = interval(served, feed, seconds)
            feed.stop()
            health = served.get("/health")
        receiver.close()
    base = max(quantile(quiet, 0.99), quantile(again, 0.99))
    figures = [
        Figure("quiet, p50", ms(quantile(quiet, 0.5)), "", "ms", len(quiet)),
        Figure("quiet before, p99", ms(quantile(quiet, 0.99)), "", "ms", len(quiet)),
        Figure("quiet after, p99", ms(quantile(again, 0.99)), "", "ms", len(again)),
    ]
    for (kind, rows), one in found.items():
        counts = answers[kind, rows]
        name = f"{rows:,} rows as {kind}"
        figures += [
            Figure(f"{name}: traces matched", float(counts.get("200", 0)), ">= 1", "", 1),
            Figure(f"{name}: p99", ms(quantile(one, 0.99)), "", "ms", len(one)),
            Figure(f"{name}: p99 over quiet", quantile(one, 0.99) / base, "<= 2", "", len(one)),
        ]
    everything = sorted(at for one in found.values() for at in one)
    own = [sensor["skipped"] for sensor in health["sensors"]]
    return [
        *figures,
        Figure("all while matching, p99", ms(quantile(everything, 0.99)), "", "ms",
               len(everything)),
        Figure("the same over quiet", quantile(everything, 0.99) / base, "<= 2", "",
               len(everything)),
        Figure("observations refused", float(sum(health["skipped"].values()) + sum(own)), "<= 0",
               "", sum(sensor["count"] for sensor in health["sensors"])),
    ]  # fmt: skip


def interval(served, feed, seconds):
    """Sorted latencies of the fixes that are sent within so many seconds from now."""
    listening, begin = Listening(served.port, seconds + 0.5, ahead()), time.perf_counter()
    heard = listening.heard()
    end = begin + seconds
    return latencies({k: at for k, at in feed.sent.items() if begin < at < end}, heard, 2)


def body_file(here, kind, rows):
    """A trace of so many fixes, the drive over and over, as a file."""
    import pyarrow as pa

    fixes = here.drive.fixes
    laps = -(-rows // len(fixes))
    span = float(fixes.time[-1] - fixes.time[0]) + 1.0
    columns = {
        "time": np.concatenate([fixes.time + lap * span for lap in range(laps)])[:rows].round(2),
        "lat": np.tile(fixes.lat_deg, laps)[:rows].round(8),
        "lon": np.tile(fixes.lon_deg, laps)[:rows].round(8),
    }
    path = here.folder / f"{rows}.{kind}"
    if kind == "json":
        path.write_text(json.dumps({name: values.tolist() for name, values in columns.items()}))
    elif kind == "csv":
        lines = (f"{t},{a},{b}\n" for t, a, b in zip(*columns.values(), strict=True))
        path.write_text("time,lat,lon\n" + "".join(lines))
    else:
        table = pa.table(columns)
        with pa.OSFile(str(path), "wb") as file, pa.ipc.new_stream(file, table.schema) as writer:
            writer.write_table(table)
    return path


def post(port, path, kind, seconds):
    """Post a file again and again; print how often which status came."""
    end = time.monotonic() + float(seconds) - 0.5
    with open(path, "rb") as file:
        body = file.read()
    counts = {}
    while time.monotonic() < end:
        asked = urllib.request.Request(
            f"http://127.0.0.1:{port}/match", body, {"Content-Type": kind}
        )
        try:
            with urllib.request.urlopen(asked, timeout=300) as answer:
                status = answer.status
                while answer.read(1 << 20):
                    pass
        except urllib.error.HTTPError as error:
            status = error.code
        counts[status] = counts.get(status, 0) + 1
    print(json.dumps(counts))
