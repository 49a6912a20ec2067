"""Programs in C call the library by the generated header."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from whichroad.filter.step import run
from whichroad.geodesy.kernels import to_plane
from whichroad.geodesy.plane import Plane
from whichroad.native import library
from whichroad.native.header import header
from whichroad.native.layout import Array, Layout

from . import toys

LAT, LON = 0.86, 0.15


def text_of(*layouts: Layout) -> str:
    return header(layouts, ["about it"] * len(layouts))


def compiled(folder: Path, program: str, name: str, *arguments: str) -> subprocess.CompletedProcess:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler here")
    (folder / f"{name}.c").write_text(program, "utf-8")
    return subprocess.run(
        [compiler, "-std=c11", "-Wall", "-Wextra", "-Werror", f"{name}.c", "-o", name, *arguments],
        cwd=folder, check=True, capture_output=True, text=True,
    )  # fmt: skip


PROGRAM = """
#include <stdio.h>
#include "whichroad.h"

static double zeros[1 << 16];

int main(void) {
    struct whichroad_to_plane_block p = {0};
SPHERE
    p.lat = LAT;
    p.lon = LON;
    if (whichroad_layout_to_plane != WHICHROAD_LAYOUT_TO_PLANE) return 2;
    if (whichroad_layout_run != WHICHROAD_LAYOUT_RUN) return 3;
    if (whichroad_to_plane(&p)) return 4;
    struct whichroad_run_block r = {0};
ARRAYS
    r.last = 1;
    if (whichroad_run(&r)) return 5;
    printf("%a %a %d\\n", p.result_f0, p.result_f1, (int)r.result);
    return 0;
}
"""


def test_a_c_program_runs_an_epoch_and_finds_a_place_as_python_does(tmp_path):
    """The filter is empty and the epoch has no fix: it answers that one epoch is done."""
    done = subprocess.run(
        [sys.executable, "-m", "whichroad.native", "header"],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    (tmp_path / "whichroad.h").write_text(done.stdout, "utf-8")
    sphere = Plane(49.0, 8.0).sphere
    place = "".join(f"    p.sphere_{n} = {v.hex()};\n" for n, v in sphere._asdict().items())
    arrays = "".join(
        f"    r.{leaf.path.replace('.', '_')} = (void *)zeros;\n"
        for leaf in run.layout.leaves()
        if isinstance(leaf.kind, Array)
    )
    program = PROGRAM.replace("SPHERE", place).replace("ARRAYS", arrays)
    program = program.replace("LAT;", f"{LAT.hex()};").replace("LON;", f"{LON.hex()};")
    found = library.found()
    own = tmp_path / f"libwhichroad{found.suffix}"
    shutil.copy(found, own)
    compiled(tmp_path, program, "run", f"./{own.name}", "-Wl,-rpath,$ORIGIN")
    said = subprocess.run(
        ["./run"], cwd=tmp_path, check=True, capture_output=True, text=True
    ).stdout
    x, y, last = said.split()
    assert (float.fromhex(x), float.fromhex(y)) == to_plane(sphere, LAT, LON)
    assert last == "1"


def test_records_have_the_same_places_in_c_as_in_numpy(tmp_path):
    """The header says each offset, and the compiler compares."""
    text = text_of(toys.toy_records.layout, toys.toy_tuples.layout)
    (tmp_path / "whichroad.h").write_text(text, "utf-8")
    assert text.count("offsetof") == len(toys.TRACK.names) + len(toys.STATE.names)
    compiled(tmp_path, '#include "whichroad.h"\nint main(void) { return 0; }\n', "empty")


def test_a_record_that_c_lays_out_otherwise_does_not_compile(tmp_path):
    text = text_of(toys.toy_records.layout).replace("double weight;", "float weight;")
    (tmp_path / "whichroad.h").write_text(text, "utf-8")
    with pytest.raises(subprocess.CalledProcessError):
        compiled(tmp_path, '#include "whichroad.h"\nint main(void) { return 0; }\n', "wrong")
