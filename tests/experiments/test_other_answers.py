"""The experiments' drives as files, and answers of other programs beside ours."""

import json
import re
import sys

import geopandas
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib import image

import whichroad
from whichroad import cli
from whichroad.errors import SettingError
from whichroad.evaluate import evaluate_files
from whichroad.experiments import (
    NUMBERS,
    REPORT,
    SCENES,
    TABLE,
    all_experiments,
    run_experiments,
)
from whichroad.experiments.other_answers import OtherAnswers
from whichroad.experiments.pictures import Picture
from whichroad.experiments.runs import answer

SEEDS = range(2)
CHOSEN = ("fork", "outage", "gst")
BARE = ["time", "lat", "lon"]


def answer_to(scene: str, seed: int) -> pa.Table:
    """Points of the default method."""
    drive = SCENES[scene].drive(SCENES[scene].roads, seed)
    return answer(SCENES[scene], drive, "default").to_arrow()


@pytest.fixture(scope="module", autouse=True)
def one_dot():
    """A picture of one dot for all of a scene, which are looked at elsewhere and take longest."""

    def draw_scene(scene, runs, example, out):
        image.imsave(out / f"{scene.name}.png", np.zeros((1, 1, 3)))
        return [Picture(out / f"{scene.name}.png", "A dot.")]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(all_experiments, "draw_scene", draw_scene)
        yield


@pytest.fixture(scope="module")
def done(one_dot, tmp_path_factory):
    """Kept drives, and answers to them: the same as ours, places alone, and as CSV with roads."""
    folder = tmp_path_factory.mktemp("others")
    for scene in CHOSEN:
        for name in ("same", "bare", "roads"):
            (folder / name / scene).mkdir(parents=True)
        for seed in SEEDS:
            points = answer_to(scene, seed)
            pq.write_table(points, folder / "same" / scene / f"{seed}.parquet")
            pq.write_table(points.select(BARE), folder / "bare" / scene / f"{seed}.parquet")
            own = points.select([*BARE, "edge_id"]).to_pandas()
            own.to_csv(folder / "roads" / scene / f"{seed}.csv", index=False)
    out = folder / "out"
    answers = {name: folder / name for name in ("same", "bare", "roads")}
    about = run_experiments(out, scenes=CHOSEN, seeds=SEEDS, keep=True, answers=answers)
    return out, about


def figures(about: dict, scene: str, model: str) -> dict[str, float]:
    return {
        row["figure"]: row["value"] for row in about["rows"]
        if (row["scene"], row["model"]) == (scene, model)
    }  # fmt: skip


def of_lifetimes(name: str) -> bool:
    """Figures of hypotheses that no table of points holds, and of wheels without a filter."""
    return "count" in name or "wheels alone" in name or "fixes' own" in name


@pytest.mark.parametrize("scene", CHOSEN)
def test_our_own_tables_as_anothers_have_our_own_figures(done, scene):
    ours = figures(done[1], scene, "default, per fix" if scene == "gst" else "default")
    same = figures(done[1], scene, "same")
    exact = {"position error", "as stated", "ANEES", "truth in the 95 % ellipse"}
    common = {name for name in same if any(name.startswith(word) for word in exact)}
    assert len(common) >= 4
    for name in common:
        assert same[name] == pytest.approx(ours[name], rel=1e-6)
    if scene != "gst":
        assert {name for name in ours if not of_lifetimes(name)} == set(same)
        # the most probable road of the table is that of all hypotheses
        name = "true road the most probable at the end"
        assert same[name] == ours[name]


@pytest.mark.parametrize("scene", CHOSEN)
def test_an_answer_has_the_figures_that_its_columns_allow(done, scene):
    bare, roads = (figures(done[1], scene, name) for name in ("bare", "roads"))
    assert bare
    assert all(name.startswith("position error") for name in bare)
    assert bare == pytest.approx({name: roads[name] for name in bare})
    if scene != "gst":
        more = set(roads) - set(bare)
        assert more
        assert all(name.startswith("true road the most probable") for name in more)
        same = figures(done[1], scene, "same")
        assert (
            same["true road the most probable at the end"]
            == (roads["true road the most probable at the end"])
        )


def test_the_report_and_the_table_have_their_columns(done):
    out, _ = done
    page = (out / REPORT).read_text("utf-8")
    assert page.count('<th class="">same</th>') == len(CHOSEN)
    assert re.findall(r"https?:|<script|<link|@import|url\(", page) == []
    table = (out / TABLE).read_text("utf-8").splitlines()
    assert table[0] == "| scene | figure | paper | whichroad | bare | roads | same |"
    assert {line.count("|") for line in table} == {8}
    json.loads((out / NUMBERS).read_text("utf-8"))


def test_a_kept_drive_is_answered_from_its_files(done):
    out, _ = done
    place = out / "drives" / "outage"
    files = [place / "1" / name for name in ("fixes.parquet", "odometry.parquet")]
    result = whichroad.match(files, place / "roads.map", vehicle=place / "1" / "vehicle.toml")
    result.write(out / "points.parquet")
    got = evaluate_files(out / "points.parquet", place / "1" / "truth.parquet")
    assert got["outage_right_edge"] == 1.0
    own = evaluate_files(
        out.parent / "same" / "outage" / "1.parquet", place / "1" / "truth.parquet"
    )
    # sigmas of speeds are not in the tables
    assert got["rmse_m"] == pytest.approx(own["rmse_m"], rel=0.1)
    # the truth's edges are those of both maps
    edges = whichroad.RoadMap.open(place / "roads.map").edges_table().set_index("edge_id")
    drawn = geopandas.read_file(place / "roads.geojson").set_index("edge_id")
    assert drawn.geometry.geom_equals_exact(edges.geometry, 1e-6).all()
    truth = pq.read_table(place / "1" / "truth.parquet").to_pandas()
    assert set(truth.edge_id) <= set(edges.index)


def test_an_answer_that_is_missing_is_named_before_the_work(done, tmp_path):
    with pytest.raises(SettingError, match=r"fork has no answer to seed 7; 7\.parquet"):
        run_experiments(
            tmp_path / "x", scenes=["fork"], seeds=range(7, 8),
            answers={"mine": done[0].parent / "same"},
        )  # fmt: skip
    assert not (tmp_path / "x").exists()
    for name in ("default", "paper", "", "a,b"):
        with pytest.raises(SettingError, match="answers: the name is"):
            run_experiments(tmp_path / "x", answers={name: tmp_path})
    with pytest.raises(SettingError, match="is not a folder"):
        run_experiments(tmp_path / "x", answers={"mine": tmp_path / "none"})


def test_a_road_that_is_not_named_is_no_wrong_one(tmp_path):
    scene = SCENES["fork"]
    points = answer_to("fork", 0).select([*BARE, "edge_id", "p_road"])
    edges = points["edge_id"].to_pylist()
    half = len(edges) // 2
    nowhere = pa.array([*edges[:half], *[None] * (len(edges) - half)], pa.int64())
    (tmp_path / "fork").mkdir()
    table = points.set_column(points.column_names.index("edge_id"), "edge_id", nowhere)
    pq.write_table(table, tmp_path / "fork" / "0.parquet")
    r = OtherAnswers.of("mine", tmp_path).run(scene, scene.drive(scene.roads, 0))
    named = r.right + r.wrongest > 0.0
    assert named[: half - 1].all()
    assert not named[half + 1 :].any()


def test_the_command_takes_names_and_folders(done, tmp_path, monkeypatch, capsys):
    folder = done[0].parent / "bare"

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["whichroad", "experiments", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return stop.value.code, capsys.readouterr()

    chosen = ("--scene", "fork", "--seeds", "0:1", "--out", tmp_path / "out")
    code, _ = run(*chosen, "--keep", "--answers", f"mine={folder}")
    assert code == 0
    rows = json.loads((tmp_path / "out" / NUMBERS).read_text("utf-8"))["rows"]
    assert "mine" in {row["model"] for row in rows}
    kept = sorted(p.name for p in (tmp_path / "out" / "drives" / "fork" / "0").iterdir())
    assert kept == ["fixes.parquet", "odometry.parquet", "truth.parquet", "vehicle.toml"]
    code, said = run(*chosen, "--answers", "mine")
    assert (code, "NAME=DIR was expected" in said.err) == (2, True)


def test_kept_fixes_are_those_of_the_drive(done):
    place = done[0] / "drives" / "gst" / "0"
    drive = SCENES["gst"].drive(SCENES["gst"].roads, 0).drive
    table = pq.read_table(place / "fixes.parquet").to_pandas()
    np.testing.assert_array_equal(table.lat, drive.fixes.lat_deg)
    np.testing.assert_array_equal(table.cov_en_m2, drive.fixes.cov_en)
    wheels = pq.read_table(place / "odometry.parquet").to_pandas()
    np.testing.assert_array_equal(wheels.wheel_rl_ticks, drive.odometry.left)
