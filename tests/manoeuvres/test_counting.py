"""The counting of `benchmarks manoeuvres`, by answers that are made up, and one scene answered."""

from dataclasses import fields

import numpy as np
import pytest
from benchmarks import Options
from benchmarks.manoeuvres import names, run
from benchmarks.manoeuvres.counting import HEAD, WORDS, count, figures, line, which
from benchmarks.worlds.scoring import Said

N = 101
T = np.arange(N, dtype=float)


def said(**changes) -> Said:
    """100 s at 10 m/s, on road 0 until 500 m and on road 1 from there; all said rightly."""
    road = np.where(T < 50, 0, 1)
    columns = {
        "time": T, "travel": 10.0 * T, "speed": np.full(N, 10.0), "true_road": road,
        "error": np.tile([1.0, 0.0], (N, 1)), "cov": np.tile([1.0, 0.0, 1.0], (N, 1)),
        "level": np.full(N, 5.0), "top": road, "p_top": np.ones(N), "lost": np.zeros(N, bool),
    }  # fmt: skip
    return Said(**{**columns, **changes})


ALL = np.ones(N, bool)


def values(*drives) -> dict[str, float | None]:
    return {f.figure.removeprefix("x: "): f.value for f in figures("x", list(drives), "0:1")}


def test_a_right_answer_is_all_right():
    assert values(count(said(), ALL)) == pytest.approx(
        {"wrong at P >= 0.999": 0.0, "declared": 100.0, "level exceeded": 0.0, "level": 5.0,
         "ANEES": 0.5, "right road": 100.0, "named": 0.0}
    )  # fmt: skip


def test_a_wrong_road_counts_where_it_is_declared_and_only_there():
    top = np.where(T < 50, 0, 7)
    p = np.where(T < 90, 1.0, 0.9989)
    one = count(said(top=top, p_top=p), ALL)
    # road 0 is right until 10 m behind its end, road 7 is nowhere
    assert (one.declared, one.wrong) == (90, 40)
    assert values(one)["right road"] == pytest.approx(100.0 * 50 / N)


def test_any_road_is_wrong_where_the_map_lacks_it_and_no_road_counts_as_missed():
    unmapped = np.where(T < 50, 0, -1)
    one = count(said(true_road=unmapped, top=np.zeros(N, int)), ALL)
    assert one.wrong == 51 - 1  # 10 m behind the junction road 0 is still right
    assert values(one)["right road"] == 100.0


def test_only_epochs_that_are_asked_for_count():
    error = np.where(T < 80, 1.0, 6.0)
    one = said(error=np.column_stack([error, np.zeros(N)]))
    assert values(count(one, T < 80))["level exceeded"] == 0.0
    assert values(count(one, T >= 80))["level exceeded"] == 1000.0
    assert values(count(one, T < 0))["level exceeded"] is None


def test_epochs_count_while_it_moves_after_20_s_and_of_a_fault_from_where_it_is_told():
    drive = said(speed=np.where(T < 95, 10.0, 0.0))
    assert np.array_equal(which(drive, 30.0, None), (T >= 20) & (T < 95))
    assert np.array_equal(which(drive, 30.0, (5.0, 0.0)), (T >= 35) & (T < 95))
    long = Said(**{f.name: getattr(drive, f.name) for f in fields(drive)} | {"time": 10.0 * T})
    assert long.time[which(long, 300.0, (8.0, 0.0))].tolist() == list(range(310, 430, 10))
    assert long.time[which(long, 300.0, (0.0, np.inf))].tolist() == list(range(300, 601, 10))


def test_epochs_are_pooled_and_drives_counted():
    wrong = count(said(top=np.full(N, 7)), ALL, ("gnss: sigma",))
    right = [count(said(), T < 25)] * 3
    found = {f.figure: f for f in figures("x", [wrong, *right], "0:4")}
    rate = found["x: wrong at P >= 0.999"]
    assert (rate.value, rate.n, rate.met) == (pytest.approx(1e3 * N / (N + 75)), N + 75, False)
    assert rate.ci95 is not None
    assert rate.ci95[0] <= rate.value <= rate.ci95[1]
    level = found["x: level exceeded"]
    assert (level.value, level.ci95, level.met) == (0.0, None, True)
    assert found["x: named"].value == 250.0
    row = line("x", [wrong, *right]).split()
    assert row[:5] == ["x", "4", str(N + 75), str(N), "1"]
    assert row[-1] == "1"
    assert len(HEAD) == len(line("x", [wrong, *right]))


def test_a_scene_is_answered_beside_its_control():
    lines: list[str] = []
    found = run(Options(seeds=range(1, 2), say=lines.append, more={"scenes": "side_street"}))
    rows = [row[:44].rstrip() for row in lines[1:]]
    suites = ("wheels", "odometer", "odometer and Doppler")
    assert rows == [
        f"side_street, {what}: {suite}" for what in ("unmapped", "mapped") for suite in suites
    ]
    assert len(found) == len(rows) * len(WORDS)
    value = {f.figure: f.value for f in found}
    assert value["side_street, mapped: wheels: right road"] > 95.0
    assert value["side_street, mapped: wheels: declared"] > 60.0
    # two thirds of the drive are on the main street
    assert 25.0 < value["side_street, unmapped: wheels: declared"] < 70.0


def test_on_line_the_answer_is_nearly_that_of_the_record():
    more = {"scenes": "side_street"}
    recorded, live = (
        run(Options(seeds=range(1, 2), say=lambda _: None, more=m))
        for m in (more, more | {"lag": "online"})
    )
    for a, b in zip(recorded, live, strict=True):
        assert a.figure == b.figure
        if a.figure.endswith("wheels: level"):
            assert b.value == pytest.approx(a.value, rel=0.05)


def test_a_scene_that_does_not_exist_is_named():
    assert names("yard,tyres") == ["yard", "tyres"]
    with pytest.raises(SystemExit, match="'loop' is no scene; one of town, u_turn"):
        names("loop")
