"""What users are told beside the pose: competing roads, protection, rejected fixes."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import whichroad
from strategies import seeds
from whichroad.cli.match import print_summary
from whichroad.epochs import build_timeline
from whichroad.filter.state import NO_EDGE
from whichroad.geodesy.plane import Plane
from whichroad.observations import Drive, Fixes, GeoFix, WheelCounts, WheelTicks
from whichroad.online import Estimate, Localizer
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.settings import Settings, Vehicle
from whichroad.simulate import SimulatedDrive, draw_town, simulate_drive
from whichroad.tables.estimates import _competing
from whichroad.tables.export import points_table
from whichroad.tables.status import STATUS, competing, reason

PLANE = Plane(49.4, 8.7)
CAR = Vehicle(track_width=1.5, metres_per_tick_left=0.01, metres_per_tick_right=0.01)
SIGMA = 3.0


@pytest.fixture(scope="module")
def roads() -> RoadMap:
    """Two parallel streets 20 m apart, named, 1.4 km long."""
    import geopandas
    from shapely import LineString

    lines = []
    for y in (0.0, 20.0):
        lat, lon = PLANE.to_geodetic(np.array([0.0, 1400.0]), np.array([y, y]))
        lines.append(LineString(np.column_stack([lon, lat])))
    table = {"name": ["South Street", "North Street"], "oneway": ["yes", "yes"]}
    return RoadMap.from_edges(geopandas.GeoDataFrame(table, geometry=lines, crs="EPSG:4326"))


def fixes(x: np.ndarray, y: np.ndarray, time: np.ndarray) -> Fixes:
    """Fixes of 3 m, their course said with the first one only."""
    n = len(x)
    course = np.full(n, np.inf)
    course[0] = 6.0
    return Fixes(
        time, *PLANE.to_geodetic(x, y), np.full(n, SIGMA**2), np.zeros(n), np.full(n, SIGMA**2),
        np.full(n, 10.0), np.full(n, np.inf), np.full(n, 90.0), course, np.zeros(n, np.uint8),
    )  # fmt: skip


def drive(y: float, jump: float = 0.0) -> Drive:
    """A minute eastwards at 10 m/s and this y; fixes jump north from second 40 to 50."""
    time = np.arange(0.0, 60.0, 0.1)
    ticks = np.round(1000.0 * time)
    at = time[::10]
    aside = np.where((at >= 40.0) & (at < 50.0), jump, 0.0)
    log = fixes(100.0 + 10.0 * at, y + aside, at)
    return Drive("one", log, WheelCounts(time, ticks, ticks))


def told(roads: RoadMap, one: Drive, **settings: float) -> dict[str, list]:
    """The points of a drive, column by column."""
    tuned = Settings(**settings)
    timeline = build_timeline(one, roads.plane, CAR)
    output = localize_recorded(roads, timeline, vehicle=CAR, settings=tuned).output
    return points_table("one", timeline.epochs, output, roads).to_pydict()


def one_by_one(one: Drive) -> list[GeoFix | WheelTicks]:
    """A drive's records in time order, wheels before fixes."""
    counts = one.odometry
    assert one.fixes is not None
    assert isinstance(counts, WheelCounts)
    names = [n for n in Fixes.__slots__ if n != "flags"]
    columns = [getattr(one.fixes, n).tolist() for n in names]
    fixed = [GeoFix(*row) for row in zip(*columns, strict=True)]
    rows = zip(counts.time.tolist(), counts.left.tolist(), counts.right.tolist(), strict=True)
    return sorted([*(WheelTicks(*row) for row in rows), *fixed], key=lambda r: r.time)


def on_line(roads: RoadMap, one: Drive) -> list[Estimate]:
    """The same on line."""
    localizer = Localizer(roads, vehicle=CAR)
    return [localizer.update(r) for r in one_by_one(one)]


def test_where_roads_compete_the_reason_names_them(roads: RoadMap):
    points = told(roads, drive(10.0))
    ambiguous = [r for r, s in zip(points["reason"], points["status"], strict=True)
                 if s == "ambiguous"]  # fmt: skip
    assert len(ambiguous) > 100
    assert all("South Street, edge " in r and "North Street, edge " in r for r in ambiguous)
    first = ambiguous[50]
    assert first.count("(0.") == first.count(" or ") + 1


@given(seeds, st.integers(0, 8))
def test_many_are_put_into_words_as_one_is(roads: RoadMap, seed: int, rows: int):
    """Also shares that lie between two of two decimals: 0.125, 0.375, ..."""
    rng = np.random.default_rng(seed)
    edges = rng.integers(-1, len(roads), (rows, 6)).astype(np.int32)
    edges[np.arange(6) >= rng.integers(1, 7, (rows, 1))] = NO_EDGE
    p = -np.sort(-rng.integers(0, 41, (rows, 6)) / 40.0).astype(np.float32).astype(float)
    wanted = [
        competing([(e, q) for e, q in zip(*pair, strict=True) if e != NO_EDGE], roads.name)
        for pair in zip(edges.tolist(), p.tolist(), strict=True)
    ]
    assert _competing(edges, p, roads) == wanted


def test_on_line_the_same_roads_are_named(roads: RoadMap):
    estimate = on_line(roads, drive(10.0))[-1]
    assert estimate.status == "ambiguous"
    assert "South Street, edge " in estimate.reason
    assert "North Street, edge " in estimate.reason


def test_a_receiver_that_jumps_is_said_not_to_be_believed(roads: RoadMap):
    points = told(roads, drive(0.0, jump=200.0))
    during = points["reason"][420]
    assert "fixes 200 m away are rejected" in during or "fixes 199 m away" in during
    assert not any("believed" in r for r in points["reason"][:400])
    assert "believed" not in points["reason"][-1]
    estimates = {e.time: e for e in on_line(roads, drive(0.0, jump=200.0))}
    assert "m away are rejected" in estimates[min(estimates, key=lambda t: abs(t - 42.0))].reason


def test_the_protection_level_is_null_before_the_first_answer_and_no_less_than_the_ellipse(
    roads: RoadMap,
):
    late = drive(0.0)
    assert late.fixes is not None
    late = Drive(
        "one", Fixes(*(getattr(late.fixes, n)[5:] for n in Fixes.__slots__)), late.odometry
    )
    points = told(roads, late)
    assert points["protection_level_m"][0] is None
    assert points["gnss_scale"][0] is None
    assert points["map_scale"][0] is None
    assert points["reason"][0] == "no fix has come yet"
    known = [(p, a) for p, a in zip(points["protection_level_m"], points["ellipse_major_m"],
                                    strict=True) if p is not None]  # fmt: skip
    assert len(known) > 500
    assert all(p > 3.0 * a for p, a in known)  # 1e-3 of a Gaussian lies beyond 3.7 sigma


def test_a_smaller_risk_asks_for_a_larger_protection_level(roads: RoadMap):
    usual, strict = (
        np.array(told(roads, drive(0.0), protection_risk=r)["protection_level_m"][10:], float)
        for r in (1e-3, 1e-7)
    )
    assert (strict > usual).all()


def test_on_line_and_recorded_say_the_same_protection_and_scale(roads: RoadMap):
    one = drive(0.0)
    assert one.fixes is not None
    between = Drive("one", Fixes(one.fixes.time + 0.05, *(getattr(one.fixes, n)
                                 for n in Fixes.__slots__[1:])), one.odometry)  # fmt: skip
    points = told(roads, between)
    estimates = on_line(roads, between)
    assert len(estimates) == len(points["time"])
    assert math.isinf(estimates[0].protection_level)
    for k in (1, 100, 400, 600):
        assert estimates[k].protection_level == pytest.approx(points["protection_level_m"][k])
        assert estimates[k].gnss_scale == pytest.approx(points["gnss_scale"][k])
        assert estimates[k].map_scale == pytest.approx(points["map_scale"][k])


def test_on_line_the_pose_in_the_map_s_frame_is_near_the_road(roads: RoadMap):
    estimate = on_line(roads, drive(3.0))[-1]
    lat, _ = roads.plane.to_geodetic(0.0, 0.0)
    assert math.isfinite(lat)
    assert estimate.map_cov.shape == (2, 2)
    assert np.linalg.eigvalsh(estimate.map_cov)[0] > 0.0
    assert estimate.map_pose.heading == estimate.pose.heading


@pytest.mark.parametrize("status", STATUS)
def test_every_status_has_words_and_adapted_noise_is_added_to_them(status: str):
    assert status == "on_road" or reason(status)
    larger = reason(status, scale=2.3)
    assert larger.endswith("GNSS sigmas taken 2.3 times as large") == (status != "outage")


def test_what_a_receiver_alone_begins_with_is_no_reason(roads: RoadMap):
    fixes = drive(0.0).fixes
    assert fixes is not None
    online = Localizer(roads)
    for time, lat, lon in list(zip(fixes.time, fixes.lat_deg, fixes.lon_deg, strict=True))[:5]:
        said = online.update(GeoFix(float(time), float(lat), float(lon), 9.0, 0.0, 9.0))
        assert said.gnss_scale > 1.9
        assert "GNSS sigmas" not in said.reason


def test_a_third_road_is_named_only_when_it_counts():
    few = reason("ambiguous", roads=[(1, 0.7), (-1, 0.27), (3, 0.03)])
    assert few == "edge 1 (0.70) or off the roads (0.27)"
    many = reason("ambiguous", roads=[(1, 0.5), (2, 0.3), (3, 0.2)])
    assert many == "edge 1 (0.50) or edge 2 (0.30) or edge 3 (0.20)"


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """The paper's town."""
    path = tmp_path_factory.mktemp("town") / "town.osm"
    path.write_text(draw_town(), "utf-8")
    return RoadMap.from_osm(path)


@pytest.fixture(scope="module")
def ignorant(town: RoadMap) -> SimulatedDrive:
    """Half an hour whose user believes in wheels an eighth smaller than they are."""
    one = simulate_drive(town, seed=5, length_m=15_000.0)
    ticks = one.vehicle.metres_per_tick_left
    believed = replace(
        one.vehicle, metres_per_tick_left=0.88 * ticks, metres_per_tick_right=0.88 * ticks
    )
    return replace(one, vehicle=believed)


def test_a_matched_drive_says_what_does_not_fit_and_its_summary_is_json(
    town: RoadMap, ignorant: SimulatedDrive
):
    result = whichroad.match(ignorant.drive, town, vehicle=ignorant.vehicle)
    assert [f.what for f in whichroad.diagnose(result)] == ["wheels: scale"]
    assert result.diagnosis[0].statistic == pytest.approx(1.0 / 0.88, abs=0.03)
    [told] = json.loads(json.dumps(result.summary["diagnosis"]))
    assert told["what"] == "wheels: scale"
    assert told["advice"] == result.diagnosis[0].advice


def test_on_line_the_diagnosis_is_that_of_the_recorded_drive(
    town: RoadMap, ignorant: SimulatedDrive
):
    localizer = Localizer(town, vehicle=ignorant.vehicle)
    for record in one_by_one(ignorant.drive):
        localizer.update(record)
    assert [f.what for f in whichroad.diagnose(localizer)] == ["wheels: scale"]


def test_a_drive_by_gnss_alone_or_by_the_paper_is_not_judged(
    town: RoadMap, ignorant: SimulatedDrive
):
    alone = replace(ignorant.drive, odometry=None)
    assert whichroad.match(alone, town).diagnosis == ()
    literal = whichroad.match(ignorant.drive, town, vehicle=ignorant.vehicle, model="paper")
    assert literal.diagnosis == ()


def test_the_command_line_tells_what_does_not_fit_beside_the_answer(
    town: RoadMap, ignorant: SimulatedDrive, capsys: pytest.CaptureFixture[str]
):
    print_summary(whichroad.match(ignorant.drive, town, vehicle=ignorant.vehicle))
    said = capsys.readouterr()
    assert "warning: wheels: scale: 1.1" in said.err
    assert "correct metres_per_tick" in said.err
    assert "diagnosis" not in said.out
