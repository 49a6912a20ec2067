"""A vehicle with wheels at 100 Hz and GNSS at 10 Hz: its files, its sentences, its frames."""

import math
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np

from whichroad import RoadMap, simulate_drive
from whichroad.observations import Drive, Fixes, WheelCounts
from whichroad.readers.vehicle import read_vehicle
from whichroad.settings import Vehicle, to_toml
from whichroad.simulate import draw_town
from whichroad.simulate.drive_files import DBC, SIGNALS

FRAME = 928  # of both wheel counters in the simulator's .dbc
KNOT = 1852.0 / 3600.0


@dataclass
class World:
    """A folder with a map, a car and its .dbc, and a drive."""

    folder: Path
    drive: Drive
    vehicle: Vehicle

    @property
    def map(self):
        """Compiled."""
        return self.folder / "town.map"

    def options(self):
        """What `whichroad live` needs to know of the car."""
        return ("--map", self.map, "--vehicle", self.folder / "vehicle.toml")


@contextmanager
def world(metres=3000.0, seed=3):
    """A drive through the simulator's town, in a folder that goes away."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "town.osm").write_text(draw_town(), encoding="utf-8")
        roads = RoadMap.from_osm(folder / "town.osm")
        roads.save(folder / "town.map")
        ride = simulate_drive(roads, seed=seed, length_m=metres)
        car = replace(ride.vehicle, signals=SIGNALS, counter_bits=16)
        (folder / "vehicle.toml").write_text(to_toml(car), encoding="utf-8")
        (folder / "car.dbc").write_text(DBC, encoding="utf-8")
        yield World(folder, finer(ride.drive), read_vehicle(folder / "vehicle.toml"))


def finer(drive: Drive) -> Drive:
    """The same drive with wheels at 100 Hz and fixes at 10 Hz."""
    log, fixes = drive.odometry, drive.fixes
    begin, end = float(log.time[0]), float(min(log.time[-1], fixes.time[-1]))
    at = begin + np.arange(0.0, end - begin, 0.01)
    left, right = (np.floor(np.interp(at, log.time, c)) for c in (log.left, log.right))
    at_fix = begin + np.arange(0.0, end - begin, 0.1)
    columns = {
        name: np.interp(at_fix, fixes.time, getattr(fixes, name))
        for name in ("lat_deg", "lon_deg", "cov_ee", "cov_en", "cov_nn", "speed")
    }
    unknown = np.full(len(at_fix), np.inf)
    rest = {"sigma_speed": np.full(len(at_fix), 0.3), "bearing_deg": np.zeros(len(at_fix))}
    flags = np.zeros(len(at_fix), np.uint8)
    return replace(
        drive,
        odometry=WheelCounts(at, left, right),
        fixes=Fixes(time=at_fix, **columns, **rest, sigma_bearing_deg=unknown, flags=flags),
    )


def burst(fixes: Fixes, row: int, when: float) -> bytes:
    """GGA, GST and RMC of one fix, as if it were made at `when`."""
    whole, hundredths = divmod(round(when * 100.0), 100)
    moment = time.gmtime(whole)
    clock = time.strftime("%H%M%S", moment) + f".{hundredths:02d}"
    lat, lon = float(fixes.lat_deg[row]), float(fixes.lon_deg[row])
    place = f"{angle(lat, 2)},{'N' if lat >= 0 else 'S'},{angle(lon, 3)},{'E' if lon >= 0 else 'W'}"
    east, north = math.sqrt(fixes.cov_ee[row]), math.sqrt(fixes.cov_nn[row])
    knots = float(fixes.speed[row]) / KNOT
    bodies = (
        f"GPGGA,{clock},{place},1,09,0.9,52.0,M,45.0,M,,",
        f"GPGST,{clock},1.2,,,,{north:.2f},{east:.2f},4.0",
        f"GPRMC,{clock},A,{place},{knots:.3f},,{time.strftime('%d%m%y', moment)},,,A",
    )
    return b"".join(f"${b}*{reduce(xor, b.encode()):02X}\r\n".encode() for b in bodies)


def angle(degrees: float, digits: int) -> str:
    """`ddmm.mmmmmm`."""
    micro = round(abs(degrees) * 60e6)
    return f"{micro // 60_000_000:0{digits}d}{micro % 60_000_000 / 1e6:09.6f}"


def payload(log: WheelCounts, row: int) -> bytes:
    """The frame of both counters."""
    sides = (int(log.left[row]) % 65536, int(log.right[row]) % 65536)
    return b"".join(s.to_bytes(2, "little") for s in sides) + bytes(4)
