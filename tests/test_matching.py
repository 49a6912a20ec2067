"""One call: every way to say what was driven and where gives one answer, or says what is wrong."""

import pickle
import sys

import geopandas
import numpy as np
import pandas as pd
import pytest
import shapely

import whichroad
from laws.public import geo_fixes, road_map
from scenes import drive_along
from whichroad import cli
from whichroad.errors import DriveError, MapError, ReadError, SettingError
from whichroad.geodesy.plane import Plane
from whichroad.observations import Distance, GeoFix, WheelSpeed

PLANE = Plane(49.4, 8.7)
UTM = "EPSG:32632"
N = 40


@pytest.fixture(scope="module")
def edges() -> geopandas.GeoDataFrame:
    """A street of two rows, and one that crosses its end."""
    lines = []
    for line in ([(0, 0), (250, 0)], [(250, 0), (500, 0)], [(500, 0), (500, 200)],
                 [(500, 0), (500, -200)]):  # fmt: skip
        lat, lon = PLANE.to_geodetic(*np.array(line, float).T)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
    return geopandas.GeoDataFrame({"id": [1, 2, 3, 4]}, geometry=lines, crs="EPSG:4326")


@pytest.fixture(scope="module")
def roads(edges) -> whichroad.RoadMap:
    return whichroad.RoadMap.from_edges(edges)


@pytest.fixture(scope="module")
def fixes() -> pd.DataFrame:
    """A drive of half a kilometre to the east."""
    lat, lon = PLANE.to_geodetic(5.0 + 12.0 * np.arange(N), np.zeros(N))
    return pd.DataFrame({"time": 1.6e9 + np.arange(N), "lat": lat, "lon": lon})


@pytest.fixture(scope="module")
def answer(fixes, roads) -> pd.DataFrame:
    return whichroad.match(fixes, roads).points


def observed(fixes: pd.DataFrame) -> list[GeoFix]:
    rows = zip(fixes.time, fixes.lat, fixes.lon, strict=True)
    return [GeoFix(time=float(t), lat_deg=a, lon_deg=o) for t, a, o in rows]


def same(one, two) -> None:
    np.testing.assert_allclose(one.lat, two.lat, atol=1e-9)
    np.testing.assert_allclose(one.p_road, two.p_road, atol=1e-6)
    assert one.edge_id.tolist() == two.edge_id.tolist()


def test_observations_and_rows_are_matched_like_the_table_of_them(fixes, roads, answer):
    seen = observed(fixes)
    same(whichroad.match(seen, roads).points, answer)
    same(whichroad.match(seen[::-1], roads).points, answer)  # in any order
    same(whichroad.match(fixes.to_dict("records"), roads).points, answer)
    stamped = fixes.assign(time=pd.to_datetime(fixes.time, unit="s", utc=True))
    same(whichroad.match(stamped.to_dict("records"), roads).points, answer)


def test_observations_of_wheels_are_odometry_and_what_cannot_be_is_counted(fixes, roads):
    seen = observed(fixes)
    wheels = [WheelSpeed(1.6e9 + 0.1 * k, 12.0, 12.0) for k in range(10 * N)]
    wrong = [WheelSpeed(1.6e9 + 3.05, np.nan, 12.0), GeoFix(1.6e9 + 7.5, np.nan, 8.7)]
    result = whichroad.match([*seen, *wheels, *wrong], roads)
    assert result.summary["epochs"] == 10 * N
    assert result.summary["fixes"] == N
    skipped = {"missing wheel speed": 1, "impossible position": 1}
    assert result.summary["skipped"] == skipped
    with pytest.raises(ReadError, match=r"Distance, WheelSpeed together; one kind"):
        whichroad.match([*seen, *wheels, Distance(1.6e9, 0.0)], roads)


def test_columns_x_and_y_are_places_in_the_system_that_is_told(fixes, roads, answer):
    points = geopandas.GeoSeries(geopandas.points_from_xy(fixes.lon, fixes.lat, crs=4326))
    plane = points.to_crs(UTM)
    table = pd.DataFrame({"time": fixes.time, "X": plane.x, "Y": plane.y})
    same(whichroad.match(table, roads, crs=UTM).points, answer)
    with pytest.raises(ReadError, match=r"crs= \(--crs\)"):
        whichroad.match(table, roads)
    with pytest.raises(DriveError, match=r"^columns x, y not used: no crs \(--crs\) was given"):
        whichroad.match(table.assign(odo=12.0 * np.arange(N)), roads)


def test_own_columns_as_text_are_refused(fixes, roads):
    with pytest.raises(SettingError, match=r"columns is 'time=a'; .*as a dict"):
        whichroad.match(fixes, roads, columns="time=a")


def test_a_frame_of_edges_is_a_map(fixes, edges, answer):
    same(whichroad.match(fixes, edges).points, answer)


@pytest.mark.parametrize("name", ["town.gpkg", "town.shp", "town.fgb", "town.geojson"])
def test_what_geopandas_reads_is_a_map(fixes, edges, answer, tmp_path, name: str):
    edges.to_file(tmp_path / name)
    points = whichroad.match(fixes, tmp_path / name).points
    np.testing.assert_allclose(points.lat, answer.lat, atol=1e-6)  # GeoJSON has seven digits
    # which way it goes is even at the first fix
    assert points.source_id.iloc[1:].tolist() == answer.source_id.iloc[1:].tolist()


def test_what_is_no_map_and_no_settings_is_refused(fixes, roads):
    with pytest.raises(MapError, match="roads: NoneType was given; a RoadMap"):
        whichroad.match(fixes, None)
    with pytest.raises(SettingError, match=r"settings is a dict; whichroad\.Settings"):
        whichroad.match(fixes, roads, settings={"default_sigma_m": 3.0})
    with pytest.raises(SettingError, match=r"vehicle is a dict; whichroad\.Vehicle"):
        whichroad.match(fixes, roads, vehicle={"track_width": 1.5})


def test_a_result_says_what_it_is_of(fixes, roads):
    assert repr(whichroad.match(fixes, roads)) == "Result('drive', 40 epochs, 0.5 km)"
    both = pd.concat([fixes.assign(trip="a"), fixes.assign(trip="b")])
    assert repr(whichroad.match(both, roads)) == "Result(2 drives, 80 epochs, 0.9 km)"


def test_drives_that_fail_are_told_by_name_and_the_others_go_on(fixes, roads):
    placed, blind = fixes.assign(trip="a", speed=12.0), fixes.assign(trip="b", speed=12.0)
    far = fixes.assign(trip="c", lat=fixes.lat + 20.0)
    result = whichroad.match(pd.concat([placed, blind.assign(lat=None, lon=None), far]), roads)
    assert repr(result) == "Result(1 drive, 2 failed, 40 epochs, 0.5 km)"
    first, second = result.summary["failed"]
    assert first.startswith("b: ")
    assert "; the drive has no usable GNSS fix; " in first
    assert second.startswith("c: none of its 40 fixes is within 1 km")


def test_the_figures_of_several_drives_are_those_of_one_over_all_epochs(fixes, roads):
    short = fixes.head(10).assign(trip="b", lat=[91.0, *fixes.lat[1:10]])
    both = pd.concat([fixes.assign(trip="a", accuracy=-1.0), short])
    alone = whichroad.match(fixes, roads).summary
    told = whichroad.match(both, roads).summary
    points = whichroad.match(both, roads).points
    assert alone.keys() - told.keys() <= {"drive_id", "sources", "diagnosis"}
    assert told["epochs"] == len(points) == N + 9
    for name in ("p_way", "p_road", "p_off_road"):
        assert told[f"mean_{name}"] == pytest.approx(points[name].mean(), rel=1e-6)
    assert told["status"] == pytest.approx(points.status.value_counts(normalize=True).to_dict())
    each = told["each"]
    assert told["path_m"] == pytest.approx(sum(one["path_m"] for one in each))
    assert told["skipped"]["impossible position"] == 1
    assert sum(told["skipped"].values()) == sum(n for d in each for n in d["skipped"].values())


def test_points_and_path_are_the_same_frames_at_each_access(fixes, roads):
    result = whichroad.match(fixes, roads)
    result.points["x"] = 1
    result.path["mine"] = "a"
    assert (result.points.x == 1).all()
    assert (result.path.mine == "a").all()
    assert "x" not in result.to_arrow().column_names


@pytest.mark.parametrize("lag", [None, "full"])
def test_a_result_out_of_a_pickle_is_the_same(fixes, roads, lag, tmp_path):
    both = pd.concat([fixes.assign(trip="a"), fixes.assign(trip="b")])
    for drive in (fixes, both):
        result = whichroad.match(drive, roads, lag=lag, hypotheses=drive is fixes)
        again = pickle.loads(pickle.dumps(result))
        assert again.to_arrow().equals(result.to_arrow())
        assert again.path_arrow().equals(result.path_arrow())
        assert again.summary == result.summary
        assert again.diagnosis == result.diagnosis
        assert repr(again) == repr(result)
        assert again.points.equals(result.points)
        again.write(tmp_path / "points.parquet", force=True)
        if lag and drive is fixes:
            assert again.routes() == result.routes()
            assert again.alternatives == result.alternatives
        else:
            with pytest.raises(SettingError, match="no lag, or several drives"):
                again.routes()
        if drive is fixes:
            np.testing.assert_array_equal(again.hypotheses["p"], result.hypotheses["p"])


def test_a_map_out_of_a_pickle_is_the_same(fixes, roads, answer, tmp_path):
    roads.save(tmp_path / "town.map")
    for one in (roads, whichroad.RoadMap.open(tmp_path / "town.map")):
        again = pickle.loads(pickle.dumps(one))
        assert again.info() == roads.info()
        same(whichroad.match(fixes, again).points, answer)


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run `whichroad match` in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["whichroad", "match", *arguments])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code, said.out, said.err

    return call


def _sum_by(limit, parts) -> dict:
    sums: dict = {}
    for edge, p in parts:
        sums[limit(edge)] = sums.get(limit(edge), 0.0) + p
    return sums


def test_a_speed_limit_has_the_probability_of_all_roads_that_have_it(fixes, edges):
    roads = whichroad.RoadMap.from_edges(edges.assign(maxspeed=["50", "50", "30", "50"]))

    def limit(edge: int) -> float | None:
        return roads.attributes(edge)["speed_limit_kmh"]

    result = whichroad.match(fixes, roads)
    told = result.attribute("maxspeed").to_pandas()
    for _, point in result.points.iterrows():
        here = told[told.time == point.time]
        assert here.p.sum() == pytest.approx(1.0, abs=1e-6)
        assert here.p.is_monotonic_decreasing
        asked = _sum_by(limit, ((a["edge_id"], a["p"]) for a in point.alternatives))
        for value, p in asked.items():
            assert here.p[here.value == value].sum() == pytest.approx(p, abs=1e-6)
    with pytest.raises(SettingError, match="is none of this map"):
        result.attribute("colour")
    roads = result._roads
    assert roads.attribute("maxspeed", 3) == roads.attribute("speed_limit_kmh", 3)
    for wrong, said in (
        ((3, "name"), r"write attribute\('name', 3\)"), (("nam", 3), "did you mean name"),
        (("name", -1), "the number of an edge, from 0 to"), (("name", None), "off the roads"),
        (("name", 10**6), "the number of an edge, from 0 to"),
    ):  # fmt: skip
        with pytest.raises(SettingError, match=said):
            roads.attribute(*wrong)
    with pytest.raises(SettingError, match="has no map"):
        pickle.loads(pickle.dumps(result)).attribute("maxspeed")

    localizer = whichroad.Localizer(roads)
    for fix in observed(fixes):
        estimate = localizer.update(fix)
        parts = [(h.edge, h.p) for h in estimate.hypotheses if h.edge is not None]
        shares = dict(estimate.attribute("maxspeed"))
        assert sum(shares.values()) == pytest.approx(1.0)
        for value, p in _sum_by(limit, parts).items():
            assert shares[value] == pytest.approx(p, abs=1e-9)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])  # of many trips, each its own way
def test_a_path_is_told_by_source_roads_where_that_is_asked(run, fixes, roads, suffix: str):
    roads.save("town.map")
    both = pd.concat([fixes.assign(trip="a"), fixes.assign(trip="b")])
    both.to_csv("d.csv", index=False)
    both.to_parquet("d.parquet")
    drive = f"d.{suffix}"
    assert run(drive, "--map", "town.map", "--path-out", "edges.csv")[0] == 0
    assert run(drive, "--map", "town.map", "--path-out", "roads.csv", "--by-source")[0] == 0
    assert pd.read_csv("edges.csv").groupby("drive_id").source_id.nunique().tolist() == [1, 1]
    told = pd.read_csv("roads.csv")
    assert told.groupby("drive_id").source_id.agg(list).tolist() == [[1, 2], [1, 2]]


def test_many_drives_of_a_csv_are_told_by_their_sums(run, fixes, roads):
    roads.save("town.map")
    drives = [fixes.assign(trip=f"trip {k}", accuracy=-1.0) for k in range(6)]
    far = fixes.assign(trip="far", lat=fixes.lat + 20.0)
    pd.concat([*drives, far]).to_csv("d.csv", index=False)
    code, out, err = run("d.csv", "--map", "town.map", "-o", "points.csv")
    assert code == 0
    assert out.splitlines() == [
        "all",
        "  drives                 6",
        "  epochs                 240",
        "  epochs without answer  0",
        "  path                   2,8" + out.partition("2,8")[2].strip(),
    ]
    assert err.count("accuracy or sigma of 0 or less (settings' default used)") == 1
    assert "skipped: accuracy or sigma of 0 or less (settings' default used): 240\n" in err
    assert "skipped: far: none of its 40 fixes is within 1 km of a road" in err


def test_two_limits_share_the_probability_of_their_roads():
    """Parallel streets, and fixes between them: the limit is as undecided as the street."""
    lines = [[[0.0, y], [600.0, y]] for y in (0.0, 8.0)]
    roads = road_map(lines, maxspeed=["50", "30"], oneway=["yes", "yes"])
    truth = drive_along([[20.0, 4.0], [580.0, 4.0]])
    fix = np.column_stack([truth.x, truth.y, np.full((len(truth.x), 2), 3.0), 0.0 * truth.x])
    result = whichroad.match(geo_fixes(truth, fix, np.arange(0, len(truth.x), 10)), roads)
    limits = result.attribute("maxspeed").to_pandas()
    last = limits[limits.time == limits.time.max()].set_index("value").p
    by_street = {
        roads.attribute("speed_limit_kmh", road["edge_id"]): road["p"]
        for road in result.to_arrow()["alternatives"][-1].as_py()
    }
    assert set(by_street) == {50.0, 30.0}
    assert min(by_street.values()) > 0.05
    for limit, p in by_street.items():
        assert last[limit] == pytest.approx(p, abs=1e-6)
