"""Lineage: what the filter did is told, every P as the points say it, every end with its reason."""

import pickle
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
import pytest

import whichroad
from laws.public import CAR, DISTANCE, GNSS, START, WHEELS, degrees, geo_fixes, readings, road_map
from scenes import Truth, drive_along, gnss
from whichroad.epochs import build_timeline
from whichroad.errors import SettingError
from whichroad.lineage import epoch_by_epoch
from whichroad.lookback.smoothing import Lag, Past
from whichroad.readers import drive_of_observations
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings

FORK = road_map([[(0, 0), (300, 0)], [(300, 0), (900, 0)], [(300, 0), (893, -94)]])
STREET = road_map([[(0, 0), (600, 0)]])
CUT = road_map(
    [[(150 * k, 0), (150 * (k + 1), 0)] for k in range(4)], highway=2 * ["primary", "secondary"]
)
GAP = road_map([[(0, 0), (300, 0)], [(700, 0), (1100, 0)]])
TOWN = road_map(
    [[(0, 150 * k), (600, 150 * k)] for k in range(4)]
    + [[(150 * k, 0), (150 * k, 450)] for k in range(5)]
)
RIGHT = drive_along([(0, 0), (300, 0), (893, -94)])
BACK = drive_along([(60, 0), (330, 0), (330, 8), (60, 8)], radius=4.0, speed=5.0)
ACROSS = drive_along([(0, 0), (150, 0), (150, 300), (450, 300), (450, 0), (600, 0)])
ON = drive_along([(0, 0), (1100, 0)])


def driven(truth: Truth, mode: str, every: int = 10) -> list[Any]:
    """What the sensors say of a drive, a fix every so many epochs."""
    fixes = geo_fixes(
        truth, gnss(truth, seed=5), np.arange(0, len(truth.time), every), doppler=True
    )
    return [*readings(truth, mode), *fixes]


def matched(roads: whichroad.RoadMap, truth: Truth, mode: str, every: int = 10, **more: Any) -> Any:
    return whichroad.match(driven(truth, mode, every), roads, vehicle=CAR, **more)


SCENES = {
    "fork, wheels": lambda: matched(FORK, RIGHT, WHEELS),
    "fork, odometer": lambda: matched(FORK, RIGHT, DISTANCE),
    "fork, paper": lambda: matched(FORK, RIGHT, WHEELS, model="paper"),
    "turned round": lambda: matched(STREET, BACK, GNSS),
    "town, wheels": lambda: matched(TOWN, ACROSS, WHEELS, mask=[(20.0, 70.0)]),
    "town, GNSS": lambda: matched(TOWN, ACROSS, GNSS),
    "town, a fix every 8 s": lambda: matched(TOWN, ACROSS, GNSS, every=80),
    "town, paper": lambda: matched(TOWN, ACROSS, GNSS, model="paper"),
    "town, from a pose": lambda: matched(
        TOWN, ACROSS, WHEELS, start=(49.4, 8.7, 90.0), mask=[(0.0, 30.0)]
    ),
    "between two roads": lambda: matched(GAP, ON, WHEELS),
}  # fmt: skip
ACROSS_NODES = {"fork, odometer", "town, GNSS"}


@pytest.fixture(scope="module", params=SCENES)
def answer(request) -> whichroad.Result:
    return SCENES[request.param]()


def p_of_edges(answer: whichroad.Result) -> tuple[pd.Series, pd.Series]:
    """P of each edge at each time, as the lineage and as the points say it."""
    edge = answer.lineage.to_pandas().set_index("id").edge_id
    weights = answer.lineage.weights()
    weights["edge"] = weights.id.map(edge)
    said = {
        (row.time, one["edge_id"]): one["p"]
        for row in answer.points.itertuples()
        for one in row.alternatives
        if one["edge_id"] is not None and one["edge_id"] >= 0
    }
    assert len(said) >= len(answer.points) / 2
    return weights.dropna().groupby(["time", "edge"]).p.sum(), pd.Series(said)


def test_p_of_an_edge_is_that_of_the_points(answer, request):
    """Where none lies across a node: its P is shared between both sides, but not with wheels.

    What an edge lacks, the edges about it have then.
    """
    told, said = p_of_edges(answer)
    if request.node.callspec.params["answer"] not in ACROSS_NODES:
        np.testing.assert_allclose(told[said.index], said, atol=1e-7)
        return
    lives = answer.lineage.to_pandas().set_index("id")
    came = lives.parent_id.map(lives.edge_id)
    pairs = set(zip(lives.edge_id, came, strict=True)) | set(zip(came, lives.edge_id, strict=True))
    more = said - told.reindex(said.index).fillna(0.0)
    away = more[more.abs() > 1e-7]
    assert 0 < len(away) < 0.15 * len(said)
    for (time, edge), p in away.items():
        other = [more.get((time, e), 0.0) for one, e in pairs if one == edge]
        assert sum(max(-np.sign(p) * x, 0.0) for x in other) >= abs(p) - 2e-3, (time, edge)


def test_what_lives_on_roads_sums_to_one_minus_p_off_road(answer):
    edge = answer.lineage.to_pandas().set_index("id").edge_id
    weights = answer.lineage.weights()
    on = weights[weights.id.map(edge).notna()].groupby("time").p.sum()
    points = answer.points.set_index("time")
    on = on.reindex(points.index).fillna(0.0)
    np.testing.assert_allclose(on, 1.0 - points.p_off_road, atol=1e-9)


def test_every_parent_lives_until_its_child_is_born(answer):
    table = answer.lineage.to_pandas()
    assert (table.id == np.arange(len(table))).all()
    assert table.born.is_monotonic_increasing
    children = table[table.parent_id.notna()]
    assert len(children) > 0
    parents = table.loc[children.parent_id.astype(int)]
    assert (parents.id.to_numpy() < children.id.to_numpy()).all()
    assert (parents.born.to_numpy() < children.born.to_numpy()).all()
    ends = parents.died.fillna(answer.points.time.iloc[-1] + pd.Timedelta(1, "s"))
    assert (ends.to_numpy() >= children.born.to_numpy()).all()
    assert set(table[table.parent_id.isna()].birth) <= {"start", "restart"}


def test_births_less_deaths_are_those_alive(answer):
    table, weights = answer.lineage.to_pandas(), answer.lineage.weights()
    alive = weights.groupby("time").id.nunique()
    time = alive.index
    born = np.searchsorted(np.sort(table.born), time.to_numpy(), side="right")
    died = np.searchsorted(np.sort(table.died.dropna()), time.to_numpy(), side="right")
    assert (born - died == alive).all()
    assert (table.died.isna() == (table.reason == "alive at the drive's end")).all()
    assert not weights.duplicated(["time", "id"]).any()


def test_the_table_sums_up_the_weights_over_time(answer):
    table, p = answer.lineage.to_pandas().set_index("id"), answer.lineage.weights().groupby("id").p
    for column, of_p in (("p_born", p.first()), ("p_most", p.max()), ("p_last", p.last())):
        np.testing.assert_array_equal(table[column], of_p)
    assert (table.driven_m >= 0.0).all()


def test_the_merged_go_on_in_one_that_lives_on_their_edge(answer):
    table = answer.lineage.to_pandas()
    merged = table[table.reason.str.startswith("merged")]
    into = table.loc[merged.into_id.astype(int)]
    np.testing.assert_array_equal(merged.edge_id, into.edge_id)
    assert (into.born.to_numpy() <= merged.died.to_numpy()).all()
    last = into.died.fillna(answer.points.time.iloc[-1] + pd.Timedelta(1, "s"))
    assert (last.to_numpy() > merged.died.to_numpy()).all()


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, GNSS])
def test_where_a_road_just_runs_on_p_is_handed_on_whole(mode):
    result = matched(CUT, drive_along([(0, 0), (600, 0)]), mode)
    table, weights = by_street(result), result.lineage.weights()
    best = table[table.p_most > 0.9]
    assert best.road.tolist() == ["0+", "1+", "2+", "3+"]
    assert best.birth.tolist() == ["start", *3 * ["the road runs on"]]
    assert best.parent_id[1:].tolist() == best.id[:-1].tolist()
    assert best.into_id[:-1].tolist() == best.id[1:].tolist()
    assert best.reason[:-1].str.startswith("handed on").all()
    names = result_edges(result)
    ahead = weights.id.map(table.set_index("id").road.str.endswith("+"))
    told = weights[ahead].groupby("time").p.sum()
    few = [row for row in result.points.itertuples() if len(row.alternatives) < 6]
    assert len(few) > 100 or mode == GNSS
    for row in few:
        said = sum(one["p"] for one in row.alternatives if names.get(one["edge_id"], "")[1:] == "+")
        assert said == pytest.approx(told[row.time], abs=1e-6)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, GNSS])
def test_the_gaussians_told_are_as_many_as_the_estimates_count(mode):
    drive = drive_of_observations(driven(ACROSS, mode), Settings())
    timeline = build_timeline(drive, TOWN.plane, CAR)
    live = localize_recorded(TOWN, timeline, vehicle=CAR).output.rows.live
    told = whichroad.match(drive, TOWN, vehicle=CAR).lineage.weights()
    np.testing.assert_array_equal(told.groupby("time").components.sum(), live[live > 0])


def by_street(result: whichroad.Result) -> pd.DataFrame:
    """The hypotheses, with street and direction, `1+` or `1-`, or `off`."""
    edges = result_edges(result)
    table = result.lineage.to_pandas()
    return table.assign(road=[edges.get(edge, "off") for edge in table.edge_id])


def result_edges(result: whichroad.Result) -> dict[int, str]:
    table = result._roads.edges_table()
    signs = np.where(table.forward, "+", "-")
    return dict(
        enumerate(f"{name}{sign}" for name, sign in zip(table.source_id, signs, strict=True))
    )


def counted(table: pd.DataFrame) -> pd.DataFrame:
    return table[table.p_most >= 0.01]


def test_at_a_fork_both_roads_are_born_of_the_first_and_the_wrong_one_is_outweighed():
    table = by_street(matched(FORK, RIGHT, WHEELS))
    branches = counted(table)[counted(table).birth == "branch at a node"]
    assert {"1+", "2+"} <= set(branches.road)
    assert set(table.road[branches.parent_id.astype(int)]) == {"0+"}
    first = table[table.road == "0+"].iloc[0]
    assert first.birth == "start"
    assert first.reason.startswith("handed on")
    assert table.road[int(first.into_id)] == "2+"
    wrong = counted(table)[counted(table).road == "1+"]
    assert wrong.reason.iloc[-1] == "had counted, and fell below the pruning limit"
    assert wrong.p_last.iloc[-1] < 0.001
    assert wrong.p_most.max() < 0.5
    last = table[table.p_last > 0.9]
    assert [*zip(last.road, last.reason, strict=True)] == [("2+", "alive at the drive's end")]
    assert first.driven_m == pytest.approx(295.0, abs=25.0)


@pytest.mark.parametrize(
    ("end", "speed", "mode"),
    [(335, 5.0, WHEELS), (335, 5.0, DISTANCE), (335, 5.0, GNSS), (600, 2.0, GNSS)],
)
def test_who_turns_round_at_a_dead_end_or_slowly_within_a_street_is_told_as_a_u_turn(
    end, speed, mode
):
    back = drive_along([(60, 0), (330, 0), (330, 8), (60, 8)], radius=4.0, speed=speed)
    table = by_street(matched(road_map([[(0, 0), (end, 0)]]), back, mode))
    last = table[table.p_last >= 0.5].iloc[-1]
    assert (last.road, last.reason) == ("0-", "alive at the drive's end")
    assert last.birth == "U-turn"
    before = table.loc[int(last.parent_id)]
    assert (before.road, before.birth) == ("0+", "start")


def test_who_drives_on_where_no_road_is_is_born_off_the_roads_and_comes_back_to_one():
    result = matched(GAP, ON, WHEELS)
    table = by_street(result)
    last = table[table.p_last >= 0.5].iloc[-1]
    assert last.road == "1+"
    births = []
    while last.birth != "start":
        births.append((last.road, last.birth))
        last = table.iloc[int(last.parent_id)]
    assert ("1+", "back to a road") in births
    assert ("off", "off the roads") in births
    assert births.index(("1+", "back to a road")) < births.index(("off", "off the roads"))


def test_after_an_hour_elsewhere_all_is_given_up_and_starts_anew():
    there, here = drive_along([(0, 0), (300, 0)]), drive_along([(0, 450), (400, 450)])
    late = Truth(here.time + there.time[-1] + 3600.0, *here[1:])
    drive = driven(there, GNSS) + driven(late, GNSS)
    table = whichroad.match(drive, TOWN, vehicle=CAR).lineage.to_pandas()
    again = table[table.birth == "restart"]
    assert len(again) > 0
    given_up = table[table.reason == "given up at a new start from a fix"]
    assert set(given_up.died) == {again.born.iloc[0]}
    assert again.born.iloc[0] == pd.Timestamp(START + late.time[0], unit="s", tz="UTC").round("us")
    assert again.parent_id.isna().all()


def mergers(past: Past, time: np.ndarray) -> list[tuple[float, int]]:
    """Time and edge of all mergers, as the filter's history for smoothing links hypotheses.

    Who goes on as its own child has not merged; that one was not there before.
    """
    history, tree = past.history, past.path.entry.parent
    steps, nodes, links = history.steps, history.nodes, history.links
    found = []
    for before, now in pairwise(steps):
        old = nodes[before.first_node : before.end_node]
        new = nodes[now.first_node : now.end_node]
        for entry in sorted(set(old.path_entry.tolist()) - set(new.path_entry.tolist())):
            own = np.flatnonzero(old.path_entry == entry)
            edge = int(old.edge[own[0]])
            takers = [
                node
                for node in new[new.edge == edge]
                if np.isin(links.origin[node.first_link : node.end_link], own).any()
                and (tree[node.path_entry] != entry or node.path_entry in old.path_entry)
            ]
            if takers:
                found.append((float(time[now.epoch]), edge))
    return sorted(found)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE, GNSS])
def test_what_merged_and_what_fell_is_what_the_history_for_smoothing_links(mode):
    rows = np.arange(0, len(ACROSS.time), 20)
    noisy = geo_fixes(ACROSS, gnss(ACROSS, seed=5, sigma=12.0), rows)
    drive = drive_of_observations([*readings(ACROSS, mode), *noisy], Settings())
    settings = Settings(off_road_leave=0.0)  # else the history adds links of its own
    timeline = build_timeline(drive, TOWN.plane, CAR)
    past = localize_recorded(
        TOWN, timeline, vehicle=CAR, settings=settings, lag=Lag.of("full")
    ).past  # fmt: skip
    table = whichroad.match(drive, TOWN, vehicle=CAR, settings=settings).lineage.to_pandas()
    merged = table[table.reason.str.startswith("merged")]
    fallen = table[table.reason.str.contains("pruning limit")]
    assert len(fallen) > 5
    died = merged.died.astype("int64").to_numpy() / 1e6
    told = sorted(zip(died.tolist(), merged.edge_id.fillna(-1).astype(int), strict=True))
    linked = mergers(past, timeline.epochs.time)
    assert len(linked) > 5
    assert [edge for _, edge in told] == [edge for _, edge in linked]
    np.testing.assert_allclose([t for t, _ in told], [t for t, _ in linked], atol=1e-5)


def test_without_a_pruning_limit_all_ends_on_a_street_are_mergers():
    straight = drive_along([(60, 0), (500, 0)])  # no node is reached
    pruned, kept = (
        matched(STREET, straight, WHEELS, settings=Settings(prune=prune)).lineage.to_pandas()
        for prune in (1e-4, 0.0)
    )
    fallen = kept.reason.str.contains("pruning limit")
    assert pruned.reason.str.contains("pruning limit").sum() > len(pruned) / 2
    assert fallen.sum() == 0
    assert kept.reason.str.startswith("merged").sum() >= 5


def test_the_paper_draws_candidates_about_the_most_probable_hypothesis():
    result = matched(FORK, RIGHT, WHEELS, model="paper")
    table, weights = result.lineage.to_pandas(), result.lineage.weights()
    assert set(table.birth) == {"start", "candidate"}
    top = weights.loc[weights.groupby("time").p.idxmax()].set_index("time").id
    for h in table[table.birth == "candidate"].itertuples():
        assert top[: h.born].iloc[-2] == h.parent_id


def test_smoothing_does_not_change_the_lineage():
    one, other = (matched(TOWN, ACROSS, WHEELS, lag=lag).lineage for lag in (None, "full"))
    assert one.to_arrow().equals(other.to_arrow())
    assert one.weights_arrow().equals(other.weights_arrow())


def test_a_full_path_tree_grows_and_nothing_changes(monkeypatch):
    one = matched(TOWN, ACROSS, WHEELS, mask=[(20.0, 70.0)]).lineage
    monkeypatch.setattr(epoch_by_epoch, "_ENTRIES", 2060)  # 2048 must be free for an epoch
    other = matched(TOWN, ACROSS, WHEELS, mask=[(20.0, 70.0)]).lineage
    assert len(one) > 2 * 12
    assert one.to_arrow().equals(other.to_arrow())


def test_a_search_over_the_map_comes_before_the_lineage():
    result = matched(TOWN, ACROSS, WHEELS, start="map", mask=[(0.0, 60.0)])
    weights, points = result.lineage.weights(), result.points
    begin = weights.time.min()
    assert begin > points.time[0]
    assert set(result.lineage.to_pandas().birth[weights.id[weights.time == begin]]) == {"start"}
    later = points[points.time >= begin].set_index("time")
    edge = result.lineage.to_pandas().set_index("id").edge_id
    on = weights[weights.id.map(edge).notna()].groupby("time").p.sum()
    np.testing.assert_allclose(
        on.reindex(later.index).fillna(0.0), 1.0 - later.p_off_road, atol=1e-9
    )


def test_a_pickled_result_has_its_lineage_if_it_was_asked_for():
    result = matched(FORK, RIGHT, WHEELS)
    with pytest.raises(SettingError, match="was pickled before"):
        _ = pickle.loads(pickle.dumps(result)).lineage
    table = result.lineage.to_arrow()
    again = pickle.loads(pickle.dumps(result)).lineage
    assert again.to_arrow().equals(table)
    assert again.weights_arrow().equals(result.lineage.weights_arrow())
    assert repr(again) == f"Lineage('drive', {table.num_rows} hypotheses)"


def test_several_drives_have_no_lineage():
    lon, lat = degrees(10.0 * np.arange(20), np.zeros(20))
    one = pd.DataFrame({"time": START + np.arange(20), "lat": lat, "lon": lon})
    both = pd.concat([one.assign(trip="a"), one.assign(trip="b")])
    with pytest.raises(SettingError, match="there are several drives"):
        _ = whichroad.match(both, STREET).lineage


def test_the_table_is_written_and_read_again(tmp_path):
    lineage = matched(FORK, RIGHT, WHEELS).lineage
    lineage.write(tmp_path / "lineage.parquet")
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "lineage.parquet"), lineage.to_pandas()
    )
    lineage.write(tmp_path / "lineage.csv")
    read = pd.read_csv(tmp_path / "lineage.csv")
    assert read.id.tolist() == lineage.to_pandas().id.tolist()
    assert read.reason.tolist() == lineage.to_pandas().reason.tolist()


def test_a_picture_has_a_lane_for_every_edge_that_counts():
    matplotlib.use("agg")
    lineage = matched(FORK, RIGHT, WHEELS).lineage
    table = lineage.to_pandas()
    axes = lineage.plot()
    edges = counted(table).edge_id.fillna(-1).unique()
    assert len(axes.get_yticks()) == len(edges)
    near = lineage.plot(window=(0.0, 10.0), least=0.5)
    assert len(near.get_yticks()) == 1
    assert near.get_xlim() == (0.0, 10.0)
    matplotlib.pyplot.close("all")
