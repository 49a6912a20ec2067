"""The scoring of `benchmarks worlds`, by drives that are counted by hand."""

import numpy as np
import pytest
from benchmarks.exact_bounds import clopper_pearson, upper_bound
from benchmarks.worlds.drives import Scored
from benchmarks.worlds.faults import Event
from benchmarks.worlds.figures import (
    declarations,
    poses,
    wrong_by_world,
)
from benchmarks.worlds.scoring import (
    INSIDE,
    Decision,
    PoseSums,
    Said,
    counted,
    decide,
    driven,
    nees,
    pose_sums,
    right_road,
    time_to_alert,
    top_roads,
    under,
)


def said(top, p=1.0, **changes) -> Said:
    """A minute at 10 m/s, one epoch a second, road 0 until 300 m and road 1 from there."""
    n = 61
    time = np.arange(n, dtype=float)
    columns = {
        "time": time,
        "travel": 10.0 * time,
        "speed": np.full(n, 10.0),
        "true_road": np.where(time < 30, 0, 1),
        "error": np.zeros((n, 2)),
        "cov": np.tile([1.0, 0.0, 1.0], (n, 1)),
        "level": np.full(n, 5.0),
        "top": np.broadcast_to(top, n).astype(int),
        "p_top": np.broadcast_to(p, n).astype(float),
        "lost": np.zeros(n, bool),
    }
    return Said(**{**columns, **changes})


T = np.arange(61)
PASSED = np.array([30.0])


def test_the_first_sure_epoch_behind_a_decision_declares_its_road():
    [one] = decide(said(np.where(T < 33, 0, 1)), PASSED)
    assert (one.declared, one.wrong, one.when, one.road) == (True, False, 33.0, 1)


def test_the_road_just_left_is_not_declared_within_30_m_and_is_wrong_beyond():
    [one] = decide(said(0), PASSED)
    # the last epoch on road 0 is at 290 m: 30 m are over at 330 m
    assert (one.declared, one.wrong, one.when, one.road) == (True, True, 33.0, 0)


def test_a_declaration_of_another_road_is_wrong_at_once():
    [one] = decide(said(np.where(T < 31, 0, 7), error=np.tile([3.0, -4.0], (61, 1))), PASSED)
    assert (one.declared, one.wrong, one.when, one.road) == (True, True, 31.0, 7)
    assert (one.true_road, one.error) == (1, 5.0)


def test_a_road_that_begins_within_10_m_of_travel_is_right_and_11_m_ahead_is_wrong():
    road = np.where(T < 30, 0, np.where(T < 41, 1, 2))
    ahead = np.where(T < 40, 0, 2)
    [near] = decide(said(ahead, np.where(T < 40, 0.5, 1.0), true_road=road), PASSED)
    assert not near.wrong
    ahead = np.where(T < 39, 0, 2)
    [far] = decide(said(ahead, np.where(T < 39, 0.5, 1.0), true_road=road), PASSED)
    assert far.wrong


def test_a_road_below_the_declared_probability_is_no_declaration():
    [one] = decide(said(1, 0.9989), PASSED)
    assert (one.declared, one.wrong, one.epoch) == (False, False, -1)


def test_a_decision_ends_where_the_next_one_begins_and_the_warm_up_has_none():
    found = decide(said(np.where(T < 50, 0, 1), np.where(T < 50, 0.5, 1.0)),
                   np.array([10.0, 30.0, 45.0]))  # fmt: skip
    assert [(d.time, d.declared) for d in found] == [(30.0, False), (45.0, True)]


def test_any_mapped_road_is_wrong_on_an_unmapped_street():
    unmapped = np.where(T < 30, 0, -1)
    [one] = decide(said(np.where(T < 31, 0, 5), true_road=unmapped), PASSED)
    assert one.wrong
    assert driven(said(0, true_road=unmapped), 40, 10.0, 10.0) == set()


def test_edges_of_one_road_are_summed():
    road, p = top_roads(
        epoch=np.array([0, 0, 0, 2]), edge=np.array([0, 1, 2, 2]),
        p=np.array([0.3, 0.3, 0.4, 0.8]), road_of_edge=np.array([4, 4, 9]), n=3,
    )  # fmt: skip
    assert road.tolist() == [4, -1, 9]
    assert p == pytest.approx([0.6, 0.0, 0.8])


def test_no_alternatives_are_no_roads():
    none = np.array([], int)
    road, p = top_roads(none, none, np.array([]), np.array([0]), 2)
    assert road.tolist() == [-1, -1]
    assert p.tolist() == [0.0, 0.0]


def test_the_right_road_has_10_m_of_travel_to_spare_on_both_sides():
    right = right_road(said(np.where(T < 32, 0, 1)))
    # road 0 ends at 290 m, so it is right until 300 m; it is said at 310 m too
    assert np.flatnonzero(~right).tolist() == [31]
    assert not right_road(said(-1, true_road=np.full(61, -1))).any()


def test_the_squared_error_is_that_of_the_inverse_covariance():
    rng = np.random.default_rng(3)
    error, root = rng.normal(size=(61, 2)), rng.normal(size=(61, 2, 2))
    cov = root @ root.transpose(0, 2, 1) + np.eye(2)
    one = said(0, error=error, cov=np.column_stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]]))
    want = np.einsum("ki,kij,kj->k", error, np.linalg.inv(cov), error)
    assert nees(one) == pytest.approx(want)


def test_pose_sums_are_those_counted_by_hand():
    error = np.zeros((61, 2))
    error[40] = [3.0, 4.0]  # 5 m: on the level, not beyond it
    error[41] = [6.0, 0.0]
    error[5] = [100.0, 0.0]  # in the warm-up
    error[50] = [100.0, 0.0]  # at standstill
    speed = np.where(T == 50, 0.0, 10.0)
    one = said(np.where(T < 30, 0, 1), error=error, speed=speed)
    sums = pose_sums(one, counted(one))
    assert (sums.epochs, sums.exceeded, sums.square) == (40, 1, 61.0)
    assert (sums.nees, sums.inside) == (61.0, 38)
    assert (sums.right, sums.roads, sums.level) == (40, 40, 5.0)
    assert pytest.approx(5.991, abs=1e-3) == INSIDE
    assert pose_sums(one, np.zeros(61, bool)) == pytest.approx(PoseSums(), nan_ok=True)


def test_epochs_under_a_fault_end_120_s_after_it_and_after_300_s_at_the_latest():
    time = np.arange(0.0, 1000.0, 10.0)
    assert time[under(time, 100.0, 150.0)][[0, -1]].tolist() == [100.0, 270.0]
    assert time[under(time, 100.0, 900.0)][[0, -1]].tolist() == [100.0, 400.0]


@pytest.mark.parametrize(
    ("beyond", "lost", "seconds"),
    [((25, 31), (), 6.0), ((25, 31), range(28, 61), 3.0), ((5, 9), (), 0.0), ((40, 61), (), 20.0)],
)
def test_an_alert_takes_until_the_level_holds_again_or_lost_is_said(beyond, lost, seconds):
    error = np.zeros((61, 2))
    error[slice(*beyond)] = [50.0, 0.0]
    flag = np.isin(T, list(lost))
    assert time_to_alert(said(0, error=error, lost=flag)) == seconds


def drive(name: str, *decisions: tuple[bool, bool], kind: str = "fork") -> Scored:
    made = [
        Decision(100.0 * k, 100.0 * k + 50.0, d, w, 100.0 * k + 2.0 + k, k, 0)
        for k, (d, w) in enumerate(decisions)
    ]
    return Scored(
        name, "here", "wheels", [Event("slip", 0.0, 10.0)], made,
        [frozenset({kind})] * len(made), PoseSums(), {}, 0.0, np.zeros((0, 2)),
    )  # fmt: skip


def test_declarations_are_counted_by_situation_and_the_worst_is_first():
    drives = [
        drive("a", (True, True), (True, True), (False, False)),
        drive("b", *[(True, False)] * 4, kind="roundabout"),
    ]
    rows = {r.kind: r for r in declarations(drives)}
    assert rows["all"].decisions == 7
    assert (rows["all"].declared, rows["all"].wrong, rows["all"].wrong_drives) == (6, 2, 1)
    assert (rows["fork"].wrong, rows["roundabout"].wrong) == (2, 0)
    assert rows["roundabout"].seconds == pytest.approx(3.5)
    # slip ended at 10 s: decisions until 130 s are under it
    assert rows["fault: slip"].decisions == 4
    assert next(iter(rows)) == "fork"


def test_wrong_declarations_of_a_world_are_taken_together():
    good = [drive(f"{w}/{k}", *[(True, False)] * 5) for w in range(2, 12) for k in range(2)]
    bad = [drive("1/0", *[(True, True)] * 5), drive("1/1", *[(True, True)] * 5)]
    rate, over_worlds = wrong_by_world(good + bad)
    assert rate == pytest.approx(1e3 / 11)
    assert over_worlds is not None
    # the only bad world of eleven is left out by a third of the draws, twice or more in a quarter
    assert over_worlds[0] == 0.0
    assert over_worlds[1] > 2e3 / 11 - 1.0
    assert wrong_by_world([]) == (0.0, None)


def test_bounds_of_rates_are_clopper_and_pearsons():
    assert upper_bound(0, 3000) == pytest.approx(1.0 - 0.05 ** (1 / 3000))
    low, high = clopper_pearson(1, 10)
    assert (low, high) == (pytest.approx(0.00253, abs=1e-5), pytest.approx(0.44502, abs=1e-5))
    assert clopper_pearson(0, 5)[0] == 0.0
    assert clopper_pearson(5, 5)[1] == 1.0


def test_the_share_above_the_level_weighs_each_drive_alike():
    sums = [
        PoseSums(100, 10, 200.0, 95, 400.0, 90, 100, 6.0),
        PoseSums(900, 0, 1800.0, 855, 3600.0, 900, 900, 8.0),
    ]
    found = poses("all", sums)
    assert found is not None
    assert found.exceeded == pytest.approx(0.05)
    assert (found.anees, found.inside, found.rmse) == pytest.approx((1.0, 0.95, 2.0))
    assert (found.right, found.level) == pytest.approx((0.99, 7.0))
    assert poses("none", [PoseSums()]) is None
