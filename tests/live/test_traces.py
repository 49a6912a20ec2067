"""Posted traces: matched beside the filter, one at a time, and never larger than the memory."""

import asyncio
import contextlib
import gzip
import io
import json
import os
import select
import shutil
import socket
import struct
import subprocess
import sys
import time

import httpx
import numpy as np
import pandas
import pyarrow as pa
import pytest
import requests
from jsonschema import Draft202012Validator

from live.service import Served, drive_files, refusal_of
from whichroad import match, read_vehicle
from whichroad.errors import ReadError
from whichroad.live import trace_worker, traces
from whichroad.live.schemas import schemas
from whichroad.live.trace_limits import (
    MOST_BYTES,
    MOST_ROWS,
    TooLargeTrace,
    check_size,
    stream_of,
)
from whichroad.readers import drive_from_table

ARROW, CSV, JSON = "application/vnd.apache.arrow.stream", "text/csv", "application/json"


def columns_of(ride, rows):
    """Times and places of so many fixes, the drive over and over."""
    fixes = ride.drive.fixes
    laps = -(-rows // len(fixes))
    span = fixes.time[-1] - fixes.time[0] + 1.0
    time_ = np.concatenate([fixes.time + lap * span for lap in range(laps)])[:rows]
    return {
        "time": time_,
        "lat": np.tile(fixes.lat_deg, laps)[:rows],
        "lon": np.tile(fixes.lon_deg, laps)[:rows],
    }


def as_arrow(columns, compression=None, schema=None):
    table = pa.table(columns) if schema is None else pa.table(columns, schema)
    sink = io.BytesIO()
    options = pa.ipc.IpcWriteOptions(compression=compression)
    with pa.ipc.new_stream(sink, table.schema, options=options) as writer:
        writer.write_table(table)
    return sink.getvalue()


def as_csv(columns):
    rows = zip(*columns.values(), strict=True)
    return ("time,lat,lon\n" + "\n".join(f"{t},{a},{b}" for t, a, b in rows)).encode()


def as_json(columns):
    return json.dumps({name: values.tolist() for name, values in columns.items()}).encode()


def path_as_json(path):
    """GeoJSON whose times are written as those of the points."""
    times = {
        name: [
            None
            if pandas.isna(moment)
            else f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 1000:03d}Z"
            for moment in path[name]
        ]
        for name in ("enter_time", "exit_time")
    }
    return json.loads(path.assign(**times).to_json(drop_id=True))


# Limits, before anything is decoded


@pytest.mark.parametrize("compression", [None, "lz4", "zstd"])
def test_a_stream_of_allowed_size_passes_in_every_compression(ride, compression):
    check_size(as_arrow(columns_of(ride, 5000), compression), ".arrow")


@pytest.mark.parametrize("compression", [None, "lz4", "zstd"])
def test_rows_are_counted_before_they_are_decoded(compression):
    nulls = as_arrow({"a": pa.nulls(MOST_ROWS + 1)}, compression)
    with pytest.raises(TooLargeTrace, match="200,000 rows"):
        check_size(nulls, ".arrow")
    zeros = as_arrow({"time": np.zeros(MOST_ROWS + 1)}, compression)
    with pytest.raises(TooLargeTrace, match="200,000 rows"):
        check_size(zeros, ".arrow")


def test_rows_of_all_batches_are_counted():
    table = pa.table({"time": np.zeros(150_000)})
    sink = io.BytesIO()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
        writer.write_table(table)
    with pytest.raises(TooLargeTrace, match="200,000 rows"):
        check_size(sink.getvalue(), ".arrow")


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_decompressed_bytes_are_counted_before_they_are_decompressed(compression):
    columns = {f"c{i}": np.zeros(100_000) for i in range(100)}
    data = as_arrow(columns, compression)
    assert len(data) < MOST_BYTES / 100
    with pytest.raises(TooLargeTrace, match="bytes, decompressed"):
        check_size(data, ".arrow")


def test_a_dictionary_counts_too():
    words = pa.DictionaryArray.from_arrays(pa.array([0]), pa.array(["x" * 1000] * 100_000))
    with pytest.raises(TooLargeTrace, match="bytes, decompressed"):
        check_size(as_arrow({"a": words}, "zstd"), ".arrow")


def as_file(columns):
    table, sink = pa.table(columns), io.BytesIO()
    with pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
    return sink.getvalue()


def test_a_file_is_taken_as_the_stream_within_it(ride):
    columns = columns_of(ride, 100)
    stream = stream_of(as_file(columns))
    assert pa.ipc.open_stream(stream).read_all() == pa.table(columns)
    assert stream_of(stream) is stream
    with pytest.raises(TooLargeTrace):
        check_size(stream_of(as_file({"time": np.zeros(MOST_ROWS + 1)})), ".arrow")
    with pytest.raises(ReadError, match="Arrow stream"):
        stream_of(b"FEA1" + bytes(100))


@pytest.mark.parametrize("seed", range(5))
def test_what_is_counted_is_what_arrow_decodes(ride, seed):
    rng = np.random.default_rng(seed)
    rows = int(rng.integers(1, 3000))
    columns = columns_of(ride, rows)
    columns |= {f"c{i}": rng.normal(size=rows) for i in range(seed)}
    data = as_arrow(columns, ["lz4", "zstd"][seed % 2])
    decoded = pa.ipc.open_stream(data).read_all()
    size = sum(b.size for c in decoded.columns for k in c.chunks for b in k.buffers() if b)
    import whichroad.live.trace_limits as limits

    found = [
        (limits._Table.root(head).table(2), body)
        for head, body in limits._messages(memoryview(data))
        if limits._Table.root(head).number(1, "B") == 3
    ]
    assert sum(batch.number(0, "q") for batch, _ in found) == decoded.num_rows
    assert sum(limits._decompressed(*one) for one in found) == pytest.approx(size, abs=64 * 20)


@pytest.mark.parametrize("seed", range(200))
def test_a_damaged_stream_is_a_read_error_or_passes(ride, seed):
    rng = np.random.default_rng(seed)
    data = bytearray(as_arrow(columns_of(ride, 50), "zstd"))
    for _ in range(int(rng.integers(1, 6))):
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
    data = bytes(data[: int(rng.integers(1, len(data) + 1))])
    with contextlib.suppress(ReadError):
        check_size(data, ".arrow")


@pytest.mark.parametrize(
    ("suffix", "data"),
    [
        (".json", b"[" + b"[]," * 5_000_000 + b"[]]"),
        (".json", b"[" + b"{}," * 5_000_000 + b"{}]"),
        (".json", b'{"time":[' + b"1.5," * 3_000_000 + b"1]}"),
        (".csv", b"time,lat,lon\n" + b"1\n" * 8_000_000),
        (".csv", b"time,lat,lon\r" + b"1\r" * 8_000_000),
        (".csv", b"a," * 8_000_000),
        (".gpx", b"<gpx>" + b"<a/>" * 4_000_000),
        (".gpx", b"<gpx><trk><trkseg>" + b"<trkpt/>" * 2_000_000),
        (".nmea", b"$\n" * 8_000_000),
    ],
    ids=range(9),
)
def test_texts_that_stand_for_too_much_are_refused(suffix, data):
    with pytest.raises(TooLargeTrace, match="at most"):
        check_size(data, suffix)


# Over HTTP


@pytest.fixture(scope="module")
def served(files):
    options = ("--map", files / "town.map", *drive_files(files / "drive"))
    with Served(*options, "--speed", 1) as one:
        one.until(lambda said: said["answered"])
        assert one.control("pause")[0] == 200  # traces are matched: no test asks where it is
        yield one


def post(served, body, kind, **headers):
    for _ in range(1200):  # another trace may be being matched
        status, said = served.ask("POST", "/match", body, {"content-type": kind, **headers})
        if status != 429:
            return status, json.loads(said)
        time.sleep(0.1)
    raise AssertionError("it stays busy")


@pytest.mark.parametrize("rows", [1, 7, 100, 10_000])
def test_an_answer_in_pieces_is_the_whole(town, ride, monkeypatch, rows):
    monkeypatch.setattr(trace_worker, "_ROWS_AT_ONCE", rows)
    result = match(drive_from_table(pa.table(columns_of(ride, 200))), town)
    said = json.loads("".join(trace_worker.answer_of(result)))
    assert len(result.path) > 7
    points = result.points.drop(columns="geometry")
    assert said["points"] == json.loads(points.to_json(orient="records", date_format="iso"))
    assert said["path"] == path_as_json(result.path)


@pytest.fixture(scope="module")
def matched(files, ride, town):
    """Columns, and what `match` says of them: rows as JSON and a path, but for the drive's name."""
    columns = columns_of(ride, 2500)
    car = read_vehicle(files / "drive" / "vehicle.toml")
    result = match(drive_from_table(pa.table(columns), vehicle=car), town, vehicle=car)
    points = result.points.drop(columns="geometry")
    return columns, json.loads(points.to_json(orient="records", date_format="iso")), result.path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "kind"), [(as_csv, CSV), (as_json, JSON), (as_arrow, ARROW), (as_file, ARROW)]
)
def test_an_answer_is_that_of_match(served, matched, make, kind):
    columns, points, path = matched
    status, said = post(served, make(columns), kind)
    assert status == 200
    name = said["summary"]["drive_id"]
    assert said["points"] == [{**row, "drive_id": name} for row in points]
    assert said["path"] == path_as_json(path.assign(drive_id=name))
    assert said["version"] == 1
    assert said["summary"]["epochs"] == 2500
    rows = said["points"][: None if kind == JSON else 9]  # all have the same: a schema is slow
    Draft202012Validator(schemas()["match"]).validate({**said, "points": rows})


STRANGE = [  # bodies, their formats, and the status of the refusal
    (b'{"time": [99999999999999999999999], "lat": [1], "lon": [2]}', JSON, (400, 422)),
    (b'[{"time": 1, "lat": 99999999999999999999999, "lon": 2}]', JSON, (400, 422)),
    (b"time,lat,lon\n99999999999999999999999,1,2\n", CSV, (422,)),
    (b'{"time": [1e999], "lat": [1], "lon": [2]}', JSON, (400, 422)),
    (b'[{"time": -1e20, "lat": 49.4115, "lon": 2.8267}]', JSON, (422,)),
    (as_arrow({"time": pa.array([2**64 - 1], pa.uint64()), "lat": [1.0], "lon": [2.0]}), ARROW,
     (422,)),
    (as_arrow({"time": np.zeros(20_000_000, np.int8)}, "zstd"), ARROW, (413,)),
    (as_arrow({"time": pa.nulls(100_000_000)}, "zstd"), ARROW, (413,)),
    (b"[" + b"[]," * 5_000_000 + b"[]]", JSON, (413,)),
    (b"\x1f\x8b\x08\x00" + bytes(100), CSV, (422,)),
]  # fmt: skip
SUFFIXES = {ARROW: ".arrow", CSV: ".csv", JSON: ".json"}


def assert_one_sentence(said):
    assert len(said) < 200
    assert ".py" not in said


@pytest.mark.parametrize(("body", "kind", "status"), STRANGE, ids=range(len(STRANGE)))
def test_what_stands_for_too_much_is_a_4xx_with_one_sentence(files, tmp_path, body, kind, status):
    """As the process that matches says it, but in this one."""
    refused = refusal_of(body, SUFFIXES[kind], files, tmp_path)
    assert refused.status in status
    assert_one_sentence(refused.why)


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 2, 7])  # at reading, at matching, at checking the size
def test_a_refusal_comes_over_http_too(served, which):
    body, kind, status = STRANGE[which]
    got, said = post(served, body, kind)
    assert got in status
    assert_one_sentence(said["error"])


@pytest.mark.slow
def test_a_body_in_another_encoding_is_refused(served):
    headers = {"content-type": CSV, "content-encoding": "gzip"}
    status, said = served.ask("POST", "/match", b"x", headers)
    assert status == 415
    assert "encoding" in json.loads(said)["error"]


def held(served):
    """A connection whose trace is being received, and stays so."""
    for _ in range(100):
        one = socket.create_connection(("127.0.0.1", served.port), timeout=100)
        one.sendall(
            b"POST /match HTTP/1.1\r\nHost: localhost\r\nContent-Type: text/csv\r\n"
            b"Content-Length: 1000000\r\n\r\ntime,lat,lon\n"
        )
        if not select.select([one], [], [], 0.3)[0]:  # else another one is still being matched
            return one
        one.close()
    raise AssertionError("it is always busy")


BODY = b"time,lat,lon\n" + b"1,49.4,8.7\n" * 1_000_000


@pytest.mark.slow
@pytest.mark.parametrize("expect", [False, True])
def test_who_comes_meanwhile_is_told_before_the_body_is_read(served, expect, tmp_path):
    """By curl, httpx and requests, with a body that is larger than what is read of it."""
    first = held(served)
    url = f"http://127.0.0.1:{served.port}/match"
    headers = {"Content-Type": CSV, **({"Expect": "100-continue"} if expect else {})}
    with httpx.Client(timeout=100) as client:
        for _ in range(3):
            answer = client.post(url, content=BODY, headers=headers)
            assert (answer.status_code, answer.headers["retry-after"]) == (429, "2")
            assert answer.json() == {"error": "another trace is being matched"}
    for _ in range(3):
        said = requests.post(url, data=BODY, headers=headers, timeout=100)
        assert (said.status_code, said.headers["retry-after"]) == (429, "2")
        assert said.json() == {"error": "another trace is being matched"}
    curl = shutil.which("curl")
    if curl is not None:
        (tmp_path / "body").write_bytes(BODY)
        wanted = "Expect: 100-continue" if expect else "Expect:"
        for _ in range(3):
            done = subprocess.run(
                [curl, "-s", "-S", "-i", "-H", f"Content-Type: {CSV}", "-H", wanted,
                 "--data-binary", f"@{tmp_path / 'body'}", url],
                capture_output=True, text=True,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            assert done.stdout.startswith("HTTP/1.1 429 "), done.stdout
            assert "retry-after: 2" in done.stdout.lower()
            assert "100 Continue" not in done.stdout
    first.close()


@pytest.mark.slow
def test_a_client_that_waits_to_be_asked_for_its_body_is_asked_where_it_is_taken(served, ride):
    body = as_csv(columns_of(ride, 30))
    head = (
        f"POST /match HTTP/1.1\r\nHost: localhost\r\nContent-Type: {CSV}\r\nConnection: close\r\n"
        f"Content-Length: {len(body)}\r\nExpect: 100-continue\r\n\r\n"
    )
    one, said = None, b""
    while one is None or said.startswith(b"HTTP/1.1 429"):  # until the trace before is given up
        if one is not None:
            one.close()
        one = socket.create_connection(("127.0.0.1", served.port), timeout=60)
        one.sendall(head.encode())
        said = one.recv(1000)
    assert said.startswith(b"HTTP/1.1 100 ")
    one.sendall(body)
    said = b""
    while data := one.recv(65536):
        said += data
    assert said.startswith(b"HTTP/1.1 200 ")
    one.close()


def workers(served):
    """Processes that the service started and that live."""
    folder = f"/proc/{served.process.pid}/task/{served.process.pid}/children"
    with open(folder) as file:
        return [int(pid) for pid in file.read().split()]


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="needs Linux's /proc")
def test_the_worker_ends_with_its_client_and_with_the_service(files, ride):
    body = as_csv(columns_of(ride, 150_000))
    head = (
        f"POST /match HTTP/1.1\r\nHost: localhost\r\nContent-Type: {CSV}\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    ).encode()
    options = ("--map", files / "town.map", *drive_files(files / "drive"))
    with Served(*options) as service:
        service.until(lambda said: said["answered"])

        def begin():
            client = socket.create_connection(("127.0.0.1", service.port), timeout=100)
            client.sendall(head + body)
            return client, until(lambda: workers(service))[0]

        client, worker = begin()
        client.close()
        until(lambda: not workers(service))
        assert post(service, as_csv(columns_of(ride, 30)), CSV)[0] == 200
        client, worker = begin()
        service.kill()
        until(lambda: state(worker) == "Z")
        client.close()
    with Served(*options, gives_way=True) as service:
        service.until(lambda said: said["answered"])
        client, worker = begin()
        until(lambda: os.getpriority(os.PRIO_PROCESS, worker) == 19)
        service.stop()
        until(lambda: state(worker) == "Z")
        client.close()


@pytest.mark.skipif(os.name != "posix", reason="folders are cleared on POSIX only")
def test_what_a_killed_service_has_left_is_removed_and_nothing_else(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    names = (f"{gone.pid}-a", f"{os.getpid()}-b", "other")
    folders = [tmp_path / f"whichroad-traces-{name}" for name in names]
    for folder in folders:
        folder.mkdir()
        (folder / "body").write_text("x")
    traces._remove_left(tmp_path)
    assert [folder.exists() for folder in folders] == [False, True, True]


def until(holds, seconds=120.0):
    """What something is, as soon as it is true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := holds():
            return found
        time.sleep(0.02)
    raise AssertionError("it did not happen")


def state(pid):
    """Of a process, as Linux names it; Z: it has ended."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


@pytest.mark.slow
def test_a_map_that_is_not_a_compiled_file_is_matched_on_as_well(files, town, ride, tmp_path):
    from whichroad.simulate import draw_town

    (tmp_path / "town.osm").write_text(draw_town(), encoding="utf-8")
    options = ("--map", tmp_path / "town.osm", *drive_files(files / "drive"))
    with Served(*options) as service:
        service.until(lambda said: said["answered"])
        status, said = post(service, as_csv(columns_of(ride, 100)), CSV)
    assert status == 200
    assert len(said["points"]) == 100


@pytest.mark.slow
@pytest.mark.parametrize("chunked", [False, True])
def test_a_body_that_is_cut_short_is_a_400_with_one_sentence(served, chunked):
    for path in ("/match", "/control"):
        length = "Transfer-Encoding: chunked" if chunked else "Content-Length: 1000"
        start = b"100\r\n{" if chunked else b"{"
        said = b""
        while not said or said.startswith(b"HTTP/1.1 429"):
            with socket.create_connection(("127.0.0.1", served.port), timeout=100) as one:
                one.sendall(
                    f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {JSON}\r\n"
                    f"{length}\r\n\r\n".encode()
                    + start
                )
                time.sleep(0.1)
                one.shutdown(socket.SHUT_WR)
                said = b""
                while data := one.recv(65536):
                    said += data
        assert said.startswith(b"HTTP/1.1 400 ")
        error = json.loads(said.partition(b"\r\n\r\n")[2])["error"]
        assert error == "the body ended before it was complete"


def test_metadata_of_an_arrow_message_is_read_as_pyarrow_wrote_it():
    """The oracle of the flat buffers' reader: numbers that pyarrow says itself."""
    import whichroad.live.trace_limits as limits

    data = as_arrow({"time": np.arange(7.0)})
    heads = [limits._Table.root(head) for head, _ in limits._messages(memoryview(data))]
    assert [head.number(1, "B") for head in heads] == [1, 3]
    reader = pa.ipc.MessageReader.open_stream(data)
    lengths = [message.body.size if message.body else 0 for message in reader]
    assert [head.number(3, "q") for head in heads] == lengths
    assert struct.unpack("<I", data[:4]) == (0xFFFFFFFF,)


def test_a_second_trace_may_begin_with_the_end_of_the_first(served, ride):
    async def run():
        async with httpx.AsyncClient(timeout=60) as client:
            for _ in range(3):
                answer = await client.post(
                    f"http://127.0.0.1:{served.port}/match",
                    content=as_csv(columns_of(ride, 30)), headers={"content-type": CSV},
                )  # fmt: skip
                assert answer.status_code == 200

    asyncio.run(run())


def as_geojson(columns, name):
    """A LineString with the times of its vertices."""
    line = [[lon, lat] for lat, lon in zip(columns["lat"], columns["lon"], strict=True)]
    times = {name: [float(t) for t in columns["time"]]}
    geometry = {"type": "LineString", "coordinates": line}
    return json.dumps({"type": "Feature", "geometry": geometry, "properties": times}).encode()


@pytest.mark.slow
def test_a_line_with_times_is_smoothed_masked_and_answered_by_its_path_alone(
    served, files, ride, town
):
    columns = {name: values[:90] for name, values in columns_of(ride, 100).items()}
    car = read_vehicle(files / "drive" / "vehicle.toml")
    result = match(
        drive_from_table(pa.table(columns), vehicle=car), town, vehicle=car, lag="full",
        mask=[(20.0, 40.0)],
    )  # fmt: skip
    for kind, name in (("application/geo+json", "coordTimes"), (JSON, "times")):
        head = {"content-type": kind, "accept-encoding": "gzip"}
        address = "/match?lag=full&mask=20:40&give=path"
        status, body = served.ask("POST", address, as_geojson(columns, name), head)
        assert (status, body[:2]) == (200, b"\x1f\x8b")  # compressed, as was asked
        said = json.loads(gzip.decompress(body))
        assert said.keys() == {"version", "path", "summary"}
        assert said["summary"]["fixes_masked"] == result.summary["fixes_masked"] > 10
        expected = path_as_json(result.path.assign(drive_id=said["summary"]["drive_id"]))
        assert said["path"] == expected


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("lag=soon", "full"), ("mask=9:3", "ends before"), ("mask=now", "START:END"),
        ("give=all of it", "points, path"), ("lags=3", "unknown"), ("mask=1:inf", "finite"),
        ("vehicle=none", "no vehicle"),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_an_option_that_is_none_is_told_before_the_body_is_read(served, query, words):
    head = {"content-type": CSV}
    status, said = served.ask("POST", f"/match?{query.replace(' ', '+')}", b"x", head)
    assert status == (404 if "vehicle" in query else 400)
    assert words in json.loads(said)["error"]
