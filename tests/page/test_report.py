"""The report: one file that needs nothing else."""

import copy
import json
import re
from pathlib import Path

import numpy as np
import pytest

from whichroad.errors import WriteError
from whichroad.page.standalone import MODULES, standalone
from whichroad.page.static_files import STATIC
from whichroad.replay.drive_report import report_data, write_report
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.roadmap import RoadMap
from whichroad.tables.status import STATUS

NAMES = re.compile(
    r"^(?:export )?(?:async )?(?:const|let|function|class) (\w+|\{[^}]*\}|\[[^\]]*\])", re.M
)


def test_the_file_names_nothing_outside_of_itself(
    recorded: RecordedMessages, roads: RoadMap, tmp_path: Path
):
    path = tmp_path / "report.html"
    write_report(recorded, path, roads)
    text = path.read_text("utf-8").replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|<link rel=\"stylesheet|src=|^import ", text, re.M)
    assert "{{" not in text.split('<script type="application/json"')[0]
    data = json.loads(re.search(r'id="data">(.*?)</script>', text, re.S).group(1))  # type: ignore[union-attr]
    assert data["drive_id"] == recorded.drive_id
    assert len(data["line"]["t"]) == len(data["poses"]) == len(data["more"]["edge"])
    assert data["roads"]


def test_the_modules_of_a_report_have_no_name_twice():
    names = [
        name
        for module in MODULES
        for name in NAMES.findall((STATIC / f"{module}.js").read_text("utf-8"))
    ]
    assert len(names) == len(set(names))


def test_codes_of_a_status_mean_the_same_in_the_browser():
    text = (STATIC / "look.js").read_text("utf-8")
    table = text[text.index("export const STATUS = {") : text.index("export const STATUSES")]
    assert tuple(re.findall(r"^  (\w+): \{", table, re.M)) == STATUS


def test_a_name_cannot_break_out_of_the_page():
    page = standalone("</title><script>alert(1)</script>", {"name": "</script><b>{{style}}"})
    assert "<script>alert" not in page
    assert "</script><b>" not in page
    assert "{{style}}" in page


def test_a_report_without_a_map_has_a_track_and_no_roads(
    recorded: RecordedMessages, tmp_path: Path
):
    data = report_data(recorded)
    assert data["roads"] == []
    assert data["edges"] == {}
    assert data["line"]["lat"]
    write_report(recorded, tmp_path / "plain.html")


def test_to_pass_from_one_edge_to_the_next_is_no_place_to_look_at(
    recorded: RecordedMessages, roads: RoadMap
):
    bare = copy.copy(recorded)
    bare.route = None
    passing = (recorded.columns["p_road"] < 0.9) & (recorded.columns["p_way"] > 0.95)
    assert (np.diff(passing.astype(int)) == 1).sum() > 5
    without = [place["kind"] for place in report_data(bare)["places"]]
    for shown in (recorded, bare):  # by the route, and by the map alone
        places = report_data(shown, roads)["places"]
        kinds = [place["kind"] for place in places]
        assert kinds.count("outage") == without.count("outage") > 0
        assert 0 < kinds.count("ambiguous") <= without.count("ambiguous") <= 3
        for place in places:
            k = recorded.at(place["worst"])
            assert place["kind"] != "ambiguous" or recorded.columns["p_way"][k] < 0.95


def test_the_worst_place_is_listed_first(recorded: RecordedMessages, roads: RoadMap):
    places = report_data(recorded, roads)["places"]
    missed = [place["missed_s"] for place in places]
    assert missed == sorted(missed, reverse=True)
    assert min(missed) >= 0.5
    (doubt,) = [p for p in places if p["kind"] == "ambiguous" and p["begin"] == 0.0]
    rows = (recorded.time - recorded.time[0] < doubt["end"]) & (recorded.status == 1)
    held = np.diff(recorded.time, append=recorded.time[-1])
    expected = ((1.0 - recorded.columns["p_way"]) * held)[rows].sum()
    assert doubt["missed_s"] == pytest.approx(expected, abs=0.01)


def test_a_file_that_is_there_is_kept_unless_told_otherwise(
    recorded: RecordedMessages, tmp_path: Path
):
    path = tmp_path / "report.html"
    path.write_text("mine")
    with pytest.raises(WriteError, match="exists"):
        write_report(recorded, path)
    assert path.read_text() == "mine"
    write_report(recorded, path, force=True)
    with pytest.raises(WriteError, match=r"\.html was expected"):
        write_report(recorded, tmp_path / "report.pdf")
