"""Drives of our own simulator, with lane offsets, map errors and a slow GNSS error."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from whichroad.geodesy.plane import Plane
from whichroad.simulate import GOOD, drivable, simulate_drive

from .. import Options
from . import harness, runner, scores

# what is matched is the antenna, as peers know no vehicle
WORLD = replace(GOOD, antenna_forward=0.0)
LENGTH_M = 8_000.0
WARM_UP_S = 20.0
ALL = (*harness.PEERS, runner.OURS)


def measure(options: Options, seeds: range, every: tuple[int, ...]) -> dict[str, Any]:
    """By interval and matcher: RMSE of the position, route mismatch; of ours the ellipse too."""
    pbf = options.need("maps", "heidelberg.osm.pbf")
    roads = harness.our_adapter(options, pbf).maps[0][2]
    allowed = drivable(roads.arrays, np.random.default_rng(0)) & _public(roads)
    drives = [
        simulate_drive(roads, seed=s, length_m=LENGTH_M, scenario=WORLD, allowed=allowed)
        for s in seeds
    ]
    traces = {f"{k}s": [_trace(options, i, d, k) for i, d in enumerate(drives)] for k in every}
    found: dict[str, Any] = {key: {} for key in traces}
    for name in runner.present(options, ALL):
        done = runner.run(options, name, pbf, traces, options.more.get("seconds", 1e9))
        if done is None:
            continue
        for key, condition in done.conditions.items():
            given = scores.answers(condition, traces[key])
            found[key][name] = _scored(options, roads, drives, traces[key], given)
            found[key][name]["fails"] = len(condition["errors"])
        options.say(f"{name}: our own drives done")
    for row in found.values():
        _pair(row)
    return found


def _pair(row: dict[str, Any]) -> None:
    """Beside each peer's RMSE ours at the same fixes: who answers easy ones gains nothing."""
    ours = row.get(runner.OURS, {}).pop("squares", None)
    for name, theirs in row.items():
        squares = theirs.pop("squares", None)
        if name != runner.OURS and ours is not None and squares is not None:
            both = ~np.isnan(ours) & ~np.isnan(squares)
            theirs["rmse"] = float(np.sqrt(squares[both].mean()))
            theirs["rmse_ours_there"] = float(np.sqrt(ours[both].mean()))


def _public(roads: Any) -> np.ndarray:
    """Roads that every peer's map has: no driveways and farm tracks."""
    return np.array([word not in ("service", "road") for word in roads.column("highway")])


def _trace(options: Options, number: int, drive: Any, interval: int) -> Any:
    """The fixes of a drive as the harness gives them."""
    f = drive.drive.fixes
    keep = harness.module(options, "real").thin(f.time, interval)
    zero = np.zeros(len(keep))
    return harness.module(options, "simulate").Trace(
        number, f.time[keep], f.lat_deg[keep], f.lon_deg[keep], WORLD.gnss_reported,
        float(interval), zero, zero,
    )  # fmt: skip


def _scored(
    options: Options, roads: Any, drives: list[Any], traces: list[Any], given: list[dict[str, Any]]
) -> dict[str, Any]:
    metrics = harness.module(options, "metrics")
    graph = _plane(roads.plane)
    squares, routes, inside, p, right = [], [], [], [], []
    for drive, trace, answer in zip(drives, traces, given, strict=True):
        truth = drive.truth
        at = np.clip(np.searchsorted(truth.time, trace.t - 1e-3), 0, len(truth.time) - 1)
        keep = trace.t > truth.time[0] + WARM_UP_S
        lat, lon = roads.plane.to_geodetic(truth.x[at], truth.y[at])
        true = np.column_stack(graph.xy(lat, lon))
        whole, driven = _route(roads, truth, at)
        row = metrics.score_route(graph, [whole], answer)
        lines = [np.column_stack(graph.xy(*np.array(q).T)) for q in answer["route"] if len(q) > 1]
        ends = [np.column_stack(graph.xy(*q.T)) for q in (driven, whole)]
        row["d_minus"], row["d_plus"], row["d0"] = metrics.route_mismatch(ends[:1], ends[1:], lines)
        routes.append(row)
        if "said" in answer:
            said = answer["said"]
            k = scores.at_fixes(said, trace.t)
            error, within = _errors(graph, said, k, true)
            squares.append(np.where(keep & (k >= 0), error, np.nan))
            inside.append(within[keep & (k >= 0)])
            a, b = scores.decisions(
                said, trace.t, lambda i, edge, e=truth.edge[at]: bool(e[i] == edge)
            )
            p, right = p + a, right + b
        else:
            squares.append(_matched(graph, answer["points"], true, keep))
    out: dict[str, Any] = scores.pooled(routes)
    out["squares"] = np.concatenate(squares)
    out["rmse"] = float(np.sqrt(np.nanmean(out["squares"])))
    if inside:
        out["ellipse"] = float(np.concatenate(inside).mean())
        out["calibration"] = scores.calibration(p, right)
    return out


def _plane(plane: Plane) -> Any:
    """The harness's flat map about our origin, with places instead of node numbers."""
    earth = 6371008.8
    ky = np.radians(1.0) * earth
    kx = ky * np.cos(np.radians(plane.lat0_deg))
    return SimpleNamespace(
        xy=lambda lat, lon: (
            (np.asarray(lon) - plane.lon0_deg) * kx,
            (np.asarray(lat) - plane.lat0_deg) * ky,
        ),
        nodes_latlon=lambda places: places,
    )


def _route(roads: Any, truth: Any, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lines (lat, lon) of the edges driven from the first fix to the last, whole and cut."""
    edge = truth.edge[at[0] : at[-1] + 1]
    runs = edge[np.flatnonzero(np.diff(edge, prepend=-9))].tolist()
    ends: list[tuple[float | None, float | None]] = [(None, None)] * len(runs)
    start, end = float(truth.along[at[0]]), float(truth.along[at[-1]])
    ends[0], ends[-1] = (start, None), (start if len(runs) == 1 else None, end)

    def line(cuts: list[tuple[float | None, float | None]]) -> np.ndarray:
        parts = [roads.edge_line(e, *cut) for e, cut in zip(runs, cuts, strict=True)]
        return np.column_stack(roads.plane.to_geodetic(*np.vstack(parts).T))

    return line([(None, None)] * len(runs)), line(ends)


def _errors(
    graph: Any, said: dict[str, Any], k: np.ndarray, true: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors of the pose (m²), and whether the truth is in the 95 % ellipse."""
    column = {n: np.asarray(said[n], float)[k] for n in
              ("lat", "lon", "cov_ee_m2", "cov_en_m2", "cov_nn_m2")}  # fmt: skip
    x, y = graph.xy(column["lat"], column["lon"])
    dx, dy = x - true[:, 0], y - true[:, 1]
    ee, en, nn = column["cov_ee_m2"], column["cov_en_m2"], column["cov_nn_m2"]
    nees = (nn * dx * dx - 2.0 * en * dx * dy + ee * dy * dy) / (ee * nn - en * en)
    return dx * dx + dy * dy, nees < scores.CHI2_95


def _matched(graph: Any, points: list[Any], true: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Squared errors of the points a peer matched, NaN where none is or the drive begins."""
    latlon = np.array([q or (np.nan, np.nan) for q in points], float)
    x, y = graph.xy(latlon[:, 0], latlon[:, 1])
    square = (x - true[:, 0]) ** 2 + (y - true[:, 1]) ** 2
    return np.where(keep, square, np.nan)
