"""A map that does not hold the drive, and options that concern nothing, are refused or said."""

import sys
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely

import whichroad
from whichroad import cli
from whichroad.errors import MapError, SettingError
from whichroad.geodesy.plane import Plane
from whichroad.roadmap.extent import NEAR, are_near, distance

PLANE = Plane(49.4, 8.7)
N = 40


def street(*points: tuple[float, float]) -> shapely.LineString:
    """A line through points of the plane."""
    lat, lon = PLANE.to_geodetic(*np.array(points, float).T)
    return shapely.LineString(np.column_stack([lon, lat]))


def map_of(*lines: shapely.LineString) -> whichroad.RoadMap:
    return whichroad.RoadMap.from_edges(geopandas.GeoDataFrame(geometry=list(lines), crs=4326))


@pytest.fixture(scope="module")
def roads() -> whichroad.RoadMap:
    return map_of(street((0, 0), (250, 0)), street((250, 0), (500, 0)))


@pytest.fixture(scope="module")
def city() -> whichroad.RoadMap:
    """An extract in the form of an L, in whose empty corner no road is."""
    return map_of(
        *(street((0, k * 500), (0, k * 500 + 500)) for k in range(20)),
        *(street((k * 500, 0), (k * 500 + 500, 0)) for k in range(20)),
    )


def drive(x: float = 5.0, y: float = 0.0, step: float = 12.0) -> pd.DataFrame:
    """A drive to the east, at 25 m/s at most."""
    lat, lon = PLANE.to_geodetic(x + step * np.arange(N), np.full(N, y))
    time = 1.6e9 + max(1.0, step / 25.0) * np.arange(N)
    return pd.DataFrame({"time": time, "lat": lat, "lon": lon})


def test_the_distance_from_a_map_is_that_from_its_nearest_road(city):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-30_000, 30_000, (2, 200))
    lat, lon = PLANE.to_geodetic(x, y)
    arms = shapely.union_all([shapely.LineString([(0, 0), (0, 10_000)]),
                              shapely.LineString([(0, 0), (10_000, 0)])])  # fmt: skip
    true = shapely.distance(arms, shapely.points(x, y))  # plane m, of a plane true to 1e-5 here
    found = [distance(city, *place) for place in zip(lat.tolist(), lon.tolist(), strict=True)]
    np.testing.assert_allclose(found, true, rtol=1e-4)
    clear = np.abs(true - NEAR) > 1.0
    assert clear.sum() > 190
    np.testing.assert_array_equal(are_near(lat, lon, city)[clear], true[clear] < NEAR)
    near = rng.uniform(-2_500, 12_500, (2, 2000))
    lat, lon = PLANE.to_geodetic(*near)
    true = shapely.distance(arms, shapely.points(*near))
    clear = np.abs(true - NEAR) > 1.0
    np.testing.assert_array_equal(are_near(lat, lon, city)[clear], true[clear] < NEAR)
    assert 0.1 < are_near(lat, lon, city).mean() < 0.9


@pytest.mark.parametrize(("km", "said"), [(2, "2.0 km"), (10, "10.0 km"), (300, "300 km")])
def test_a_drive_that_is_nowhere_near_the_map_is_refused_with_its_distance(roads, km, said):
    with pytest.raises(MapError, match=rf"none of its 40 fixes .* {said} from the map.*extract\?"):
        whichroad.match(drive(y=-1000.0 * km), roads)


def test_a_drive_within_the_box_of_a_map_and_far_from_its_roads_is_refused(city):
    with pytest.raises(MapError, match=r"7\.0 km from the map"):
        whichroad.match(drive(x=7000.0, y=7000.0), city)


def test_swapped_coordinates_are_named(roads):
    swapped = drive().rename(columns={"lat": "lon", "lon": "lat"})
    with pytest.raises(MapError, match="were latitude and longitude swapped"):
        whichroad.match(swapped, roads)


def localized(
    roads: whichroad.RoadMap, fixes: pd.DataFrame, left: float = 12.0, right: float = 12.0
) -> whichroad.Localizer:
    """A localizer at the end of a drive with wheels."""
    localizer = whichroad.Localizer(roads)
    for time, lat, lon in fixes[["time", "lat", "lon"]].itertuples(index=False):
        localizer.take(whichroad.WheelSpeed(time, left, right))
        localizer.take(whichroad.GeoFix.with_sigma(time, lat, lon, 3.0))
    return localizer


def bend() -> pd.DataFrame:
    """Half a circle to the left, as wheels at 12 and 12.47 m/s tell it."""
    angle = np.pi * np.arange(N) / (N - 1) - 0.5 * np.pi
    radius = 12.23 * (N - 1) / np.pi
    lat, lon = PLANE.to_geodetic(250 + radius * np.cos(angle), radius * (1 + np.sin(angle)))
    return pd.DataFrame({"time": 1.6e9 + np.arange(N), "lat": lat, "lon": lon})


def test_swapped_coordinates_are_named_on_line_and_wheels_are_not(roads):
    turn = np.pi / (N - 1) * 0.75
    sound = localized(roads, bend(), 12.23 - turn, 12.23 + turn)
    assert [one.what for one in sound.diagnosis] == []
    assert "from the map" not in sound.estimate().reason
    swapped = bend().rename(columns={"lat": "lon", "lon": "lat"})
    found = localized(roads, swapped, 12.23 - turn, 12.23 + turn)
    assert [one.what for one in found.diagnosis] == ["map extent"]
    for text in (found.diagnosis[0].advice, found.estimate().reason):
        assert "km from the map" in text
        assert text.endswith("were latitude and longitude swapped?")
    assert found.estimate().reason.startswith("no mapped road fits; lat 8.7")
    again = whichroad.Localizer.from_bytes(found.to_bytes(), roads)
    assert again.diagnosis == found.diagnosis


def test_a_vehicle_that_leaves_the_map_is_told_so_on_line_and_one_false_fix_is_not(roads):
    away = localized(roads, drive(x=-1800.0))
    assert [one.what for one in away.diagnosis] == ["map extent"]
    assert "1.3 km from the map" in away.diagnosis[0].advice
    assert away.diagnosis[0].advice.endswith("is this the right extract?")
    localizer = localized(roads, drive())
    end = drive().time.iloc[-1]
    localizer.take(whichroad.GeoFix.with_sigma(end + 1.0, 8.7, 49.4, 3.0))
    assert [one.what for one in localizer.diagnosis] == []
    assert "from the map" not in localizer.estimate().reason


def test_a_drive_partly_outside_keeps_its_answer_and_says_how_much_lies_outside(roads):
    result = whichroad.match(drive(step=100.0), roads)  # to the east, 3.9 km
    points = result.points
    east = 5.0 + 100.0 * np.arange(N)
    outside = int((east > 500.0 + NEAR).sum())
    assert result.summary["fixes_outside_map"] == outside
    assert len(points) == N
    assert points.edge_id[1:5].notna().all()
    assert "fixes_outside_map" not in whichroad.match(drive(), roads).summary


def test_a_trip_of_many_that_is_off_the_map_says_so(roads):
    table = pd.concat([drive().assign(trip="a"), drive(y=-10_000.0).assign(trip="b")])
    rows = whichroad.match_many(table, roads, drive_id="trip").drives.to_pandas()
    assert rows.answered.tolist() == [True, False]
    assert "10.0 km from the map" in rows.reason[1]


def test_a_start_off_the_map_is_refused(roads):
    with pytest.raises(SettingError, match=r"start: lat 4\.4000, lon 8\.7000 is 5,0\d\d km from"):
        whichroad.match(drive(), roads, start=(4.4, 8.7, 90.0))
    with pytest.raises(SettingError, match=r"start: .* km from the map"):
        whichroad.Localizer(roads, start=(4.4, 8.7, 90.0))
    vague = whichroad.StartPose(49.4, 8.75, 0.0, 1500.0, np.inf)  # 3.6 km away, and says 1.5 km
    assert len(whichroad.match(drive(), roads, start=vague).points) == N


def test_a_start_that_the_first_fix_contradicts_is_said(city):
    lat, lon = PLANE.to_geodetic(0.0, 8000.0)
    result = whichroad.match(drive(), city, start=(lat, lon, 90.0))
    assert any("start pose is 8.0 km from the drive's first fix" in note
               for note in result.summary["notes"])  # fmt: skip


@pytest.mark.parametrize("mask", [(100, 200), (-50, -2), (1.5e9, 1.5e9 + 100)])
def test_a_mask_outside_the_drive_is_refused(roads, mask):
    with pytest.raises(SettingError, match=r"mask: .* the drive lasts 39 s"):
        whichroad.match(drive(), roads, mask=[mask])
    assert whichroad.match(drive(), roads, mask=[(30, 100)]).summary["fixes_masked"] == 10


# At the command line


@pytest.fixture
def run(monkeypatch, capsys, tmp_path, roads):
    """Run the command line in a folder with a drive and a map: exit code, output, errors."""
    monkeypatch.chdir(tmp_path)
    roads.save("city.map")
    drive().to_csv("in.csv", index=False)
    (tmp_path / "car.dbc").write_text("")

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["whichroad", *arguments])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code, said.out, said.err

    return call


def test_an_option_without_effect_is_refused_or_said(run):
    match = ("match", "in.csv", "--map", "city.map")
    code, _, error = run(*match, "--dbc", "car.dbc")
    assert (code, "in.csv holds no CAN frames" in error) == (1, True)
    code, _, error = run(*match, "--mask", "1000:2000")
    assert (code, "the drive lasts 39 s" in error) == (1, True)
    code, _, error = run(*match, "--start", "4.4,8.7,90")
    assert (code, "from the map" in error) == (1, True)
    code, _, error = run(*match, "--crs", "EPSG:3067")
    assert (code, "crs (--crs) EPSG:3067 not used" in error) == (0, True)
    Path("in.gpx").write_text('<gpx version="1.1"><trk><trkseg/></trk></gpx>')
    code, _, error = run("match", "in.gpx", "--map", "city.map", "--crs", "EPSG:3067")
    assert code == 1


def crossing(y: float) -> whichroad.RoadMap:
    """A street to the east, and one to the north from its middle."""
    return map_of(
        street((0, y), (250, y)), street((250, y), (500, y)), street((250, y), (250, y + 200))
    )


def test_what_lies_outside_is_said(run):
    drive(step=100.0).to_csv("long.csv", index=False)
    code, _, error = run("match", "long.csv", "--map", "city.map")
    assert code == 0
    assert "note: long: 25 of 40 fixes (62.5 %) are farther than 1 km from every road" in error


def test_a_report_with_a_map_of_another_place_is_refused(run):
    for name, y in (("home.map", 0.0), ("other.map", 9000.0)):
        crossing(y).save(name)
    assert run("match", "in.csv", "--map", "home.map", "-o", "points.parquet")[0] == 0
    report = ("report", "points.parquet", "-o", "page.html", "--map")
    code, _, error = run(*report, "city.map")
    assert (code, "the map has 2 edges" in error) == (1, True)
    code, _, error = run(*report, "other.map")
    assert (code, "9.0 km from the map's roads of the same numbers" in error) == (1, True)
    assert not Path("page.html").exists()
    assert run(*report, "home.map")[0] == 0
