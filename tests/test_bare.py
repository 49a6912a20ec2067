"""The core alone: no drawing, no frames, no CAN, no pandas, no compiler."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_drives_are_matched_and_written_without_any_extra():
    done = subprocess.run(
        [sys.executable, ROOT / "release" / "smoke.py"], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "a table of trips" in done.stdout


def test_a_command_names_the_extra_that_it_lacks(tmp_path):
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); from smoke import Absent; "
        "sys.meta_path.insert(0, Absent()); from whichroad.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, ROOT / "release", "demo", "--out", tmp_path / "demo"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 1
    assert 'pip install "whichroad[' in done.stderr
    assert "Traceback" not in done.stderr
