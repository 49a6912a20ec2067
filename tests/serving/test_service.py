"""`whichroad serve` as a user starts it: many callers, bad ones, huge ones."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import quote

import httpx
import numpy as np
import pandas as pd
import pytest

import whichroad
from live.service import KEEPS_PACE
from whichroad import RoadMap, Settings, Vehicle, simulate_drive
from whichroad.answers import osrm_match, trace_route
from whichroad.answers.polylines import encoded
from whichroad.live.traces import Traces
from whichroad.serving import workers
from whichroad.serving.answering_process import ATTRIBUTES, plan_of
from whichroad.serving.endpoints import Endpoints
from whichroad.serving.workers import Lane
from whichroad.simulate import draw_town

_CODE = (
    f"from whichroad.serving import workers as l; l._CODE = {KEEPS_PACE!r} + l._CODE; "
    f"from whichroad.live import traces as t; t._WORKER = {KEEPS_PACE!r} + t._WORKER; "
    "from whichroad.cli import main; main()"
)


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """A compiled map and the drawn one that it is of."""
    folder = tmp_path_factory.mktemp("town")
    (folder / "town.osm").write_text(draw_town(), encoding="utf-8")
    RoadMap.from_osm(folder / "town.osm").save(folder / "town.map")
    return folder / "town.map"


@pytest.fixture(scope="module")
def process(town):
    """The service on any free port."""
    started = subprocess.Popen(
        [sys.executable, "-c", _CODE, "serve", "--map", town, "--port", "0", "--workers", "2"],
        stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    yield started
    started.send_signal(signal.SIGINT)
    assert started.wait(120) == 0
    started.stdout.close()


@pytest.fixture(scope="module")
def base(process):
    """Its address."""
    line = process.stdout.readline().strip()
    assert line.startswith("http://127.0.0.1:")
    return line


@pytest.fixture(scope="module")
def drive(town):
    """Places and times of a minute."""
    fixes = simulate_drive(RoadMap.open(town), seed=3, length_m=1500.0).drive.fixes
    columns = (fixes.time, fixes.lat_deg, fixes.lon_deg)
    return [column[:60].tolist() for column in columns]


JSON_BODY = {"content-type": "application/json"}


def address(base, drive, more=""):
    time_, lat, lon = drive
    places = ";".join(f"{b:.6f},{a:.6f}" for a, b in zip(lat, lon, strict=True))
    return f"{base}match/v1/driving/{places}?timestamps={';'.join(f'{t:.0f}' for t in time_)}{more}"


def body_of(drive):
    names = ("time", "lat", "lon")
    shape = [dict(zip(names, row, strict=True)) for row in zip(*drive, strict=True)]
    return {"shape": shape, "costing": "auto"}


def test_the_service_answers_as_the_functions_do(base, drive, town):
    roads = RoadMap.open(town)
    url = address(base, drive, "&steps=true")
    coordinates, _, options = url.partition("driving/")[2].partition("?")
    assert httpx.get(url).json() == osrm_match(roads, coordinates, options)
    told = httpx.post(base + "trace_route", json=body_of(drive)).json()
    assert told == trace_route(roads, body_of(drive))
    again = httpx.get(base + "trace_route", params={"json": json.dumps(body_of(drive))}).json()
    assert again == told


def test_many_callers_get_their_own_answers(base, drive):
    def ask(k):
        part = [column[k : k + 30] for column in drive]
        return len(httpx.get(address(base, part)).json()["tracepoints"]), part

    with ThreadPoolExecutor(8) as callers:
        answers = list(callers.map(ask, range(40)))
    assert all(count == len(part[0]) for count, part in answers)


def test_bad_requests_are_refused_in_the_words_of_their_service(base, drive):
    for path, code in (
        ("match/v1/driving/8,49;abc", "InvalidQuery"),
        ("route/v1/driving/8,49;8,50", "InvalidService"),
        ("match/v2/driving/8,49;8,50", "InvalidVersion"),
        ("match/v1/driving", "InvalidUrl"),
        ("", "InvalidUrl"),
    ):
        answer = httpx.get(base + path)
        assert (answer.status_code, answer.json()["code"]) == (400, code)
    answer = httpx.post(base + "trace_attributes", content=b"{{{")
    assert (answer.status_code, answer.json()["error_code"]) == (400, 100)
    assert httpx.get(address(base, drive)).status_code == 200


def test_a_body_beyond_the_limit_is_refused_before_it_is_read(base):
    answer = httpx.post(base + "trace_route", content=b" " * (5 * 1024 * 1024))
    assert answer.status_code == 413


def test_a_huge_trace_goes_beside_the_usual_ones(base, drive):
    usual = address(base, drive)
    laps = [[t + 70.0 * lap for t in drive[0]] for lap in range(60)]
    long = [[t for lap in laps for t in lap], drive[1] * 60, drive[2] * 60]
    with ThreadPoolExecutor(1) as callers, httpx.Client() as client:
        huge = callers.submit(
            httpx.post, base + "trace_attributes", json=body_of(long), timeout=300
        )
        answered = 0
        while not huge.done():
            assert client.get(usual).status_code == 200
            answered += 1
    assert huge.result().status_code == 200
    assert len(huge.result().json()["matched_points"]) == 3600
    health = httpx.get(base + "health").json()
    assert health["large"]["answered"] == 1
    assert answered >= 1


def test_an_encoded_line_of_many_points_goes_to_the_large_traces(base, drive):
    before = httpx.get(base + "health").json()["large"]["answered"]
    places = [np.tile(column, 20) for column in drive[1:]]
    line = f"polyline({encoded(*places)})"
    answer = httpx.get(f"{base}match/v1/driving/{quote(line)}", timeout=300)
    body = {"encoded_polyline": encoded(*places, 6), "costing": "auto"}
    told = httpx.post(base + "trace_attributes", json=body, timeout=300)
    assert (len(answer.json()["tracepoints"]), len(told.json()["matched_points"])) == (1200, 1200)
    assert httpx.get(base + "health").json()["large"]["answered"] == before + 2


def test_words_that_are_no_text_are_answered_and_end_no_process(base, drive):
    before = httpx.get(base + "health").json()["usual"]["ended"]
    odd = '{"costing": "\\ud800"}', json.dumps(body_of(drive) | {"id": "\ud800 100%25"})
    refused, taken = (httpx.post(base + "trace_route", content=one) for one in odd)
    assert (refused.status_code, refused.json()["error_code"]) == (400, 125)
    assert (taken.status_code, taken.json()["id"]) == (200, "\ud800 100%25")
    asked = httpx.get(base + "trace_route", params={"json": odd[1]})
    assert asked.json() == taken.json()
    assert httpx.get(base + "health").json()["usual"]["ended"] == before


def test_what_is_too_slow_for_the_usual_lane_is_answered_by_the_large_one(town, drive, monkeypatch):
    monkeypatch.setattr(workers, "_CODE", KEEPS_PACE + workers._CODE)

    async def asked():
        plan = [plan_of(town, Vehicle(), Settings(), 1000, last) for last in (False, True)]
        usual, large = Lane(plan[0], 1, 8, 1e-4), Lane(plan[1], 1, 8, 300.0)
        traces = Traces(RoadMap.open(town), Vehicle(), Settings(), town)
        await asyncio.gather(usual.start(), large.start())
        try:
            app = Endpoints(usual, large, traces).application(True, None)
            transport = httpx.ASGITransport(app)
            async with httpx.AsyncClient(transport=transport) as client:
                answer = await client.get(address("http://localhost/", drive))
            return answer.status_code, usual.ended, large.answered
        finally:
            traces.close()
            await asyncio.gather(usual.close(), large.close())

    assert asyncio.run(asked()) == (200, 1, 1)


def signal_all(process, number):
    """Send a signal to all processes that the service started."""
    if not Path("/proc/self/task").exists():
        pytest.skip("no list of processes here")
    found = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    for pid in found.split():
        os.kill(int(pid), number)


def test_a_process_that_dies_is_replaced(base, drive, process):
    signal_all(process, signal.SIGKILL)
    end = time.monotonic() + 300.0
    codes = []
    while time.monotonic() < end and codes[-3:] != [200] * 3:
        codes.append(httpx.get(address(base, drive), timeout=300).status_code)
    assert codes[-3:] == [200] * 3
    assert set(codes) <= {200, 413}


def test_a_process_that_died_while_it_waited_costs_no_request(town, drive):
    async def asked():
        lane = Lane(plan_of(town, Vehicle(), Settings(), 1000, False), 1, 8, 300.0)
        await lane.start()
        try:
            (one,) = lane._all
            one._process.kill()
            await one._process.wait()
            body = json.dumps(body_of(drive)).encode()
            return (await lane.ask(ATTRIBUTES + body))[0], lane.ended, len(lane._all)
        finally:
            await lane.close()

    assert asyncio.run(asked()) == (200, 1, 1)


def test_nothing_is_answered_to_those_who_have_left(base, drive, process):
    """Its two processes stand still until twelve have asked and left."""

    def counts():
        return httpx.get(base + "health", timeout=300).json()["usual"]

    host, port = base.removeprefix("http://").rstrip("/").split(":")
    path = address("/", [[*range(600)], *(column * 10 for column in drive[1:])])
    lines = f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
    before, callers = counts(), []
    signal_all(process, signal.SIGSTOP)
    try:
        for _ in range(12):
            callers.append(socket.create_connection((host, int(port))))
            callers[-1].sendall(lines)
        end = time.monotonic() + 60.0
        while counts()["waiting"] < 10 and time.monotonic() < end:
            time.sleep(0.01)
        assert counts()["waiting"] == 10
        for caller in callers:
            caller.close()
        counts()  # the service has read that they left
    finally:
        signal_all(process, signal.SIGCONT)
    assert httpx.get(address(base, drive), timeout=300).status_code == 200
    after = counts()
    assert after["left"] - before["left"] == 10
    assert after["answered"] - before["answered"] <= 3


class Slow:
    """A process that answers after a while."""

    def __init__(self, has_ended=False):
        self.has_ended, self.was_ended = has_ended, False
        self.go = asyncio.Event()

    async def ask(self, _request):
        """An empty answer."""
        await self.go.wait()
        return 200, b""

    def end(self):
        """Say so."""
        self.was_ended = True
        return asyncio.sleep(0)


def test_those_who_have_left_take_no_place_from_those_who_wait():
    async def asked():
        lane, one, gone = Lane("", 1, 2, 10.0), Slow(), set()
        lane._free.put_nowait(one)

        def ask(name):
            return asyncio.create_task(lane.ask(b"", lambda: asyncio.sleep(0, name in gone)))

        tasks = []
        for name in "abc":
            tasks.append(ask(name))
            await asyncio.sleep(0.01)
        gone.add("b")
        for name in "de":
            tasks.append(ask(name))
            await asyncio.sleep(0.01)
        one.go.set()
        answers = await asyncio.gather(*tasks, return_exceptions=True)
        counts = lane.answered, lane.left, lane.refused, lane.waiting
        return [str(getattr(a, "detail", a[0] if type(a) is tuple else a)) for a in answers], counts

    told, counts = asyncio.run(asked())
    left, many = "the client has left", "too many requests wait; ask again"
    assert told == ["200", left, "200", "200", many]
    assert counts == (3, 1, 1, 0)


def test_a_process_that_died_is_ended_before_another_takes_its_place(monkeypatch):
    async def asked():
        lane, dead, new = Lane("", 1, 2, 10.0), Slow(has_ended=True), Slow()
        new.go.set()
        monkeypatch.setattr(workers.Answering, "start", lambda _plan: asyncio.sleep(0, new))
        lane._free.put_nowait(dead)
        return (await lane.ask(b""))[0], dead.was_ended, new.was_ended, lane.ended

    assert asyncio.run(asked()) == (200, True, False, 1)


def test_other_hosts_and_origins_are_not_served(base):
    assert httpx.get(base + "health", headers={"host": "example.org"}).status_code == 403
    refused = httpx.get(base + "health", headers={"origin": "http://example.org"})
    assert refused.status_code == 403


def test_a_trace_can_be_posted_as_to_live(base, drive, town):
    def posted(rows, more="", **head):
        text = "time,lat,lon\n" + "\n".join(f"{t},{a},{b}" for t, a, b in rows)
        head = {"content-type": "text/csv", **head}
        return httpx.post(f"{base}match{more}", content=text, headers=head, timeout=300)

    def answered():
        return httpx.get(base + "health").json()["usual"]["answered"]

    rows, before = list(zip(*drive, strict=True)), answered()
    answer = posted(rows)
    assert answer.status_code == 200
    points = whichroad.match(pd.DataFrame(rows, columns=["time", "lat", "lon"]), town).points
    told = answer.json()["points"]
    assert [one["edge_id"] for one in told] == points.edge_id.tolist()
    assert [one["lat"] for one in told] == pytest.approx(points.lat.tolist(), abs=1e-9)
    part = posted(rows, "?give=path&lag=full", **{"accept-encoding": "gzip"})
    assert part.headers["content-encoding"] == "gzip"
    assert set(part.json()) == {"version", "path", "summary"}
    assert answered() == before + 2
    laps = [
        (round(t + 70.0 * lap, 1), round(a, 5), round(b, 5))
        for lap in range(17)
        for t, a, b in rows
    ]
    assert len(posted(laps).json()["points"]) == len(laps)  # more than the usual lane takes


def test_traces_of_many_callers_are_matched_side_by_side(base, drive):
    rows = [dict(zip(("time", "lat", "lon"), row, strict=True)) for row in zip(*drive, strict=True)]

    def ask(n):
        told = httpx.post(base + "match", json=rows[: 20 + n], timeout=300)
        return told.status_code == 200 and len(told.json()["points"]) == 20 + n

    with ThreadPoolExecutor(6) as callers:
        assert all(callers.map(ask, range(40)))


def test_what_cannot_be_matched_is_refused_with_what_a_client_can_do(base):
    empty = httpx.post(base + "match", json=[])
    assert (empty.status_code, "no rows" in empty.json()["error"]) == (422, True)
    other = httpx.post(base + "match", json=[{"a": 1}]).json()["error"]
    assert other.endswith("; rename the columns")
    meant = httpx.post(base + "match", json=[{"ts_x": 1, "lat": 49.4, "lon": 8.7}]).json()["error"]
    assert meant.endswith("; did you mean time=ts_x? rename the columns so")
    huge = httpx.post(base + "match", content=b" " * (17 * 2**20), headers=JSON_BODY)
    assert huge.status_code == 413
