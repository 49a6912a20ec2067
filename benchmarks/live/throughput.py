"""A recording as fast as possible through the whole service, everything switched on."""

import time

import numpy as np

from whichroad import read_drive
from whichroad.writers import write_table

from .. import Figure, Options
from .process import Listener, Served
from .world import world


def throughput(options: Options) -> list[Figure]:
    """Observations a second; what is recorded; memory early and late."""
    seconds, metres = options.more.get("seconds", 20.0), options.more.get("metres", 3000.0)
    with world(metres) as here:
        files = tables(here)
        play = ("--play", files[0], "--play", files[1], "--speed", "max", "--laps", 100_000)
        out = ("--record", here.folder / "rec", "--state", here.folder / "state")
        out += ("--nmea-out", "tcp://127.0.0.1:0")
        with Served(*here.options(), *play, *out, out=True) as served:
            served.answered()
            listener = Listener(served.port)
            begin, first, used = time.perf_counter(), count(served), served.cpu()
            memory = []
            while time.perf_counter() - begin < seconds:
                end = time.perf_counter() + 0.5
                while time.perf_counter() < end:
                    listener.read()
                memory.append((count(served), served.memory()))
            last, end, used = count(served), time.perf_counter(), served.cpu() - used
            health = served.get("/health")
            served.kill()
        (drive,) = read_drive(here.folder / "rec", vehicle=here.vehicle)
        recorded = len(drive.fixes) + len(drive.odometry.time)
    taken = last - first
    half = np.array([one for one in memory if one[0] >= 0.5 * last])
    growth = float(np.polyfit(1e-6 * half[:, 0], half[:, 1], 1)[0]) if len(half) > 2 else 0.0
    return [
        Figure("observations a second", taken / (end - begin), ">= 20000", "1/s", taken),
        Figure("the same per second of processor time", taken / used, "", "1/s", taken),
        Figure("observations lost", float(sum(health["skipped"].values())), "<= 0", "", taken),
        Figure("recorded before kill -9", 100.0 * recorded / last, "", "%", last),
        Figure("resident memory", memory[-1][1], "", "MB", taken),
        Figure("its slope over the second half", growth, "<= 2", "MB/million", taken),
    ]


def count(served):
    """Observations taken so far."""
    return served.get("/health")["sensors"][0]["count"]


def tables(here):
    """The drive as two tables."""
    import pyarrow as pa

    from whichroad.tables.schema import times

    f, o = here.drive.fixes, here.drive.odometry
    fixes = {"time": times(f.time), "lat": f.lat_deg, "lon": f.lon_deg, "cov_ee_m2": f.cov_ee}
    fixes |= {"cov_en_m2": f.cov_en, "cov_nn_m2": f.cov_nn, "speed_mps": f.speed}
    wheels = {"time": times(o.time), "wheel_rl_ticks": o.left, "wheel_rr_ticks": o.right}
    paths = here.folder / "fixes.parquet", here.folder / "wheels.parquet"
    for path, columns in zip(paths, (fixes, wheels), strict=True):
        write_table(pa.table(columns), path)
    return paths
