"""A library of the toys, built once as the package's own is."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from whichroad.native import cache, library, linking

from . import toys

NAMES = ("toy_numbers", "toy_span", "toy_tuples", "toy_records", "toy_nothing")


def lowered(folder: Path, *arguments: str) -> tuple[Path, str]:
    """A library of the toys, and what the process said that lowered them."""
    target = cache.own_target()
    made = folder / f"toys{cache.suffix(target)}"
    job = {
        "modules": ["toys"], "entries": NAMES, "others": False, "source": "toys", "level": 2,
        "objects": {target: str(folder / "toys.o")},
    }  # fmt: skip
    path = os.pathsep.join([str(Path(toys.__file__).parent), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-m", "whichroad.native.lower", json.dumps(job), *arguments],
        env=os.environ | {"PYTHONPATH": path, "NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    command = linking.linker(target, portable=False)
    assert command
    linking.link(command, target, [folder / "toys.o"], made)
    return made, done.stdout


@pytest.fixture(scope="session")
def can_build():
    """Skips where kernels cannot be compiled."""
    pytest.importorskip("numba")
    if linking.linker(cache.own_target(), portable=False) is None:
        pytest.skip("no C compiler here, and no ziglang")


@pytest.fixture(scope="session")
def toy_path(can_build, tmp_path_factory) -> Path:
    return lowered(tmp_path_factory.mktemp("toys"))[0]


@pytest.fixture(scope="session")
def toy_library(toy_path):
    return library.load(toy_path)
