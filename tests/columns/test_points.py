"""Value oracles for the columns of the points.

Ingredients: hypotheses of the on-line filter at the same epochs, drawn streets, observations and
truth. Degrees and metres are converted by pyproj.
"""

import math
import re
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from columns.scene import (
    BEFORE,
    EDGES,
    FALSE,
    GEOD,
    IDS,
    SETTINGS,
    SHIFT,
    STREETS,
    Seen,
    drawn,
    edge_line,
    foot,
    roads,
    seen,
)
from laws.public import GNSS, START, WHEELS, metres
from whichroad.observations import Pose

Array = NDArray[np.float64]

MODES = pytest.mark.parametrize("mode", [WHEELS, GNSS])
PLANE = pyproj.CRS.from_proj4(
    f"+proj=sterea +lat_0={roads().plane.lat0_deg!r} +lon_0={roads().plane.lon0_deg!r} +ellps=WGS84"
)
TO_DEGREES = pyproj.Transformer.from_crs(PLANE, "EPSG:4326", always_xy=True)
STREET_OF = {number: name for name, number in IDS.items()}
LINES = {name: drawn(name) for name in STREETS}
EDGE_OF = {s.removeprefix("-"): (e, s[0] != "-") for e, parts in EDGES.items() for s in parts}


class Mixture(NamedTuple):
    """The hypotheses of an epoch, in the axes of east and north."""

    p: Array  # (n,)
    edge: list[int | None]
    place: Array  # (n, 2) lon, lat
    mean: Array  # (3,) longitude, latitude (degrees), bearing (rad)
    cov: Array  # (3, 3) east, north (m), bearing (rad)
    off: Array  # (n, 2) of each hypothesis from the mean, m
    covs: Array  # (n, 2, 2) position, east and north

    def shares(self) -> dict[int | None, float]:
        """P of each edge, None off the roads, the most probable first."""
        total: dict[int | None, float] = {}
        for edge, p in zip(self.edge, self.p, strict=True):
            total[edge] = total.get(edge, 0.0) + float(p)
        return dict(sorted(total.items(), key=lambda item: -item[1]))


def mixture(estimate: Any) -> Mixture | None:
    """The moments of an estimate's hypotheses; None where there are none."""
    h = estimate.hypotheses
    if not h:
        return None
    p = np.array([one.p for one in h])
    x, y, heading = np.array([(one.pose.x, one.pose.y, one.pose.heading) for one in h]).T
    mx, my = p @ x, p @ y
    lon, lat = TO_DEGREES.transform(mx, my)
    factors = pyproj.Proj(PLANE).get_factors(lon, lat)
    turn = math.radians(factors.meridian_convergence)
    best = heading[np.argmax(p)]
    swing = np.angle(np.exp(1j * (heading - best)))
    middle = p @ swing
    if np.abs(swing).max() > 1.0:  # the mean direction
        middle = float(np.angle(p @ np.exp(1j * swing)))
    # to east, north and bearing, all in true metres and radians
    c, s = math.cos(turn), math.sin(turn)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, -1.0]])
    apart = np.column_stack([x - mx, y - my, np.angle(np.exp(1j * (swing - middle)))])
    apart[:, :2] /= factors.meridional_scale
    covs = np.array([one.cov for one in h])
    cov = axes @ (np.einsum("i,ijk->jk", p, covs) + (p[:, None] * apart).T @ apart) @ axes.T
    bearing = (0.5 * math.pi - (best + middle) + turn) % (2.0 * math.pi)
    places = np.column_stack(TO_DEGREES.transform(x, y))
    return Mixture(
        p, [one.edge for one in h], places, np.array([lon, lat, bearing]), cov,
        (apart @ axes.T)[:, :2], (axes @ covs @ axes.T)[:, :2, :2],
    )  # fmt: skip


@cache
def mixtures(mode: str) -> list[Mixture | None]:
    return [mixture(e) for e in seen(mode).estimates]


def answered(mode: str) -> NDArray[np.bool_]:
    return np.array([m is not None for m in mixtures(mode)])


def column(mode: str, name: str) -> list[Any]:
    return list(seen(mode).points[name].to_pylist())


def numbers(mode: str, name: str) -> Array:
    """A column with NaN where there is no answer."""
    return np.array([np.nan if v is None else v for v in column(mode, name)], float)


def by_epoch(mode: str, value: Callable[[Mixture, Any], float]) -> Array:
    """A number of each epoch, NaN without an answer."""
    rows = zip(mixtures(mode), seen(mode).estimates, strict=True)
    return np.array([np.nan if m is None else value(m, e) for m, e in rows])


def assert_column(mode: str, name: str, expected: Array, **tolerance: float) -> None:
    np.testing.assert_allclose(numbers(mode, name), expected, **{"rtol": 0.0, **tolerance})


@MODES
def test_the_scene_has_every_status(mode: str):
    status = set(column(mode, "status"))
    assert {"on_road", "ambiguous", "off_road", "lost"} <= status
    if mode == WHEELS:
        assert {"outage", "stopped"} <= status
        assert (~answered(mode)).sum() == BEFORE + 1


@MODES
def test_names_and_times_are_those_of_the_drive(mode: str):
    assert set(column(mode, "drive_id")) == {"drive"}
    time = seen(mode).points["time"].cast("int64").to_numpy() * 1e-6
    np.testing.assert_allclose(time - START, seen(mode).truth.time, atol=1e-6)


@MODES
def test_the_pose_is_the_mean_of_the_hypotheses(mode: str):
    assert_column(mode, "lon", by_epoch(mode, lambda m, _: m.mean[0]), atol=1e-9)
    assert_column(mode, "lat", by_epoch(mode, lambda m, _: m.mean[1]), atol=1e-9)
    off = numbers(mode, "bearing_deg") - by_epoch(mode, lambda m, _: np.degrees(m.mean[2]))
    np.testing.assert_allclose((off + 180.0) % 360.0, np.where(answered(mode), 180.0, np.nan),
                               atol=1e-5)  # fmt: skip


@MODES
def test_the_covariance_is_that_of_the_mixture(mode: str):
    for name, (i, j) in {"ee": (0, 0), "en": (0, 1), "nn": (1, 1)}.items():
        expected = by_epoch(mode, lambda m, _, i=i, j=j: m.cov[i, j])
        size = np.sqrt(by_epoch(mode, lambda m, _, i=i, j=j: m.cov[i, i] * m.cov[j, j]))
        assert_column(mode, f"cov_{name}_m2", expected, atol=1e-6 * np.nanmax(size), rtol=1e-4)


@MODES
def test_the_bearing_sigma_is_that_of_the_mixture(mode: str):
    expected = by_epoch(mode, lambda m, _: math.degrees(math.sqrt(m.cov[2, 2])))
    assert_column(mode, "sigma_bearing_deg", expected, rtol=1e-6)


@MODES
def test_the_ellipse_is_that_of_the_covariance(mode: str):
    def axes(m: Mixture, _: Any) -> tuple[float, float, float]:
        value, vector = np.linalg.eigh(m.cov[:2, :2])
        return math.sqrt(value[1]), math.sqrt(value[0]), math.atan2(vector[0, 1], vector[1, 1])

    ok = answered(mode)
    major, minor, bearing = np.array(
        [(np.nan,) * 3 if m is None else axes(m, None) for m in mixtures(mode)]
    ).T
    assert_column(mode, "ellipse_major_m", major, rtol=1e-4)
    assert_column(mode, "ellipse_minor_m", minor, rtol=1e-4)
    said = numbers(mode, "ellipse_bearing_deg")
    assert ((said[ok] >= 0.0) & (said[ok] < 180.0)).all()
    off = np.radians(said) - bearing
    long = ok & (major > 1.01 * minor)
    np.testing.assert_allclose(np.abs(np.cos(off[long])), 1.0, atol=1e-4)


@MODES
def test_the_speed_is_that_of_the_vehicle(mode: str):
    t = seen(mode).truth
    said = numbers(mode, "speed_mps")
    assert_column(mode, "speed_mps", by_epoch(mode, lambda _, e: e.speed), atol=1e-9)
    on = believed(mode) & (t.s < 650.0)  # at 10 m/s
    if mode == GNSS:
        assert np.abs(said[on] - 10.0).mean() < 1.0
        return
    np.testing.assert_allclose(said[on], 10.0, atol=0.3)
    stands = np.array(column(mode, "status")) == "stopped"
    assert set(said[stands]) == {0.0}


def edge_of(m: Mixture) -> int | None:
    """The most probable edge, None off the roads."""
    shares = m.shares()
    on = [edge for edge in shares if edge is not None]
    return on[0] if on and shares.get(None, 0.0) <= 0.5 else None


@MODES
def test_the_edge_is_the_most_probable_one(mode: str):
    said = column(mode, "edge_id")
    clear = 0
    for k, m in enumerate(mixtures(mode)):
        if m is None:
            assert said[k] is None
            continue
        shares = list(m.shares().values())
        if len(shares) < 2 or shares[0] > shares[1] + 1e-6:
            clear += 1
            assert said[k] == edge_of(m)
            assert said[k] == seen(mode).estimates[k].edge
    assert clear > 0.9 * len(said) - BEFORE


@MODES
def test_source_and_direction_are_those_of_the_matched_street(mode: str):
    c = {name: column(mode, name) for name in (
        "edge_id", "source_id", "forward", "matched_lat", "matched_lon", "bearing_deg",
    )}  # fmt: skip
    seen_streets: set[str] = set()
    edges: dict[int, tuple[str, bool]] = {}
    table = roads().edges_table()
    for k, edge in enumerate(c["edge_id"]):
        if edge is None:
            assert c["source_id"][k] is None
            assert c["forward"][k] is None
            continue
        street = STREET_OF[int(c["source_id"][k])]
        place = foot(c["matched_lon"][k], c["matched_lat"][k], LINES[street])
        assert place.away < 0.01
        # one edge is one chain of streets in one direction
        name, as_drawn = EDGE_OF[street]
        way = name, as_drawn == c["forward"][k]
        assert edges.setdefault(edge, way) == way
        seen_streets.add(street)
        line = edge_line(name)[:: 1 if way[1] else -1]
        np.testing.assert_allclose(table.geometry[edge].coords, line, atol=1e-9)
        if k > len(c["edge_id"]) // 10 and seen(mode).points["p_road"][k].as_py() > 0.9:
            x, y = metres(*LINES[street].T)
            along = np.degrees(np.arctan2(*np.array([x[-1] - x[0], y[-1] - y[0]])))
            ahead = math.cos(math.radians(c["bearing_deg"][k] - along))
            assert (ahead > 0.0) == c["forward"][k]
    assert seen_streets >= {"stem", "left", "last"}


def matched_feet(mode: str, prefix: str) -> list[tuple[int, Any]]:
    """Epochs on a road, and a position of theirs relative to the edge in driving direction."""
    c = {name: column(mode, name) for name in ("source_id", "forward", f"{prefix}_lat",
                                               f"{prefix}_lon")}  # fmt: skip
    feet = []
    for k, source in enumerate(c["source_id"]):
        if source is not None:
            name, as_drawn = EDGE_OF[STREET_OF[int(source)]]
            line = edge_line(name)[:: 1 if as_drawn == c["forward"][k] else -1]
            feet.append((k, foot(c[f"{prefix}_lon"][k], c[f"{prefix}_lat"][k], line)))
    return feet


@MODES
def test_the_abscissa_is_that_of_the_matched_position(mode: str):
    said = column(mode, "abscissa_m")
    feet = matched_feet(mode, "matched")
    for k, place in feet:
        assert said[k] == pytest.approx(place.along, abs=0.02)
    assert sum(value is not None for value in said) == len(feet)


@MODES
def test_the_place_on_the_source_is_that_of_the_matched_position_on_the_street_as_drawn(mode: str):
    c = {name: column(mode, name) for name in ("source_id", "source_m", "source_share",
                                               "matched_lat", "matched_lon")}  # fmt: skip
    compared = 0
    for k, source in enumerate(c["source_id"]):
        if source is None:
            assert c["source_m"][k] is None
            assert c["source_share"][k] is None
            continue
        line = LINES[STREET_OF[int(source)]]
        along = foot(c["matched_lon"][k], c["matched_lat"][k], line).along
        length = GEOD.line_length(*line.T)
        assert c["source_m"][k] == pytest.approx(along, abs=0.02)
        assert c["source_share"][k] == pytest.approx(along / length, abs=1e-4)
        compared += 1
    assert compared > 20


@MODES
def test_the_matched_position_is_the_projection_of_the_position_in_the_map(mode: str):
    """And the lateral offset is its distance right of the edge."""
    lateral, p = column(mode, "lateral_m"), numbers(mode, "p_road")
    feet = dict(matched_feet(mode, "matched"))
    checked = 0
    for k, place in matched_feet(mode, "map"):
        now = mixtures(mode)[k]
        one = len(now.p) < 5 and now.p.max() > 0.98
        if p[k] > 0.998 and one and 20.0 < place.along < 400.0:
            checked += 1
            assert feet[k].along == pytest.approx(place.along, abs=0.2)
            assert lateral[k] == pytest.approx(place.right, abs=0.2)
    assert checked > 20
    assert [v is None for v in lateral] == [v is None for v in column(mode, "edge_id")]
    expected = [np.nan if e is None else seen(mode).estimates[k].lateral
                for k, e in enumerate(column(mode, "edge_id"))]  # fmt: skip
    assert_column(mode, "lateral_m", np.array(expected), atol=1e-9)


@MODES
def test_the_matched_position_equals_that_of_the_on_line_estimate(mode: str):
    on = [value is not None for value in column(mode, "edge_id")]
    expected = np.array([e.matched or (np.nan, np.nan) for e in seen(mode).estimates])
    expected[~np.array(on)] = np.nan
    assert_column(mode, "matched_lat", expected[:, 0], atol=1e-9)
    assert_column(mode, "matched_lon", expected[:, 1], atol=1e-9)


def error_of(mode: str, prefix: str, east: float = 0.0, north: float = 0.0) -> Array:
    """Errors of positions against the truth plus an offset, m, (n, 2)."""
    t = seen(mode).truth
    x, y = metres(numbers(mode, f"{prefix}lon"), numbers(mode, f"{prefix}lat"))
    return np.column_stack([x - t.x - east, y - t.y - north])


def believed(mode: str) -> NDArray[np.bool_]:
    """Answered epochs without the start and the outliers."""
    t = seen(mode).truth
    return answered(mode) & (t.s > 60.0) & (t.time < t.time[-1] - FALSE - 1.0)


@MODES
def test_positions_are_those_of_the_vehicle_in_the_world_and_in_the_map(mode: str):
    """Within their covariance; chi-square 25 is exceeded once in 270,000 times.

    Without wheels only on the roads.
    """
    ok = believed(mode)
    if mode == GNSS:
        ok &= seen(mode).truth.s < 850.0
    cov = np.array([[[m.cov[0, 0], m.cov[0, 1]], [m.cov[0, 1], m.cov[1, 1]]]
                    for m in mixtures(mode) if m is not None])  # fmt: skip
    none = np.full((2, 2), np.nan)
    map_cov = np.array([none if e.map_cov is None else e.map_cov for e in seen(mode).estimates])
    ok_cov = cov[ok[answered(mode)]]
    in_map = error_of(mode, "map_", *SHIFT)
    for error, spread in ((error_of(mode, ""), ok_cov), (in_map, map_cov[ok])):
        square = np.einsum("ni,nij,nj->n", error[ok], np.linalg.inv(spread), error[ok])
        assert square.max() < 25.0
        assert np.sqrt((error[ok] ** 2).sum(axis=1)).mean() < 6.0
    bearing = 90.0 - np.degrees(seen(mode).truth.heading)
    off = (numbers(mode, "bearing_deg") - bearing + 180.0) % 360.0 - 180.0
    assert (np.abs(off[ok]) < 5.0 * numbers(mode, "sigma_bearing_deg")[ok] + 3.0).all()


@MODES
def test_the_position_in_the_map_equals_that_of_the_on_line_estimate(mode: str):
    poses = [e.map_pose for e in seen(mode).estimates]
    ok = answered(mode)
    assert [pose is not None for pose in poses] == ok.tolist()
    lon, lat = np.full((2, len(poses)), np.nan)
    known = [pose for pose in poses if pose is not None]
    lon[ok], lat[ok] = TO_DEGREES.transform([p.x for p in known], [p.y for p in known])
    assert_column(mode, "map_lat", lat, atol=1e-9)
    assert_column(mode, "map_lon", lon, atol=1e-9)


@MODES
def test_probabilities_are_sums_over_the_hypotheses(mode: str):
    assert_column(
        mode, "p_road", by_epoch(mode, lambda m, _: m.shares().get(edge_of(m), 0.0)
                                 if edge_of(m) is not None else 0.0), atol=1e-9,
    )  # fmt: skip
    off = by_epoch(mode, lambda m, _: m.shares().get(None, 0.0))
    assert_column(mode, "p_off_road", off, atol=1e-9)
    # the way holds the edge and what is on the roads at most; the rest is on other roads
    way, answered_at = numbers(mode, "p_way"), answered(mode)
    assert (way >= numbers(mode, "p_road") - 1e-12)[answered_at].all()
    assert (way <= 1.0 - off + 1e-9)[answered_at].all()
    ambiguous = np.array(column(mode, "status")) == "ambiguous"
    rest = 1.0 - numbers(mode, "p_road") - off
    assert (rest[ambiguous] > 0.04).any()


@MODES
def test_alternatives_are_the_edges_in_the_order_of_their_probability(mode: str):
    for k, row in enumerate(column(mode, "alternatives")):
        m = mixtures(mode)[k]
        if m is None:
            assert row == []
            continue
        shares = list(m.shares().items())[:6]
        expected = {edge: p for edge, p in shares if edge is not None and p > 1e-9}
        assert {a["edge_id"]: a["p"] for a in row} == pytest.approx(expected, abs=1e-6)
        assert [a["p"] for a in row] == sorted((a["p"] for a in row), reverse=True)


def since_fix(mode: str) -> Array:
    """Seconds since the last fix."""
    t = seen(mode).truth.time
    last = np.where([f is not None for f in seen(mode).fixes], t, -np.inf)
    return np.asarray(t - np.maximum.accumulate(last))


def since_moved(mode: str) -> Array:
    """Seconds since the vehicle last moved."""
    t = seen(mode).truth
    moved = np.diff(t.s, prepend=-1.0) > 1e-6
    return np.asarray(t.time - np.maximum.accumulate(np.where(moved, t.time, -np.inf)))


@MODES
def test_the_status_is_the_first_that_applies(mode: str):
    """In the order lost, off_road, ambiguous, outage, stopped, on_road; limits to 0.2 s."""
    status, p, off = column(mode, "status"), numbers(mode, "p_way"), numbers(mode, "p_off_road")
    fix, stood, t = since_fix(mode), since_moved(mode), seen(mode).truth.time
    elsewhere = 0
    for k, said in enumerate(status):
        false = mode == GNSS and t[k] > t[-1] - FALSE + 0.5
        if not answered(mode)[k]:
            assert said == "lost"
        elif said == "lost":  # three fixes in a row that fit nothing
            assert mode == GNSS
            elsewhere += not false
        elif off[k] > 0.5:
            assert said == "off_road"
        elif p[k] < SETTINGS.ambiguous_below:
            assert said == "ambiguous"
        elif abs(fix[k] - SETTINGS.outage_after_s) < 0.2 or abs(stood[k] - 1.0) < 0.2:
            assert said in ("on_road", "outage", "stopped")
        elif fix[k] > SETTINGS.outage_after_s:
            assert said == "outage"
        elif mode == WHEELS:
            assert said == ("stopped" if stood[k] > 1.0 else "on_road")
        else:
            assert said == "on_road"
    if mode == GNSS:
        assert status[-4:] == ["lost"] * 4
        assert status[-6:-4] == ["off_road"] * 2
        assert elsewhere <= 1


def away_of(mode: str) -> Array:
    """Distance (m) of the last fix if it is an outlier, else 0, for each epoch."""
    s: Seen = seen(mode)
    away, last = np.zeros(len(s.fixes)), 0.0
    for k, fix in enumerate(s.fixes):
        m = mixtures(mode)[k]
        if fix is not None and m is not None:
            _, _, d = GEOD.inv(m.mean[0], m.mean[1], fix.lon_deg, fix.lat_deg)
            own = 1.5 * max(s.estimates[k].gnss_scale, 1.0)
            sigma = math.sqrt(own**2 + m.cov[0, 0] + m.cov[1, 1])
            last = d if d > max(20.0, 6.0 * sigma) else 0.0
        away[k] = last
    return np.where(since_fix(mode) <= 3.0, away, 0.0)


NUMBER = re.compile(r"\((\d\.\d\d)\)")


def hundredths(words: str) -> list[float]:
    """Probabilities in a reason."""
    return [float(p) for p in NUMBER.findall(words)]


@MODES
def test_the_reason_names_the_status_and_outliers_and_the_gnss_scale(mode: str):
    words = {
        "on_road": "", "off_road": "no mapped road fits", "lost": "fixes fit no hypothesis",
        "outage": "no GNSS fix for a while: dead reckoning and map",
        "stopped": "the vehicle stands",
    }  # fmt: skip
    away = away_of(mode)
    names = roads().edges_table().name
    titles = {e: f"{name}, edge {e}" for e, name in enumerate(names)} | {None: "off the roads"}
    rows = zip(column(mode, "status"), column(mode, "reason"), strict=True)
    for k, (status, said) in enumerate(rows):
        m, scale = mixtures(mode)[k], seen(mode).estimates[k].gnss_scale
        if m is None:
            assert said == "no fix has come yet"
            continue
        if status == "ambiguous":
            shares = list(m.shares().items())
            main = " or ".join(
                f"{titles[e]} ({p:.2f})" for i, (e, p) in enumerate(shares) if i < 2 or p >= 0.05
            )
        else:
            main = words[status]
        gnss = ""
        if away[k] > 0.0:
            gnss = f"fixes {away[k]:.0f} m away are rejected"
        elif round(scale, 1) > 2.0 and status != "outage":
            gnss = f"GNSS sigmas taken {scale:.1f} times as large"
        if away[k] > 0.0 and status == "lost":
            main = ""
        expected = "; ".join(part for part in (main, gnss) if part)
        assert NUMBER.sub("", said) == NUMBER.sub("", expected)
        # P is a float of 32 bits, rounded
        assert hundredths(said) == pytest.approx(hundredths(expected), abs=0.0101)
        assert said == expected or status == "ambiguous"


def without_the_unknown(m: Mixture, status: str) -> tuple[Any, Any]:
    """Which entries are hypotheses, and their weights.

    The entry for unknown causes, at the mean of the mixture, is none.
    """
    unknown = 0.9 if status == "lost" else SETTINGS.unknown
    known = np.ones(len(m.p), bool)
    extra = [i for i, e in enumerate(m.edge) if e is None and abs(m.p[i] - unknown) < 1e-15]
    known[extra[-1:]] = False
    return known, m.p[known] / (1.0 - unknown)


def restless(mode: str) -> np.ndarray:
    """√(λ / λ₀) by which levels with wheels grow, (n,): λ₀ follows a larger λ in 90 s."""
    scale, time = numbers(mode, "gnss_scale"), seen(mode).truth.time
    more, calm, last = np.ones(len(time)), 0.0, -math.inf
    for k, fix in enumerate(seen(mode).fixes):
        if mode != WHEELS or fix is None or time[k] - last < 0.95 or np.isnan(scale[k]):
            continue
        since = time[k] - last if time[k] - last <= 6.0 else 1.0  # after a pause it begins anew
        now, last = max(scale[k], 0.9), time[k]
        calm = now if now < calm or calm == 0.0 else calm
        calm += (now - calm) * (1.0 - math.exp(-since / 90.0))
        more[k:] = max(math.sqrt(now / calm), 1.0)
    return more


def tails(mode: str) -> np.ndarray:
    """How many times wider the sigmas of levels are, (n,): Student's, of what was learnt so far."""
    time, wider = seen(mode).truth.time, np.ones(len(seen(mode).fixes))
    learnt, last, usual = -1.0, -math.inf, -2.0 * math.log(SETTINGS.protection_risk)
    for k, fix in enumerate(seen(mode).fixes):
        if fix is None or time[k] - last < 0.95 or time[k] > time[-1] - 2.0:
            continue  # the last outliers teach nothing
        learnt = 0.0 if learnt < 0.0 else learnt + min(time[k] - last, 10.0)
        last = time[k]
        freedom = 8.0 + learnt / 3.0 if mode == WHEELS else 16.0
        wider[k:] = math.sqrt(freedom * (math.exp(usual / freedom) - 1.0) / usual)
    return wider


def reach(mode: str, k: int) -> float:
    """Metres to the fix that is not believed, and three of its sigmas, of who is lost; else 0.

    From the most probable hypothesis; levels are no shorter.
    """
    m, fix = mixtures(mode)[k], seen(mode).fixes[k]
    if m is None or fix is None or column(mode, "status")[k] != "lost":
        return 0.0
    lon, lat = m.place[np.argmax(m.p)]
    x, y = metres([lon, fix.lon_deg], [lat, fix.lat_deg])
    return math.hypot(x[1] - x[0], y[1] - y[0]) + 3.0 * math.sqrt(fix.cov_ee)


def assert_beyond_at_the_risk(
    mode: str, name: str, about: Callable[[Mixture, Any], tuple[Any, Any]]
) -> None:
    """Sum w exp(-max(level - d, 0)^2 / 2 sigma^2) = risk, to 1e-3 of every level.

    The sigmas are wider by `tails`, and with wheels the level is the one told over √(λ / λ₀).
    Of who is lost it is `reach`, where that is more.

    Args:
        mode: The odometry.
        name: Column of the level.
        about: Distances d of hypotheses from the mean, and their sigmas.
    """
    levels, risk = numbers(mode, name) / restless(mode), SETTINGS.protection_risk
    wider = tails(mode)
    for k, m in enumerate(mixtures(mode)):
        if m is None:
            assert np.isnan(levels[k])
            continue
        known, w = without_the_unknown(m, column(mode, "status")[k])
        away, sigma = about(m, seen(mode).estimates[k])
        wide = wider[k] * sigma[known]
        low, high = (
            (w * np.exp(-0.5 * (np.maximum(r - away[known], 0.0) / wide) ** 2)).sum()
            for r in (0.999 * levels[k], 1.001 * levels[k])
        )
        far = reach(mode, k)
        if levels[k] <= far * (1.0 + 1e-6):
            assert levels[k] == pytest.approx(far, rel=1e-6)
        else:
            assert low >= risk * (1.0 - 1e-6)
        assert high <= risk * (1.0 + 1e-6)


@MODES
def test_the_protection_level_bounds_the_tail_of_the_mixture(mode: str):
    """With the major axes of the hypotheses."""

    def about(m: Mixture, estimate: Any) -> tuple[Any, Any]:
        axes = np.sqrt([np.linalg.eigvalsh(cov)[-1] for cov in m.covs])
        return np.hypot(*m.off.T), axes

    assert_beyond_at_the_risk(mode, "protection_level_m", about)


@MODES
@pytest.mark.parametrize(("name", "across"), [("level_along_m", 0), ("level_across_m", 1)])
def test_the_levels_bound_the_tail_along_the_heading_and_across_it(mode: str, name, across):
    """As the protection level, with the distances and sigmas of that direction."""

    def about(m: Mixture, estimate: Any) -> tuple[Any, Any]:
        s, c = math.cos(m.mean[2]), math.sin(m.mean[2])  # of the heading, by the bearing
        e = np.array([[c, s], [-s, c]][across])
        return np.abs(m.off @ e), np.sqrt([e @ cov @ e for cov in m.covs])

    assert_beyond_at_the_risk(mode, name, about)


@MODES
def test_the_gnss_scale_is_the_ratio_of_true_to_reported_errors(mode: str):
    expected = by_epoch(mode, lambda _, e: e.gnss_scale)
    assert_column(mode, "gnss_scale", expected, rtol=1e-11)  # rounded sums, over a drive
    if mode == WHEELS:
        s = seen(mode)
        rows = [k for k, f in enumerate(s.fixes) if f is not None and believed(mode)[k]]
        x, y = metres([s.fixes[k].lon_deg for k in rows], [s.fixes[k].lat_deg for k in rows])
        off = np.column_stack([x - s.truth.x[rows], y - s.truth.y[rows]])
        ratio = math.sqrt((off**2).mean()) / 1.5
        learnt = numbers(mode, "gnss_scale")[rows[len(rows) // 2 :]].mean()
        assert 0.5 * ratio < learnt < 2.0 * ratio


@MODES
def test_the_map_scale_begins_at_one_and_is_never_below_a_metre(mode: str):
    scale = numbers(mode, "map_scale")
    assert np.isnan(scale).tolist() == (~answered(mode)).tolist()
    known = scale[~np.isnan(scale)]
    assert known[0] == 1.0
    assert (known >= 1.0 / 4.6).all()
    assert (known[-1] < 1.0) == (mode == WHEELS)  # the scene's map is exact


@MODES
def test_attributes_are_those_of_the_street_that_the_source_names(mode: str):
    """And not of another one on the same edge."""
    source = column(mode, "source_id")
    want = {"name": "name", "highway": "highway", "speed_limit_kmh": "maxspeed", "lanes": "lanes",
            "layer": "layer", "bridge": "bridge", "tunnel": "tunnel"}  # fmt: skip
    for name, given in want.items():
        usual = 0 if name in ("layer", "bridge", "tunnel") else None
        for k, said in enumerate(column(mode, name)):
            if source[k] is None:
                assert said is None
                continue
            assert said == STREETS[STREET_OF[int(source[k])]].get(given, usual)


@MODES
def test_the_geometry_is_a_point_at_the_pose(mode: str):
    frame = seen(mode).result.points
    ok = answered(mode)
    np.testing.assert_allclose(frame.geometry.x[ok], numbers(mode, "lon")[ok], atol=1e-12)
    np.testing.assert_allclose(frame.geometry.y[ok], numbers(mode, "lat")[ok], atol=1e-12)
    assert frame.geometry.isna().tolist() == (~ok).tolist()


@MODES
def test_an_on_line_estimate_equals_the_row_of_its_epoch(mode: str):
    ok, rows = answered(mode), seen(mode).estimates
    assert [e.answered for e in rows] == ok.tolist()
    nothing, no_cov = Pose(*[np.nan] * 6), np.full((3, 3), np.nan)
    poses = [e.pose or nothing for e in rows]
    covs = [no_cov if e.cov is None else e.cov for e in rows]
    speeds = [np.nan if e.speed is None else e.speed for e in rows]
    fields = {
        "lat": [p.lat for p in poses], "lon": [p.lon for p in poses],
        "bearing_deg": [p.bearing_deg for p in poses], "p_road": [e.p_road for e in rows],
        "p_way": [e.p_way for e in rows],
        "p_off_road": [e.p_off_road for e in rows], "speed_mps": speeds,
        "protection_level_m": [e.protection_level for e in rows],
        "level_along_m": [e.level_along_m for e in rows],
        "level_across_m": [e.level_across_m for e in rows],
        "gnss_scale": [e.gnss_scale for e in rows],
        "map_scale": [e.map_scale for e in rows],
        "sigma_bearing_deg": [math.degrees(math.sqrt(cov[2, 2])) for cov in covs],
    }  # fmt: skip
    for name, values in fields.items():
        assert_column(mode, name, np.where(ok, values, np.nan), rtol=1e-9)
    assert column(mode, "edge_id") == [e.edge for e in rows]
    assert column(mode, "status") == [e.status for e in rows]
    away = np.array([e.disbelieved for e in rows])
    np.testing.assert_allclose(away[ok], away_of(mode)[ok], atol=0.01)
    on = [k for k, edge in enumerate(column(mode, "edge_id")) if edge is not None]
    for name, value in (("abscissa_m", "abscissa"), ("lateral_m", "lateral")):
        said = [getattr(rows[k], value) for k in on]
        np.testing.assert_allclose(numbers(mode, name)[on], said, atol=1e-9)
    trace = [float(np.trace(cov[:2, :2])) for cov in covs]
    total = numbers(mode, "cov_ee_m2") + numbers(mode, "cov_nn_m2")
    np.testing.assert_allclose(total, np.where(ok, trace, np.nan), rtol=1e-9)
