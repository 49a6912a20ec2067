"""Answers in the words of OSRM and Valhalla: parsed by routingpy, and true to `match`."""

import json

import numpy as np
import pytest
from routingpy.routers import Valhalla
from routingpy.routers.osrm import OSRM

from whichroad import match, simulate_drive
from whichroad.answers import AnswerError, osrm_match, trace_attributes, trace_route
from whichroad.answers.polylines import decoded, encoded

FULL = "geometries=geojson&overview=full&annotations=true&steps=true"
MATCHING = {"confidence", "legs", "weight_name", "weight", "duration", "distance", "geometry"}
LEG = {"steps", "weight", "distance", "summary", "duration", "annotation"}
STEP = {
    "intersections", "driving_side", "geometry", "maneuver", "name", "mode", "weight", "duration",
    "distance",
}  # fmt: skip
POINT = {
    "alternatives_count", "waypoint_index", "matchings_index", "distance", "name", "location",
    "hint",
}  # fmt: skip
# what Valhalla 3.9 gives on drives in Heidelberg
EDGE = {
    "truck_route", "speed_limit", "density", "sac_scale", "shoulder", "sidewalk",
    "bicycle_network", "cycle_lane", "lane_count", "max_downward_grade", "max_upward_grade",
    "weighted_grade", "way_id", "id", "travel_mode", "vehicle_type", "surface", "drive_on_right",
    "internal_intersection", "roundabout", "bridge", "tunnel", "unpaved", "toll", "use",
    "traversability", "end_shape_index", "begin_shape_index", "end_heading", "begin_heading",
    "road_class", "speed", "speed_type", "speeds_non_faded", "country_crossing", "forward",
    "traffic_signal", "length", "end_node",
}  # fmt: skip


@pytest.fixture(scope="module")
def fixes(town):
    """Sixty fixes of a drive, one a second."""
    drive = simulate_drive(town, seed=3, length_m=1500.0).drive.fixes
    return drive.time[:60], drive.lat_deg[:60], drive.lon_deg[:60]


@pytest.fixture(scope="module")
def asked(fixes):
    """Coordinates, and the times as OSRM takes them."""
    time, lat, lon = fixes
    places = ";".join(f"{b:.7f},{a:.7f}" for a, b in zip(lat, lon, strict=True))
    return places, "timestamps=" + ";".join(f"{t:.0f}" for t in time)


@pytest.fixture(scope="module")
def body(fixes):
    """The same as Valhalla takes it."""
    shape = [{"time": t, "lat": a, "lon": b} for t, a, b in zip(*map(np.ndarray.tolist, fixes),
                                                              strict=True)]  # fmt: skip
    return {"shape": shape, "costing": "auto", "shape_match": "map_snap"}


def test_an_osrm_answer_has_every_key_and_routingpy_parses_it(town, asked):
    places, times = asked
    answer = osrm_match(town, places, f"{times}&{FULL}")
    json.dumps(answer, allow_nan=False)
    assert answer["code"] == "Ok"
    (matching,) = answer["matchings"]
    assert set(matching) == MATCHING
    assert all(set(leg) == LEG for leg in matching["legs"])
    assert all(set(step) == STEP for leg in matching["legs"] for step in leg["steps"])
    assert all(set(point) == POINT for point in answer["tracepoints"])
    parsed = OSRM.parse_direction_json({"routes": answer["matchings"]}, False, "geojson")
    assert parsed.geometry == matching["geometry"]["coordinates"]
    assert parsed.distance == int(matching["distance"])


def test_legs_add_up_to_the_matching_and_annotations_to_the_legs(town, asked):
    places, times = asked
    (matching,) = osrm_match(town, places, f"{times}&{FULL}")["matchings"]
    legs = matching["legs"]
    assert len(legs) == 59
    assert sum(leg["distance"] for leg in legs) == pytest.approx(matching["distance"], abs=3.1)
    for leg in legs:
        told = leg["annotation"]
        assert len(told["nodes"]) == len(told["distance"]) + 1
        assert sum(told["distance"]) == pytest.approx(leg["distance"], abs=0.1)


def test_the_line_of_a_matching_is_as_long_as_it_says(town, asked):
    places, times = asked
    for name in ("polyline", "polyline6", "geojson"):
        options = f"{times}&overview=full&geometries={name}"
        (matching,) = osrm_match(town, places, options)["matchings"]
        line = matching["geometry"]
        lat, lon = (
            np.array(line["coordinates"]).T[::-1]
            if name == "geojson"
            else decoded(line, 6 if name == "polyline6" else 5)
        )
        east, north = np.diff(lon) * np.cos(np.radians(lat[0])), np.diff(lat)
        drawn = np.hypot(east, north).sum() * 111_194.9
        assert drawn == pytest.approx(matching["distance"], rel=0.02)


def test_confidence_is_the_probability_of_the_path(town, asked, fixes):
    places, times = asked
    (matching,) = osrm_match(town, places, times)["matchings"]
    time, lat, lon = fixes
    rows = list(zip(np.rint(time), np.round(lat, 7), np.round(lon, 7), strict=True))
    result = match(rows, town, lag="full")
    (best,) = result.routes(1)
    assert matching["confidence"] == pytest.approx(best.p, abs=1e-6)


def test_each_point_has_the_estimate_of_match_under_its_own_key(town, asked, fixes):
    places, times = asked
    told = osrm_match(town, places, times)["whichroad"]
    time, lat, lon = fixes
    rows = list(zip(np.rint(time), np.round(lat, 7), np.round(lon, 7), strict=True))
    points = match(rows, town, lag="full").to_arrow()
    for name in ("edge_id", "source_id", "status"):
        assert told[name] == points[name].to_pylist()
    for name in told.keys() - {"edge_id", "source_id", "status"}:
        np.testing.assert_allclose(told[name], points[name].to_pylist(), rtol=1e-4, atol=6e-3)


def test_a_second_run_of_fixes_off_every_road_gives_null_and_two_matchings_or_one(town, asked):
    places, times = asked
    parts = places.split(";")
    away = [part if not 20 <= k < 45 else _moved(part, 0.02) for k, part in enumerate(parts)]
    answer = osrm_match(town, ";".join(away), times)
    assert None in answer["tracepoints"]
    told = answer["whichroad"]
    assert {told["status"][k] for k, p in enumerate(answer["tracepoints"]) if p is None} <= {
        "off_road", "lost", "outage",
    }  # fmt: skip
    assert max(told["p_off_road"][20:45]) > 0.5


def _moved(part, degrees):
    lon, lat = part.split(",")
    return f"{lon},{float(lat) + degrees:.7f}"


def test_waypoints_make_the_legs(town, asked):
    places, times = asked
    answer = osrm_match(town, places, f"{times}&waypoints=0;30;59")
    assert len(answer["matchings"][0]["legs"]) == 2
    numbers = [point["waypoint_index"] for point in answer["tracepoints"]]
    assert [k for k, number in enumerate(numbers) if number is not None] == [0, 30, 59]


@pytest.mark.parametrize(
    ("places", "options", "code"),
    [
        ("8,49", "", "InvalidOptions"),
        ("8,49;8", "", "InvalidQuery"),
        ("8,abc;8,9", "", "InvalidQuery"),
        ("8,49;8,95", "", "InvalidValue"),
        ("1,1;1.001,1", "", "NoSegment"),
        (None, "timestamps=1;2", "InvalidOptions"),
        (None, "timestamps=" + ";".join(str(99 - k) for k in range(60)), "InvalidValue"),
        (None, "timestamps=" + ";".join(["nan"] * 60), "InvalidValue"),
        (None, "timestamps=" + ";".join(["5"] * 60), "NoMatch"),
        (None, "radiuses=1", "InvalidOptions"),
        (None, "geometries=wkt", "InvalidQuery"),
        (None, "nothing=1", "InvalidQuery"),
        (None, "waypoints=2;59", "InvalidValue"),
        (None, "annotations=all", "InvalidQuery"),
        (";".join(["8,49"] * 20_000), "", "TooBig"),
    ],
)
def test_a_refused_request_has_the_code_of_osrm(town, asked, places, options, code):
    with pytest.raises(AnswerError) as refused:
        osrm_match(town, asked[0] if places is None else places, options)
    assert refused.value.status == 400
    assert refused.value.answer["code"] == code


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e3, "milliseconds; divide all by 1,000."),
        (1e9, "nanoseconds; divide all by 1,000,000,000."),
    ],
)
def test_timestamps_in_other_units_are_named(town, fixes, asked, factor, said):
    times = ";".join(f"{(1.7e9 + k) * factor:.0f}" for k in range(60))
    with pytest.raises(
        AnswerError, match=r"seconds since 1970.*: number 1 is 17\d*, as of"
    ) as refused:
        osrm_match(town, asked[0], f"timestamps={times}")
    assert str(refused.value).endswith(said)
    assert refused.value.answer["code"] == "InvalidValue"


def test_a_timestamp_that_goes_back_or_is_none_is_named(town, asked):
    times = [str(k) for k in range(60)]
    times[7] = "3"
    with pytest.raises(AnswerError, match=r"monotonically increasing: number 8 is 3, after 6\.$"):
        osrm_match(town, asked[0], "timestamps=" + ";".join(times))
    times[5] = "nan"
    with pytest.raises(AnswerError, match=r"one for each coordinate: number 6 is nan\.$"):
        osrm_match(town, asked[0], "timestamps=" + ";".join(times))


def test_latitude_and_longitude_that_seem_swapped_are_named(town, fixes):
    _, lat, lon = fixes
    places = ";".join(f"{a:.7f},{b:.7f}" for a, b in zip(lat, lon, strict=True))
    with pytest.raises(
        AnswerError, match="seem swapped: longitude,latitude was expected"
    ) as refused:
        osrm_match(town, places, "")
    assert refused.value.answer["code"] == "NoSegment"
    with pytest.raises(AnswerError, match=r"any coordinate\.$"):
        osrm_match(town, "1,1;1.001,1", "")


def test_routingpy_parses_the_answers_of_valhalla(town, body):
    answer = trace_attributes(town, body)
    json.dumps(answer, allow_nan=False)
    parsed = Valhalla.parse_trace_attributes_json(answer)
    assert len(parsed.matched_edges) == len(answer["edges"])
    assert len(parsed.matched_points) == len(body["shape"])
    assert all(set(edge) >= EDGE for edge in answer["edges"])
    direction = Valhalla.parse_direction_json(trace_route(town, body), "km")
    assert direction.distance == pytest.approx(1000 * sum(e["length"] for e in answer["edges"]), 5)


def test_points_of_valhalla_lie_where_their_edge_and_share_say(town, body):
    answer = trace_attributes(town, body)
    lat, lon = decoded(answer["shape"], 6)
    assert answer["edges"][-1]["end_shape_index"] == len(lat) - 1
    for point in answer["matched_points"]:
        edge = answer["edges"][point["edge_index"]]
        span = slice(edge["begin_shape_index"], edge["end_shape_index"] + 1)
        off = np.hypot(lat[span] - point["lat"], lon[span] - point["lon"])
        begin = edge.get("source_percent_along", 0.0)
        assert begin - 1e-3 <= point["distance_along_edge"]
        assert point["distance_along_edge"] <= edge.get("target_percent_along", 1.0) + 1e-3
        assert off.min() * 111_000 <= 1000 * edge["length"] + 1.0


def test_filters_choose_the_attributes(town, body):
    names = ["edge.names", "edge.length", "matched.point", "shape", "node.elapsed_time"]
    kept = trace_attributes(town, {**body, "filters": {"attributes": names, "action": "include"}})
    assert set().union(*kept["edges"]) == {"names", "length", "end_node"}
    assert set(kept["matched_points"][0]) == {"lat", "lon"}
    assert "shape" in kept
    assert "raw_score" not in kept
    left = trace_attributes(town, {**body, "filters": {"attributes": names, "action": "exclude"}})
    assert "length" not in left["edges"][0]
    assert "shape" not in left


def test_units_and_an_encoded_line(town, body, fixes):
    km = trace_route(town, body)["trip"]
    miles = trace_route(town, {**body, "units": "miles"})["trip"]
    assert miles["summary"]["length"] * 1.609344 == pytest.approx(km["summary"]["length"], abs=2e-3)
    line = {"encoded_polyline": encoded(fixes[1], fixes[2], 6), "costing": "auto"}
    again = trace_route(town, line)["trip"]
    assert again["summary"]["length"] == pytest.approx(km["summary"]["length"], rel=0.05)


def test_distances_are_told_in_the_units_that_are_asked_for(town, body):
    def told(units):
        legs = trace_route(town, {**body, "units": units})["trip"]["legs"]
        first = legs[0]["maneuvers"][0]
        return first["length"], first["verbal_post_transition_instruction"].split()[-2:]

    for units, whole, small in (
        ("miles", "miles.", "feet."),
        ("kilometers", "kilometers.", "meters."),
    ):
        length, (number, word) = told(units)
        assert word in (whole, small)
        per = {"feet.": 5280.0, "meters.": 1000.0}.get(word, 1.0)
        assert float(number) == pytest.approx(length * per, abs=0.05 + 0.001 * per)


def test_points_of_valhalla_with_one_time_are_taken_in_their_order(town, body):
    still = [{**point, "time": 0} for point in body["shape"]]
    none = [{n: v for n, v in point.items() if n != "time"} for point in body["shape"]]
    assert trace_route(town, {**body, "shape": still}) == trace_route(town, {**body, "shape": none})


@pytest.mark.parametrize(
    ("wrong", "seen"),
    [
        (lambda k, time: time - 3600.0 * (k > 45), "that of point 47 is "),
        (lambda k, time: time if k % 2 else None, " points have none."),
    ],
)
def test_times_of_valhalla_that_are_not_used_are_warned_of(town, body, wrong, seen):
    shape = [{**p, "time": wrong(k, p["time"])} for k, p in enumerate(body["shape"])]
    none = [{n: v for n, v in point.items() if n != "time"} for point in shape]
    answers = [trace_attributes(town, {**body, "shape": one}) for one in (shape, none)]
    (warning,) = answers[0].pop("warnings")
    assert warning["text"].startswith("The times of the points are not used: ")
    assert seen in warning["text"]
    assert answers[0] == answers[1]
    assert trace_route(town, {**body, "shape": shape})["trip"]["warnings"] == [warning]
    osrm = trace_route(town, {**body, "shape": shape, "format": "osrm"})
    assert osrm["warnings"] == [warning]
    assert "warnings" not in trace_attributes(town, body)


def test_the_form_of_osrm_is_given_by_valhalla_too(town, body):
    answer = trace_route(town, {**body, "format": "osrm"})
    assert answer["code"] == "Ok"
    steps = answer["matchings"][0]["legs"][0]["steps"]
    assert {"instruction"} <= set(steps[0]["maneuver"])
    assert steps[-1]["maneuver"]["type"] == "arrive"


PLACES = [{"lat": 1, "lon": 8}, {"lat": 1, "lon": 8.001}]


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (b"{", 100),
        (b"[" * 100_000, 100),
        (b"[]", 100),
        ({}, 124),
        ({"costing": "rocket"}, 125),
        ({"costing": "auto"}, 114),
        ({"costing": "auto", "shape": [{"lat": 49, "lon": 8}]}, 123),
        ({"costing": "auto", "shape": [{"lat": "x", "lon": 8}] * 2}, 100),
        ({"costing": "auto", "shape": [8, 9]}, 100),
        ({"costing": "auto", "shape": [{"lat": 1e400, "lon": 8}] * 2}, 100),
        ({"costing": "auto", "encoded_polyline": "~~~~~"}, 100),
        ({"costing": "auto", "shape": [{"lat": 1, "lon": 8}] * 3, "shape_match": "x"}, 445),
        ({"costing": "auto", "shape": [{"lat": 1, "lon": 8}] * 20_000}, 153),
        ({"costing": "auto", "shape": [{"lat": 1, "lon": 8}, {"lat": 1, "lon": 8.001}]}, 171),
        ({"costing": "auto", "shape": PLACES, "trace_options": {"gps_accuracy": -5}}, 158),
        ({"costing": "auto", "shape": PLACES, "gps_accuracy": -0.1}, 158),
        ({"costing": "auto", "shape": PLACES, "durations": [1, 2, 3]}, 136),
        ({"costing": "auto", "shape": PLACES, "durations": []}, 136),
        ({"costing": "auto", "shape": PLACES, "durations": "2"}, 100),
    ],
)
def test_a_refused_request_has_the_number_of_valhalla(town, request_, code):
    with pytest.raises(AnswerError) as refused:
        trace_attributes(town, request_)
    assert refused.value.answer["error_code"] == code


def test_a_polyline_comes_back_and_damage_is_refused():
    lat, lon = np.array([38.5, 40.7, 43.252]), np.array([-120.2, -120.95, -126.453])
    assert encoded(lat, lon) == "_p~iF~ps|U_ulLnnqC_mqNvxq`@"  # the format's own example
    for digits in (5, 6):
        np.testing.assert_allclose(decoded(encoded(lat, lon, digits), digits), (lat, lon))
    for damaged in ("_p~iF", "_p~iF~ps|", "é", "~" * 50):
        with pytest.raises(ValueError, match="polyline"):
            decoded(damaged)
