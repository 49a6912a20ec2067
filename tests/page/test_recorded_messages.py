"""A recorded drive as messages."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from whichroad import Settings
from whichroad.errors import DriveError, ReadError
from whichroad.live.message_types import (
    EstimateMessage,
    FixMessage,
    HypothesisMessage,
    RoadMessage,
)
from whichroad.live.schemas import schemas
from whichroad.matching import match
from whichroad.replay.open_replay import Remaking, is_points, one_of
from whichroad.replay.points import read_points
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.replay.timeline import thinned, timeline
from whichroad.roadmap import RoadMap
from whichroad.tables.status import STATUS

PLAY: Any = {"mode": "replay", "paused": False, "speed": 1.0, "position_s": 0, "length_s": 1}


def test_a_message_has_the_keys_of_the_live_service(recorded: RecordedMessages):
    for k in range(0, len(recorded), 500):
        said = recorded.message(k, 3, PLAY)
        assert set(said) == set(EstimateMessage.__annotations__)
        assert set(said["road"]) == set(RoadMessage.__annotations__)
        assert set(said["fix"] or ()) <= set(FixMessage.__annotations__)
        for one in said["hypotheses"]:
            assert set(one) == set(HypothesisMessage.__annotations__)
        Draft202012Validator(schemas()["estimate"]).validate(said)


def test_a_message_says_what_the_points_say(recorded: RecordedMessages, remaking: Remaking):
    result = match(remaking.drive, remaking.roads, vehicle=remaking.vehicle)
    for k in range(0, len(recorded), 700):
        row, said = result.to_arrow().slice(k, 1).to_pylist()[0], recorded.message(k, 0, PLAY)
        assert said["epoch_s"] == pytest.approx(row["time"].timestamp(), abs=1e-5)
        assert (said["pose"] or {})["lat"] == pytest.approx(row["lat"], abs=1e-7)
        assert said["p_road"] == pytest.approx(row["p_road"], abs=1e-7)
        assert said["status"] == row["status"]
        assert said["road"]["edge_id"] == row["edge_id"]


def test_hypotheses_come_most_probable_first_and_their_p_is_one_at_most(recorded: RecordedMessages):
    for k in range(0, len(recorded), 50):
        shares = [one["p"] for one in recorded.hypotheses(k)]
        assert shares == sorted(shares, reverse=True)
        assert sum(shares) <= 1.0 + 1e-5


def test_the_best_hypothesis_stands_where_the_pose_is_when_it_is_alone(recorded: RecordedMessages):
    alone = np.flatnonzero(recorded.choices.p[:, 0] > 0.99999 * (1.0 - Settings().unknown))
    assert len(alone) > 100
    metre = 360.0 / 40_030_000.0  # of latitude, degrees
    away = np.abs(recorded.choices.lat[alone, 0] - recorded.columns["lat"][alone]) / metre
    # an edge may have several Gaussians: the best of them is near their mean, in sigmas
    assert (away / recorded.choices.major[alone, 0]).max() < 0.25


def test_masked_fixes_are_withheld_and_the_ellipse_grows(
    recorded: RecordedMessages, remaking: Remaking
):
    begin = float(recorded.time[0]) + 90.0
    dark = remaking([(begin, begin + 40.0)])
    k = recorded.at(129.0)
    assert dark.message(k, 0, PLAY)["gnss_masked"]
    assert dark.message(k, 0, PLAY)["fix"]["masked"]  # type: ignore[index]
    assert not recorded.message(k, 0, PLAY)["gnss_masked"]
    assert dark.columns["ellipse_major_m"][k] > 1.2 * recorded.columns["ellipse_major_m"][k]
    before = slice(0, recorded.at(89.9))
    assert np.array_equal(
        dark.columns["lat"][before], recorded.columns["lat"][before], equal_nan=True
    )


def test_wheels_alone_are_shown_in_gaps_of_gnss_only(
    recorded: RecordedMessages, remaking: Remaking
):
    begin = float(recorded.time[0]) + 90.0
    dark = remaking([(begin, begin + 40.0)])
    inside, outside = dark.at(120.0), dark.at(80.0)
    assert dark.reckoning.at(outside) is None
    one = dark.reckoning.at(inside)
    assert one is not None
    assert one["since_epoch_s"] == pytest.approx(begin, abs=1.5)
    driven = np.trapezoid(
        dark.columns["speed_mps"][dark.at(one["since_epoch_s"] - dark.time[0]) : inside],
        dark.time[dark.at(one["since_epoch_s"] - dark.time[0]) : inside],
    )
    assert one["travelled_m"] == pytest.approx(driven, rel=0.1)


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".geojson", ".arrow"])
def test_points_from_a_file_make_the_film_that_was_written(
    suffix: str, recorded: RecordedMessages, remaking: Remaking, roads: RoadMap, tmp_path: Path
):
    result = match(remaking.drive, roads, vehicle=remaking.vehicle)
    path = tmp_path / f"points{suffix}"
    result.write(path)
    assert is_points(path)
    again = RecordedMessages(read_points(path), roads)
    assert len(again) == len(recorded)
    for k in range(0, len(recorded), 600):
        old, new = recorded.message(k, 0, PLAY), again.message(k, 0, PLAY)
        assert new["epoch_s"] == pytest.approx(old["epoch_s"], abs=1e-5)
        assert (new["pose"] or {})["lat"] == pytest.approx((old["pose"] or {})["lat"], abs=1e-7)
        assert new["status"] == old["status"]
        roads_of = [{h["edge_id"]: h["p"] for h in m["hypotheses"]} for m in (old, new)]
        assert roads_of[1] == pytest.approx(roads_of[0], abs=1e-4)
        Draft202012Validator(schemas()["estimate"]).validate(new)


def test_a_log_is_no_table_of_points_and_is_told_so(folder: Path):
    assert not is_points(folder / "drive.nmea")
    assert not is_points(folder / "missing.parquet")
    with pytest.raises(ReadError, match="no column 'p_road'"):
        read_points(folder / "truth.parquet")


def test_of_several_drives_one_has_to_be_named(remaking: Remaking):
    with pytest.raises(DriveError, match="2 drives"):
        one_of([remaking.drive, remaking.drive], None)


def test_the_columns_keep_their_least_probable_moments(recorded: RecordedMessages):
    line = timeline(recorded, rows=200)
    assert len(line["t"]) <= 200
    assert min(line["p"]) == pytest.approx(np.nanmin(recorded.columns["p_way"]), abs=1e-4)
    assert max(line["status"]) < len(STATUS)
    everything = thinned(recorded.time, recorded.columns["p_way"], len(recorded))
    assert np.array_equal(everything, np.arange(len(recorded)))
