"""A run that Ctrl-C ends, or that is killed: it says how far it is, and leaves nothing behind."""

import os
import re
import signal
import subprocess
import sys
import threading
from functools import partial

import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from whichroad.cli import app
from whichroad.fleet import run_fleet, staging
from whichroad.fleet.manifest import said_of_end
from whichroad.fleet.run import _unheard


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_run_that_is_interrupted_says_how_far_it_is(tmp_path, town, table, monkeypatch, workers):
    def interrupt(so_far):
        raise KeyboardInterrupt

    pq.write_table(table, tmp_path / "t.parquet")
    monkeypatch.setattr("whichroad.fleet.run_fleet", partial(run_fleet, unit_rows=500))
    line = ["fleet", "t.parquet", "--map", str(town), "-o", "out", "--workers", workers]
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as first:
        first.setattr(sys.modules["whichroad.cli.fleet"], "_line", interrupt)
        ran = CliRunner().invoke(app, line)
    assert ran.exit_code == 130
    assert re.search(
        r"^interrupted: [1-9]\d* of \d+ units done; go on by --resume$", ran.stderr, re.M
    )
    assert not list((tmp_path / "out").rglob("*/.part*"))
    for half in ("points/.part-00000.parquet.7", "path/.part-00001.parquet.7", ".manifest.json.7"):
        (tmp_path / "out" / half).parent.mkdir(exist_ok=True)
        (tmp_path / "out" / half).touch()
    ran = CliRunner().invoke(app, [*line, "--resume"])
    assert ran.exit_code == 0, ran.output
    left = [str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob(".*")]
    assert left == ["points/.part-00000.parquet.7"]  # no table of this run
    assert said_of_end(tmp_path).startswith("interrupted before the first unit")


@pytest.fixture
def usual_interrupt():
    """Ctrl-C raises KeyboardInterrupt: Spark leaves a handler of its own behind."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_what_a_run_begins_hears_no_interrupt_and_it_hears_it_later(usual_interrupt):
    heard, shown = [], "import signal; print(signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    ended = threading.Event()
    other = threading.Thread(target=ended.wait)  # it takes the signal for this one
    other.start()

    def begin():
        with _unheard():
            os.kill(os.getpid(), signal.SIGINT)
            child = subprocess.run([sys.executable, "-c", shown], capture_output=True, check=True)
            heard.append(child.stdout)

    with pytest.raises(KeyboardInterrupt):
        begin()
    ended.set()
    other.join()
    assert b"SIGINT" in heard[0]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_sort_that_is_interrupted_is_no_error_of_the_query():
    class Interrupted:
        def execute(self, query):
            raise RuntimeError("Query interrupted")

    with pytest.raises(KeyboardInterrupt):
        staging._run(Interrupted(), "SELECT 1")
