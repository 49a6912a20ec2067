"""Point objects: tables, where they are passed, what is ahead and what is near."""

import json
import math

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import whichroad
from whichroad.cli import app
from whichroad.errors import ReadError, SettingError
from whichroad.filter.places.nearby import within_circle
from whichroad.filter.places.point_objects import STANCE
from whichroad.graph.network import records
from whichroad.places import Places
from whichroad.places.place_table import read_places
from whichroad.simulate import draw_town, simulate_drive


@pytest.fixture(scope="module")
def roads(tmp_path_factory):
    path = tmp_path_factory.mktemp("places") / "town.osm"
    path.write_text(draw_town(1))
    return whichroad.RoadMap.from_osm(path)


@pytest.fixture(scope="module")
def spread(roads):
    """Every 40th metre of every legal edge."""
    edges = roads.arrays.edges
    places = [
        (e, s)
        for e in np.flatnonzero(edges.rule == 0).tolist()
        for s in np.arange(10.0, edges.length[e], 60.0).tolist()
    ]
    xy = np.array([roads.at(e, s)[:2] for e, s in places])
    lat, lon = roads.plane.to_geodetic(xy[:, 0].copy(), xy[:, 1].copy())
    return Places({"lat": lat, "lon": lon, "on_map": [True] * len(lat)}, roads)


def stance(roads, edge, s, sigma, p=1.0):
    """A hypothesis on an edge, whose map has no error."""
    one = records(1, STANCE)
    x, y, heading = roads.at(edge, s)
    one.p, one.s, one.sigma, one.edge = p, s, sigma, edge
    one.x = one.map_x = x
    one.y = one.map_y = y
    c, d = math.cos(heading), math.sin(heading)
    one.xx = one.map_xx = (sigma * c) ** 2 + d * d
    one.xy = one.map_xy = (sigma**2 - 1.0) * c * d
    one.yy = one.map_yy = (sigma * d) ** 2 + c * c
    return one


def drawn(roads, places, edge, s, sigma, within, draw, drives):
    """What so many drives come past first, by chance: distances of each place."""
    arrays, passage = roads.arrays, places.arrays.passage
    of_edge = {}
    for row in passage:
        of_edge.setdefault(int(row.edge), []).append((float(row.s), int(row.place)))
    found = {}
    for _ in range(drives):
        start = draw.normal(s, sigma)
        if not 0.0 <= start <= arrays.edges.length[edge]:
            continue
        seen, here, offset = {}, edge, -start
        while offset < within:
            for at, place in of_edge.get(here, []):
                if 0.0 < offset + at <= within:
                    seen.setdefault(place, offset + at)
            offset += float(arrays.edges.length[here])
            turns = arrays.turns[arrays.edges.first_turn[here] : arrays.edges.end_turn[here]]
            prior = turns.prior.astype(float)
            if not len(prior):
                break
            here = int(turns.edge[int(draw.choice(len(prior), p=prior / prior.sum()))])
        for place, metres in seen.items():
            found.setdefault(place, []).append(metres)
    return found


@pytest.mark.parametrize("sigma", [1.0, 15.0])
def test_ahead_is_what_random_drives_come_past(roads, spread, sigma):
    draw = np.random.default_rng(5)
    edges = roads.arrays.edges
    sharp = np.flatnonzero((edges.rule == 0) & (edges.length > 6.0 * 15.0))
    drives, widths = 400, []
    for edge in draw.choice(sharp, 3, replace=False).tolist():
        s = 0.5 * float(edges.length[edge])
        answer = spread.ahead(stance(roads, edge, s, sigma).tobytes(), 400.0)
        found = drawn(roads, spread, edge, s, sigma, 400.0, draw, drives)
        assert len(answer) > 5
        assert [a.distance_m for a in answer] == sorted(a.distance_m for a in answer)
        for one in answer:
            metres = found.get(one.id, [])
            spread_of_p = math.sqrt(max(one.p * (1.0 - one.p), 0.002) / drives)
            assert len(metres) / drives == pytest.approx(one.p, abs=4.5 * spread_of_p)
            if len(metres) > 100:
                assert np.mean(metres) == pytest.approx(
                    one.distance_m, abs=5.0 * one.sigma_m / math.sqrt(len(metres)) + 0.01
                )
                drawn_line = 0.02 * one.distance_m  # which these drives are without
                width = np.sqrt(np.var(metres) + drawn_line) / one.sigma_m
                assert width < 1.3
                widths.append(width)  # a rare detour may not be drawn
        listed = {one.id for one in answer}
        assert np.median(widths) == pytest.approx(1.0, abs=0.1)
        assert all(len(m) < 0.03 * drives for place, m in found.items() if place not in listed)


def test_what_was_just_passed_is_not_ahead(roads):
    edge = int(np.argmax(roads.arrays.edges.length * (roads.arrays.edges.rule == 0)))
    places = Places({"id": ["mark"], "edge_id": [edge], "abscissa_m": [100.0]}, roads)
    before = places.ahead(stance(roads, edge, 95.0, 0.5).tobytes(), 50.0)
    at = places.ahead(stance(roads, edge, 100.0, 2.0).tobytes(), 50.0)
    behind = places.ahead(stance(roads, edge, 105.0, 0.5).tobytes(), 50.0)
    assert [one.id for one in before] == ["mark"]
    assert before[0].p == 1.0
    assert before[0].distance_m == pytest.approx(5.0)
    assert at[0].p == pytest.approx(0.5)
    assert at[0].distance_m == pytest.approx(2.0 * math.sqrt(2.0 / math.pi), rel=1e-3)
    assert behind == []
    half = places.ahead(stance(roads, edge, 95.0, 0.5, 0.5).tobytes(), 50.0, known=0.9)
    assert half[0].p == pytest.approx(0.45)


def test_a_place_in_the_world_is_met_where_the_map_is_wrong(roads):
    edge = int(np.argmax(roads.arrays.edges.length * (roads.arrays.edges.rule == 0)))
    x, y, _ = roads.at(edge, 200.0)
    lat, lon = roads.plane.to_geodetic(x, y)
    here = stance(roads, edge, 150.0, 1.0)
    here.x += 6.0 * math.cos(roads.at(edge, 150.0)[2])  # the map lies 6 m behind the world
    here.y += 6.0 * math.sin(roads.at(edge, 150.0)[2])
    for on_map, metres in ((True, 50.0), (False, 44.0)):
        places = Places({"lat": [lat], "lon": [lon], "on_map": [on_map]}, roads)
        found = places.ahead(here.tobytes(), 100.0)
        assert found[0].distance_m == pytest.approx(metres, abs=0.1)
        assert found[0].sigma_m == pytest.approx(math.sqrt(1.0 + 0.02 * metres), abs=0.05)


def test_nearby_is_the_share_of_a_gaussian_in_a_circle():
    draw = np.random.default_rng(2)
    for _ in range(6):
        mean, root = draw.normal(0.0, 40.0, 2), draw.normal(0.0, 12.0, (2, 2))
        cov = root @ root.T
        samples = draw.multivariate_normal(mean, cov, 40_000)
        share = np.mean(np.hypot(*samples.T) < 50.0)
        p = within_circle(*mean, cov[0, 0], cov[0, 1], cov[1, 1], 50.0)
        assert p == pytest.approx(share, abs=0.012)


def test_nearby_takes_every_place_within_the_radius(roads, spread):
    edge = int(np.argmax(roads.arrays.edges.length))
    here = stance(roads, edge, 50.0, 0.05)
    found = {one.id for one in spread.nearby(here.tobytes(), 130.0)}
    away = np.hypot(spread.arrays.place.x - here.x[0], spread.arrays.place.y - here.y[0])
    inner, outer = np.flatnonzero(away < 125.0), np.flatnonzero(away < 135.0)
    assert set(inner.tolist()) <= found <= set(outer.tolist())


def test_a_place_at_a_junction_is_passed_by_all_that_come_to_it(roads):
    edges = roads.arrays.edges
    node = int(np.argmax(np.bincount(edges.to_node)))
    into = np.flatnonzero(edges.to_node == node)
    x, y = roads.at(int(into[0]), float(edges.length[into[0]]))[:2]
    lat, lon = roads.plane.to_geodetic(x, y)
    places = Places({"lat": [lat], "lon": [lon]}, roads)
    assert sorted(places.arrays.passage.edge.tolist()) == into.tolist()
    assert np.allclose(np.sort(places.arrays.passage.s), np.sort(edges.length[into]))


def test_a_bearing_chooses_the_direction(roads):
    edges = roads.arrays.edges
    both = np.flatnonzero((edges.opposite >= 0) & (edges.length > 200.0))
    edge = int(both[0])
    x, y, heading = roads.at(edge, 100.0)
    lat, lon = roads.plane.to_geodetic(x, y)
    bearing = float(roads.plane.bearing(heading, x, y))
    table = {"lat": [lat] * 3, "lon": [lon] * 3, "bearing_deg": [bearing, bearing + 180.0, None]}
    places = Places(table, roads)
    of = {k: sorted(places.arrays.passage.edge[places.arrays.passage.place == k]) for k in range(3)}
    assert of == {0: [edge], 1: [edges.opposite[edge]], 2: sorted([edge, edges.opposite[edge]])}


def test_what_cannot_be_used_is_counted(roads):
    lat, lon = roads.plane.to_geodetic(*roads.at(0, 1.0)[:2])
    table = {
        "lat": [lat, None, 0.0, None, None], "lon": [lon, 8.0, 0.0, None, None],
        "edge_id": [None, None, None, 10**7, 0], "abscissa_m": [None, None, None, 1.0, 1e6],
    }  # fmt: skip
    places = Places(table, roads)
    assert len(places) == 2
    assert places.skipped == {
        "without a position": 1, "on an edge that is not in the map": 1,
        "beyond the ends of its edge": 1,
    }  # fmt: skip
    assert places.beside == {"farther than 50 m from every road": 1}
    assert len(places.notes()) == 4


def test_formats_of_tables_say_the_same(tmp_path, roads):
    geopandas = pytest.importorskip("geopandas")
    lat, lon = [49.4, 49.41], [2.8, 2.81]
    plain = tmp_path / "places.csv"
    plain.write_text("id,Latitude,Longitude,sigma_m\n7,49.4,2.8,0.5\n8,49.41,2.81,\n")
    commas = tmp_path / "commas.csv"
    commas.write_text("id;Latitude;Longitude;sigma_m\n7;49,4;2,8;0,5\n8;49,41;2,81;\n")
    told = tmp_path / "told.csv"
    told.write_text("sep=;\n" + commas.read_text())
    frame = geopandas.GeoDataFrame(
        {"id": [7, 8], "sigma_m": [0.5, None]},
        geometry=geopandas.points_from_xy(lon, lat), crs="EPSG:4326",
    )  # fmt: skip
    geojson, parquet = tmp_path / "places.geojson", tmp_path / "places.parquet"
    frame.to_file(geojson)
    frame.to_crs("EPSG:3857").to_parquet(parquet)
    rows = [
        {"id": 7, "lat": 49.4, "lon": 2.8, "sigma_m": 0.5},
        {"id": 8, "lat": 49.41, "lon": 2.81},
    ]
    for given in (plain, commas, told, geojson, parquet, frame, rows):
        read = read_places(given)
        assert read.ids == [7, 8]
        assert np.allclose(read.lat, lat)
        assert np.allclose(read.lon, lon)
        assert read.sigma.tolist() == [0.5, 0.0]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("nowhere.csv", "does not exist"),
        ({"a": [1]}, "lat and lon"),
        ({"lat": ["north"], "lon": [1.0]}, "row 1: lat is 'north'"),
        ({"lat": [1.0], "lon": [1.0], "on_map": ["perhaps"]}, "on_map"),
        ({"lat": [1.0], "lon": [1.0], "sigma_m": [1e8]}, "row 1: sigma_m is 1e"),
        ({"lat": [1.0, 1.0], "lon": [1.0, 1.0], "sigma_m": [1.0, -2.0]}, "row 2: sigma_m is -2"),
        ({"edge_id": [3.5], "abscissa_m": [1.0]}, "row 1: edge_id is 3.5; the whole number"),
        ("{", "cannot be read"),
    ],
)
def test_what_is_no_table_is_refused(table, words, tmp_path):
    if table == "{":
        table = tmp_path / "places.geojson"
        table.write_text(json.dumps([1, 2]))
        words = "was expected"
    with pytest.raises(ReadError, match=words):
        read_places(table)


def test_ahead_of_a_drive_recorded_and_on_line(roads, spread):
    drive = simulate_drive(roads, seed=3, length_m=900.0)
    result = whichroad.match(drive.drive, roads, vehicle=drive.vehicle, places=spread)
    table = result.ahead(200.0)
    assert table.column_names == ["drive_id", "time", "id", "distance_m", "sigma_m", "p"]
    assert result.nearby(30.0).num_rows > 0
    fixes = drive.drive.fixes
    recorded = whichroad.match(
        [(t, a, o) for t, a, o in zip(fixes.time, fixes.lat_deg, fixes.lon_deg, strict=True)],
        roads, places=spread,
    )  # fmt: skip
    localizer = whichroad.Localizer(roads, places=spread)
    for t, a, o in zip(fixes.time, fixes.lat_deg, fixes.lon_deg, strict=True):
        estimate = localizer.update(whichroad.GeoFix(t, a, o))
    live = {one.id: one for one in estimate.ahead(200.0)}
    rows = recorded.ahead(200.0).to_pylist()
    last = {r["id"]: r for r in rows if r["time"] == rows[-1]["time"]}
    likely = [place for place, one in live.items() if one.p > 0.3]
    assert len(likely) > 2
    for place in likely:
        assert last[place]["p"] == pytest.approx(live[place].p, abs=0.03)
        assert last[place]["distance_m"] == pytest.approx(live[place].distance_m, abs=5.0)
    assert localizer.predict(estimate.time + 1.0).ahead(200.0)
    again = whichroad.Localizer.from_bytes(localizer.to_bytes(), roads, places=spread)
    assert again.estimate().ahead(200.0) == estimate.ahead(200.0)


def test_many_trips_tell_what_one_does(roads, spread):
    drive = simulate_drive(roads, seed=3, length_m=400.0)
    fixes = drive.drive.fixes
    table = {"time": fixes.time, "lat": fixes.lat_deg, "lon": fixes.lon_deg}
    one = whichroad.match(pa.table(table), roads, places=spread)
    trips = pa.concat_tables(
        [pa.table(table | {"drive_id": [name] * len(fixes)}) for name in ("a", "b")]
    )
    many = whichroad.match_many(trips, roads, places=spread)
    for ask, found in ((one.ahead(500.0), many.ahead), (one.nearby(50.0), many.nearby)):
        assert found["drive_id"].unique().to_pylist() == ["a", "b"]
        again = found.filter(pc.equal(found["drive_id"], "b")).drop_columns("drive_id")
        assert again.to_pylist() == ask.drop_columns("drive_id").to_pylist()
    assert "ahead" in repr(many)
    without = whichroad.match_many(trips, roads)
    assert without.points.equals(many.points)
    assert len(without.ahead) == 0
    assert "ahead" not in repr(without)


def test_places_are_asked_for(roads, spread):
    drive = simulate_drive(roads, seed=3, length_m=300.0)
    result = whichroad.match(drive.drive, roads, vehicle=drive.vehicle)
    with pytest.raises(SettingError, match="places"):
        result.ahead()
    with pytest.raises(SettingError, match="places"):
        whichroad.Localizer(roads).update(whichroad.GeoFix(0.0, 49.4, 2.8)).nearby()
    with pytest.raises(SettingError, match="no place"):
        Places({"lat": [None], "lon": [None]}, roads)
    with pytest.raises(SettingError, match="0 to 5000"):
        spread.ahead(b"", -1.0)


def test_the_command_writes_what_is_ahead(roads, spread, tmp_path):
    drive = simulate_drive(roads, seed=3, length_m=300.0)
    fixes = drive.drive.fixes
    rows = zip(fixes.time, fixes.lat_deg, fixes.lon_deg, strict=True)
    csv, marks = tmp_path / "drive.csv", tmp_path / "marks.csv"
    csv.write_text("time,lat,lon\n" + "".join(f"{t},{a},{o}\n" for t, a, o in rows))
    at = roads.plane.to_geodetic(spread.arrays.place.x.copy(), spread.arrays.place.y.copy())
    marks.write_text(
        "id,lat,lon\nnone,,\n"
        + "".join(f"m{k},{a},{o}\n" for k, (a, o) in enumerate(zip(*at, strict=True)))
    )
    roads.save(tmp_path / "town.map")
    ahead, near = tmp_path / "ahead.csv", tmp_path / "near.parquet"
    args = ["match", str(csv), "--map", str(tmp_path / "town.map"), "--every", "5"]
    done = CliRunner().invoke(app, [*args, "--places", str(marks)])
    assert done.exit_code != 0
    assert "--ahead, --nearby or --report" in str(done.exception)
    done = CliRunner().invoke(app, [*args, "--ahead", str(ahead)])
    assert "go with --places" in str(done.exception)
    page = tmp_path / "report.html"
    given = ["--places", str(marks), "--ahead", str(ahead), "--nearby", str(near)]
    done = CliRunner().invoke(app, [*args, *given, "--report", str(page)])
    assert done.exit_code == 0, done.output
    data = json.loads(page.read_text("utf-8").partition('id="data">')[2].partition("</script>")[0])
    shown = {data["beside"]["points"][one[0]][0] for row in data["beside"]["ahead"] for one in row}
    assert shown
    assert shown <= {line.split(",")[2] for line in ahead.read_text().replace('"', "").split()}
    assert "places: 1 without a position; left out" in done.output
    header, *lines = ahead.read_text().replace('"', "").splitlines()
    assert header == "drive_id,time,id,distance_m,sigma_m,p"
    times = [line.split(",")[1] for line in lines]
    assert 1 < len(set(times)) <= 1 + len(fixes) / 5 < len(times)
    assert pq.read_table(near).num_rows > 0
