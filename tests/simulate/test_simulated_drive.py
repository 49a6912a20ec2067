"""Laws of simulated drives: the truth is one motion, and the sensors err as they say."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from whichroad.errors import MapError, SettingError
from whichroad.simulate import GOOD, PRESETS, START, SimulationSettings, drivable, simulate_drive

PERFECT = replace(
    GOOD,
    map_sigma=0.0,
    relative_sigma=0.0,
    scale_sigma=0.0,
    differential_sigma=0.0,
    track_sigma=0.0,
    wheel_walk=0.0,
)
CHI2_999 = 3.29  # a standard normal exceeds it in 0.1 % of cases


def along(truth, values):
    return np.diff(values) / np.diff(truth.time)


def test_speed_is_the_derivative_of_the_position(hand_made):
    truth = simulate_drive(
        hand_made, seed=3, length_m=3000.0, scenario=replace(GOOD, odometry_rate=100.0)
    ).truth
    chord = np.hypot(along(truth, truth.x), along(truth, truth.y))
    middle = 0.5 * (truth.speed[1:] + truth.speed[:-1])
    # a chord is shorter than its arc by (κ ds)² / 24 of it: 1e-4 at 100 Hz; 0.1 mm of float time
    assert np.abs(chord - middle).max() < 1e-3 * middle.max() + 0.02


def test_heading_is_the_direction_of_travel(hand_made):
    truth = simulate_drive(
        hand_made, seed=3, length_m=3000.0, scenario=replace(GOOD, odometry_rate=100.0)
    ).truth
    moving = np.hypot(np.diff(truth.x), np.diff(truth.y)) > 0.02
    direction = np.arctan2(np.diff(truth.y), np.diff(truth.x))
    middle = np.angle(np.exp(1j * truth.heading[1:]) + np.exp(1j * truth.heading[:-1]))
    error = np.angle(np.exp(1j * (direction - middle)))[moving]
    # the heading of a grid interval is the mean of cubic slopes: a second-order error of its step
    assert np.abs(error).max() < 0.02


def test_heading_is_continuous_and_bends_can_be_steered(hand_made):
    for seed in range(4):
        truth = simulate_drive(hand_made, seed=seed).truth
        step = np.diff(truth.travelled)
        turn = np.abs(np.angle(np.exp(1j * np.diff(truth.heading))))
        assert (turn <= 0.3 * step + 1e-9).all()  # no bend tighter than 3.3 m


def test_standing_moves_nothing(hand_made):
    drive = simulate_drive(hand_made, seed=2)
    truth, wheels = drive.truth, drive.drive.odometry
    still = truth.stopped[1:] & truth.stopped[:-1]
    assert still.sum() > 20
    for values in (truth.x, truth.y, truth.heading, wheels.left, wheels.right):
        assert (np.diff(values)[still] == 0).all()


def test_perfect_wheels_integrate_to_the_true_path(hand_made):
    drive = simulate_drive(
        hand_made, seed=1, length_m=4000.0, scenario=replace(PERFECT, odometry_rate=100.0)
    )
    truth, counts, s = drive.truth, drive.drive.odometry, drive.settings
    left, right = (np.diff(c) * s.metres_per_tick for c in (counts.left, counts.right))
    heading = truth.heading[0] + np.concatenate([[0.0], np.cumsum(right - left) / s.track_width])
    # counts are rounded down: 2 * 40 mm / 1.5 m of heading, and never more, however far
    error = np.angle(np.exp(1j * (heading - truth.heading)))
    assert np.abs(error).max() < 2 * s.metres_per_tick / s.track_width
    arc, true = 0.5 * (left + right), np.unwrap(truth.heading)
    moved = np.cumsum(arc * np.exp(0.5j * (true[1:] + true[:-1])))
    # the course's points are 1 m apart: its arcs are longer than its chords by a few 1e-5
    error = moved - ((truth.x[1:] - truth.x[0]) + 1j * (truth.y[1:] - truth.y[0]))
    assert np.abs(error).max() < 1e-4 * truth.travelled[-1]


def test_wheels_err_as_the_settings_say(hand_made):
    # noise off: scale and drift of each drive are exactly the drawn ones
    drive = simulate_drive(hand_made, seed=8, scenario=replace(GOOD, wheel_walk=0.0))
    truth, counts, s, true = drive.truth, drive.drive.odometry, drive.settings, drive.wheels
    rolled = s.metres_per_tick * 0.5 * (np.ptp(counts.left) + np.ptp(counts.right))
    assert rolled * true.scale == pytest.approx(truth.travelled[-1], abs=0.2)
    draws = [simulate_drive(hand_made, seed=k, length_m=200.0).wheels for k in range(120)]
    for value, sigma in (
        ([w.scale - 1 for w in draws], s.scale_sigma),
        ([w.differential for w in draws], s.differential_sigma),
        ([w.track_width / s.track_width - 1 for w in draws], s.track_sigma),
    ):
        # variance of n normals: relative standard error sqrt(2 / n)
        assert np.mean(np.square(value)) / sigma**2 == pytest.approx(
            1, abs=CHI2_999 * np.sqrt(2 / 120)
        )


@pytest.mark.parametrize("scenario", ["good", "urban"])
def test_gnss_errors_have_the_size_they_should(hand_made, scenario):
    settings = replace(PRESETS[scenario], multipath_rate=0.0)
    squares = []
    for seed in range(40):  # a few independent errors each: far apart in time
        drive = simulate_drive(hand_made, seed=seed, length_m=5000.0, scenario=settings)
        apart = int(3 * settings.gnss_time)
        squares += list((drive.fix_error[::apart] ** 2).mean(axis=1))
    bias = (
        settings.gnss_bias_low**2
        + settings.gnss_bias_low * settings.gnss_bias_high
        + settings.gnss_bias_high**2
    ) / 3  # mean square of the uniform draw
    expected = bias + settings.gnss_white**2
    n = len(squares)
    # two axes each, unequal: between 1 and 2 degrees of freedom; the draw of the bias widens it
    assert np.mean(squares) / expected == pytest.approx(1, abs=CHI2_999 * np.sqrt(2.2 / n))


def test_reported_covariance_fits_the_errors_of_a_good_receiver(hand_made):
    chi2 = []
    for seed in range(40):
        drive = simulate_drive(hand_made, seed=seed, length_m=5000.0)
        f, e = drive.drive.fixes, drive.fix_error
        det = f.cov_ee * f.cov_nn - f.cov_en**2
        nees = (
            f.cov_nn * e[:, 0] ** 2 - 2 * f.cov_en * e[:, 0] * e[:, 1] + f.cov_ee * e[:, 1] ** 2
        ) / det
        chi2 += list(nees[::300])
    assert np.mean(chi2) / 2 == pytest.approx(1, abs=CHI2_999 / np.sqrt(len(chi2)))


def test_the_slow_error_stands_while_the_car_stands(hand_made):
    quiet = replace(GOOD, gnss_white=0.0, stop_time=60.0)
    drive = simulate_drive(hand_made, seed=2, scenario=quiet)
    still = np.diff(drive.fix_truth.travelled) == 0
    assert still.sum() > 30
    assert np.abs(np.diff(drive.fix_error, axis=0)[still]).max() == 0


def test_fixes_lie_at_the_antenna_plus_their_error(hand_made):
    drive = simulate_drive(
        hand_made, seed=4, length_m=2000.0, scenario=replace(GOOD, antenna_left=0.5)
    )
    f, t, s = drive.drive.fixes, drive.fix_truth, drive.settings
    x, y = hand_made.plane.from_geodetic(f.lat_deg, f.lon_deg)
    ahead = s.antenna_forward * np.exp(1j * t.heading) + 0.5j * np.exp(1j * t.heading)
    turned = (drive.fix_error @ [1, 1j]) * np.exp(1j * hand_made.plane.convergence(x, y))
    assert np.abs((x + 1j * y) - (t.x + 1j * t.y) - ahead - turned).max() < 1e-4


def test_outages_have_no_fix_and_the_length_asked_for(hand_made):
    drive = simulate_drive(hand_made, seed=5, scenario="outage")
    truth = drive.truth
    assert len(drive.outages) == 3
    for begin, end in drive.outages:
        fixes = drive.drive.fixes.time
        assert not ((fixes > begin) & (fixes < end)).any()
        driven = np.interp([begin, end], truth.time, truth.travelled)
        if end < truth.time[-1]:
            assert np.diff(driven)[0] == pytest.approx(1500, abs=2)
    assert (~drive.seen_fix).sum() + len(drive.drive.fixes) == len(drive.fix_error)


def test_the_route_is_legal_and_connected(hand_made):
    roads = hand_made.arrays
    for seed in range(10):
        route = simulate_drive(hand_made, seed=seed, length_m=3000.0).route
        for a, b in itertools.pairwise(route):
            edge, turns = roads.edges[a], roads.turns
            turns = turns[edge.first_turn : edge.end_turn]
            assert turns.rule[turns.edge.tolist().index(b)] == 0
            assert roads.edges.rule[b] == 0
            assert edge.opposite != b


def test_banned_turns_and_dead_ends_are_never_taken(hand_made):
    roads = hand_made.arrays
    turns = roads.turns.copy()
    turns.rule[::3] = 2
    strict = hand_made._replace(arrays=roads._replace(turns=turns))
    pairs = {
        (e, int(turn.edge))
        for e, edge in enumerate(roads.edges)
        for turn in turns[edge.first_turn : edge.end_turn]
        if turn.rule
    }
    for seed in range(5):
        drive = simulate_drive(strict, seed=seed, length_m=3000.0)
        assert drive.truth.travelled[-1] > 2900.0
        assert not pairs & set(
            zip(drive.route[:-1].tolist(), drive.route[1:].tolist(), strict=True)
        )


def test_edges_follow_the_route_and_the_map_position_lies_on_them(hand_made):
    drive = simulate_drive(hand_made, seed=6)
    truth, roads = drive.truth, hand_made.arrays
    changes = truth.edge[np.concatenate([[True], np.diff(truth.edge) != 0])]
    assert list(changes) == list(drive.route[: len(changes)])
    assert (truth.along >= 0).all()
    assert (truth.along <= roads.edges.length[truth.edge]).all()
    x = np.empty(len(truth))
    y = np.empty(len(truth))
    for k, (e, s) in enumerate(zip(truth.edge, truth.along, strict=True)):
        v = roads.vertices[roads.edges.first_vertex[e] : roads.edges.last_vertex[e] + 1]
        x[k], y[k] = np.interp(s, v.s, v.x), np.interp(s, v.s, v.y)
    # usual lane 1.75 m + next lane 3.3 m + streets and strays, corners cut by a few metres
    assert np.hypot(x - truth.map_x, y - truth.map_y).max() < 10.0


@pytest.mark.parametrize("side", ["right", "left"])
def test_one_keeps_to_the_driving_side(hand_made, side):
    drive = simulate_drive(hand_made, seed=6, scenario=replace(GOOD, driving_side=side))
    truth, edges = drive.truth, hand_made.arrays.edges[drive.truth.edge]
    a, b = (hand_made.arrays.vertices[v] for v in (edges.first_vertex, edges.last_vertex))
    dx, dy = b.x - a.x, b.y - a.y
    right = ((truth.map_x - a.x) * dy - (truth.map_y - a.y) * dx) / np.hypot(dx, dy)
    middle = np.abs(truth.along / edges.length - 0.5) < 0.3
    assert np.median(right[middle]) == pytest.approx(1.75 if side == "right" else -1.75, abs=0.5)
    assert drive.vehicle.driving_side == side


def test_the_world_is_the_map_moved_by_the_warp(hand_made):
    drive = simulate_drive(hand_made, seed=7)
    t = drive.truth
    shift = drive.error_field.at(t.map_x, t.map_y)
    # the warp is taken at the path's grid points, 1 m apart
    assert np.abs(np.column_stack([t.x - t.map_x, t.y - t.map_y]) - shift).max() < 0.05


def test_the_map_error_has_the_size_it_should():
    from whichroad.simulate.map_error_field import draw_map_error

    place = np.zeros(1), np.zeros(1)
    shifts = [draw_map_error(GOOD, np.random.default_rng(k)).at(*place)[0] for k in range(400)]
    variance = GOOD.map_sigma**2 + GOOD.relative_sigma**2
    assert np.mean(np.square(shifts)) / variance == pytest.approx(
        1, abs=CHI2_999 * np.sqrt(2 / 800)
    )


def test_same_seed_same_drive_and_another_seed_another(hand_made):
    one, two, other = (simulate_drive(hand_made, seed=s, length_m=1500.0) for s in (1, 1, 2))
    for part in ("lat_deg", "cov_ee", "speed"):
        assert (getattr(one.drive.fixes, part) == getattr(two.drive.fixes, part)).all()
    assert (one.drive.odometry.left == two.drive.odometry.left).all()
    assert (one.truth.x == two.truth.x).all()
    assert list(one.route) != list(other.route)


def test_the_drive_is_as_long_as_asked(hand_made):
    drive = simulate_drive(hand_made, seed=1, length_m=5000.0)
    # lanes and cut corners make the path longer or shorter than the centre lines
    assert drive.truth.travelled[-1] == pytest.approx(5000.0, rel=0.03)


def test_a_given_route_is_driven_and_a_broken_one_refused(hand_made):
    route = simulate_drive(hand_made, seed=1, length_m=2000.0).route
    drive = simulate_drive(hand_made, seed=9, route=route)
    assert list(np.unique(drive.truth.edge)) == list(np.unique(route))
    with pytest.raises(SettingError, match="is not followed by"):
        simulate_drive(hand_made, seed=9, route=[route[0], route[0]])
    with pytest.raises(SettingError, match="it is empty"):
        simulate_drive(hand_made, seed=9, route=[])


def test_what_cannot_be_driven_is_refused(hand_made):
    edges = hand_made.arrays.edges.copy()
    edges.rule = 4
    closed = hand_made.arrays._replace(edges=edges)
    with pytest.raises(MapError, match="no legal drive"):
        simulate_drive(hand_made._replace(arrays=closed), seed=1)


def test_settings_out_of_bounds_are_refused():
    with pytest.raises(SettingError, match="gnss_white"):
        SimulationSettings(gnss_white=-1.0)
    with pytest.raises(SettingError, match="gnss_rate is 0"):
        SimulationSettings(gnss_rate=0.0)
    with pytest.raises(SettingError, match="driving_side"):
        SimulationSettings(driving_side="middle")


def test_an_unknown_scenario_is_refused_with_what_there_is(hand_made):
    with pytest.raises(SettingError, match="good, urban, outage"):
        simulate_drive(hand_made, seed=1, scenario="hilly")


def test_slip_shows_in_one_wheel_only(hand_made):
    slippery = replace(PERFECT, slip_rate=1e-3, slip_sigma=2.0)
    clean = simulate_drive(hand_made, seed=3, scenario=PERFECT).drive.odometry
    slipped = simulate_drive(hand_made, seed=3, scenario=slippery).drive.odometry
    differs = [np.ptp(getattr(slipped, w) - getattr(clean, w)) for w in ("left", "right")]
    assert max(differs) > 10  # counts


def test_drivable_edges_lead_on_for_ever(hand_made):
    roads = hand_made.arrays
    ok = drivable(roads, np.random.default_rng(0))
    assert ok.mean() > 0.9
    for e in np.flatnonzero(ok):
        edge = roads.edges[e]
        follow = roads.turns.edge[edge.first_turn : edge.end_turn]
        assert ok[follow[follow != edge.opposite]].any()


def test_a_single_street_is_driven_and_outages_may_be_given_in_seconds(one_street):
    drive = simulate_drive(one_street, seed=1, outages_s=[(10.0, 20.0)])
    assert len(drive.route) == 1
    assert 100 < drive.truth.travelled[-1] < 800
    since = drive.drive.fixes.time - START
    assert not ((since >= 10.0) & (since <= 20.0)).any()
    assert drive.outages == ((START + 10.0, START + 20.0),)
