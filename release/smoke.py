"""What a wheel must do where it is installed: answer a drive without any compiler.

    python release/smoke.py

Prints the seconds from the import to the first answers.
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path


def main() -> None:
    """Answer a short drive, with wheels, with fixes alone, looking back, and a table of trips."""
    sys.modules["numba"] = sys.modules["llvmlite"] = None  # type: ignore[assignment]
    begin = time.perf_counter()
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
        p = float(result.points["p_road"].mean())
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
    assert kernel_mode() == "native", kernel_mode()


if __name__ == "__main__":
    main()
