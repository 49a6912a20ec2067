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
    """A library of the toys by two processes, and what the one said that has the entries."""
    target = cache.own_target()
    made = folder / f"toys{cache.suffix(target)}"
    objects = [folder / "calls.o", folder / "inner.o"]
    path = os.pathsep.join([str(Path(toys.__file__).parent), *filter(None, sys.path)])
    environment = {"PYTHONPATH": path, "NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic"}
    processes = []
    for others, made_here in enumerate(objects):
        job = {
            "modules": ["toys"], "entries": NAMES, "others": bool(others), "level": 2,
            "inner": ["toys:sum_of"], "source": "toys", "objects": {target: str(made_here)},
        }  # fmt: skip
        command = [sys.executable, "-m", "whichroad.native.lower", json.dumps(job), *arguments]
        processes.append(
            subprocess.Popen(
                command, env=os.environ | environment, text=True, stdout=subprocess.PIPE
            )
        )
    said = [process.communicate()[0] for process in processes]
    assert not any(process.returncode for process in processes), said
    command = linking.linker(target, portable=False)
    assert command
    linking.link(command, target, objects, made)
    return made, said[0]


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
