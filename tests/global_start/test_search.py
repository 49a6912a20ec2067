"""A start from wheels and the map alone: it finds the road, and does not pretend before."""

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest
import typer

import whichroad
from scenes import Town, columns, drive_along, grid_town, network
from whichroad.cli.arguments import read_start
from whichroad.epochs import Timeline, build_timeline
from whichroad.errors import DriveError, SettingError
from whichroad.filter.motion import arc_chord
from whichroad.filter.state import DISTANCE, OFF_ROAD, WHEELS, new_epochs
from whichroad.filter.summary.estimate import AMBIGUOUS
from whichroad.global_start import is_vague, prior_components
from whichroad.observations import Drive, Fixes, StartPose
from whichroad.recorded import Recorded, localize_recorded
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive, drivable, simulate_drive

from .wheels import PLANE, wheels_of

SURE = 0.95


def driven(town: whichroad.RoadMap, seed: int, length_m: float = 2000.0) -> SimulatedDrive:
    allowed = drivable(town.arrays, np.random.default_rng(0))
    return simulate_drive(town, seed=seed, length_m=length_m, scenario="good", allowed=allowed)


def in_the_dark(drive: SimulatedDrive) -> Drive:
    return replace(drive.drive, fixes=None)


def searched(
    town: whichroad.RoadMap, drive: SimulatedDrive, start: StartPose | str = "map"
) -> tuple[Recorded, np.ndarray, np.ndarray]:
    """The answer, and at its epochs the true edge and the distance travelled."""
    timeline = build_timeline(in_the_dark(drive), town.plane, drive.vehicle)
    recorded = localize_recorded(town, timeline, vehicle=drive.vehicle, start=start)
    at = np.searchsorted(drive.truth.time, timeline.epochs.time - 1e-3)
    at = np.minimum(at, len(drive.truth) - 1)
    return recorded, drive.truth.edge[at], drive.truth.travelled[at]


def first_sure(recorded: Recorded, travelled: np.ndarray) -> float:
    return float(travelled[np.argmax(recorded.output.rows.p_edge > SURE)])


def test_turns_tell_where_a_drive_without_any_fix_is(town: whichroad.RoadMap):
    right, sure, epochs = 0, 0, 0
    for seed in range(4):
        recorded, edge, travelled = searched(town, driven(town, seed))
        late = travelled > 1000.0
        declared = late & (recorded.output.rows.p_edge > SURE)
        epochs += int(late.sum())
        sure += int(declared.sum())
        right += int((declared & (recorded.output.rows.edge == edge)).sum())
    assert sure > 0.8 * epochs
    assert right > 0.97 * sure


def test_until_it_knows_it_says_ambiguous_and_its_ellipse_spans_the_town(town: whichroad.RoadMap):
    recorded, _, travelled = searched(town, driven(town, 1))
    output = recorded.output
    early = travelled < min(100.0, 0.5 * first_sure(recorded, travelled))
    assert early.sum() > 10
    assert (output.rows.status[early] == AMBIGUOUS).all()
    assert (np.sqrt(columns(output, "xx yy")[early].sum(axis=1)) > 500.0).all()
    assert (output.rows.live[early] > 100).all()


def test_the_probabilities_of_an_epoch_never_sum_to_more_than_one(town: whichroad.RoadMap):
    recorded, _, _ = searched(town, driven(town, 1))
    output = recorded.output
    assert (output.rows.p_edge + output.rows.p_off_road < 1.0 + 1e-9).all()
    assert (output.rows.alt_p.sum(axis=1) < 1.0 + 1e-5).all()
    assert (output.rows.live > 0).all()


def test_the_path_begins_where_the_drive_did(town: whichroad.RoadMap):
    """Found late, the route is known from its start."""
    drive = driven(town, 1)
    recorded, edge, _ = searched(town, drive)
    route = recorded.chain.edge[recorded.chain.edge != OFF_ROAD]
    driven_edges = edge[np.flatnonzero(np.diff(edge, prepend=-1))]
    assert route[0] == driven_edges[0]
    assert set(driven_edges[:-1]) <= set(route)


def test_a_drive_too_short_to_know_stays_ambiguous(town: whichroad.RoadMap):
    recorded, _, _ = searched(town, driven(town, 2, length_m=60.0))
    assert (recorded.output.rows.status == AMBIGUOUS).all()
    assert len(recorded.chain.edge) == 0


def test_of_equal_blocks_none_is_declared():
    """A grid without borders in sight: the turns fit many corners alike."""
    roads = network(grid_town(8, 8, 100.0), curvature=PLANE.curvature)
    truth = drive_along([[330.0, 308.0], [400.0, 308.0], [405.0, 380.0]])
    recorded = localize_recorded(Town(roads, PLANE), wheels_of(truth), start="map")
    assert recorded.output.rows.p_edge[-1] < 0.5
    assert recorded.output.rows.p_off_road[-1] < 0.5


def test_a_vague_pose_is_found_out_sooner_than_the_whole_map(town: whichroad.RoadMap):
    drive = driven(town, 1)
    lat, lon = town.plane.to_geodetic(drive.truth.x[:1] + 60.0, drive.truth.y[:1] - 60.0)
    pose = StartPose(float(lat[0]), float(lon[0]), 0.0, 100.0, 180.0)
    anywhere, edge, travelled = searched(town, drive)
    near, _, _ = searched(town, drive, pose)
    assert near.output.rows.live[0] < anywhere.output.rows.live[0]
    assert first_sure(near, travelled) < first_sure(anywhere, travelled)
    k = np.argmax(near.output.rows.p_edge > SURE)
    assert near.output.rows.edge[k] == edge[k]


def test_a_car_that_comes_from_an_unmapped_yard_is_found_on_the_road(town: whichroad.RoadMap):
    """Circles of 7 m that no street has, and then the drive."""
    drive = driven(town, 1, 2500.0)
    timeline = build_timeline(in_the_dark(drive), town.plane, drive.vehicle)
    n = 150
    yard = new_epochs(n)
    yard.time[:] = timeline.epochs.time[0] - 0.1 * np.arange(n, 0, -1)
    yard.arc, yard.turn, yard.odometry_valid = 1.0, 1.0 / 7.0, 1
    yard.forward, yard.left = arc_chord(1.0, 1.0 / 7.0)
    both = new_epochs(n + len(timeline.epochs))
    both[:n], both[n:] = yard, timeline.epochs
    output = localize_recorded(
        town, Timeline(both, WHEELS, 0), vehicle=drive.vehicle, start="map"
    ).output
    assert output.rows.p_off_road[n - 1] > 0.5
    assert output.rows.p_edge[-1] > SURE
    at = np.searchsorted(drive.truth.time, both.time[-1] - 1e-3)
    assert output.rows.edge[-1] == drive.truth.edge[min(at, len(drive.truth) - 1)]


# A fix on the way


def with_a_fix(drive: SimulatedDrive, at_m: float, east_m: float = 0.0) -> Drive:
    """The drive with one fix of 3 m where so much was travelled."""
    fixes = drive.drive.fixes
    time = drive.truth.time[np.searchsorted(drive.truth.travelled, at_m)]
    k = np.searchsorted(fixes.time, time)
    one = Fixes(*(getattr(fixes, name)[k : k + 1].copy() for name in Fixes.__slots__))
    one.lon_deg[0] += east_m / (111_320.0 * math.cos(math.radians(one.lat_deg[0])))
    return replace(drive.drive, fixes=one)


def test_a_fix_ends_the_search(town: whichroad.RoadMap):
    drive = driven(town, 1)
    timeline = build_timeline(with_a_fix(drive, 100.0), town.plane, drive.vehicle)
    output = localize_recorded(town, timeline, vehicle=drive.vehicle, start="map").output
    k = int(np.flatnonzero(timeline.epochs.has_fix)[0])
    assert output.rows.live[k - 1] > 100
    assert output.rows.live[k] < 50
    at = np.searchsorted(drive.truth.time, timeline.epochs.time[k] - 1e-3)
    error = columns(output, "x y")[k] - [drive.truth.x[at], drive.truth.y[at]]
    assert np.hypot(*error) < 3.0 * np.sqrt(output.rows.cov[k, 0] + output.rows.cov[k, 3])


def test_a_fix_that_fits_nothing_starts_the_filter_anew(town: whichroad.RoadMap):
    drive = driven(town, 1)
    timeline = build_timeline(with_a_fix(drive, 100.0, 9_000.0), town.plane, drive.vehicle)
    output = localize_recorded(town, timeline, vehicle=drive.vehicle, start="map").output
    k = int(np.flatnonzero(timeline.epochs.has_fix)[0])
    assert output.rows.p_off_road[k] > 0.99
    assert np.hypot(*(columns(output, "x y")[k] - timeline.epochs.fix[k, :2])) < 10.0


# What cannot be


def test_a_drive_that_tells_no_turns_is_refused(town: whichroad.RoadMap):
    epochs = new_epochs(10)
    with pytest.raises(DriveError, match="no odometry that measures turns"):
        localize_recorded(town, Timeline(epochs, DISTANCE, 0), start="map")


def test_roads_without_end_are_refused(town: whichroad.RoadMap, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(importlib.import_module("whichroad.global_start.prior"), "_MOST", 100)
    with pytest.raises(DriveError, match="places to search; at most 100 were expected"):
        prior_components(town, Settings(), None)


def test_a_vague_pose_off_the_map_is_refused(town: whichroad.RoadMap):
    with pytest.raises(DriveError, match="no road of the map is near the start"):
        prior_components(town, Settings(), StartPose(0.0, 0.0, 0.0, 200.0))


def test_only_poses_and_the_map_are_starts(town: whichroad.RoadMap):
    drive = in_the_dark(driven(town, 1, 100.0))
    with pytest.raises(SettingError, match='a pose or "map" was expected'):
        whichroad.match(drive, town, start="home")
    with pytest.raises(SettingError, match="the paper's method needs a fix"):
        whichroad.match(drive, town, start="map", model="paper")


def test_on_line_there_is_no_start_from_the_map(town: whichroad.RoadMap):
    with pytest.raises(SettingError, match="only a recorded drive can start from the map"):
        whichroad.Localizer(town, start="map")


def test_match_starts_from_the_map(town: whichroad.RoadMap):
    drive = driven(town, 1, 800.0)
    result = whichroad.match(in_the_dark(drive), town, vehicle=drive.vehicle, start="map")
    assert result.summary["epochs_without_answer"] == 0
    assert result.summary["fixes"] == 0


@pytest.mark.parametrize(
    ("start", "mode", "vague"),
    [
        ("map", WHEELS, True),
        ("map", DISTANCE, True),  # and refused
        (StartPose(0.0, 0.0, 0.0), WHEELS, False),
        (StartPose(0.0, 0.0, 0.0, 300.0), WHEELS, True),
        (StartPose(0.0, 0.0, 0.0, 5.0, 180.0), WHEELS, True),
        (StartPose(0.0, 0.0, 0.0, 300.0), DISTANCE, False),
        (None, WHEELS, False),
    ],
)
def test_what_must_be_searched_for(start: StartPose | str | None, mode: int, vague: bool):
    assert is_vague(start, mode) == vague


def test_the_command_line_names_all_kinds_of_starts():
    assert read_start("49.4,8.7,90") == (49.4, 8.7, 90.0)
    assert read_start("map") == "map"
    place = read_start("map:49.4,8.7,500")
    assert isinstance(place, StartPose)
    assert (place.lat_deg, place.lon_deg, place.sigma_m) == (49.4, 8.7, 500.0)
    assert is_vague(place, WHEELS)


@pytest.mark.parametrize("text", ["map:49.4,8.7", "map:49.4,8.7,0", "map:99,8.7,50", "maps"])
def test_the_command_line_refuses_other_starts(text: str):
    with pytest.raises(typer.BadParameter, match="expected"):
        read_start(text)
