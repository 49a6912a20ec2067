"""Traces as people have them: no single point, gap or stop breaks the answer."""

import numpy as np
import pytest

import whichroad
from demands.town import BLOCK, PLANE, corners, fixes, roads, streets

ROUND = ("00", "01", "02", "12", "22", "23", "33")


def drive(**changes: float) -> dict[str, np.ndarray]:
    line = corners(*ROUND)
    line[0] += [60.0, 0.0]
    line[-1] -= [0.0, 60.0]
    return fixes(line, **changes)


def without(table: dict[str, np.ndarray], rows: np.ndarray) -> dict[str, np.ndarray]:
    return {name: np.delete(column, rows) for name, column in table.items()}


def inserted(table, at: int, **values):
    return {
        name: np.insert(column, at, values.get(name, column[at])) for name, column in table.items()
    }


def test_the_streets_driven_are_found_and_joined():
    result = whichroad.match(drive(), roads())
    assert streets(result) == list(ROUND[1:-1])
    path = result.path
    assert path.broken_rule.isna().all()
    assert (path.to_node[:-1].to_numpy() == path.from_node[1:].to_numpy()).all()


def test_points_given_twice_are_counted_and_change_nothing():
    table = drive()
    twice = {name: np.repeat(column, 2) for name, column in table.items()}
    once, again = whichroad.match(table, roads()), whichroad.match(twice, roads())
    assert again.to_arrow().equals(once.to_arrow())
    assert sum(again.summary["skipped"].values()) == len(table["time"])


def test_two_places_at_one_time_are_no_trouble():
    table = drive()
    lat, lon = PLANE.to_geodetic(200.0, 30.0)
    odd = inserted(table, 20, time=table["time"][20], lat=lat, lon=lon)
    result = whichroad.match(odd, roads())
    assert streets(result) == list(ROUND[1:-1])
    assert sum(result.summary["skipped"].values()) == 1


def test_a_long_stop_neither_turns_nor_ends_the_drive():
    table = drive(sigma=2.0)
    k = 25
    stop = 300
    waited = {name: np.insert(c, k, np.full(stop, c[k])) for name, c in table.items()}
    waited["time"] = 1.6e9 + np.arange(len(waited["time"]))
    result = whichroad.match(waited, roads())
    assert streets(result) == list(ROUND[1:-1])


@pytest.mark.parametrize("metres", [300.0, 50_000.0])
def test_a_wild_point_does_not_lead_astray(metres):
    table = drive()
    lat, lon = PLANE.to_geodetic(100.0 + metres, -metres)
    table["lat"][30], table["lon"][30] = lat, lon
    result = whichroad.match(table, roads())
    assert streets(result) == list(ROUND[1:-1])
    assert result.summary["epochs_without_answer"] == 0


@pytest.mark.parametrize("gap", [20.0, 3600.0])
def test_a_gap_does_not_end_the_answer(gap):
    table = drive()
    half = len(table["time"]) // 2
    table["time"][half:] += gap
    result = whichroad.match(table, roads())
    assert result.summary["epochs_without_answer"] == 0
    first, last = result.path.iloc[0], result.path.iloc[-1]
    assert roads().attributes(int(first.edge_id), first.exit_m)["name"] == "Row 0"
    assert roads().attributes(int(last.edge_id), last.exit_m)["name"] == "Column 3"


@pytest.mark.parametrize("count", [1, 2])
def test_a_trace_of_hardly_any_points_is_answered(count):
    table = {name: column[:count] for name, column in drive().items()}
    result = whichroad.match(table, roads())
    assert result.to_arrow().num_rows == count
    assert result.summary["epochs_without_answer"] == 0


def test_a_field_without_roads_is_off_road_and_the_rest_goes_on():
    field = [[60.0, 0.0], [BLOCK, 0.0], [BLOCK, -600.0], [3 * BLOCK, -600.0], [3 * BLOCK, 0.0]]
    result = whichroad.match(fixes([*field, [3 * BLOCK, 300.0]]), roads())
    points = result.points
    assert result.summary["epochs_without_answer"] == 0
    middle = points[(points.time > points.time[40]) & (points.time < points.time[90])]
    assert (middle.status == "off_road").mean() > 0.8
    last = points.iloc[-1]
    assert roads().attributes(int(last.edge_id), last.abscissa_m)["name"] == "Column 3"


def test_a_point_is_worth_what_it_says_of_itself():
    table = drive()
    k = 22
    x, y = PLANE.from_geodetic(table["lat"][k], table["lon"][k])
    table["lat"][k], table["lon"][k] = PLANE.to_geodetic(float(x) + 80.0, float(y) + 60.0)
    doubted = {**table, "sigma_m": table["sigma_m"].copy()}
    doubted["sigma_m"][k] = 200.0
    without_it = whichroad.match(without(table, np.array([k])), roads()).points
    points = whichroad.match(doubted, roads()).points
    there = points[points.time.isin(without_it.time)]
    a = PLANE.from_geodetic(there.lat.to_numpy(), there.lon.to_numpy())
    b = PLANE.from_geodetic(without_it.lat.to_numpy(), without_it.lon.to_numpy())
    assert np.hypot(a[0] - b[0], a[1] - b[1]).max() < 3.0


def test_a_receiver_asked_thirty_times_a_second_is_no_less_sure():
    line = corners("20", "21", "22", "23", "24")
    slow = fixes(line, sigma=3.0, seed=4)
    t = np.arange(slow["time"][0], slow["time"][-1], 1 / 30)
    fast = {name: np.interp(t, slow["time"], column) for name, column in slow.items()}
    fast["time"] = t
    p_slow = whichroad.match(slow, roads()).points.p_road[5:].mean()
    points = whichroad.match(fast, roads()).points
    assert points.p_road[150:].mean() > p_slow - 0.02


def test_courses_tell_the_carriageway():
    from whichroad.simulate import MapBuilder

    builder = MapBuilder()
    for name, x, y in (("a", 0, 0), ("b", 800, 0), ("c", 0, 9), ("d", 800, 9)):
        builder.node(name, x, y)
    builder.way(["a", "b"], "primary", oneway="yes")
    builder.way(["d", "c"], "primary", oneway="yes")
    builder.way(["a", "c"], "primary")
    builder.way(["b", "d"], "primary")
    both = builder.compiled()
    table = fixes([[700.0, 4.5], [100.0, 4.5]], sigma=4.0)  # between them, westwards
    n = len(table["time"])
    table |= {"speed_mps": np.full(n, 10.0), "bearing_deg": np.full(n, 270.0)}
    points = whichroad.match(table, both).points
    assert set(points.source_id[10:]) == {"2"}


def test_tracks_of_one_file_are_answered_one_by_one(tmp_path):
    from datetime import UTC, datetime

    tracks = []
    for seed, names in enumerate((("00", "01", "02"), ("40", "41", "42"), ("44", "34", "24"))):
        line = corners(*names)
        line[0] += 0.3 * (line[1] - line[0])
        line[-1] += 0.3 * (line[1] - line[-1])
        rows = fixes(line, seed=seed)
        points = "".join(
            f"<trkpt lat='{a:.7f}' lon='{o:.7f}'>"
            f"<time>{datetime.fromtimestamp(t + 1000 * seed, UTC).isoformat()}</time></trkpt>"
            for t, a, o in zip(rows["time"], rows["lat"], rows["lon"], strict=True)
        )
        tracks.append(f"<trk><name>track {seed}</name><trkseg>{points}</trkseg></trk>")
    gpx = tmp_path / "three.gpx"
    gpx.write_text(f"<gpx version='1.1' creator='t'>{''.join(tracks)}</gpx>")
    result = whichroad.match(gpx, roads())
    assert [one["epochs"] for one in result.summary["each"]] == [22, 22, 22]
    ids = list(dict.fromkeys(result.path.drive_id))
    assert len(ids) == 3
    for name, street in zip(ids, ("Row 0", "Row 4", "Column 4"), strict=True):
        mine = result.points[result.points.drive_id == name]
        at = zip(mine.edge_id, mine.abscissa_m, strict=True)
        assert {roads().attributes(int(e), s)["name"] for e, s in at} == {street}
