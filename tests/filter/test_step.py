"""The whole filter: what must not change its answer, and one drive solved at once."""

import math

import numpy as np
import pytest

from oracles.one_road import OneRoad
from scenes import (
    Truth,
    brake,
    column,
    columns,
    drive_along,
    epochs_of,
    gnss,
    grid_town,
    living,
    localize,
    network,
    parallel_roads,
    steps,
    straight_road,
    untouched,
)
from strategies import UNITS
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, DISTANCE, OFF_ROAD, WHEELS, K, X
from whichroad.filter.summary.estimate import Output
from whichroad.settings import Settings

TOWN = grid_town()
ROUTE = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (3, 2), (4, 2), (4, 3), (4, 4)]
CORNERS = np.array([(i * 120 + 10 * np.sin(j), j * 120 + 8 * np.cos(i)) for i, j in ROUTE])
SAID = "p_edge p_off_road"
ELLIPSE = (4.0, 2.0, 0.3)
ONCE_A_SECOND = 10  # epochs


def town_drive(seed: int = 0) -> tuple[Truth, np.ndarray]:
    """950 m through the town and fixes with a slanting ellipse."""
    truth = drive_along(CORNERS)
    fix = gnss(truth, seed=seed)
    fix[:, 2:] = ELLIPSE
    return truth, fix


def second(truth: Truth, every: int = ONCE_A_SECOND) -> np.ndarray:
    return np.arange(0, len(truth.time), every)


def town_epochs(truth: Truth, fix: np.ndarray, every: int = ONCE_A_SECOND) -> Records:
    return epochs_of(truth, fix, second(truth, every), course=0.1)


def p_of(output: Output, *edges: int) -> np.ndarray:
    """Probability of some edges together at every epoch."""
    return np.where(np.isin(output.rows.alt_edge, edges), output.rows.alt_p, 0.0).sum(axis=1)


def sigma(output: Output) -> np.ndarray:
    """Root of the sum of both position variances, m."""
    return np.sqrt(columns(output, "xx yy").sum(axis=1))


def place(output: Output) -> np.ndarray:
    return columns(output, "x y")


def cov2(output: Output) -> np.ndarray:
    return columns(output, "xx xy xy yy").reshape(-1, 2, 2)


def assert_same_world(
    output: Output, base: Output, turn: np.ndarray, shift=(0.0, 0.0), within: float = 1e-6
) -> None:
    """The output is the base one, seen after turning and shifting the world."""
    same = {"atol": within, "rtol": within}
    np.testing.assert_allclose(place(output), place(base) @ turn.T + shift, **same)
    np.testing.assert_allclose(cov2(output), turn @ cov2(base) @ turn.T, **same)
    np.testing.assert_allclose(columns(output, SAID), columns(base, SAID), **same)
    np.testing.assert_array_equal(output.rows.edge, base.rows.edge)
    np.testing.assert_array_equal(output.rows.status, base.rows.status)


@pytest.mark.parametrize(("mode", "within"), [(WHEELS, 1e-6), (DISTANCE, 1e-3), (CLOCK, 1e-3)])
@pytest.mark.parametrize("angle", [0.7, -2.0, math.pi])
def test_turning_and_shifting_the_world_turns_and_shifts_the_estimate(angle, mode, within):
    """Where two opposite headings merge, rounding chooses between two means.

    Without a heading sensor that happens to off-road hypotheses, of weight below 1e-3.
    """
    truth, fix = town_drive()
    base = localize(network(TOWN), town_epochs(truth, fix), mode=mode).output
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shift = np.array([3000.0, -2000.0])
    x, y = (np.column_stack([truth.x, truth.y]) @ turn.T + shift).T
    turned = fix.copy()
    turned[:, :2] = fix[:, :2] @ turn.T + shift
    turned[:, 4] += angle
    epochs = town_epochs(truth._replace(x=x, y=y, heading=truth.heading + angle), turned)
    output = localize(network([line @ turn.T + shift for line in TOWN]), epochs, mode=mode).output
    assert_same_world(output, base, turn, shift, within)


def test_a_mirrored_world_driven_on_the_left_gives_the_mirrored_estimate():
    truth, fix = town_drive()
    base = localize(network(TOWN), town_epochs(truth, fix)).output
    mirror = np.diag([1.0, -1.0])
    mirrored = fix * [1.0, -1.0, 1.0, 1.0, -1.0]
    epochs = town_epochs(truth._replace(y=-truth.y, heading=-truth.heading), mirrored)
    output = localize(network([line @ mirror for line in TOWN]), epochs, side="left").output
    assert_same_world(output, base, mirror)


def test_vertices_that_do_not_bend_a_road_change_nothing():
    truth, fix = town_drive()
    base = localize(network(TOWN), town_epochs(truth, fix)).output
    for count in (3, 8, 21):
        fine = network([np.linspace(line[0], line[1], count) for line in TOWN])
        assert_same_world(localize(fine, town_epochs(truth, fix)).output, base, np.eye(2))


def test_streets_drawn_backwards_and_in_another_order_change_nothing():
    truth, fix = town_drive()
    base = localize(network(TOWN), town_epochs(truth, fix)).output
    order = np.random.default_rng(0).permutation(len(TOWN))
    output = localize(network([TOWN[i][::-1] for i in order]), town_epochs(truth, fix)).output
    edge = base.rows.edge
    on = edge >= 0
    new = np.argsort(order)
    assert (output.rows.edge[on] == 2 * new[edge[on] // 2] + 1 - edge[on] % 2).all()
    np.testing.assert_allclose(columns(output, SAID), columns(base, SAID), atol=1e-6)
    np.testing.assert_allclose(place(output), place(base), atol=1e-6)


def test_the_plane_s_scale_changes_nothing_that_is_true_on_the_ground():
    """The same town drawn a thousand kilometres off, where the plane stretches it by 0.1 %.

    The stretch itself grows by 1e-6 over the town's 500 m, a few millimetres.
    """
    truth, fix = town_drive()
    epochs = town_epochs(truth, fix)
    base = localize(network(TOWN), epochs).output
    k, origin = 1.001, np.array([1e6, 0.0])
    there = fix * [k, k, 1.0, 1.0, 1.0] + [*origin, 0.0, 0.0, 0.0]
    roads = network([k * line + origin for line in TOWN], curvature=(k - 1.0) / 1e12)
    epochs.fix = there * epochs.has_fix[:, None]
    output = localize(roads, epochs).output
    np.testing.assert_allclose((place(output) - origin) / k, place(base), atol=0.02)
    np.testing.assert_allclose(columns(output, SAID), columns(base, SAID), atol=0.01)
    np.testing.assert_array_equal(output.rows.status, base.rows.status)


def slow_error_only(truth: Truth, seed: int) -> np.ndarray:
    """Fixes whose error only wanders: the same process, however often it is looked at."""
    rng = np.random.default_rng(seed)
    keep = math.exp(-(truth.time[1] - truth.time[0]) / 60.0)
    error = np.empty((len(truth.time), 2))
    error[0] = rng.normal(0.0, 4.0, 2)
    for k in range(1, len(error)):
        error[k] = keep * error[k - 1] + math.sqrt(1.0 - keep**2) * rng.normal(0.0, 4.0, 2)
    fix = np.column_stack([truth.x, truth.y, np.full((len(error), 2), 4.0), np.zeros(len(error))])
    fix[:, :2] += error
    return fix


PARALLEL = network(parallel_roads(12.0))
BESIDE = drive_along([[200.0, -1.75], [1400.0, -1.75]])


def seldom_and_often(seed: int, settings: Settings) -> list[Output]:
    """With a fix each second, and with ten."""
    fix = slow_error_only(BESIDE, seed)
    return [
        localize(
            PARALLEL, epochs_of(BESIDE, fix, second(BESIDE, every), course=0.1), settings=settings
        ).output
        for every in (10, 1)
    ]


@pytest.mark.parametrize("seed", range(3))
def test_a_receiver_asked_ten_times_as_often_teaches_nearly_nothing_more(seed: int):
    """Of the place; what it teaches of itself is another question."""
    slow, fast = seldom_and_often(seed, Settings(gnss_adapt_time=1e12))
    at = second(BESIDE)[1:]
    np.testing.assert_allclose(p_of(fast, 0)[at], p_of(slow, 0)[at], atol=0.02)
    np.testing.assert_allclose(sigma(fast)[at], sigma(slow)[at], rtol=0.02)


def test_a_receiver_asked_ten_times_as_often_is_not_thought_less_of():
    """Nothing but learning is sensitive to it: learnt by the fix, sigmas were 14 % larger."""
    at = second(BESIDE)[1:]
    for seed in range(3):
        slow, fast = seldom_and_often(seed, Settings())
        np.testing.assert_allclose(sigma(fast)[at], sigma(slow)[at], rtol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_the_map_looked_at_half_as_often_says_the_same(seed: int):
    """Compared where both have just looked, once the start is 50 m behind."""
    epochs = epochs_of(BESIDE, gnss(BESIDE, sigma=4.0, seed=seed), second(BESIDE), course=0.1)
    often, seldom = (
        localize(PARALLEL, epochs, settings=Settings(map_spacing=spacing)).output
        for spacing in (4.0, 8.0)
    )
    at = slice(48, None, 8)
    np.testing.assert_allclose(p_of(often, 0)[at], p_of(seldom, 0)[at], atol=0.01)
    np.testing.assert_allclose(often.rows.p_off_road[at], seldom.rows.p_off_road[at], atol=0.01)


@pytest.mark.parametrize("pieces", [2, 9])
def test_nodes_on_one_of_two_parallel_roads_change_its_probability_by_a_hundredth(pieces: int):
    first, other = parallel_roads(12.0)
    cuts = np.linspace(first[0], first[1], pieces + 1)
    roads = network([*(cuts[k : k + 2] for k in range(pieces)), other])
    epochs = epochs_of(BESIDE, gnss(BESIDE, sigma=4.0, seed=1), second(BESIDE), course=0.1)
    whole, cut = localize(PARALLEL, epochs).output, localize(roads, epochs).output
    there = p_of(cut, *range(0, 2 * pieces, 2))
    np.testing.assert_allclose(there, p_of(whole, 0), atol=0.01)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
@pytest.mark.parametrize("seed", range(2))
def test_ten_minutes_of_standing_teach_nothing(seed: int, mode: int):
    """Compared from ten seconds after the stop; with GNSS alone, which reports a speed of 0."""
    at, rng = 600, np.random.default_rng(seed)
    stood, rows = brake(BESIDE, at - 10, 6000, goes_on=True)
    fix = gnss(BESIDE, sigma=4.0, seed=seed)[rows]
    fix[at : at + 6000, :2] += rng.normal(0.0, 2.0, (6000, 2))
    epochs = epochs_of(stood, fix, second(stood), course=0.1)
    every = 1
    if mode == CLOCK:
        epochs.speed, epochs.speed_sigma = np.gradient(stood.s, stood.time), 0.3
        every = ONCE_A_SECOND
        epochs = epochs[::every].copy()
    output = localize(PARALLEL, epochs, mode=mode).output
    before, after = (at + 100) // every, (at + 5990) // every
    for p in (p_of(output, 0), output.rows.p_off_road):
        assert abs(p[after] - p[before]) <= 0.01
    assert abs(sigma(output)[after] / sigma(output)[before] - 1.0) <= 0.05


def test_one_fix_two_hundred_metres_away_moves_the_estimate_by_less_than_a_sigma():
    truth, fix = town_drive()
    off = fix.copy()
    off[300, :2] += [120.0, 160.0]
    base, output = (localize(network(TOWN), town_epochs(truth, f)).output for f in (fix, off))
    apart = np.hypot(*(place(output) - place(base)).T)
    assert (apart <= sigma(base)).all()
    later = slice(400, None)
    assert (output.rows.edge[later] == base.rows.edge[later]).mean() > 0.98


def test_at_every_epoch_the_probabilities_sum_to_one_and_the_covariances_are_positive():
    truth, fix = town_drive()
    for _, belief, output in steps(network(TOWN), town_epochs(truth, fix)):
        alive = living(belief)
        assert alive.weight.sum() == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(np.exp(alive.log_weight), alive.weight, atol=1e-12)
        assert len(alive) == output.rows.live.max() or len(alive) <= 48
        scaled = alive["cov"] / np.outer(UNITS, UNITS)
        assert np.linalg.eigvalsh(scaled).min() > -1e-9


def wild_epochs(seed: int, n: int = 250) -> Records:
    """Sensors gone mad: jumps, leaps backwards, pauses, fixes of any sigma anywhere."""
    rng = np.random.default_rng(seed)
    pauses = rng.choice([0.0, 1e-3, 0.1, 1.0, 5.0, 40.0], n, p=[0.05, 0.05, 0.5, 0.2, 0.15, 0.05])
    arc = rng.choice([0.0, 0.01, 1.0, 6.0, 50.0, 300.0], n, p=[0.2, 0.1, 0.4, 0.2, 0.08, 0.02])
    arc *= rng.choice([1.0, -1.0], n, p=[0.85, 0.15])
    turn = rng.choice([0.0, 0.02, 0.3, 3.0], n, p=[0.5, 0.3, 0.15, 0.05]) * rng.normal(size=n)
    heading = np.cumsum(turn)
    x, y = 60.0 + np.cumsum(arc * np.cos(heading)), 60.0 + np.cumsum(arc * np.sin(heading))
    truth = Truth(np.cumsum(pauses), x, y, heading, np.cumsum(arc))
    fix = np.column_stack([x, y, np.exp(rng.uniform(-4, 4, (n, 2))), rng.uniform(-4, 4, n)])
    error = rng.choice([1.0, 10.0, 300.0, 1e5], (n, 1), p=[0.6, 0.3, 0.09, 0.01])
    fix[:, :2] += error * rng.normal(size=(n, 2))
    at = np.flatnonzero(np.append(True, rng.random(n - 1) < 0.4))
    some = rng.random((2, n)) < 0.5
    epochs = epochs_of(truth, fix, at)
    epochs.arc, epochs.turn = arc, turn
    epochs.odometry_valid = rng.random(n) < 0.9
    epochs.speed = rng.uniform(-1.0, 30.0, n)
    epochs.speed_sigma = np.where(some[0], np.inf, np.exp(rng.uniform(-4, 3, n)))
    epochs.course = rng.uniform(-4.0, 4.0, n)
    epochs.course_sigma = np.where(some[1], np.inf, np.exp(rng.uniform(-5, 2, n)))
    return epochs


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
@pytest.mark.parametrize("seed", [0, 1, 2, 6])
def test_whatever_the_sensors_say_probabilities_stay_probabilities(seed: int, mode: int):
    roads = network(grid_town(4, 4, 70.0), one_way=[1, 5])
    for k, belief, output in steps(roads, wild_epochs(seed), mode=mode):
        alive = living(belief)
        row = output.rows[k]
        assert untouched(belief), k
        assert alive.weight.sum() == pytest.approx(1.0, abs=1e-9), k
        assert all(np.isfinite(row[name]).all() for name in row.dtype.names), k
        assert abs(row.heading) <= math.pi
        scaled = alive["cov"] / np.outer(UNITS, UNITS)
        assert np.linalg.eigvalsh(scaled).min() > -1e-6, k


def test_what_is_said_is_the_moments_of_the_mixture():
    truth, fix = town_drive()
    for k, belief, output in steps(network(TOWN), town_epochs(truth, fix)):
        if k % 50:
            continue
        alive = living(belief)
        p, mean = alive.weight, alive["mu"][:, :2]
        middle = p @ mean
        apart = mean - middle
        cov = np.einsum(
            "k,kij->ij", p, alive["cov"][:, :2, :2] + apart[:, :, None] * apart[:, None]
        )
        np.testing.assert_allclose(place(output)[k], middle, atol=1e-9)
        np.testing.assert_allclose(cov2(output)[k], cov, atol=1e-9)
        known = 1.0 - Settings().unknown
        off = known * p[alive.edge == OFF_ROAD].sum() + Settings().unknown
        on = known * p[alive.edge == output.rows.edge[k]].sum()
        assert output.rows.p_off_road[k] == pytest.approx(off)
        assert output.rows.p_edge[k] == pytest.approx(on)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
def test_a_drive_in_one_call_is_the_drive_epoch_by_epoch(mode: int):
    truth, fix = town_drive()
    epochs = town_epochs(truth, fix)
    whole = localize(network(TOWN), epochs, mode=mode).output
    *_, (_, _, output) = steps(network(TOWN), epochs, mode=mode)
    for a, b in zip(output, whole, strict=True):
        np.testing.assert_array_equal(a, b)


ALONE = {"off_road_start": 0.0, "off_road_leave": 0.0, "off_road_return": 0.0, "prune": 1e-6}


@pytest.mark.parametrize("start", [1.0, 2.0])
def test_without_fixes_the_way_along_a_straight_road_is_as_doubtful_as_the_odometer(start: float):
    """The map adds nothing to Var(x + κ s), nor takes it away.

    Which may fall at first: a fix that was too far ahead at the start, and less so later,
    made x too large and κ too small.
    """
    truth = drive_along([[100.0, -1.75], [3000.0, -1.75]])
    epochs = epochs_of(truth, gnss(truth), np.arange(0, 300, 10), course=0.1)
    par = Settings(**ALONE, gnss_start=start)
    answers = steps(network(straight_road()), epochs, settings=par)
    _, belief, output = next(answer for answer in answers if answer[0] == 290)
    last = belief.hyp["cov"][0].copy()
    *_, _ = answers
    s = truth.s[290:] - truth.s[290]
    odometer = last[X, X] + 2.0 * s * last[X, K] + s**2 * last[K, K]
    odometer += par.along_noise**2 * s + 1e-10 * s**3 / 3.0
    np.testing.assert_allclose(column(output, "xx")[290:], odometer, rtol=1e-4)
    assert odometer[-1] > 10.0 * odometer[0]


def test_a_drive_between_two_roads_is_the_joint_gaussian_solved_at_once():
    """Means, covariances and the odds of two roads 12 m apart, after 300 m of everything."""
    truth = drive_along([[700.0, 2.0], [1010.0, 2.0]])
    fix = gnss(truth, sigma=4.0, seed=3)
    epochs = epochs_of(truth, fix, second(truth), course=0.1)
    par = Settings(**ALONE, gnss_gate=1e6, gnss_adapt_time=1e12)
    oracles = {
        e: OneRoad(fix[0], truth.heading[0], 0.13, e, y, par) for e, y in ((0, 0.0), (2, 12.0))
    }
    before: dict[int, np.ndarray] = {}
    for k, belief, _ in steps(PARALLEL, epochs, settings=par):
        for oracle in oracles.values():
            if k > 0:
                oracle.move(before[oracle.edge], epochs.arc[k], epochs.time[k] - epochs.time[k - 1])
                if epochs.has_fix[k]:
                    oracle.see_fix(before[oracle.edge], fix[k])
            if k == 0 or oracle.travelled >= par.map_spacing:
                oracle.see_road()
        before = {int(hyp.edge): hyp["mu"].copy() for hyp in living(belief)}
        assert set(before) == {0, 2}
    answers = {e: oracle.joint.solve() for e, oracle in oracles.items()}
    for hyp in living(belief):
        mean, cov, _ = answers[int(hyp.edge)]
        np.testing.assert_allclose(hyp["mu"] / UNITS, mean / UNITS, atol=1e-6)
        square = np.outer(UNITS, UNITS)
        np.testing.assert_allclose(hyp["cov"] / square, cov / square, atol=1e-6)
    odds = {int(hyp.edge): hyp.log_weight for hyp in living(belief)}
    assert 0.01 < math.exp(odds[2]) < 0.99
    assert odds[0] - odds[2] == pytest.approx(answers[0][2] - answers[2][2], abs=1e-6)
    evidence = np.logaddexp(answers[0][2], answers[2][2]) + math.log(0.5)  # equal at first
    assert belief.state[0].log_evidence == pytest.approx(evidence, abs=1e-5)


def test_a_ranking_that_is_kept_is_what_it_would_be_anew():
    """While no weight changes the edges keep their order, and are not ranked again."""
    truth, fix = town_drive()
    roads, epochs = network(TOWN), town_epochs(truth, fix)
    kept = localize(roads, epochs).output
    anew = None
    for _, belief, output in steps(roads, epochs):
        belief.state[0].ranking.known = 0
        anew = output
    assert anew is not None
    assert (kept.rows.alt_p[:, 1] > 0.01).any()
    for name in kept.rows.dtype.names:
        np.testing.assert_array_equal(kept.rows[name], anew.rows[name], err_msg=name)
