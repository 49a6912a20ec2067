"""When and where the edges of a path are driven: points and path say the same."""

from itertools import pairwise

import numpy as np
import pytest

from scenes import network
from whichroad._compile import Records
from whichroad.filter.lookback.passage import TRAVERSAL, first_epochs, time_edges
from whichroad.filter.state import EPOCH, NO_EDGE, OFF_ROAD
from whichroad.filter.summary.estimate import new_output
from whichroad.graph.network import TURN_BANNED, U_TURN, records
from whichroad.lookback.traversals import trimmed, without_glances, without_touches

# a street of three edges of 100 m and a side street; edge 2 i + 1 is edge 2 i driven back
ROADS = network(
    [
        [[0.0, 0.0], [100.0, 0.0]],
        [[100.0, 0.0], [200.0, 0.0]],
        [[200.0, 0.0], [300.0, 0.0]],
        [[200.0, 0.0], [200.0, 80.0]],
    ]
)


def passed(
    chain: list[tuple[int, float]],
    seen: list[tuple[float, int, float, float]],
    other: int = NO_EDGE,
) -> Records:
    """Times of a chain (edge, entered) by what is seen (time, edge, abscissa, P).

    What is left of P is that of the edge `other`, or of none at epochs on that edge itself.
    """
    epochs = records(len(seen), EPOCH)
    rows = new_output(len(seen), False).rows
    rows.alt_edge[:] = NO_EDGE
    for k, (time, edge, s, p) in enumerate(seen):
        epochs[k].time = time
        rows[k].live, rows[k].edge, rows[k].s, rows[k].p_edge = 1, edge, s, p
        rest = other if edge != other else NO_EDGE
        rows[k].alt_edge[:2], rows[k].alt_p[:2] = (edge, rest), (p, 1.0 - p)
    driven = records(len(chain), TRAVERSAL)
    driven.edge, driven.entered, driven.share = *np.array(chain).T, 1.0
    first = np.zeros(len(chain) + 1, np.int64)
    first_epochs(driven, epochs, first)
    time_edges(ROADS, driven, first, epochs, rows, len(seen) - 1)
    ends = driven[driven.p >= 0.0]
    assert all(a.exit_time == b.enter_time for a, b in pairwise(ends))
    return driven


def test_a_path_ends_where_the_vehicle_was_last_seen():
    """The likeliest chain of edges enters one more; no estimate is on it."""
    seen = [(10.0 * k, 0, 20.0 * k, 0.999) for k in range(5)]
    seen += [(50.0, 2, 5.0, 0.999), (60.0, 2, 90.0, 0.6), (61.0, 2, 97.0, 0.6)]
    driven = passed([(0, 0.0), (2, 48.0), (4, 60.5)], seen)
    (left,) = np.flatnonzero(driven.p < 0.0)
    assert left == 2
    assert driven[1].exit_m == 97.0
    assert driven[1].exit_time == 61.0
    kept, first = trimmed(driven, np.array([0, 3]))
    assert kept.edge.tolist() == [0, 2]
    assert first.tolist() == [0, 2]


def test_an_edge_that_the_vehicle_left_for_a_place_off_the_roads_is_the_last_one():
    driven = passed([(0, 0.0), (2, 48.0)], [(0.0, 0, 20.0, 0.999), (60.0, OFF_ROAD, 0.0, 0.9)])
    assert np.all(driven[:1].p >= 0.0)


def said_at(driven: Records, time: float) -> set[int]:
    """Edges of the path at a moment."""
    return {int(r.edge) for r in driven if r.enter_time <= time <= r.exit_time}


def test_a_stand_before_a_gap_is_part_of_the_edge():
    """It stands at 66 m for four minutes, its position creeps back, then it is off the roads."""
    stand = [(20.0 + k, 0, 66.0 - 0.01 * k, 0.9993) for k in range(240)]
    seen = [(0.0, 0, 10.0, 0.999), (10.0, 0, 50.0, 0.999), *stand]
    seen += [(270.0, OFF_ROAD, 0.0, 0.9), (280.0, 6, 30.0, 0.999), (290.0, 6, 60.0, 0.999)]
    driven = passed([(0, 0.0), (6, 275.0)], seen)
    assert driven[0].exit_m == 66.0  # the farthest place
    assert driven[0].exit_time >= 259.0
    assert driven[1].gap


def test_a_turn_keeps_the_places_that_the_way_back_has_seen():
    """The farthest place of a turn may have been seen on the opposite edge alone."""
    seen = [(0.0, 0, 20.0, 0.999), (10.0, 0, 80.0, 0.999), (20.0, 2, 30.0, 0.999)]
    seen += [(30.0, 3, 10.0, 0.999), (40.0, 3, 60.0, 0.999), (50.0, 1, 30.0, 0.999)]
    driven = passed([(0, 0.0), (2, 15.0), (3, 25.0), (1, 45.0)], seen)
    assert driven[1].exit_m == 90.0
    assert driven[2].enter_m == 10.0


def test_sure_points_find_the_path_on_their_edge_though_it_was_entered_late():
    """The hypothesis that was right in the end had entered the third edge too early."""
    seen = [(float(k), 0, 10.0 * k, 0.999) for k in range(10)]
    seen += [(float(k), 2, 10.0 * (k - 10), 0.999) for k in range(10, 20)]
    seen += [(float(k), 4, 10.0 * (k - 20), 0.999) for k in range(20, 30)]
    driven = passed([(0, 0.0), (2, 12.5), (4, 17.5)], seen)
    for time, edge, _, _ in seen:
        assert edge in said_at(driven, time)
    assert driven[1].exit_time == 20.0


def test_an_unsure_point_does_not_hold_the_path_back():
    """A point of P 0.5 on the edge before, after the next one was seen for sure."""
    seen = [(0.0, 0, 50.0, 0.999), (5.0, 2, 10.0, 0.999), (6.0, 0, 99.0, 0.5)]
    seen += [(7.0, 2, 30.0, 0.999), (12.0, 2, 80.0, 0.999)]
    driven = passed([(0, 0.0), (2, 6.5)], seen)
    assert driven[0].exit_time <= 5.0
    assert driven[1].p == np.float32(0.999)


def test_a_wait_before_a_node_is_part_of_the_edge_on_which_it_is_likelier():
    """It stands at 95 m, and the hypothesis that wins in the end crossed the node at 12 s."""
    seen = [(float(k), 0, 10.0 * k, 0.999) for k in range(9)]
    seen += [(9.0 + k, 0, 95.0, 0.6) for k in range(30)]
    seen += [(39.0 + k, 2, 1.0 + 10.0 * k, 0.7 if k == 0 else 0.999) for k in range(5)]
    glances = [(t, 2, 1.0, 0.55) if t in {14.0, 20.0, 21.0} else (t, *at) for t, *at in seen]
    for told in (seen, glances):
        driven = passed([(0, 0.0), (2, 12.0)], told, other=2)
        assert 38.0 <= driven[0].exit_time <= 39.0
        assert [r.exit_m - r.enter_m for r in driven] == [100.0, 41.0]
        assert driven[-1].exit_time == 43.0


def test_a_wait_behind_a_node_is_part_of_the_edge_that_was_entered():
    """Both edges are likely, that behind the node more so."""
    seen = [(float(k), 0, 10.0 * k, 0.999) for k in range(10)]
    seen += [(10.0 + k, 2, 5.0, 0.6) for k in range(30)]
    seen += [(40.0 + k, 2, 10.0 * k, 0.999) for k in range(1, 5)]
    assert 9.0 <= passed([(0, 0.0), (2, 10.0)], seen, other=0)[0].exit_time <= 10.0


def test_edges_that_no_point_has_seen_get_the_time_from_the_start_by_their_lengths():
    """The first fix was answered on another road, and its own found at the second."""
    driven = passed([(0, 0.0), (2, 20.0), (4, 60.0)], [(0.0, 7, 5.0, 0.6), (60.0, 4, 40.0, 0.999)])
    assert driven[0].enter_time == 0.0
    assert driven[0].exit_time == 25.0
    assert driven[1].exit_time == 50.0
    assert driven[2].exit_time == 60.0


def test_a_fix_that_sees_no_edge_of_the_path_is_on_that_of_its_time():
    """Evenly it would be on the first edge after 60 s, and was on the second by then."""
    seen = [(0.0, 7, 5.0, 0.6), (60.0, 7, 9.0, 0.6), (240.0, 4, 40.0, 0.999)]
    driven = passed([(0, 0.0), (2, 60.0), (4, 240.0)], seen)
    assert driven[0].exit_time == 60.0
    assert driven[1].exit_time == pytest.approx(60.0 + 180.0 * 100.0 / 140.0)


def test_a_sight_after_the_path_s_time_on_an_edge_hurries_no_other():
    """The path was to be on the second edge from 20 s on, and is on the third at 32 s."""
    seen = [(0.0, 0, 10.0, 0.999), (30.0, 0, 90.0, 0.999), (31.0, 7, 9.0, 0.6)]
    seen += [(32.0, 7, 9.0, 0.6), (45.0, 4, 40.0, 0.999)]
    driven = passed([(0, 0.0), (2, 20.0), (4, 25.0)], seen)
    assert driven[1].exit_time - driven[1].enter_time == pytest.approx(10.0)


def test_two_fixes_around_a_turn_on_the_spot_share_their_time_without_overlap():
    driven = passed([(0, 0.0), (1, 0.0)], [(0.0, 7, 5.0, 0.3), (10.0, 1, 70.0, 0.4)])
    assert driven[0].enter_time == 0.0
    assert driven[1].exit_time == 10.0
    assert sum(r.exit_time - r.enter_time for r in driven) == 10.0


def test_the_first_sight_says_where_the_first_edge_was_entered():
    """A later fix has moved the start that the hypothesis had."""
    chain, seen = [(0, 0.0), (2, 5.0)], [(0.0, 0, 90.0, 0.999), (5.0, 2, 40.0, 0.999)]
    assert passed(chain, seen)[0].enter_m == 90.0


def test_the_first_edge_of_a_path_gets_the_time_of_those_cut_off_before_it():
    driven = records(3, TRAVERSAL)
    driven.p[:] = 0.2, 0.9, 0.9
    driven.exit_m[:] = 20.0, 90.0, 50.0
    driven.enter_time[:] = 0.0, 8.0, 40.0
    left, _ = trimmed(driven, np.array([0, 3]))
    assert left.enter_time.tolist() == [0.0, 40.0]


def test_several_paths_begin_where_each_would_alone():
    driven = records(7, TRAVERSAL)
    driven.p[:] = (0.4, 0.4, 0.9, 0.9, 0.4, 0.3, 0.2)
    driven.exit_m[:] = (5.0, 9.0, 9.0, 9.0, 50.0, 5.0, 5.0)
    first = np.array([0, 3, 3, 4, 5, 7])  # the second is empty, in the last nothing is likely
    left, begins = trimmed(driven, first)
    assert left.p.tolist() == [0.9, 0.9, 0.4, 0.3, 0.2]
    assert begins.tolist() == [0, 1, 1, 2, 3, 5]


def edges_of(chain: list[tuple[int, float]], left: float = 0.0) -> list[int]:
    """What is left of a path of (edge, entered)."""
    driven = records(len(chain), TRAVERSAL)
    driven.edge, driven.entered = np.array(chain).T
    driven.left[1] = left
    kept, first = without_glances(driven, np.array([0, len(chain)]), ROADS)
    assert first.tolist() == [0, len(kept)]
    return kept.edge.tolist()


def test_an_edge_of_a_moment_that_leads_nowhere_is_not_driven():
    """The side street was the likeliest one for 2 s, where the street goes on."""
    back = 7  # the side street, towards the junction's other end
    assert edges_of([(0, 0.0), (back, 20.0), (2, 22.0)]) == [0, 2]
    assert edges_of([(0, 0.0), (back, 20.0), (2, 40.0)]) == [0, back, 2]  # it stayed there
    assert edges_of([(0, 0.0), (back, 20.0), (2, 22.0)], left=5.0) == [0, back, 2]  # a yard
    assert edges_of([(0, 0.0), (back, 20.0), (4, 22.0)]) == [0, back, 4]  # 0 and 4 do not join
    assert edges_of([(0, 0.0), (2, 20.0), (4, 22.0)]) == [0, 2, 4]  # a short edge on the way


def test_edges_at_the_ends_of_paths_stay():
    """Each drive's path is its own."""
    driven = records(4, TRAVERSAL)
    driven.edge, driven.entered = [0, 7, 2, 4], [0.0, 1.0, 2.0, 20.0]
    kept, first = without_glances(driven, np.array([0, 0, 2, 4, 4]), ROADS)
    assert kept.edge.tolist() == [0, 7, 2, 4]
    assert first.tolist() == [0, 0, 2, 4, 4]


def driven_as(*edges: int, metres: float = 0.0, p: float = 0.5, seen: int = 3) -> Records:
    """A timed path of 10 s each; of edges in the middle so many metres were driven."""
    driven = records(len(edges), TRAVERSAL)
    driven.edge, driven.p, driven.exit_m, driven.last_seen = edges, 0.95, 50.0, 9
    driven.p[1:-1], driven.exit_m[1:-1], driven.last_seen[1:-1] = p, metres, seen
    driven.enter_time[:] = 10.0 * np.arange(len(edges))
    driven.exit_time[:] = driven.enter_time + 10.0
    driven.rules[2] = U_TURN
    return driven


def test_edges_on_which_a_vehicle_would_turn_round_at_once_are_not_driven():
    """In the junction of 2, 4 and the side street 6, 7 is the way back out of this."""

    def left(*edges, **more):
        driven = driven_as(*edges, **more)
        kept, _ = without_touches(driven, np.array([0, len(edges)]), ROADS)
        return kept.edge.tolist()

    assert left(2, 6, 7, 4) == [2, 4]
    assert left(2, 6, 7, 4, seen=-1, p=0.99) == [2, 4]  # seen by no point
    assert left(2, 6, 7, 4, p=0.95) == [2, 6, 7, 4]  # points are sure of it
    assert left(2, 6, 7, 4, metres=1.0) == [2, 6, 7, 4]
    assert left(0, 6, 7, 4) == [0, 6, 7, 4]  # 0 and 4 do not join
    assert left(2, 6, 4, 5) == [2, 6, 4, 5]


def test_the_turn_past_edges_that_were_not_driven_has_its_own_rule_and_their_time():
    roads = network([[[0.0, 0.0], [200.0, 0.0]], [[200.0, 0.0], [300.0, 0.0]],
                     [[200.0, 0.0], [200.0, 80.0]]])  # fmt: skip
    for rule in (0, TURN_BANNED):
        turns = roads.turns[roads.edges[0].first_turn : roads.edges[0].end_turn]
        turns.rule[turns.edge == 2] = rule
        kept, _ = without_touches(driven_as(0, 4, 5, 2), np.array([0, 4]), roads)
        assert kept.edge.tolist() == [0, 2]
        assert kept.rules.tolist() == [0, rule]
        assert kept.enter_time.tolist() == [0.0, 30.0]
        assert kept.exit_time.tolist() == [30.0, 40.0]


def test_edges_of_several_paths_are_left_out_of_their_own():
    one = driven_as(2, 6, 7, 4)
    driven = np.concatenate([one, one[:2], one]).view(type(one))
    kept, first = without_touches(driven, np.array([0, 4, 4, 6, 10]), ROADS)
    assert kept.edge.tolist() == [2, 4, 2, 6, 2, 4]
    assert first.tolist() == [0, 2, 2, 4, 6]
    driven = np.concatenate([one[:3], one[3:]]).view(type(one))
    kept, first = without_touches(driven, np.array([0, 3, 4]), ROADS)  # of two paths
    assert len(kept) == 4
