"""Who waits for the compiler is told so; who need not wait is told nothing."""

from pathlib import Path

import pytest

from whichroad.native import build, progress

LIBRARY = Path("kernels.so")


@pytest.fixture
def slow(monkeypatch):
    """A build in eight steps, of which nothing is real."""

    def own_library(report=lambda share: None) -> Path:
        for step in range(9):
            report(step / 8)
        return LIBRARY

    monkeypatch.setattr(build, "kept", lambda: None)
    monkeypatch.setattr(build, "why_not", lambda: None)
    monkeypatch.setattr(build, "own_library", own_library)


def test_elsewhere_than_on_a_terminal_a_build_tells_a_line_now_and_then(slow, capsys):
    assert progress.build_own() == LIBRARY
    first, *lines = capsys.readouterr().err.splitlines()
    assert first.startswith("whichroad: compiling the kernels for this machine, once")
    assert [line.split(",")[0] for line in lines] == [
        f"whichroad: {share}%" for share in (25, 50, 75, 100)
    ]


def test_on_a_terminal_a_build_shows_a_bar(slow, capsys, monkeypatch):
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: True)
    assert progress.build_own() == LIBRARY
    assert "%, " not in capsys.readouterr().err


def test_nothing_is_told_where_a_library_is_kept(slow, capsys, monkeypatch):
    monkeypatch.setattr(build, "kept", lambda: LIBRARY)
    assert progress.build_own() == LIBRARY
    assert capsys.readouterr().err == ""
