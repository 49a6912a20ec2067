"""Fleets: what the command costs beside the filter, in any order, killed, poisoned.

Rates are by processor seconds of all processes, each part beside `match_many` on the same rows
in the same minute.  Trips are drives simulated in Heidelberg, with a fix every five seconds;
each comes several times, with errors of its own and at another time.

    python -m benchmarks fleet [--parts cost,order,memory,kill,poison,open,first,split,speeds,spark]
                               [--drives TRIPS]

The part `memory` has also twenty times as many trips.  `spark` needs Java 17.
"""

import ctypes
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import whichroad
from whichroad.simulate import drivable, random_route, simulate_drive

from . import Figure, Options, Skipped
from .spark_jobs import descendants

TRIPS = 4000
FIXES = 250  # of a trip
STEP = 5  # s between fixes
DRIVES = 40  # that are simulated
NOISE = 2.0  # m, the copies' own
KILLS = 20
MANY = 20  # times as many trips for the memory
MONTHS = 3  # vehicles of a month that all engines split
SPREAD = 0.1  # log, of edges, of drivers and of passages
PARTS = ("cost", "order", "memory", "kill", "poison", "open", "first", "split", "speeds",
         "spark")  # fmt: skip


def run(options: Options) -> list[Figure]:
    """All parts, or those that are asked for."""
    parts = options.more.get("parts")
    chosen = parts.split(",") if parts else PARTS
    figures: list[Figure] = []
    adopt()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(options, Path(folder))
        for part in chosen:
            options.say(f"{part}, load {os.getloadavg()[0]:.1f}")
            figures += getattr(bench, part)()
    return figures


def spent() -> float:
    """Processor seconds of this process and of those of its children that have ended."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def adopt() -> None:
    """Become the parent of all orphans: workers are children of a process that nobody awaits."""
    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER of Linux


def await_orphans() -> None:
    """Wait until all descendants have ended, so that their time is counted."""
    try:
        while True:
            os.waitpid(-1, 0)
    except ChildProcessError:
        return


def cost(work: Callable[[], Any]) -> float:
    """Processor seconds of a call."""
    before = spent()
    work()
    return spent() - before


class Bench:
    """A map, a table of trips, and a folder."""

    def __init__(self, options: Options, folder: Path) -> None:
        self.folder, self.trips = folder, int(options.more.get("drives", TRIPS))
        self.roads = whichroad.RoadMap.from_osm(options.need("maps", "heidelberg.osm.pbf"))
        self.map = folder / "heidelberg.map"
        self.roads.save(self.map)
        self.drives = self._drives()
        self.table = self._table(self.trips)
        self.source = folder / "sorted.parquet"
        pq.write_table(self.table, self.source, row_group_size=1 << 16)
        time.sleep(2.5)  # the map's time of change tells changes from now on

    def _drives(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Latitudes and longitudes of drives, a fix every STEP seconds."""
        allowed = drivable(self.roads.arrays, np.random.default_rng(0))
        found = []
        for seed in range(3000, 3000 + DRIVES):
            drive = simulate_drive(self.roads, seed=seed, length_m=18_000.0, allowed=allowed).drive
            assert drive.fixes is not None
            every = slice(0, FIXES * STEP, STEP)
            found.append((drive.fixes.lat_deg[every], drive.fixes.lon_deg[every]))
        return found

    def _table(self, trips: int, first: int = 0) -> pa.Table:
        """Trips one behind the other."""
        rng = np.random.default_rng(first)
        names, times, lats, lons = [], [], [], []
        for k in range(first, first + trips):
            lat, lon = self.drives[k % len(self.drives)]
            n = len(lat)
            names += [f"trip {k:07}"] * n
            times.append(1.7e9 + 97.0 * k + STEP * np.arange(n))
            lats.append(lat + rng.normal(0, NOISE / 111e3, n))
            lons.append(lon + rng.normal(0, NOISE / 72e3, n))
        columns = [np.concatenate(part) for part in (times, lats, lons)]
        return pa.table(
            dict(zip(("trip_id", "time", "lat", "lon"), [names, *columns], strict=True))
        )

    def fleet(
        self, source: Path, out: str, *more: str, workers: int = 2
    ) -> subprocess.Popen[bytes]:
        """The command, as a process of its own."""
        shutil.rmtree(self.folder / out, ignore_errors=True)
        return self.command(source, out, *more, workers=workers)

    def command(
        self, source: Path, out: str, *more: str, workers: int = 2
    ) -> subprocess.Popen[bytes]:
        """The command on a folder as it is."""
        line = ["-m", "whichroad", "fleet", str(source), "--map", str(self.map), "-o",
                str(self.folder / out), "--workers", str(workers), *more]  # fmt: skip
        return subprocess.Popen(
            [sys.executable, *line], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def whole(self, source: Path, out: str, *more: str, workers: int = 2) -> float:
        """Processor seconds of the command."""

        def work() -> None:
            self.fleet(source, out, *more, workers=workers).wait()
            await_orphans()

        return cost(work)

    def cost(self) -> list[Figure]:
        """The command over `match_many` alone, with points and without."""
        rows = self.table.num_rows
        whichroad.match_many(self.table.slice(0, 50_000), self.roads, threads=1)
        with_points = without = alone = float("inf")
        give = whichroad.fleet.match_batches
        for _ in range(2):
            alone = min(
                alone, cost(lambda: whichroad.match_many(self.table, self.roads, threads=1))
            )
            both = cost(lambda: [list(give(self.table, self.roads, give="path"))])
            without = min(without, both)
            with_points = min(
                with_points, self.whole(self.source, "p", "--order", "sorted", "--points", "all")
            )
        plain = min(self.whole(self.source, "n", "--order", "sorted") for _ in range(2))
        began = time.perf_counter()
        self.whole(self.source, "one", "--order", "sorted", workers=1)
        one, began = time.perf_counter() - began, time.perf_counter()
        self.whole(self.source, "two", "--order", "sorted", workers=2)
        two = time.perf_counter() - began
        return [
            Figure(f"match_many, a fix every {STEP} s", rows / alone, "", "fixes/s", rows),
            Figure("command with points over it", with_points / alone, "<= 1.3", "", rows),
            Figure("command with path and drives over match_batches", plain / without, "<= 1.1"),
            Figure("command, points", rows / with_points, "", "fixes/s of the processor", rows),
            Figure("command, path and drives", rows / plain, "", "fixes/s of the processor", rows),
            Figure("two workers over one, elapsed", one / two, ">= 1.7", "", rows),
        ]

    def shuffled(self, table: pa.Table | None = None) -> Path:
        """The rows of a table in any order."""
        table = self.table if table is None else table
        path = self.folder / "any.parquet"
        order = np.random.default_rng(1).permutation(table.num_rows)
        pq.write_table(table.take(order), path, row_group_size=1 << 16)
        return path

    def order(self) -> list[Figure]:
        """Rows in any order beside rows in order."""
        source = self.shuffled()
        usual = min(self.whole(self.source, "n", "--order", "sorted") for _ in range(2))
        mixed = min(self.whole(source, "s") for _ in range(2))
        a, b = (read(self.folder / out / "path") for out in ("n", "s"))
        return [
            Figure("rows in any order over rows in order", mixed / usual, "<= 1.3"),
            Figure("their paths are equal", float(a.equals(b)), ">= 1", "", a.num_rows),
        ]

    def mixed(self, trips: int) -> Path:
        """The rows of so many trips in any order, written without holding them."""
        path = self.folder / "mixed.parquet"
        rng = np.random.default_rng(2)
        size = np.array([len(lat) for lat, _ in self.drives])
        lat, lon = (np.concatenate([drive[k] for drive in self.drives]) for k in (0, 1))
        drive = np.arange(trips) % len(size)
        first = np.concatenate([[0], np.cumsum(size[drive])])
        begin = np.concatenate([[0], np.cumsum(size)])[drive]
        order = rng.permutation(first[-1])
        schema = self.table.schema
        with pq.ParquetWriter(path, schema) as file:
            for low in range(0, len(order), 1 << 20):
                rows = order[low : low + (1 << 20)]
                trip = np.searchsorted(first, rows, "right") - 1
                step = rows - first[trip]
                at = begin[trip] + step
                names = np.char.add("trip ", np.char.zfill(trip.astype(str), 7))
                columns = [names, 1.7e9 + 97.0 * trip + STEP * step,
                           lat[at] + rng.normal(0, NOISE / 111e3, len(at)),
                           lon[at] + rng.normal(0, NOISE / 72e3, len(at))]  # fmt: skip
                file.write_table(pa.table([pa.array(c) for c in columns], schema), 1 << 16)
        return path

    def memory(self) -> list[Figure]:
        """Largest memory of all processes together, of few and of many rows, shuffled."""
        figures, most = [], []
        for trips in (self.trips, MANY * self.trips):
            source = self.mixed(trips)
            rows = pq.read_metadata(source).num_rows
            before, process = spent(), self.fleet(source, "m")
            sorting = matching = 0.0
            while process.poll() is None:
                now = own_memory(process.pid) / 2**20
                if (self.folder / "m" / "manifest.json").exists():
                    matching = max(matching, now)
                else:
                    sorting = max(sorting, now)
                time.sleep(0.2)
            await_orphans()
            most.append(max(sorting, matching))
            figures += [
                Figure(f"memory, sorting {rows:,} rows in any order", sorting, "<= 1024", "MiB"),
                Figure(f"memory, matching {rows:,} rows", matching, "<= 1024", "MiB"),
                Figure(f"{rows:,} rows", rows / (spent() - before), "", "fixes/s of the processor"),
            ]
            shutil.rmtree(self.folder / "m", ignore_errors=True)
            source.unlink()
        return [*figures, Figure("the larger of many over few", most[1] / most[0], "0.8..1.2")]

    def kill(self) -> list[Figure]:
        """Kill -9 at twenty random moments of runs that go on: the same bytes in the end."""
        part = self.folder / "part.parquet"
        pq.write_table(self.table.slice(0, min(2000, self.trips) * FIXES), part,
                       row_group_size=1 << 16)  # fmt: skip
        began = time.monotonic()
        self._in_units(part, "whole").wait()
        seconds = time.monotonic() - began
        chance, killed, finished, same = random.Random(7), 0, 0, True
        while killed < KILLS:
            process = self._in_units(part, "cut")
            try:
                process.wait(chance.uniform(0.1, 0.8) * seconds)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGKILL)
                killed += 1
            if process.wait() == 0:
                same, finished = same and self._same("cut", "whole"), finished + 1
                shutil.rmtree(self.folder / "cut")
        self._in_units(part, "cut").wait()
        same = same and self._same("cut", "whole")
        return [
            Figure("killed and resumed: the same bytes", float(same), ">= 1", "", killed),
            Figure("runs that came to their end", float(finished + 1), "", "", killed),
        ]

    def _in_units(self, source: Path, out: str) -> subprocess.Popen[bytes]:
        """A run of two processes in a dozen units, that goes on where one is."""
        rows = max(min(2000, self.trips) * FIXES // 12, 1)
        code = (
            "from whichroad.fleet import run_fleet\n"
            "import sys\n"
            "run_fleet(sys.argv[1], sys.argv[2], sys.argv[3], trip_id='trip_id', order='sorted',\n"
            "          points='slim', workers=2, resume=True, unit_rows=int(sys.argv[4]))"
        )
        line = [str(source), str(self.map), str(self.folder / out), str(rows)]
        return subprocess.Popen([sys.executable, "-c", code, *line])

    def _same(self, one: str, other: str) -> bool:
        """Whether two runs wrote the same files."""
        names = [
            sorted(path.relative_to(self.folder / out)
                   for path in (self.folder / out).rglob("part-*.parquet"))
            for out in (one, other)
        ]  # fmt: skip
        return names[0] == names[1] and all(
            (self.folder / one / name).read_bytes() == (self.folder / other / name).read_bytes()
            for name in names[0]
        )

    def poison(self) -> list[Figure]:
        """1 % of the trips spoilt, and one of a million points: the rest as it was."""
        table = self.table.slice(0, 1000 * FIXES)
        lat, time_ = (table[name].to_numpy().copy() for name in ("lat", "time"))
        names = table["trip_id"].to_numpy(zero_copy_only=False)
        bad = np.arange(0, 1000, 100)
        for k, trip in enumerate(bad):
            rows = names == f"trip {trip:07}"
            if k % 3 == 0:
                lat[rows] = np.nan
            elif k % 3 == 1:
                lat[rows] = -33.0
            else:
                time_[rows] = time_[rows][0]
        spoilt = table.set_column(2, "lat", pa.array(lat)).set_column(1, "time", pa.array(time_))
        n = 1_000_000
        one = self.drives[0]
        at = np.arange(n) * FIXES // n
        long = pa.table(
            {"trip_id": ["long"] * n, "time": 1.6e9 + np.arange(n), "lat": one[0][at],
             "lon": one[1][at]}
        )  # fmt: skip
        good, source = self.folder / "good.parquet", self.folder / "bad.parquet"
        pq.write_table(table, good)
        pq.write_table(pa.concat_tables([long, spoilt]), source)
        self.fleet(good, "g").wait()
        self.fleet(source, "b").wait()
        spoilt_names = pa.array([f"trip {k:07}" for k in bad] + ["long"])
        import pyarrow.compute as pc

        a, b = (read(self.folder / out / "path") for out in ("g", "b"))
        a, b = (t.filter(pc.invert(pc.is_in(t["drive_id"], spoilt_names))) for t in (a, b))
        listed = pq.read_table(self.folder / "b" / "bad_trips.parquet")
        return [
            Figure("the others are as they were", float(a.equals(b)), ">= 1", "", a.num_rows),
            Figure("trips listed with a reason", float(listed.num_rows), "", "", len(bad)),
        ]

    def open(self) -> list[Figure]:
        """Processor time of an opening, of this map and of one sixteen times as long."""
        long = self.folder / "long.map"
        from whichroad.roadmap import store
        from whichroad.roadmap.arrays import to_arrays

        about, arrays = to_arrays(self.roads)
        arrays["roads.segments"] = np.tile(arrays["roads.segments"], 130).view(np.recarray)
        store.write(long, about, arrays)
        time.sleep(2.5)
        figures = []
        for path in (self.map, long):
            whichroad.RoadMap.open(path)
            took = min(cost(lambda p=path: [whichroad.RoadMap.open(p) for _ in range(20)])  # type: ignore[misc]
                       for _ in range(5)) / 20  # fmt: skip
            size = path.stat().st_size / 1e6
            figures.append(Figure(f"opening {size:,.0f} MB", 1e3 * took, "<= 3", "ms"))
        return figures

    def first(self) -> list[Figure]:
        """The first answer of a process, its imports and kernels included."""
        few = self.folder / "few.parquet"
        pq.write_table(self.table.slice(0, 10 * FIXES), few)
        code = (
            "import whichroad, sys; "
            "whichroad.match_many(sys.argv[1], sys.argv[2], drive_id='trip_id')"
        )
        line = [sys.executable, "-c", code, str(few), str(self.map)]
        took = min(cost(lambda: subprocess.run(line, check=True)) for _ in range(5))
        return [Figure("first answer of match_many, kernels there", took, "<= 2", "s")]

    def speeds(self) -> list[Figure]:
        """How often the intervals of edges hold the speed that was driven, a fix every 10 s."""
        rng = np.random.default_rng(11)
        truth = self.roads.arrays.edges.speed * np.exp(SPREAD * rng.normal(size=len(self.roads)))
        allowed = drivable(self.roads.arrays, rng)
        trips = min(2000, self.trips)
        routes = [
            random_route(self.roads.arrays, 8000.0, rng, allowed) for _ in range(-(-trips // 5))
        ]
        table = pa.concat_tables(
            [self._driven(routes[k // 5], truth, f"trip {k:05}", rng) for k in range(trips)]
        )
        tables = whichroad.match_many(table, self.roads, threads=1)
        found = whichroad.speeds(tables.path, hours=False, drives=tables.drives)
        found = found.filter((found["passages"].to_numpy() >= 10) & ~np.isnan(
            found["high_mps"].to_numpy(zero_copy_only=False)))  # fmt: skip
        # one over the speed has the mean of two log-normal factors of one spread
        true = truth[found["edge_id"].to_numpy()] * np.exp(-(SPREAD**2))
        low, high = (found[name].to_numpy() for name in ("low_mps", "high_mps"))
        ratio = found["speed_mps"].to_numpy() / true
        n = len(true)
        return [
            Figure("intervals that hold the speed of an edge",
                   100.0 * float(((low <= true) & (true <= high)).mean()), "92..98", "%", n),
            Figure("median width of an interval", 100.0 * float(np.median((high - low) / true)),
                   "", "%", n),
            Figure("median of speed over the true one", float(np.median(ratio)), "", "", n),
        ]  # fmt: skip

    def _driven(
        self, route: np.ndarray, truth: np.ndarray, name: str, rng: np.random.Generator
    ) -> pa.Table:
        """A trip along a route: a driver, and a passage of each edge, are faster or slower."""
        edges, vertices = self.roads.arrays.edges[route], self.roads.arrays.vertices
        pace = np.exp(SPREAD * (rng.normal() + rng.normal(size=len(route))))
        end = np.cumsum(edges.length)
        time_ = np.concatenate([[0.0], np.cumsum(edges.length / (truth[route] * pace))])
        at = np.arange(0.0, time_[-1], 10.0)
        gone = np.interp(at, time_, np.concatenate([[0.0], end]))
        rows = [np.arange(a, b + 1)
                for a, b in zip(edges.first_vertex, edges.last_vertex, strict=True)]  # fmt: skip
        shape = np.concatenate(rows)
        along = vertices.s[shape] + np.repeat(end - edges.length, [len(one) for one in rows])
        x, y = (np.interp(gone, along, vertices[n][shape]) for n in ("x", "y"))
        noise = rng.normal(0.0, 3.0, (2, len(at)))
        lat, lon = self.roads.plane.to_geodetic(x + noise[0], y + noise[1])
        start = 1.7e9 + float(rng.uniform(0.0, 30 * 86400.0))
        return pa.table({"trip_id": [name] * len(at), "time": start + at, "lat": lat, "lon": lon})

    def spark(self) -> list[Figure]:
        """Two workers of Spark beside two processes; and splits by all engines."""
        if shutil.which("java") is None:
            raise Skipped("Spark needs Java 17, and there is no java on the path")
        months = self.folder / "months.parquet"
        fleet = self._months()
        pq.write_table(fleet, months)
        outs = {name: self.folder / f"spark-{name}" for name in ("path", "points", "split")}
        job = [str(self.source), "", {"trip_id": "trip_id"}]
        jobs = [[job[0], str(outs[give]), job[2] | {"give": give}]
                for give in ("path", "path", "path", "points", "points")]  # fmt: skip
        jobs.append([str(months), str(outs["split"]), {"trip_id": "vehicle", "split": "5min"}])
        line = [sys.executable, "-m", "benchmarks.spark_jobs", str(self.map), json.dumps(jobs)]
        ran = subprocess.run(line, check=True, capture_output=True, text=True)
        await_orphans()
        took = [json.loads(text) for text in ran.stdout.splitlines()[-len(jobs) :]]
        plain = min(self.whole(self.source, "n", "--order", "sorted") for _ in range(2))
        full = min(self.whole(self.source, "p", "--order", "sorted", "--points", "all")
                   for _ in range(2))  # fmt: skip
        rows = self.table.num_rows
        same = [same_rows(outs[give], self.folder / "p" / give) for give in ("path", "points")]
        return [
            Figure("Spark, path, first run", took[0], "", "s", rows),
            Figure("Spark, path, a later run", min(took[1:3]), "", "s", rows),
            Figure("Spark, points, a later run", took[4], "", "s", rows),
            Figure("command, path and drives", plain, "", "s", rows),
            Figure("command, points, path and drives", full, "", "s", rows),
            Figure("Spark over the command, path", min(took[1:3]) / plain, "<= 1.3"),
            Figure("Spark over the command, points", took[4] / full, "<= 1.8"),
            Figure("the same rows of path and points", float(all(same)), ">= 1", "", rows),
            *self._split_by_all(months, fleet, outs["split"]),
        ]

    def _months(self) -> pa.Table:
        """Some vehicles of a month, rows in any order."""
        tables = [
            table.append_column("vehicle", pa.array([f"car {k}"] * len(table)))
            for k, table in ((k, self.month(k)[0]) for k in range(MONTHS))
        ]
        table = pa.concat_tables(tables)
        return table.take(np.random.default_rng(5).permutation(len(table)))

    def _split_by_all(self, months: Path, fleet: pa.Table, by_spark: Path) -> list[Figure]:
        """Whether the trips of vehicles are the same by the command, DuckDB, Spark and at once."""
        import duckdb

        at_once = whichroad.match_many(fleet, self.roads, drive_id="vehicle", split="5min")
        options = ["--trip-id", "vehicle", "--split", "5min"]
        self.fleet(months, "split", *options).wait()
        lake = duckdb.sql(f"FROM '{months}' ORDER BY vehicle, time")
        stream = pa.RecordBatchReader.from_stream(lake)
        by_duckdb = self.folder / "duckdb.parquet"
        batches = whichroad.fleet.match_batches(
            stream, self.map, trip_id="vehicle", split="5min", ordered=True
        )
        pq.write_table(pa.Table.from_batches(batches), by_duckdb)
        once = self.folder / "once.parquet"
        pq.write_table(at_once.path, once)
        found = [same_rows(other, once) for other in (self.folder / "split" / "path", by_duckdb,
                                                      by_spark)]  # fmt: skip
        trips = at_once.drives.num_rows
        names = ("the command", "DuckDB", "Spark")
        return [Figure(f"split by {name}: the same rows", float(one), ">= 1", "", trips)
                for name, one in zip(names, found, strict=True)]  # fmt: skip

    def split(self) -> list[Figure]:
        """Ends of trips of 100 vehicles in 30 days."""
        from whichroad.readers.splitting import split_trips

        right = total = parts = 0
        seconds = 0.0
        for vehicle in range(100):
            table, ends = self.month(vehicle)
            before = spent()
            found = split_trips(table, 300.0)[1]
            seconds += spent() - before
            last = np.array([part.high - 1 for part in found])
            right += sum(int(np.abs(last - end).min() <= 1) for end in ends)
            total, parts = total + len(ends), parts + len(found)
        return [
            Figure("ends of trips within one fix", 100.0 * right / total, ">= 99", "%", total),
            Figure("trips found over trips driven", parts / total, "", "", total),
            Figure("processor time of 100 vehicles", seconds, "", "s"),
        ]

    def month(self, vehicle: int) -> tuple[pa.Table, list[int]]:
        """A vehicle of 30 days: a fix every 10 s, silent or not while it stands."""
        rng = np.random.default_rng(vehicle)
        lat, lon, time_, ends = [], [], [], []
        at = 1.7e9
        here = None
        while at < 1.7e9 + 30 * 86400.0:
            drive = self.drives[int(rng.integers(len(self.drives)))]
            begin = int(rng.integers(0, 100))
            end = int(rng.integers(begin + 60, FIXES))
            a, b = drive[0][begin:end], drive[1][begin:end]
            if here is not None:  # the next drive begins where this one ended
                a, b = a + here[0] - a[0], b + here[1] - b[0]
            moves = max(np.ptp(a), np.ptp(b)) * 111e3 > 500.0
            still = np.flatnonzero(np.hypot(np.diff(a), 0.7 * np.diff(b)) * 111e3 > 5.0)
            if not moves or not len(still):
                continue
            a, b = a[: still[-1] + 2], b[: still[-1] + 2]
            times = at + 10.0 * np.arange(len(a))
            lat.append(a), lon.append(b), time_.append(times)
            ends.append(sum(map(len, lat)) - 1)
            here, stand = (a[-1], b[-1]), float(rng.uniform(600.0, 40_000.0))
            at = times[-1] + stand
            if rng.random() < 0.5:
                k = np.arange(1, int(stand / 60.0))
                lat.append(np.full(len(k), here[0])), lon.append(np.full(len(k), here[1]))
                time_.append(times[-1] + 60.0 * k)
        noise = rng.normal(0, 3.0 / 111e3, (2, sum(map(len, lat))))
        columns = {"time": np.concatenate(time_), "lat": np.concatenate(lat) + noise[0],
                   "lon": np.concatenate(lon) + noise[1]}  # fmt: skip
        return pa.table(columns), ends


def read(folder: Path) -> pa.Table:
    """A table of a run, by trip, without what names its map."""
    table = pq.read_table(folder).sort_by([("drive_id", "ascending"), ("seq", "ascending")])
    return table.replace_schema_metadata(None).combine_chunks()


def same_rows(one: Path, other: Path) -> bool:
    """Whether two tables hold the same rows, in whatever order and types of Arrow.

    The columns are those of the first: files of the command have a geometry beside lon and lat.
    """
    a, b = (pq.read_table(path).replace_schema_metadata(None) for path in (one, other))
    keys = [(n, "ascending") for n in ("drive_id", "seq", "time") if n in a.column_names]
    try:
        b = b.select(a.column_names)
        a = a.cast(b.schema)
    except (KeyError, pa.ArrowException):
        return False
    return bool(a.sort_by(keys).combine_chunks().equals(b.sort_by(keys).combine_chunks()))


def own_memory(pid: int) -> float:
    """Bytes of a process and its descendants, shared pages by their share, files left out."""
    total = 0.0
    for one in [pid, *descendants(pid)]:
        try:
            for line in Path(f"/proc/{one}/smaps_rollup").read_text().splitlines():
                if line.startswith("Pss_Anon:"):
                    total += 1024.0 * float(line.split()[1])
        except OSError:
            continue
    return total
