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


def lowered(
    folder: Path, name: str = "toys", entries: tuple[str, ...] = NAMES,
    shared: tuple[str, ...] = ("toys:sum_of",),
) -> Path:  # fmt: skip
    """A library of the toys, or of another module, by two processes."""
    target = cache.own_target()
    made = folder / f"{name}{cache.suffix(target)}"
    objects = [folder / "calls.o", folder / "inner.o"]
    path = os.pathsep.join([str(Path(toys.__file__).parent), *filter(None, sys.path)])
    environment = os.environ | {"PYTHONPATH": path}
    processes = []
    for others, made_here in enumerate(objects):
        job = {
            "modules": [name], "entries": entries, "others": bool(others), "level": 2,
            "shared": shared, "source": "toys", "objects": {target: str(made_here)},
        }  # fmt: skip
        command = [sys.executable, "-m", "whichroad.native.lower", json.dumps(job)]
        processes.append(
            subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE)
        )
    said = [process.communicate()[0] for process in processes]
    assert not any(process.returncode for process in processes), said
    command = linking.linker(target, portable=False)
    assert command
    linking.link(command, target, objects, made)
    return made


@pytest.fixture(scope="session")
def can_build():
    """Skips where kernels cannot be compiled."""
    pytest.importorskip("llvmlite")
    if linking.linker(cache.own_target(), portable=False) is None:
        pytest.skip("no C compiler here, and no ziglang")


@pytest.fixture(scope="session")
def toy_path(can_build, tmp_path_factory) -> Path:
    return lowered(tmp_path_factory.mktemp("toys"))


@pytest.fixture(scope="session")
def toy_library(toy_path):
    return library.load(toy_path)
