"""Numbers of roads, destinations and lanes of turns in the answers, as the map has them."""

import numpy as np
import pytest

from whichroad.answers import osrm_match, trace_attributes, trace_route
from whichroad.answers.signs import lanes_for, lanes_of
from whichroad.geodesy.plane import Plane
from whichroad.simulate.map_builder import ORIGIN, MapBuilder


@pytest.fixture(scope="module")
def roads():
    """A main road eastwards, whose number begins at b, and a street to the right at c."""
    town = MapBuilder()
    for name, x, y in (("a", 0, 0), ("b", 150, 0), ("c", 300, 0), ("d", 600, 0), ("e", 300, -300),
                       ("f", 150, 200)):  # fmt: skip
        town.node(name, x, y)
    town.way(["a", "b"], "primary", name="Main")
    lanes = {
        "turn:lanes:forward": "left|through|through;right",
        "turn:lanes:backward": "left|through",
    }
    town.way(["b", "c"], "primary", name="Main", ref="B 3", **lanes)
    town.way(["c", "d"], "primary", name="Main", ref="B 3")
    signed = {"destination:forward": "Harbour;Old Town"}
    town.way(["c", "e"], "residential", name="Side", **signed)
    town.way(["b", "f"], "residential", name="North")
    return town.compiled()


@pytest.fixture(scope="module")
def shape():
    """Fixes from a by c to e, 10 m and one second apart."""
    x = np.concatenate([np.arange(5.0, 300.0, 10.0), np.full(29, 300.0)])
    y = np.concatenate([np.zeros(30), -np.arange(5.0, 291.0, 10.0)])
    lat, lon = Plane(*ORIGIN).to_geodetic(x, y)
    places = zip(lat, lon, strict=True)
    return [{"time": 1.78e9 + k, "lat": a, "lon": o} for k, (a, o) in enumerate(places)]


def steps(roads, shape, **options):
    places = [(p["lon"], p["lat"]) for p in shape]
    options = {"steps": True, "timestamps": [p["time"] for p in shape],
               "waypoints": [0, len(shape) - 1], **options}  # fmt: skip
    [matching] = osrm_match(roads, places, options)["matchings"]
    return matching["legs"][0]["steps"]


def test_a_turn_has_the_lanes_before_it_and_the_street_its_signs(roads, shape):
    main, side, _ = steps(roads, shape)
    assert (main["name"], side["name"]) == ("Main", "Side")
    assert "ref" not in side
    assert side["destinations"] == "Harbour, Old Town"
    assert side["intersections"][0]["lanes"] == [
        {"valid": False, "indications": ["left"]},
        {"valid": False, "indications": ["straight"]},
        {"valid": True, "indications": ["straight", "right"]},
    ]
    assert "lanes" not in main["intersections"][1]  # at b nothing is painted


def test_the_other_direction_has_its_own_lanes_and_no_sign(roads, shape):
    back = [{**p, "time": 1.78e9 + k} for k, p in enumerate(reversed(shape))]
    side, main, _ = steps(roads, back)
    assert (side["name"], main["name"], main["ref"]) == ("Side", "Main", "B 3")
    assert "destinations" not in side
    left, ahead = main["intersections"][1]["lanes"]
    assert (left["valid"], ahead["valid"], ahead["indications"]) == (False, True, ["straight"])


def test_valhalla_tells_lanes_and_names_in_its_own_way(roads, shape):
    body = {"shape": shape, "costing": "auto", "shape_match": "map_snap"}
    legs = trace_route(roads, {**body, "format": "osrm"})["matchings"][0]["legs"]
    lanes = legs[0]["steps"][1]["intersections"][0]["lanes"]
    assert [lane["active"] for lane in lanes] == [False, False, True]
    assert lanes[2]["valid_indication"] == "right"
    names = {tuple(edge["names"]) for edge in trace_attributes(roads, body)["edges"]}
    assert names == {("Main",), ("Main", "B 3"), ("Side",)}
    back = [{**p, "time": 1.78e9 + k} for k, p in enumerate(reversed(shape))]
    told = trace_route(roads, {**body, "shape": back})["trip"]["legs"][0]["maneuvers"]
    assert told[1]["street_names"] == ["Main"]
    assert told[1]["begin_street_names"] == ["Main", "B 3"]


@pytest.mark.parametrize(
    ("turn", "valid"), [(0.0, [1, 2]), (80.0, [2]), (-95.0, [0]), (-170.0, [])]
)
def test_lanes_lead_where_they_say(turn, valid):
    lanes = lanes_of("left|through|through;right")
    told = lanes_for(lanes, turn, by_valhalla=False)
    assert [k for k, lane in enumerate(told) if lane["valid"]] == valid


def test_lanes_without_a_word_are_none_and_no_lanes_are_no_list():
    assert lanes_of("reverse;left||none|merge_to_right|bus") == [
        ["uturn", "left"], ["none"], ["none"], ["slight right"], ["none"],
    ]  # fmt: skip
    assert lanes_of("") == lanes_of("||") == []
    assert lanes_for([], 0.0, by_valhalla=True) == []
