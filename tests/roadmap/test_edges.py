"""Maps from anyone's table of roads."""

import gzip
import json

import geopandas
import numpy as np
import pandas
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
import shapely

from whichroad.errors import MapError
from whichroad.graph.network import AGAINST_ONE_WAY, NO_ACCESS
from whichroad.roadmap import RoadMap


@pytest.fixture
def town(line):
    """Four streets about a crossing, one of them one-way, one of two pieces."""
    return geopandas.GeoDataFrame(
        {
            "id": [7, 8, 9, 10, 11],
            "from": [1, 1, 4, 1, 6],
            "to": [2, 3, 1, 5, 5],
            "oneway": ["no", "yes", "no", "no", "no"],
            "name": ["East", "North", None, "South", "South"],
            "maxspeed": [50, 30, 30, 30, 30],
        },
        geometry=[
            line((0, 0), (50, 5), (100, 0)),
            line((0, 0), (0, 100)),
            line((-100, 0), (0, 0)),
            line((0, 0), (0, -100)),
            line((0, -180), (0, -100)),
        ],
        crs="EPSG:4326",
    )


def same(one, two, tolerance=1e-9):
    """Assert that two maps are the same roads."""
    a, b = one.arrays, two.arrays
    for name in ("from_node", "to_node", "opposite", "rule", "first_turn"):
        np.testing.assert_array_equal(a.edges[name], b.edges[name])
    for name in ("edge", "rule"):
        np.testing.assert_array_equal(a.turns[name], b.turns[name])
    np.testing.assert_array_equal(a.predecessors, b.predecessors)
    np.testing.assert_allclose(a.edges.length, b.edges.length, atol=tolerance)
    assert one.sources(np.arange(len(one)), 1.0)[0] == two.sources(np.arange(len(two)), 1.0)[0]
    assert one.column("name") == two.column("name")


def rule(roads, source, forward):
    """Rule of the edges on which a source row is driven in a direction."""
    [found] = {
        int(roads.arrays.edges.rule[e])
        for e in range(len(roads))
        if roads.source(e, 1.0) == (source, forward)
    }
    return found


def test_a_table_of_edges_becomes_a_network(town, check):
    roads = RoadMap.from_edges(town)
    check(roads)
    assert len(roads) == 8
    assert roads.info()["nodes"] == 5
    assert rule(roads, 8, True) == 0
    assert rule(roads, 8, False) == AGAINST_ONE_WAY
    south = next(e for e in range(8) if roads.source(e, 1.0) == (10, True))
    assert roads.source(south, 99.0) == (10, True)
    assert roads.source(south, 101.0) == (11, False)
    assert sorted(set(roads.node_ids(roads.arrays.edges.from_node))) == [1, 2, 3, 4, 6]
    assert roads.attributes(south)["name"] == "South"


LISTS = {
    "as lists": lambda values: values,
    "as Python's text": str,
    "as JSON": json.dumps,
}


@pytest.mark.parametrize("form", LISTS.values(), ids=LISTS)
def test_lists_of_values_mean_the_same_as_text(line, form):
    streets = {  # what OSMnx lists of streets that it joined
        "osmid": [[7, 8], [9], 10, [11, 12], 13],
        "highway": [
            ["footway", "residential"], ["steps", "footway"], "primary", ["service", "steps"],
            "path",
        ],
        "name": [["East", "West"], "Stairs", None, ["South"], "Way"],
        "maxspeed": [["none", "30 mph"], None, "50", None, None],
        "oneway": [[False, True], False, True, False, False],
        "lanes": [["2", "3"], None, "1", None, None],
        "bridge": [["no", "viaduct"], None, None, None, None],
        "tunnel": [None, None, None, ["yes", "no"], None],
        "access": [["yes", "private"], None, "yes", ["permissive", "yes"], None],
        "junction": [None, None, ["roundabout", "circular"], None, None],
        "layer": [None, None, None, ["-1", "0"], None],
    }  # fmt: skip
    table = geopandas.GeoDataFrame(
        {
            name: pandas.Series(
                [form(v) if isinstance(v, list) else v for v in values], dtype=object
            )
            for name, values in streets.items()
        },
        geometry=[line((0, 100 * k), (50, 100 * k)) for k in range(5)],
        crs="EPSG:4326",
    )
    roads = RoadMap.from_edges(table)
    assert roads.info()["skipped"] == {"rows of classes not for cars": 2}
    found = {
        roads.source(e, 1.0)[0]: roads.attributes(e) for e in range(len(roads))
        if roads.source(e, 1.0)[1]
    }  # fmt: skip
    assert set(found) == {"7", "10", "11"}
    assert found["7"] == {
        "source_id": "7", "name": "East", "highway": "residential", "lanes": 2, "width": None,
        "speed_limit_kmh": pytest.approx(30 * 1.609344), "layer": 0, "bridge": True,
        "tunnel": False, "oneway": 1, "roundabout": False, "access": "no",
    }  # fmt: skip
    assert found["10"]["roundabout"]
    assert found["10"]["oneway"] == 1
    assert (found["11"]["highway"], found["11"]["layer"]) == ("service", -1)
    assert (found["11"]["tunnel"], found["11"]["access"]) == (True, "yes")
    assert rule(roads, "7", False) == AGAINST_ONE_WAY | NO_ACCESS


@pytest.mark.parametrize("text", ["[", "[]", "['a'", "[1, 2", "{}", "[nan]", "[" * 5000 + "]"])
def test_a_text_that_is_no_list_is_a_word(line, text: str):
    table = geopandas.GeoDataFrame(
        {"name": [text], "highway": [text], "oneway": [text]}, geometry=[line((0, 0), (50, 0))],
        crs="EPSG:4326",
    )  # fmt: skip
    name = RoadMap.from_edges(table).name(0)
    assert name == (None if text == "[]" else text)


def test_every_form_of_the_table_gives_the_same_map(town, tmp_path):
    roads = RoadMap.from_edges(town)
    town.to_parquet(tmp_path / "a.parquet")
    town.to_file(tmp_path / "a.geojson", driver="GeoJSON")
    town.to_file(tmp_path / "a.gpkg")
    town.to_wkt(rounding_precision=15).rename(columns={"geometry": "geom_wkt"}).to_csv(
        tmp_path / "a.csv", index=False
    )
    arrow = pa.table(
        {**{c: town[c] for c in town if c != "geometry"}, "wkb": town.to_wkb().geometry}
    )
    plain = pandas.DataFrame(town.to_wkt(rounding_precision=15))
    ewkb = shapely.to_wkb(shapely.set_srid(town.geometry.values, 4326), True, include_srid=True)
    digits = town.drop(columns="geometry").assign(geom=ewkb)  # as PostGIS writes it
    digits.to_csv(tmp_path / "b.csv", index=False)
    forms = [*(tmp_path / f"a.{s}" for s in ("parquet", "geojson", "gpkg", "csv")), arrow, plain]
    forms += [pandas.DataFrame(digits), tmp_path / "b.csv"]
    for form in [*forms, str(tmp_path / "a.csv"), pyarrow.parquet.read_table(forms[0])]:
        same(roads, RoadMap.from_edges(form), 0.02)  # GeoJSON has seven decimals


@pytest.mark.parametrize("said", ["", "sep={}\n", '"sep={}"\r\n'])  # as Excel is told of it
@pytest.mark.parametrize(
    ("delimiter", "name"),
    [(";", "a.csv"), ("\t", "a.csv"), ("|", "a.csv"), (";", "a.csv.gz"), ("\t", "a.tsv"),
     (";", "a.tsv")],
)  # fmt: skip
def test_cells_are_parted_as_the_line_of_names_is(town, tmp_path, delimiter, name, said):
    """Those of a European spreadsheet have semicolons, and commas within numbers."""
    roads = RoadMap.from_edges(town.assign(width=3.25, name="Hof 1,5"))
    table = town.assign(width="3,25", name="Hof 1,5").to_wkt(rounding_precision=15)
    table.loc[0, "width"] = ""
    text = said.format(delimiter) + table.to_csv(index=False, sep=delimiter)
    opened = gzip.open if name.endswith(".gz") else open
    with opened(tmp_path / name, "wt", encoding="utf-8-sig", newline="") as file:
        file.write(text)
    read = RoadMap.from_edges(tmp_path / name)
    same(roads, read, 1e-9)
    assert read.name(0) == "Hof 1,5"
    assert set(read.column("width")) == {None, 3.25}


def test_a_projected_table_gives_the_same_map(town, tmp_path):
    roads = RoadMap.from_edges(town)
    metres = town.to_crs("EPSG:32632")
    same(roads, RoadMap.from_edges(metres), 1e-5)
    metres.to_parquet(tmp_path / "a.parquet")
    same(roads, RoadMap.from_edges(tmp_path / "a.parquet"), 1e-5)
    wkt = pandas.DataFrame(metres.to_wkt(rounding_precision=15))
    same(roads, RoadMap.from_edges(wkt, "EPSG:32632"), 1e-5)
    same(roads, RoadMap.from_edges(wkt, 32632), 1e-5)


def test_metres_without_a_coordinate_system_are_refused_with_what_to_pass(town):
    wkt = pandas.DataFrame(town.to_crs("EPSG:32632").to_wkt())
    with pytest.raises(MapError, match='crs="EPSG'):
        RoadMap.from_edges(wkt)
    with pytest.raises(MapError, match="EPSG:99999999"):
        RoadMap.from_edges(wkt, "EPSG:99999999")


def test_nodes_found_from_the_geometry_are_those_that_were_named(town):
    named = RoadMap.from_edges(town)
    found = RoadMap.from_edges(town.drop(columns=["from", "to"]))
    assert len(found) == len(named)
    a, b = found.arrays.edges, named.arrays.edges
    np.testing.assert_allclose(np.sort(a.length), np.sort(b.length))
    assert sorted(a.end_turn - a.first_turn) == sorted(b.end_turn - b.first_turn)


def test_rows_of_both_directions_make_one_street_with_two_ids(line, check):
    east, north = line((0, 0), (50, 5), (100, 0)), line((100, 0), (100, 100))
    table = geopandas.GeoDataFrame(
        {"id": ["a", "b", "c"], "u": [1, 2, 2], "v": [2, 1, 3]},
        geometry=[east, east.reverse(), north],
        crs=4326,
    )
    for rows in (table, table.drop(columns=["u", "v"])):
        roads = RoadMap.from_edges(rows)
        check(roads)
        assert len(roads) == 4
        assert rule(roads, "a", True) == rule(roads, "b", True) == 0
        assert rule(roads, "c", True) == 0
        assert rule(roads, "c", False) == AGAINST_ONE_WAY


def test_a_column_of_lanes_tells_how_far_a_vehicle_may_be_from_its_usual_one(town):
    """Two one-way lanes and four in both directions are two in each; one is one."""
    roads = RoadMap.from_edges(town.assign(lanes=[4, 2, 2, 1, 1]))
    spread = {
        roads.source(e, 1.0)[0]: float(roads.arrays.edges.lane_sigma[e])
        for e in range(len(roads))
        if roads.source(e, 1.0)[1]
    }
    assert {k: spread[k] for k in (7, 8, 9, 10)} == pytest.approx({7: 1.65, 8: 1.65, 9: 0, 10: 0})


def test_one_may_say_whether_rows_are_directions(line):
    table = geopandas.GeoDataFrame({"id": [1]}, geometry=[line((0, 0), (100, 0))], crs=4326)
    assert np.all(RoadMap.from_edges(table).arrays.edges.rule == 0)
    directed = RoadMap.from_edges(table, directed=True)
    assert sorted(directed.arrays.edges.rule) == [0, AGAINST_ONE_WAY]
    both = pandas.concat([table, table.assign(id=2, geometry=table.geometry.reverse())])
    assert rule(RoadMap.from_edges(both), 2, True) == 0
    assert np.all(RoadMap.from_edges(both, directed=False).arrays.edges.rule == 0)


def test_the_tables_of_osmnx_are_understood(line):
    east, north = line((0, 0), (50, 5), (100, 0)), line((100, 0), (100, 100))
    table = geopandas.GeoDataFrame(
        {
            "u": [1, 2, 2],
            "v": [2, 1, 3],
            "key": [0, 0, 0],
            "osmid": [5, 5, [6, 7]],
            "oneway": [False, False, True],
            "highway": ["residential", "residential", ["primary", "secondary"]],
        },
        geometry=[east, east.reverse(), north],
        crs=4326,
    ).set_index(["u", "v", "key"])
    roads = RoadMap.from_edges(table)
    assert len(roads) == 4
    assert rule(roads, "6", False) == AGAINST_ONE_WAY
    assert rule(roads, "5", True) == 0
    assert sorted(set(roads.column("highway"))) == ["primary", "residential"]


@pytest.mark.parametrize(
    ("word", "legal"),
    [(True, (True, False)), ("B", (True, True)), ("F", (True, False)), ("T", (False, True)),
     (-1, (False, True)), ("1", (True, False)), (0, (True, True))],
)  # fmt: skip
def test_one_way_columns_speak_many_languages(line, word, legal):
    table = geopandas.GeoDataFrame(
        {"id": [1], "oneway": [word]}, geometry=[line((0, 0), (100, 0))], crs=4326
    )
    roads = RoadMap.from_edges(table)
    assert (rule(roads, 1, True) == 0, rule(roads, 1, False) == 0) == legal


@pytest.mark.parametrize(("word", "legal"), [("B", (True, True)), ("F", (True, False)),
                                             ("T", (False, True))])  # fmt: skip
def test_directions_of_travel_of_here_are_one_ways(line, word, legal):
    table = geopandas.GeoDataFrame(
        {"LINK_ID": [1], "DIR_TRAVEL": [word]}, geometry=[line((0, 0), (100, 0))], crs=4326
    )
    roads = RoadMap.from_edges(table)
    assert (rule(roads, 1, True) == 0, rule(roads, 1, False) == 0) == legal
    assert roads.info()["skipped"] == {}


def test_a_one_way_word_that_nobody_knows_is_counted(line):
    table = geopandas.GeoDataFrame(
        {"oneway": ["maybe"]}, geometry=[line((0, 0), (100, 0))], crs=4326
    )
    skipped = RoadMap.from_edges(table).info()["skipped"]
    assert skipped == {"one-way words that were not understood (taken as two-way)": 1}


@pytest.mark.parametrize("as_text", [False, True])
def test_numbers_of_an_unknown_code_close_nothing_and_are_listed(line, as_text):
    """1 both, 2 along, 3 against: 1 is no one-way there."""
    codes = [1] * 6 + [2, 2, 3]
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(len(codes) + 1)]
    cells = [str(code) for code in codes] + ["maybe"] if as_text else [*codes, None]
    table = geopandas.GeoDataFrame({"oneway": cells}, geometry=lines, crs=4326)
    roads = RoadMap.from_edges(table)
    for k in range(len(codes)):
        assert (rule(roads, k, True), rule(roads, k, False)) == (0, 0)
    skipped = roads.info()["skipped"]
    (why,) = [why for why in skipped if "code" in why]
    assert "not known: 1 (6), 2 (2), 3 (1) (all taken as two-way" in why
    assert skipped[why] == 9
    assert len(skipped) == 1 + as_text


def test_few_odd_numbers_leave_one_ways_as_they_are(line):
    codes = [1, -1, 0, 7] + [0] * 396
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(len(codes))]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame({"oneway": codes}, geometry=lines, crs=4326))
    closed = [(rule(roads, k, True) > 0, rule(roads, k, False) > 0) for k in range(4)]
    assert closed == [(False, True), (True, False), (False, False), (False, False)]
    words = "one-way words that were not understood (taken as two-way)"
    assert roads.info()["skipped"] == {words: 1}


TAGS = [
    '"oneway"=>"-1","maxspeed"=>"30 mph","note"=>"a \\"b\\", c"',
    None,
    '"motor_vehicle"=>"no", "access"=>"yes","lit"=>NULL',
    '"junction"=>"roundabout","lanes"=>"2"',
]


@pytest.mark.parametrize("suffix", ["geojson", "gpkg", "shp"])
def test_tags_in_one_column_are_read_as_those_of_openstreetmap(line, tmp_path, suffix):
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(4)]
    table = geopandas.GeoDataFrame(
        {"osm_id": list("abcd"), "highway": [*3 * ["primary"], "motorway"], "other_tags": TAGS},
        geometry=lines, crs="EPSG:4326",
    )  # fmt: skip
    table.to_file(tmp_path / f"roads.{suffix}")
    roads = RoadMap.from_edges(tmp_path / f"roads.{suffix}")
    assert roads.info()["skipped"] == {}
    assert (rule(roads, "a", True), rule(roads, "a", False)) == (AGAINST_ONE_WAY, 0)
    assert (rule(roads, "b", True), rule(roads, "b", False)) == (0, 0)
    assert (rule(roads, "c", True), rule(roads, "c", False)) == (NO_ACCESS, NO_ACCESS)
    assert (rule(roads, "d", True), rule(roads, "d", False)) == (0, AGAINST_ONE_WAY)
    [ring] = [e for e in range(len(roads)) if roads.source(e, 1.0) == ("d", True)]
    assert roads.attributes(ring)["roundabout"]
    assert roads.attributes(ring)["lanes"] == 2
    limits = {roads.source(e, 1.0)[0]: roads.attributes(e)["speed_limit_kmh"] for e in range(8)}
    assert limits == {"a": pytest.approx(48.28, abs=0.01), "b": None, "c": None, "d": None}


def test_columns_of_their_own_win_over_a_column_of_tags(line):
    table = pandas.DataFrame({
        "wkt": [line((0, 0), (100, 0)).wkt], "id": [7], "oneway": ["no"], "speed_limit": [50],
        "tags": [json.dumps({"oneway": "yes", "maxspeed": "30", "layer": 1, "name": None})],
    })  # fmt: skip
    roads = RoadMap.from_edges(table)
    assert rule(roads, 7, False) == 0
    assert roads.attributes(0)["speed_limit_kmh"] == 50.0
    assert roads.attributes(0)["layer"] == 1
    assert not roads.attributes(0)["name"]


def test_tags_that_are_cut_short_and_a_table_without_one_ways_are_counted(line):
    lines = [line((0, 0), (100, 0)).wkt, line((0, 60), (100, 60)).wkt]
    table = pandas.DataFrame({"wkt": lines, "other_tags": ['"lanes"=>"2","onew', '{"lanes"']})
    roads = RoadMap.from_edges(table)
    assert roads.info()["skipped"]["tags that were cut short or not understood"] == 2
    assert roads.attributes(0)["lanes"] == 2
    two_way = "roads without one-way information, as the table has none (taken as two-way)"
    untold = RoadMap.from_edges(table[["wkt"]])
    assert untold.info()["skipped"] == {two_way: 2}  # and nobody said so
    assert RoadMap.from_edges(table[["wkt"]], directed=False).info()["skipped"] == {}


def test_an_absurd_cost_closes_a_direction(line):
    lines = [line((0, 0), (100, 0)), line((100, 0), (200, 90)), line((200, 90), (300, 0))]
    table = geopandas.GeoDataFrame(
        {"id": [1, 2, 3], "cost": [0.1, 0.1, -1], "reverse_cost": [1e6, 0.1, 0.1]},
        geometry=lines,
        crs=4326,
    )
    roads = RoadMap.from_edges(table)
    legal = [(rule(roads, i, True) == 0, rule(roads, i, False) == 0) for i in (1, 2, 3)]
    assert legal == [(True, False), (True, True), (False, True)]


def test_nodes_may_be_words(line):
    lines = [line((0, 0), (100, 0)), line((100, 0), (100, 50))]
    table = geopandas.GeoDataFrame(
        {"from_node": ["A", "B"], "to_node": ["B", "Ç"]}, geometry=lines, crs=4326
    )
    roads = RoadMap.from_edges(table)
    assert sorted(roads.node_ids(roads.arrays.edges.from_node)) == ["A", "Ç"]
    assert roads.source(0, 50.0) == (0, True)  # without ids a row is its number


def test_the_table_of_edges_has_ids_of_nodes_and_the_numbers_that_a_path_has(town):
    roads = RoadMap.from_edges(town)
    table, edges = roads.edges_table(), roads.arrays.edges
    assert table.from_number.tolist() == edges.from_node.tolist()
    assert table.to_number.tolist() == edges.to_node.tolist()
    assert roads.node_ids(table.from_number) == table.from_node.tolist()
    assert roads.node_ids([]) == []
    for wrong in (table.from_node + 10**9, [-1], [1.0], ["A"]):
        with pytest.raises(MapError, match="has the source's ids already"):
            roads.node_ids(wrong)


def test_what_cannot_be_used_is_counted_by_reason(line):
    good = line((0, 0), (100, 0))
    with np.errstate(invalid="ignore"):
        with_nan = shapely.from_wkt("LINESTRING (8.7 nan, 8.7 49.4)")
    broken = [None, shapely.LineString(), shapely.Point(8.7, 49.4), good, good]
    broken += [with_nan]
    broken += [shapely.LineString([(8.7, 49.4), (8.7, 99.0)])]
    broken += [shapely.LineString([(8.7, 49.4), (8.7, 49.4)])]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(geometry=broken, crs=4326))
    assert len(roads) == 2
    assert roads.info()["skipped"] == {
        "rows without geometry": 2,
        "geometries that are not lines": 1,
        "lines with points that are not on Earth": 2,
        "rows that repeat another": 1,
        "segments without length": 1,
    }


def test_broken_wkt_and_rows_without_nodes_are_counted(line):
    table = pa.table(
        {
            "geometry": [
                line((0, 0), (100, 0)).wkt,
                "LINESTRING (8 4",
                None,
                line((0, 0), (0, 9)).wkt,
            ],
            "from": [1, 1, 1, None],
            "to": [2, 2, 2, 2],
        }
    )
    roads = RoadMap.from_edges(table, directed=False)
    assert len(roads) == 2
    assert roads.node_ids([0, 1]) == [1, 2]
    assert roads.info()["skipped"] == {
        "rows whose geometry could not be understood": 1,
        "rows without geometry": 1,
        "rows without from or to": 1,
    }


def test_parts_of_a_multi_line_are_joined_where_they_touch(line):
    whole = shapely.MultiLineString([line((0, 0), (50, 0)), line((50, 0), (100, 0))])
    apart = shapely.MultiLineString([line((0, 50), (50, 50)), line((60, 50), (100, 50))])
    table = geopandas.GeoDataFrame({"id": [1, 2]}, geometry=[whole, apart], crs=4326)
    assert len(RoadMap.from_edges(table)) == 6
    named = table.assign(**{"from": [1, 3], "to": [2, 4]})
    roads = RoadMap.from_edges(named, directed=False)
    assert len(roads) == 2
    assert roads.info()["skipped"] == {"rows of several separate lines, with from and to": 1}


def test_footways_are_not_for_cars(line):
    lines = [line((0, 0), (100, 0)), line((0, 0), (0, 100))]
    table = geopandas.GeoDataFrame({"fclass": ["tertiary", "footway"]}, geometry=lines, crs=4326)
    roads = RoadMap.from_edges(table, directed=False)
    assert roads.column("highway") == ["tertiary", "tertiary"]
    assert roads.info()["skipped"] == {"rows of classes not for cars": 1}


def test_a_map_wider_than_the_plane_is_refused(line):
    lines = [shapely.LineString([(0, 0), (1, 1)]), shapely.LineString([(90, 0), (91, 1)])]
    with pytest.raises(MapError, match="2,000 km"):
        RoadMap.from_edges(geopandas.GeoDataFrame(geometry=lines, crs=4326))


def test_a_map_across_the_antimeridian_is_one_map(check):
    lines = [
        shapely.LineString([(179.99, -17), (180, -17)]),
        shapely.LineString([(-180, -17), (-179.99, -17)]),
    ]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(geometry=lines, crs=4326))
    check(roads)
    assert len(roads) == 2
    assert roads.arrays.edges.length[0] == pytest.approx(2 * 1064.9, abs=1)


def test_more_vertices_on_the_same_line_change_nothing(town):
    dense = town.assign(geometry=town.geometry.segmentize(3e-5))
    one, two = RoadMap.from_edges(town), RoadMap.from_edges(dense)
    assert len(two.arrays.vertices) > 3 * len(one.arrays.vertices)
    same(one, two, 1e-4)
    np.testing.assert_allclose(one.arrays.turns.prior, two.arrays.turns.prior)
    np.testing.assert_allclose(one.arrays.turns.angle, two.arrays.turns.angle, atol=1e-4)


def test_the_table_of_edges_makes_the_same_map_again(town):
    roads = RoadMap.from_edges(town)
    table = roads.edges_table()
    assert table.crs == "EPSG:4326"
    assert table.geometry.iloc[0].coords[0] == pytest.approx((8.7, 49.4), abs=1e-9)
    assert len(table) == len(roads)
    legal = table[~table.against_one_way].rename(columns={"from_node": "u", "to_node": "v"})
    again = RoadMap.from_edges(
        legal[["edge_id", "u", "v", "geometry"]].rename(columns={"edge_id": "id"})
    )
    assert len(again) == len(roads)
    assert (again.arrays.edges.rule == 0).sum() == len(legal)
    np.testing.assert_allclose(
        np.sort(again.arrays.edges.length), np.sort(roads.arrays.edges.length), atol=1e-6
    )


def test_a_point_on_an_edge_is_found_again(town):
    roads = RoadMap.from_edges(town)
    for edge in range(len(roads)):
        length = float(roads.arrays.edges.length[edge])
        for s in (0.2 * length, 0.7 * length):
            x, y, heading = roads.at(edge, s)
            found = roads.near(x + 2 * np.sin(heading), y - 2 * np.cos(heading), 10.0)
            row = found.edge.tolist().index(edge)
            assert found.s[row] == pytest.approx(s, abs=0.3)
            assert found.lateral[row] == pytest.approx(2, abs=0.1)


def test_parts_of_an_edge_run_from_abscissa_to_abscissa(town):
    roads = RoadMap.from_edges(town)
    edge = next(e for e in range(len(roads)) if roads.source(e, 1.0) == (7, True))
    part = roads.edge_line(edge, 30.0, 80.0)
    assert len(part) == 3
    np.testing.assert_allclose(part[0], roads.at(edge, 30.0)[:2])
    np.testing.assert_allclose(part[-1], roads.at(edge, 80.0)[:2])
    np.testing.assert_array_equal(part[1], roads.edge_line(edge)[1])
    assert len(roads.edge_line(edge, 20.0, 20.0)) == 2


def test_crs_in_geojson_is_degrees(tmp_path, line):
    feature = {
        "type": "Feature",
        "properties": {"ID": 3},
        "geometry": line((0, 0), (90, 0)).__geo_interface__,
    }
    path = tmp_path / "x.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    assert RoadMap.from_edges(path).source(0, 5.0) == (3, True)


@pytest.mark.data
def test_the_real_networks_keep_the_laws(data_folder, check):
    comma = RoadMap.from_edges(data_folder / "comma_sf" / "comma_sf_osm_clip.geojson")
    check(comma)
    assert comma.info()["nodes"] > 1000
    helsinki = RoadMap.from_edges(data_folder / "hsl" / "link.csv", crs="EPSG:3067")
    check(helsinki)
    assert helsinki.info()["lat"][0] == pytest.approx(60.18, abs=0.01)


def test_the_lines_of_a_collection_are_read_and_what_is_beside_them_is_counted_apart(line):
    one, two = line((0, 0), (100, 0)), line((100, 0), (100, 90))
    mixed = shapely.GeometryCollection([one, shapely.Point(one.coords[0])])
    nested = shapely.GeometryCollection([shapely.MultiLineString([two])])
    table = geopandas.GeoDataFrame(
        {"oneway": ["no"] * 3}, geometry=[mixed, nested, shapely.Point(8.7, 49.4)], crs=4326
    )
    roads = RoadMap.from_edges(table)
    assert sorted(roads.arrays.edges.length) == pytest.approx([190, 190], abs=0.01)
    assert roads.info()["skipped"] == {
        "points and areas beside the lines of a row": 1,
        "geometries that are not lines": 1,
    }


@pytest.mark.parametrize(("name", "along", "against", "both"), [
    ("RIJRICHTNG", "H", "T", "B"),
    ("sens_de_circulation", "Sens direct", "Sens inverse", "Double sens"),
    ("directionality", "inDirection", "inOppositeDirection", "bothDirections"),
    ("Directionality", "in direction", "in opposite direction", "both directions"),
    ("AJOSUUNTA", 4, 3, 2),
    ("TRAVEL_DIR", "F", "T", "B"),
])  # fmt: skip
def test_one_way_columns_of_national_providers_are_read(line, name, along, against, both):
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(4)]
    table = geopandas.GeoDataFrame({name: [along, against, both, None]}, geometry=lines, crs=4326)
    table["id"] = range(4)
    roads = RoadMap.from_edges(table)
    legal = [(rule(roads, k, True) == 0, rule(roads, k, False) == 0) for k in range(4)]
    assert legal == [(True, False), (False, True), (True, True), (True, True)]
    assert roads.info()["skipped"] == {}
    table.loc[0, name] = 9 if name == "AJOSUUNTA" else "O"
    skipped = RoadMap.from_edges(table).info()["skipped"]
    assert skipped == {"one-way words that were not understood (taken as two-way)": 1}


def test_a_column_that_looks_like_directions_and_is_not_read_is_named(line):
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(3)]
    table = geopandas.GeoDataFrame({"SENTIDO": ["D", "C", "D"]}, geometry=lines, crs=4326)
    (why,) = RoadMap.from_edges(table).info()["skipped"]
    assert "it is not known what 'sentido' says (taken as two-way; if it tells directions" in why


def test_compass_words_do_not_hide_that_rows_are_of_one_direction(line):
    blocks = [((100 * k, 0), (100 * k + 100, 0)) for k in range(10)]
    lines = [line(*ends) for a, b in blocks for ends in ((a, b), (b, a))]
    lines += [line(a, (a[0], 100)) for a, _ in blocks]
    plain = geopandas.GeoDataFrame(geometry=lines, crs=4326)
    told = plain.assign(TRAVEL_DIR=["EB", "WB"] * 10 + ["NB"] * 10)
    one, other = RoadMap.from_edges(plain), RoadMap.from_edges(told)
    assert (other.arrays.edges.rule == 0).sum() == (one.arrays.edges.rule == 0).sum() == 30


def test_an_empty_one_way_column_does_not_hide_a_filled_one(line):
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(2)]
    words = {"id": [0, 1], "oneway": [None, None], "RIJRICHTNG": ["H", "T"]}
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(words, geometry=lines, crs=4326))
    legal = [(rule(roads, k, True) == 0, rule(roads, k, False) == 0) for k in range(2)]
    assert legal == [(True, False), (False, True)]


def test_n_beside_ft_and_tf_is_closed_both_ways(line):
    lines = [line((0, 60 * k), (100, 60 * k)) for k in range(3)]
    words = {"id": [0, 1, 2], "ONEWAY": ["FT", "N", ""]}
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(words, geometry=lines, crs=4326))
    assert rule(roads, 1, True) == rule(roads, 1, False) == NO_ACCESS
    assert rule(roads, 2, True) == rule(roads, 2, False) == rule(roads, 0, True) == 0
    closed = "roads closed both ways, N beside FT and TF (kept, without access)"
    assert roads.info()["skipped"] == {closed: 1}
    words["ONEWAY"] = ["Y", "N", "N"]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(words, geometry=lines, crs=4326))
    assert rule(roads, 1, True) == rule(roads, 1, False) == 0


@pytest.mark.parametrize(("place", "limits", "said"), [
    ((40.0, -100.0), [25, 65], True), ((52.0, -1.0), ["30", None], True),
    ((40.0, -100.0), [48, 65], False), ((40.0, -100.0), ["30 mph", "65 mph"], False),
    ((48.0, 8.0), [30, 50], False),
])  # fmt: skip
def test_the_unit_that_was_taken_is_said_where_signs_are_in_mph(place, limits, said):
    lat, lon = place
    lines = [shapely.LineString([(lon, lat + k), (lon + 0.001, lat + k)]) for k in (0.0, 0.001)]
    table = geopandas.GeoDataFrame(
        {"oneway": ["no"] * 2, "speed_limit": limits}, geometry=lines, crs=4326
    )
    skipped = RoadMap.from_edges(table).info()["skipped"]
    why = "speed limits without a unit, in a country of mph (taken as km/h; write 30 mph)"
    assert skipped == ({why: sum(one is not None for one in limits)} if said else {})
