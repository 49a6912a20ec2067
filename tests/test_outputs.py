"""An output is never an input, nor another output, however its path is written."""

import os
import sys

import pytest

from whichroad import cli
from whichroad.errors import WriteError
from whichroad.simulate import draw_town
from whichroad.writers import check_apart


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A drive, a map and a points table, in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.csv").write_text("time,lat,lon\n0,49.4,8.7\n1,49.4,8.7\n")
    (tmp_path / "town.osm").write_text(draw_town(), encoding="utf-8")
    (tmp_path / "roads.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "part.parquet").write_bytes(b"a part")
    (tmp_path / "link.csv").symlink_to("in.csv")
    os.link(tmp_path / "in.csv", tmp_path / "hard.csv")
    (tmp_path / "folder").symlink_to(".")
    return tmp_path


def contents(folder):
    return {f.name: f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["whichroad", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


SAME = ["in.csv", "./in.csv", "sub/../in.csv", "link.csv", "hard.csv", "folder/in.csv"]


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["", "force"])
@pytest.mark.parametrize(
    "arguments",
    [
        *(["match", "in.csv", "--map", "town.osm", "-o", name] for name in SAME),
        *(["match", name, "--map", "town.osm", "--path-out", "in.csv"] for name in SAME),
        ["match", "in.csv", "--map", "roads.geojson", "-o", "roads.geojson"],
        ["match", "in.csv", "--map", "town.osm", "-o", "a.parquet", "--path-out", "a.parquet"],
        ["match", "in.csv", "--map", "town.osm", "-o", "a.csv", "--path-out", "sub/../a.csv"],
        ["match", "*.csv", "--map", "town.osm", "-o", "in.csv"],
        ["match", "s?b", "--map", "town.osm", "-o", "sub/part.parquet"],
        ["match", "sub", "--map", "town.osm", "-o", "sub/part.parquet"],
        ["map", "build", "town.osm", "-o", "town.osm"],
        ["map", "build", "town.osm", "-o", "folder/town.osm"],
        ["report", "in.csv", "-o", "link.csv"],
        ["report", "in.csv", "--map", "town.osm", "-o", "town.osm"],
    ],
    ids=" ".join,
)
def test_no_output_replaces_an_input_or_another_output(
    files, monkeypatch, capsys, arguments, force
):
    before = contents(files)
    assert run(monkeypatch, *arguments, *force) == 1
    error = capsys.readouterr().err
    assert "would replace a file that is read" in error or "same file" in error
    assert error.count("\n") == 1
    assert contents(files) == before


def test_a_simulated_drive_does_not_replace_its_map(files, monkeypatch, capsys):
    (files / "town.osm").rename(files / "can.log")  # one of the names that `simulate` writes
    (files / "town.osm").symlink_to("can.log")
    before = contents(files)
    assert run(monkeypatch, "simulate", "--map", "town.osm", "-o", ".", "--force") == 1
    assert "can.log" in capsys.readouterr().err
    assert contents(files) == before


@pytest.mark.parametrize("option", [("--state", "town.osm"), ("--record", "sub")])
def test_a_service_does_not_write_to_what_it_reads(files, monkeypatch, capsys, option):
    (files / "sub" / "fixes.arrow").write_bytes(b"of an earlier drive")
    before = contents(files)
    assert run(monkeypatch, "live", "--map", "town.osm", "--play", "sub", *option) == 1
    assert "would replace a file that is read" in capsys.readouterr().err
    assert contents(files) == before


def test_other_files_beside_the_inputs_are_outputs(files):
    check_apart({"-o": "out.csv", "--path-out": "path.csv"}, ["in.csv", "town.osm", None])
    check_apart({"-o": "sub/new.parquet"}, ["sub"])
    check_apart({"-o": "in.csv", "--path-out": None}, ["town.osm", "none.csv"])


def test_a_link_to_itself_is_no_reason_to_fail(files):
    (files / "loop").symlink_to("loop")
    check_apart({"-o": "loop"}, ["in.csv"])
    with pytest.raises(WriteError, match="-o"):
        check_apart({"-o": "in.csv"}, ["loop", "in.csv"])


def test_results_are_not_written_to_standard_output():
    with pytest.raises(WriteError, match="-o -: results are not written to standard output"):
        check_apart({"-o": "-"}, ["-"])
