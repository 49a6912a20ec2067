"""Level, places and sensors beside the track: in messages, and in the report's columns."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import whichroad
from whichroad.live.schemas import schemas
from whichroad.replay.drive_report import report_data
from whichroad.replay.open_replay import Remaking
from whichroad.replay.points import read_points
from whichroad.replay.recorded_messages import RecordedMessages

PLAY: Any = {"mode": "replay", "paused": False, "speed": 1.0, "position_s": 0, "length_s": 1}


@pytest.fixture(scope="module")
def full(crowded: Remaking) -> RecordedMessages:
    return crowded([])


def test_a_message_tells_the_places_that_the_drive_then_comes_past(full: RecordedMessages):
    track = np.column_stack([full.columns["lat"], full.columns["lon"]])
    came = 0
    for k in range(200, len(full) - 600, 100):
        said = full.message(k, 0, PLAY)
        Draft202012Validator(schemas()["estimate"]).validate(said)
        sure = [one for one in said["ahead"] or () if one["p"] > 0.99]
        for one in sure:
            away = np.abs(track[k:] - (one["lat"], one["lon"])).sum(axis=1).min()
            came += away < 6e-4
        assert [one["distance_m"] for one in said["ahead"] or ()] == sorted(
            one["distance_m"] for one in said["ahead"] or ()
        )
        assert all(one["distance_m"] <= 50.0 + 5.0 * one["sigma_m"] for one in said["nearby"] or ())
    assert came > 20


def test_levels_are_those_of_the_roads_and_sum_up(full: RecordedMessages, crowded: Remaking):
    kinds = set()
    for k in range(0, len(full), 50):
        levels, road = full.levels(k), full.message(k, 0, PLAY)["road"]
        assert sum(one.p for one in levels) == pytest.approx(1.0, abs=1e-6)
        assert [one.p for one in levels] == sorted((one.p for one in levels), reverse=True)
        kinds |= {one.kind for one in levels if one.p > 0.9}
        if road["edge_id"] is not None and levels[0].p > 0.9:
            place = road["edge_id"], road["abscissa_m"]
            of = [n for n in ("tunnel", "bridge") if crowded.roads.attribute(n, *place)]
            told = of[0] if of else "ground"
            assert levels[0].kind == told
    assert kinds >= {"tunnel", "bridge", "ground"}


def test_each_sensor_is_told_with_its_rate_and_what_was_learnt(full: RecordedMessages):
    heard = {one["name"]: one for one in full.heard(len(full) // 2)}
    assert list(heard) == ["gnss", "wheels", "height", "sky", "compass"]
    assert heard["wheels"]["rate_hz"] == pytest.approx(10.0, rel=0.02)
    assert heard["sky"]["rate_hz"] == pytest.approx(1.0, rel=0.02)
    assert (heard["compass"]["age_s"], heard["compass"]["count"]) == (None, 0)
    learnt = {one["what"]: one for one in heard["wheels"]["learnt"]}
    assert learnt["scale"]["value"] == pytest.approx(1.0, abs=5.0 * learnt["scale"]["sigma"])
    assert 0.0 < learnt["scale"]["sigma"] < 0.012  # of what was not learnt
    assert heard["wheels"]["doubted"] == []


def test_the_report_has_the_same_in_columns(full: RecordedMessages, crowded: Remaking):
    data = report_data(full, crowded.roads)
    beside, rows = data["beside"], len(data["line"]["t"])
    for k in range(0, rows, 250):
        epoch = full.at(data["line"]["t"][k])
        kinds = [one[1] for one in beside["levels"]["known"][beside["levels"]["row"][k]]]
        assert kinds[:1] == [one.kind for one in full.levels(epoch)][:1]
        ids = [beside["points"][one[0]][0] for one in beside["ahead"][k]]
        likely = [one["id"] for one in full.places.ahead(epoch) if one["p"] >= 0.02]
        assert ids == likely[:5]
        assert [one["name"] for one in beside["heard"]] == [
            one["name"] for one in full.heard(epoch)
        ]
    (wheels,) = [one for one in beside["heard"] if one["name"] == "wheels"]
    assert len(wheels["said"]) == len(wheels["states"]["row"]) == rows


def test_a_drive_without_places_says_that_there_are_none(recorded: RecordedMessages):
    said = recorded.message(500, 0, PLAY)
    assert (said["ahead"], said["nearby"]) == (None, None)
    assert report_data(recorded)["beside"]["ahead"] is None


def test_points_from_a_file_show_the_places_of_the_best_road(
    crowded: Remaking, full: RecordedMessages, tmp_path: Path
):
    assert crowded.places is not None
    whichroad.match(crowded.drive, crowded.roads, vehicle=crowded.vehicle).write(
        tmp_path / "points.parquet"
    )
    points = read_points(tmp_path / "points.parquet")
    read = RecordedMessages(points, crowded.roads, places=crowded.places)
    assert read.places is not None
    compared = 0
    for k in range(200, len(read) - 600, 200):
        j = int(np.searchsorted(full.time, read.time[k] - 1e-3))
        if read.columns["p_road"][k] < 0.999 or full.columns["p_road"][j] < 0.999:
            continue
        for ask in ("ahead", "nearby"):
            here, there = (getattr(one.places, ask)(at) for one, at in ((read, k), (full, j)))
            sure = {one["id"]: one for one in there if one["p"] > 0.9}
            found = {one["id"]: one for one in here}
            assert sure.keys() <= found.keys()
            for id_, one in sure.items():
                assert found[id_]["distance_m"] == pytest.approx(one["distance_m"], abs=5.0)
                compared += 1
    assert compared > 10
    assert report_data(read)["beside"]["ahead"] is not None
