"""What a wheel must do where it is installed: answer a drive without any compiler.

    python release/smoke.py

Prints the seconds from the import to the first answers.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import whichroad

ABSENT = (  # the compiler, and what comes with extras
    "numba", "llvmlite", "matplotlib", "geopandas", "pandas", "pyogrio", "cantools", "can",
)  # fmt: skip


class Absent:
    """Finds none of those packages, whether they are installed or not."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """Refuse them, and leave all others to the finders that follow."""
        if name.partition(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def without_extras(result: "whichroad.Result", roads: "whichroad.RoadMap") -> None:
    """Text in, every table out; what needs an extra says which, in one sentence."""
    import numpy as np

    import whichroad

    table = result.to_arrow()
    with tempfile.TemporaryDirectory() as folder:
        for suffix in ("parquet", "geojson", "csv", "gpx", "arrow", "nmea"):
            result.write(Path(folder) / f"points.{suffix}")
        result.write_path(Path(folder) / "path.geojson")
        text = Path(folder) / "drive.csv"
        stamps = [str(t).replace(" ", "T")[:19] + "Z" for t in table["time"].to_pylist()[:60:10]]
        places = (table[name].to_pylist()[:60:10] for name in ("lat", "lon"))
        rows = list(zip(stamps, *places, strict=True))
        text.write_text("time,lat,lon\n" + "\n".join(f"{t},{a},{b}" for t, a, b in rows))
        again = whichroad.match(text, roads).to_arrow()
    assert again.num_rows == len(stamps)
    assert np.all(again["p_off_road"].drop_null().to_numpy() < 1.0)
    rows_in_memory = [(10.0 * k, a, b) for k, (_, a, b) in enumerate(rows)]
    assert whichroad.match(rows_in_memory, roads).to_arrow().num_rows == 6
    for name in ("points", "path"):
        said = ""
        try:
            getattr(result, name)
        except whichroad.SettingError as error:
            said = str(error)
        assert 'pip install "whichroad[geo]"' in said, name


def main() -> None:
    """Answer a short drive, with wheels, with fixes alone, looking back, and a table of trips."""
    sys.meta_path.insert(0, Absent())
    begin = time.perf_counter()
    import numpy as np

    import whichroad
    from whichroad._compile import kernel_mode
    from whichroad.simulate import draw_town, simulate_drive

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.osm"
        path.write_text(draw_town(), encoding="utf-8")
        roads = whichroad.RoadMap.from_osm(path)
    drive = simulate_drive(roads, seed=1, length_m=1000.0).drive
    print(f"imports, map and drive: {time.perf_counter() - begin:.2f} s")
    for name, one, lag in (
        ("wheels", drive, None), ("fixes", replace(drive, odometry=None), None),
        ("looking back", drive, "full"),
    ):  # fmt: skip
        begin = time.perf_counter()
        result = whichroad.match(one, roads, lag=lag)
        p = float(np.mean(result.to_arrow()["p_road"].drop_null().to_numpy()))
        print(f"{name}: {time.perf_counter() - begin:.2f} s, mean p_road {p:.3f}")
        assert p > 0.5
    begin = time.perf_counter()
    fixes = drive.fixes
    trips = {
        "trip_id": ["a"] * 20 + ["b"] * 20, "time": fixes.time[:40], "lat": fixes.lat_deg[:40],
        "lon": fixes.lon_deg[:40],
    }  # fmt: skip
    answered = whichroad.match_many(trips, roads).drives.column("answered").to_pylist()
    print(f"a table of trips: {time.perf_counter() - begin:.2f} s")
    assert answered == [True, True]
    without_extras(result, roads)
    assert kernel_mode() == "native", kernel_mode()


if __name__ == "__main__":
    main()
