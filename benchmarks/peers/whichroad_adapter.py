"""whichroad behind the peers' interface: one file, run by their harness in our environment.

    python run.py ... --also whichroad=PYTHON:benchmarks/peers/whichroad_adapter.py

`match` is what a user would call; turning the answer into the harness's lists is `decode`.

An extract that holds several regions far apart (the harness puts all real tracks into one)
is compiled as one map each: a map is a plane about its middle.
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

WIDE = 3.0  # degrees of longitude; an extract up to this is one map
APART = 0.02  # degrees of longitude without any road: another region


class Adapter:
    """The four calls of the harness.

    Args:
        lag: Passed to `whichroad.match`; None where the environment variable
            WHICHROAD_BENCH_LAG says "none".
    """

    def __init__(self, lag: Any = "full") -> None:
        told = os.environ.get("WHICHROAD_BENCH_LAG", lag)
        self.lag = None if told == "none" else told
        self.maps: list[tuple[float, float, Any]] = []

    def prepare(self, pbf: str, graph: Any, workdir: str) -> None:
        """Compile the extract, each region to a map of its own."""
        import whichroad

        folder = Path(workdir)
        folder.mkdir(parents=True, exist_ok=True)
        regions = []
        for i, (west, east, part) in enumerate(_regions(pbf, folder)):
            name = f"region{i}.map"
            whichroad.RoadMap.from_osm(part).save(folder / name)
            regions.append((west, east, name))
            if part != pbf:
                os.remove(part)
        (folder / "regions.json").write_text(json.dumps(regions))

    def load(self, pbf: str, graph: Any, workdir: str) -> None:
        """Open the maps; they stay in their files until they are used."""
        import whichroad

        folder = Path(workdir)
        self.maps = [
            (west, east, whichroad.RoadMap.open(folder / name))
            for west, east, name in json.loads((folder / "regions.json").read_text())
        ]

    def roads(self, lon: float) -> Any:
        """The map of the region around a longitude."""
        return min(self.maps, key=lambda m: max(m[0] - lon, lon - m[1], 0.0))[2]

    def match(self, trace: Any) -> Any:
        """Match one trace; its sigma is told, as to every peer."""
        import whichroad

        drive = {
            "time": trace.t,
            "lat": trace.lat,
            "lon": trace.lon,
            "sigma_m": np.full(len(trace.t), trace.sigma),
        }
        roads = self.roads(float(trace.lon[0]))
        if self.lag is not None:
            try:
                return whichroad.match(drive, roads, lag=self.lag)
            except whichroad.SettingError:  # a version that does not look back
                self.lag = None
        return whichroad.match(drive, roads)

    def decode(self, raw: Any, trace: Any) -> dict[str, Any]:
        """Matched points, one for each fix in order, and the lines of the path."""
        return decode(raw, trace.t)


def decode(raw: Any, t: Any) -> dict[str, Any]:
    """The harness's lists from a result.

    Args:
        raw: A `whichroad.Result`.
        t: (n,) seconds, the times of the fixes.

    Returns:
        `points`: n of [lat, lon] or None; `route`: lines of [lat, lon].
    """
    import shapely

    table = raw.to_arrow()
    micros = table["time"].cast("int64").to_numpy()
    lat = table["matched_lat"].to_numpy(zero_copy_only=False)
    lon = table["matched_lon"].to_numpy(zero_copy_only=False)
    points: list[list[float] | None] = []
    for when in np.round(np.asarray(t, float) * 1e6).astype(np.int64):
        k = int(np.searchsorted(micros, when))
        known = k < len(micros) and micros[k] == when and np.isfinite(lat[k])
        points.append([float(lat[k]), float(lon[k])] if known else None)
    lines = shapely.from_wkb(raw.path_arrow()["geometry"].to_numpy(zero_copy_only=False))
    route = [np.asarray(line.coords)[:, 1::-1].tolist() for line in lines]
    return {"points": points, "route": route, "said": _said(table, raw.path_arrow())}


SAID = ("lat", "lon", "cov_ee_m2", "cov_en_m2", "cov_nn_m2", "edge_id", "p_road", "p_off_road")


def _said(table: Any, path: Any) -> dict[str, Any]:
    """What no peer says, for the scores of our own: pose, covariance and probabilities."""
    micros = table["time"].cast("int64").to_pylist()
    others = table["alternatives"].to_pylist()
    return {
        "time": [t / 1e6 for t in micros],
        **{n: table[n].to_pylist() for n in SAID},
        "alternatives": [[[a["edge_id"], a["p"]] for a in row or ()] for row in others],
        "path": path["edge_id"].to_pylist(),
        "entered": [t / 1e6 for t in path["enter_time"].cast("int64").to_pylist()],
    }


def _regions(pbf: str, folder: Path) -> list[tuple[float, float, str]]:
    """West and east (degrees) of each region and an extract of it; one region: the file itself."""
    import osmium

    spans = []
    for way in osmium.FileProcessor(pbf, osmium.osm.WAY | osmium.osm.NODE).with_locations():
        if way.is_way() and "highway" in way.tags:
            lons = [n.location.lon for n in way.nodes if n.location.valid()]
            if lons:
                spans.append((min(lons), max(lons)))
    merged: list[list[float]] = []
    for west, east in sorted(spans):
        if merged and west <= merged[-1][1] + APART:
            merged[-1][1] = max(merged[-1][1], east)
        else:
            merged.append([west, east])
    west, east = merged[0][0], merged[-1][1]
    if len(merged) == 1 or east - west <= WIDE:
        return [(west, east, pbf)]
    return _cut(pbf, merged, folder)


def _cut(pbf: str, spans: list[list[float]], folder: Path) -> list[tuple[float, float, str]]:
    """One extract for each span of longitudes."""
    import osmium

    starts = np.array([west for west, _ in spans])
    paths = [str(folder / f"region{i}.osm.pbf") for i in range(len(spans))]
    for path in paths:
        Path(path).unlink(missing_ok=True)
    writers = [osmium.SimpleWriter(path) for path in paths]

    def region(lon: float) -> int:
        return max(int(np.searchsorted(starts, lon + 1e-9, side="right")) - 1, 0)

    for o in osmium.FileProcessor(pbf, osmium.osm.WAY | osmium.osm.NODE).with_locations():
        if o.is_node():
            writers[region(o.location.lon)].add(o)
        elif o.is_way() and len(o.nodes) and o.nodes[0].location.valid():
            writers[region(o.nodes[0].location.lon)].add(o)
    for writer in writers:
        writer.close()
    return [(west, east, path) for (west, east), path in zip(spans, paths, strict=True)]
