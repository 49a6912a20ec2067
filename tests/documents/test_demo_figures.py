"""What README says of the demo's drive is what the demo gives today."""

import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import whichroad.demo
from whichroad.plots import Window
from whichroad.tables.schema import seconds_of

from .pages import ROOT

README = (ROOT / "README.md").read_text("utf-8")
_SURE = 0.95
_AGAIN = (
    "write the number of today, and copy methods.png, drive.png of `whichroad demo` to "
    "docs/img/demo-methods.png and docs/demo.png"
)


class Answer:
    """The most probable road of each epoch beside the true one; seconds from the drive's start."""

    def __init__(self, points: pa.Table, truth: pa.Table) -> None:
        begin = seconds_of(truth["time"])[0]
        self.time = seconds_of(points["time"]) - begin
        row = np.searchsorted(seconds_of(truth["time"]), seconds_of(points["time"]) - 1e-6)
        true = truth["edge_id"].take(np.minimum(row, truth.num_rows - 1)).to_pylist()
        found = points["edge_id"].to_pylist()
        self.right = np.array([a == b for a, b in zip(found, true, strict=True)])
        self.p = np.array(points["p_road"].to_pylist(), float)
        self.status = np.array(points["status"].to_pylist())

    def within(self, window: Window) -> np.ndarray:
        """Which epochs are those of a window."""
        return (self.time >= window.begin) & (self.time <= window.end)

    def sure_from(self, begin: float) -> float:
        """The first time from which on the right road is told with `_SURE`."""
        return float(self.time[(self.time >= begin) & self.right & (self.p >= _SURE)][0])


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the demo draws: answers of both methods, of both wheels, windows and outages."""
    out = tmp_path_factory.mktemp("demo")
    kept: dict[str, Any] = {}

    def methods(answers: Any, roads: Any, truth: pa.Table, *_: Any, **more: Any) -> list[Path]:
        for name, result in answers:
            kept[name] = Answer(result.to_arrow(), truth)
        kept.update(more)
        return []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(whichroad.demo, "plot_drive", lambda *_, **__: [out / "drive.png"])
        patch.setattr(whichroad.demo, "plot_methods", methods)
        summary = whichroad.demo.run_demo(out, force=True)
    truth = pq.read_table(out / "truth.parquet")
    kept["points"] = pq.read_table(out / "points.parquet")
    kept["path"] = pq.read_table(out / "path.parquet")
    kept["wheels"] = Answer(kept["points"], truth)
    kept["said"] = summary["said"]
    return kept


def stated(words: str) -> list[int]:
    """The numbers of a sentence of README, in which each stands as N."""
    pattern = re.escape(words).replace("N", r"(\d+)").replace(r"\ ", r"\s+")
    found = re.search(pattern, README)
    assert found, f"README does not say: {words}"
    return [int(number) for number in found.groups()]


def test_the_drive_is_as_long_as_said(shown: dict[str, Any]):
    length, dark = stated("a drive of N km, N km of it without GPS")
    told = re.findall(r"([\d.]+) km", shown["said"]["driven"])
    assert [round(float(one)) for one in told] == [length, dark]


def test_beside_a_parallel_road_the_probabilities_are_those_said(shown: dict[str, Any]):
    ours, window = shown["whichroad"], shown["windows"][0]
    rows = ours.within(window)
    low, high = stated("Ours has N to N % for the wrong road, and says that it is ambiguous")
    assert not ours.right[rows].any()
    assert set(ours.status[rows]) == {"ambiguous"}
    today = round(100 * ours.p[rows].min()), round(100 * ours.p[rows].max())
    assert today == (low, high), _AGAIN


def test_it_is_sure_of_the_right_road_as_late_as_said(shown: dict[str, Any]):
    (after,) = stated("It is sure of the right one N s after GPS is back")
    back = shown["masked"][0][1]
    assert round(shown["whichroad"].sure_from(back) - back) == after, _AGAIN


def test_the_papers_method_is_sure_as_soon_as_said(shown: dict[str, Any]):
    (after,) = stated("The paper's method is sure N s after the picture begins, and is right here")
    paper, window = shown["the paper's method"], shown["windows"][0]
    assert round(paper.sure_from(window.begin) - window.begin) == after, _AGAIN
    assert paper.right[paper.within(window)].all()


def test_the_picture_of_the_report_shows_the_probabilities_of_today(shown: dict[str, Any]):
    """Taken 408 s from the start, at 1280x800: `report.html#t=408&z=18` of `match --report`."""
    alone = stated("Route de la Forêt with N %, Route de Reims with N %")
    wheels = shown["wheels"]
    now = wheels.p[np.searchsorted(wheels.time, 408.0 - 0.01)]
    assert [round(100 * now), round(100 * (1.0 - now))] == alone, "take docs/img/report.png anew"


def test_at_the_fork_the_wheels_decide_as_soon_as_said(shown: dict[str, Any]):
    (within,) = stated("With both wheels it is decided within N s")
    behind = Window("", shown["windows"][1].end - 2.0, shown["windows"][1].end)
    for name in ("whichroad", "the paper's method"):
        answer = shown[name]
        assert np.abs(answer.p[answer.within(behind)] - 0.5).max() < 0.02
        assert set(answer.status[answer.within(behind)]) == {"ambiguous"}
    wheels = shown["wheels"]
    fork = wheels.time[(wheels.time > shown["windows"][1].begin) & (wheels.p < _SURE)][0]
    assert wheels.sure_from(fork) - fork <= within, _AGAIN


def test_alternatives_are_all_candidates_the_most_probable_first(shown: dict[str, Any]):
    """As the reference and the page on probabilities say."""
    for row in (
        shown["points"].select(["edge_id", "p_road", "p_off_road", "alternatives"]).to_pylist()
    ):
        found = row["alternatives"]
        assert found[0]["edge_id"] == row["edge_id"]
        assert found[0]["p"] == pytest.approx(row["p_road"], abs=1e-6)
        assert len(found) <= 6
        assert row["p_off_road"] + sum(one["p"] for one in found) == pytest.approx(1.0, abs=1e-3)


def test_rows_of_the_path_follow_each_other(shown: dict[str, Any]):
    """In time and at nodes; and the route is no surer than its edges."""
    rows = shown["path"].to_pylist()
    for a, b in itertools.pairwise(rows):
        assert a["to_node"] == b["from_node"]
        assert a["exit_time"] == b["enter_time"]
    assert all(row["p_route"] <= row["p"] + 1e-9 for row in rows)
