"""Edges of an old map in a new one."""

import pyarrow.csv as pacsv
from typer.testing import CliRunner

from whichroad.cli import app
from whichroad.roadmap.differences import GONE, OTHER_SOURCE, SAME, counts, differences

NODES = {1: (0, 0), 2: (200, 0), 3: (0, 200), 4: (-200, 0), 5: (0, -200), 6: (100, 0), 7: (100, 90)}
WAYS = [(10, [1, 6, 2], {}), (20, [1, 3], {}), (30, [4, 1, 5], {})]


def test_a_map_is_itself(osm):
    roads = osm(NODES, WAYS)
    rows = differences(roads, roads).to_pylist()
    assert [row["new_edge"] for row in rows] == [row["old_edge"] for row in rows]
    assert counts(differences(roads, roads)) == {"same number": len(roads)}


def test_edges_that_are_cut_renamed_or_gone_are_told(osm):
    old = osm(NODES, WAYS)
    new = osm(NODES, [(40, [6, 7], {}), (10, [1, 6, 2], {}), (21, [1, 3], {}), (30, [4, 1], {})])
    rows = differences(old, new).to_pylist()
    by_source = {}
    for row in rows:
        number, forward = old.source(
            row["old_edge"], float(old.arrays.edges.length[row["old_edge"]]) / 2
        )
        by_source.setdefault(number, []).append((row, forward))
    for row, forward in by_source[10]:
        assert row["found"] == SAME
        assert new.source(row["new_edge"], 1.0) == (10, forward)
        assert row["distance_m"] < 0.1
    for row, forward in by_source[20]:
        assert row["found"] == OTHER_SOURCE
        assert new.source(row["new_edge"], 1.0) == (21, forward)
    assert {row["found"] for row, _ in by_source[30]} == {SAME, GONE}


def test_the_command_writes_a_row_for_each_old_edge(osm, tmp_path):
    old, new = osm(NODES, WAYS), osm(NODES, WAYS[:2])
    old.save(tmp_path / "old.map")
    new.save(tmp_path / "new.map")
    line = ["map", "diff", tmp_path / "old.map", tmp_path / "new.map", "-o", tmp_path / "d.csv"]
    done = CliRunner().invoke(app, [str(part) for part in line])
    assert done.exit_code == 0, done.output
    assert "gone" in done.output
    table = pacsv.read_csv(tmp_path / "d.csv")
    assert table.num_rows == len(old)
