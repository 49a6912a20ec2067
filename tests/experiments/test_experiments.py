"""The paper's experiments on a few drives each: its claims hold, the report stands alone."""

import json
import re
import sys

import numpy as np
import pytest

from page.test_browser import browser  # noqa: F401
from page.test_layout import SIZES, change_theme, open_at, violations
from whichroad import cli
from whichroad.cli.arguments import Scene
from whichroad.experiments import (
    NUMBERS,
    REPORT,
    SCENES,
    TABLE,
    all_experiments,
    run_experiments,
)
from whichroad.experiments.pictures import Picture
from whichroad.experiments.runs import ALIVE, MODELS, answer, lifetimes, run_of

SEEDS = range(3)
ROADS = [name for name in SCENES if name != "gst"]


@pytest.fixture(scope="module")
def runs():
    """Each road scene's rides by whichroad, one per seed."""
    found = {}
    for name in ROADS:
        scene = SCENES[name]
        drives = [scene.drive(scene.roads, seed) for seed in SEEDS]
        found[name] = [run_of(scene, d, answer(scene, d, "default")) for d in drives]
    return found


@pytest.mark.parametrize("scene", ["fork", "parallel", "junction"])
def test_at_the_decision_more_than_one_road_counts(runs, scene):
    for r in runs[scene]:
        both = (r.right >= ALIVE) & (r.wrongest >= ALIVE)
        assert both.any()


@pytest.mark.parametrize("scene", ROADS)
def test_the_true_road_ends_as_the_most_probable_and_no_wrong_one_is_declared(runs, scene):
    for r in runs[scene]:
        assert r.right[-1] > r.wrongest[-1]
        assert r.wrongest[r.past > 0.0].max() < 0.999


def test_a_wrong_road_at_a_junction_lives_for_a_while_and_dies(runs):
    for r in runs["junction"]:
        (lifetime,) = lifetimes(SCENES["junction"], r)
        assert lifetime.ended
        assert lifetime.seconds > 1.0


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """All scenes over a few seeds: the folder, and what was said."""
    out = tmp_path_factory.mktemp("experiments")
    return out, run_experiments(out, seeds=SEEDS)


def test_the_report_stands_alone(done):
    page = (done[0] / REPORT).read_text("utf-8")
    assert re.findall(r"https?:|<script|<link|@import|url\(", page) == []
    sources = re.findall(r'src="([^"]{0,30})', page)
    assert sources
    assert all(source.startswith("data:image/png;base64,") for source in sources)


def test_the_report_fits_and_can_be_read_at_every_size(done, browser):  # noqa: F811
    for size, (width, _) in SIZES.items():
        page = open_at(browser, (done[0] / REPORT).as_uri(), size)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= width
        assert violations(page) == []
        change_theme(page, size)
        assert violations(page) == []
        page.close()


def test_the_json_has_a_row_for_every_number(done):
    told = json.loads((done[0] / NUMBERS).read_text("utf-8"))
    assert set(told["scenes"]) == set(SCENES)
    assert told["seeds"] == "0:3"
    for row in told["rows"]:
        assert set(row) == {
            "scene", "model", "figure", "value", "unit", "n", "ci95", "spread95"
        }  # fmt: skip
    for name in ROADS:
        models = {row["model"] for row in told["rows"] if row["scene"] == name}
        assert models == set(MODELS)
    for about in told["scenes"].values():
        for file in about["pictures"] + about["logs"]:
            assert (done[0] / file).stat().st_size > 0
        assert all(sentence.endswith(".") for sentence in about["seen"])


def test_the_life_cycle_log_accounts_for_all_probability(done):
    """At every epoch the weights of the hypotheses sum to one."""
    for model in MODELS:
        table = np.genfromtxt(done[0] / f"fork-{model}-weights.csv", delimiter=",", names=True)
        _, epoch = np.unique(table["time_s"], return_inverse=True)
        np.testing.assert_allclose(np.bincount(epoch, table["p"]), 1.0, atol=1e-4)


def test_the_same_seeds_give_the_same_numbers(done, tmp_path, monkeypatch):
    pictures = [Picture(path, "") for path in sorted(done[0].glob("junction*.png"))]
    monkeypatch.setattr(all_experiments, "draw_scene", lambda *_: pictures)  # they take longest
    again = run_experiments(tmp_path, scenes=["junction"], seeds=SEEDS)
    rows = [row for row in done[1]["rows"] if row["scene"] == "junction"]
    assert again["rows"] == rows


def test_the_table_in_markdown_names_every_scene(done):
    table = (done[0] / TABLE).read_text("utf-8")
    assert {line.split(" | ")[0] for line in table.splitlines()[2:]} == {f"| {s}" for s in SCENES}


def run(monkeypatch, capsys, *arguments):
    monkeypatch.setattr(sys, "argv", ["whichroad", "experiments", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code, *capsys.readouterr()


def test_the_command_says_what_is_seen_and_where(monkeypatch, capsys, tmp_path):
    code, out, err = run(
        monkeypatch, capsys, "--scene", "junction", "--seeds", "5:7", "--out", tmp_path
    )
    assert (code, err) == (0, "")
    assert "seeds 5:7" in out
    assert str(tmp_path / REPORT) in out


@pytest.mark.parametrize("wrong", [["--scene", "moon"], ["--seeds", "3"], ["--seeds", "3:3"]])
def test_wrong_usage_is_exit_code_2(monkeypatch, capsys, wrong, tmp_path):
    code, out, _ = run(monkeypatch, capsys, "--out", tmp_path, *wrong)
    assert (code, out) == (2, "")


def test_a_folder_with_something_else_is_left_alone(monkeypatch, capsys, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    code, out, err = run(monkeypatch, capsys, "--out", tmp_path, "--seeds", "0:1")
    assert (code, out) == (1, "")
    assert "holds other files" in err


def test_the_command_offers_every_scene():
    assert [one.value for one in Scene] == list(SCENES)
