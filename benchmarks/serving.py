"""`whichroad serve` under load: 8 callers at once, bad and huge requests beside them.

Twenty simulated traces of 100 fixes in Heidelberg.  The callers, the service and the processes
that call `match` share the processors.  As many processes as the service has call
`match(lag="full")` and make its points, its path and its route's P, which an answer holds.
"""

import heapq
import http.client
import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np

import whichroad
from whichroad.simulate import simulate_drive

from . import Figure, Options

CALLERS, FIXES, TRACES = 8, 100, 20
_SECONDS = 12.0
_CODE = "from whichroad.cli import main; main()"
Rows = list[tuple[float, float, float]]  # time, lat, lon


def traces_of(roads: whichroad.RoadMap) -> list[Rows]:
    found: list[Rows] = []
    seed = 0
    while len(found) < TRACES:
        seed += 1
        fixes = simulate_drive(roads, seed=seed, length_m=2500.0).drive.fixes
        if fixes is not None and len(fixes) >= FIXES:
            columns = (fixes.time, fixes.lat_deg, fixes.lon_deg)
            found.append(list(zip(*(c[:FIXES].tolist() for c in columns), strict=True)))
    return found


def _address(rows: Rows) -> str:
    places = ";".join(f"{lon:.6f},{lat:.6f}" for _, lat, lon in rows)
    return f"/match/v1/driving/{places}?timestamps={';'.join(f'{t:.0f}' for t, _, _ in rows)}"


def matching(map_file: str, traces: list[Rows], seconds: float, lag: str | None) -> float:
    """Traces a second that one process matches by calls of `match`."""
    roads = whichroad.RoadMap.open(map_file)
    count = 0
    begin = time.perf_counter()
    for lap in range(1 << 30):
        for rows in traces:
            result = whichroad.match(rows, roads, lag=lag)
            result.to_arrow(), result.path_arrow()
            if lag is not None:
                result.routes(1)
            count += 1
        if lap == 0:  # warm
            count, begin = 0, time.perf_counter()
        elif time.perf_counter() - begin > seconds:
            break
    return count / (time.perf_counter() - begin)


def in_processes(workers: int, map_file: str, traces: list[Rows], lag: str | None) -> float:
    """The same of several processes together."""
    with ProcessPoolExecutor(workers) as pool:
        jobs = [pool.submit(matching, map_file, traces, _SECONDS, lag) for _ in range(workers)]
        return math.fsum(job.result() for job in jobs)


@contextmanager
def _service(map_file: str, workers: int) -> Iterator[int]:
    command = ["serve", "--map", map_file, "--port", "0", "--workers", str(workers)]
    process = subprocess.Popen(
        [sys.executable, "-c", _CODE, *command],
        stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert process.stdout is not None
    try:
        yield int(process.stdout.readline().rsplit(":", 1)[1].strip("/\n"))
    finally:
        process.terminate()
        process.wait()


def _ask(client: http.client.HTTPConnection, method: str, path: str, body: str | None) -> int:
    client.request(method, path, body, {"content-type": "application/json"} if body else {})
    answer = client.getresponse()
    answer.read()
    return answer.status


def _callers(port: int, traces: list[Rows], count: int, pause: float = 0.0) -> list[float]:
    """Seconds of each answer to callers that ask again as soon as they have one."""
    took: list[list[float]] = [[] for _ in range(count)]
    end = time.perf_counter() + _SECONDS
    addresses = [_address(rows) for rows in traces]

    def call(k: int) -> None:
        client = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
        at = k
        time.sleep(pause * k / count)
        while time.perf_counter() < end:
            begin = time.perf_counter()
            assert _ask(client, "GET", addresses[at % len(addresses)], None) == 200
            took[k].append(time.perf_counter() - begin)
            at += 1
            time.sleep(max(0.0, pause - took[k][-1]))

    threads = [threading.Thread(target=call, args=(k,)) for k in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [one for of in took for one in of]


def _ask_bad(client: http.client.HTTPConnection) -> None:
    assert _ask(client, "GET", "/match/v1/driving/8,49;x", None) == 400
    assert _ask(client, "POST", "/trace_route", "[" * 10_000) == 400


def _ask_huge(client: http.client.HTTPConnection, huge: str) -> None:
    assert _ask(client, "POST", "/trace_attributes", huge) == 200


def _keep_asking(port: int, huge: str | None, stop: Event, count: Any) -> None:
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=200)
    while not stop.is_set():
        _ask_bad(client) if huge is None else _ask_huge(client, huge)
        count.value += 1
        time.sleep(0.02)


@contextmanager
def _beside(huge: str | None, port: int) -> Iterator[list[int]]:
    """Requests of another kind, one after the other, until the block ends.

    They come from a process of their own, so that reading their answers does not hold up the
    threads whose time is measured.

    Args:
        huge: The body to ask about; None: bad requests.
        port: The service's.
    """
    spawn = get_context("spawn")
    stop, count, found = spawn.Event(), spawn.Value("i", 0), [0]
    process = spawn.Process(target=_keep_asking, args=(port, huge, stop, count))
    process.start()
    while process.is_alive() and not count.value:
        time.sleep(0.01)
    before = count.value
    try:
        yield found
    finally:
        stop.set()
        process.join()
        found[0] = count.value - before
        assert process.exitcode == 0


def ideal(alone: list[float], processes: int) -> float:
    """p99, ms, of callers without a pause who share one queue, first come first served.

    Args:
        alone: Seconds of the answers to a single caller, of which those of all are drawn.
        processes: That answer side by side.
    """
    took = np.random.default_rng(0).choice(alone, 20_000)
    free = [0.0] * processes
    asked = [0.0] * CALLERS
    found = []
    for each in took.tolist():
        begin = heapq.heappop(asked)
        end = max(begin, heapq.heappop(free)) + each
        heapq.heappush(free, end)
        heapq.heappush(asked, end)
        found.append(end - begin)
    return _p99(found[CALLERS:])


def _p99(took: list[float]) -> float:
    return float(np.percentile(took, 99)) * 1e3


def run(options: Options) -> list[Figure]:
    """Rates, and the time of an answer alone, among eight, and beside bad and huge requests."""
    source = options.need("maps", "heidelberg.osm.pbf")
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        map_file = str(Path(folder) / "roads.map")
        roads = whichroad.RoadMap.from_osm(source)
        roads.save(map_file)
        traces = traces_of(roads)
        full = in_processes(workers, map_file, traces, "full")
        plain = in_processes(workers, map_file, traces, None)
        huge = json.dumps(_huge(traces))

        with _service(map_file, workers) as port:
            _callers(port, traces, 1)  # warm
            alone = _callers(port, traces, 1)
            many = _callers(port, traces, CALLERS)
            again = _callers(port, traces, 1)
            alone += again  # before and after
            few = _callers(port, traces, 2 * workers)
            pause = 2.0 * CALLERS * _SECONDS / len(many)
            paced = _callers(port, traces, CALLERS, pause)
            with _beside(None, port) as bad:
                beside_bad = _callers(port, traces, CALLERS, pause)
            with _beside(huge, port) as large:
                beside_huge = _callers(port, traces, CALLERS, pause)
    return _figures(full, plain, alone, few, many, paced, beside_bad, beside_huge, bad, large)


def _huge(traces: list[Rows]) -> dict[str, Any]:
    """A request of 15,000 points: a drive again and again."""
    rows = traces[0]
    span = rows[-1][0] - rows[0][0] + 1.0
    points = [
        {"time": t + lap * span, "lat": lat, "lon": lon}
        for lap in range(150)
        for t, lat, lon in rows
    ]
    return {"shape": points, "costing": "auto"}


def _figures(
    full: float, plain: float, alone: list[float], few: list[float], many: list[float],
    paced: list[float], beside_bad: list[float], beside_huge: list[float],
    bad: list[int], large: list[int],
) -> list[Figure]:  # fmt: skip
    rate = len(many) / _SECONDS
    return [
        Figure("match, lag full, as many processes", full, "", "traces/s"),
        Figure("match, filtered, as many processes", plain, "", "traces/s"),
        Figure("8 callers at once", rate, "", "traces/s", len(many)),
        Figure("rate over that of match, lag full", rate / full, ">= 0.7"),
        Figure("rate over that of match, filtered", rate / plain, ""),
        Figure("one caller, p99", _p99(alone), "", "ms", len(alone)),
        Figure("8 callers without a pause, p99", _p99(many), "", "ms", len(many)),
        Figure("over that of one caller", _p99(many) / _p99(alone), "<= 3"),
        # eight callers who never pause wait 8 over the rate, on average
        Figure("least mean, over p99 of one caller", 1e3 * CALLERS / max(full, rate) / _p99(alone)),
        Figure("that of an ideal queue", ideal(alone, os.cpu_count() or 1) / _p99(alone)),
        Figure("two callers a processor, over one caller", _p99(few) / _p99(alone), "<= 3"),
        Figure("8 callers without a pause, median", 1e3 * float(np.median(many)), "", "ms"),
        Figure("one caller, median", 1e3 * float(np.median(alone)), "", "ms"),
        Figure("8 callers at half the rate, p99", _p99(paced), "", "ms", len(paced)),
        Figure("half the rate, over one caller", _p99(paced) / _p99(alone), "<= 3"),
        Figure("beside bad requests, over without", _p99(beside_bad) / _p99(paced), "", "", bad[0]),
        Figure("beside huge ones, over without", _p99(beside_huge) / _p99(paced), "", "", large[0]),
    ]
