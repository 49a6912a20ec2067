"""Native, just in time, plain Python: three ways to run the same kernels.

numba takes minutes to compile them all.  Kernels that were compared with it on this kind of
machine are not compared again, by the same numba: COMPARED holds their digest, a line for each
kind.  The test below writes it where it passes outside of CI; it belongs into the commit that
changes kernels.
"""

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from whichroad.native.cache import own_target, processors, source_digest

COMPARED = Path(__file__).with_name("compared_with_numba.txt")
TESTS = Path(__file__).parents[1]
ANSWERS = """
import gc
import sys
from dataclasses import replace
from pathlib import Path
import numpy as np
import whichroad
from whichroad._compile import kernel_mode
from whichroad.simulate import draw_town, simulate_drive

gc.set_threshold(100_000, 50, 100)  # numba's objects live on, and there are millions
folder, expected = Path(sys.argv[1]), sys.argv[2]
assert kernel_mode() == expected, kernel_mode()
if expected == "jit":
    from native.whole_once import optimise_entries_only

    optimise_entries_only()
(folder / "map.osm").write_text(draw_town(), encoding="utf-8")
roads = whichroad.RoadMap.from_osm(folder / "map.osm")
drive = simulate_drive(roads, seed=1, length_m=200.0).drive
answers = {}
for name, one in (("wheels", drive), ("fixes", replace(drive, odometry=None))):
    result = whichroad.match(one, roads, lag="full" if name == "fixes" else None)
    table = result.to_arrow()
    for column in table.column_names:
        if str(table.schema.field(column).type) in {"double", "float", "int32", "uint8"}:
            answers[f"{name}_{column}"] = table.column(column).to_numpy()
    answers[f"{name}_path"] = np.array(result.path["edge_id"])
np.savez(folder / "answers.npz", **answers)
print("llvmlite" in sys.modules)
"""


def answers(folder: Path, way: str) -> tuple[dict[str, np.ndarray], str]:
    folder.mkdir()
    paths = os.pathsep.join([str(TESTS), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", ANSWERS, folder, way],
        env=os.environ | {"WHICHROAD_KERNELS": way, "NUMBA_OPT": "0", "PYTHONPATH": paths},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    with np.load(folder / "answers.npz", allow_pickle=True) as file:
        return dict(file), done.stdout.strip()


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    return answers(tmp_path_factory.mktemp("native") / "here", "native")


def test_native_answers_never_import_the_compiler(native):
    assert native[1] == "False"


def test_plain_python_answers_the_same(native, tmp_path):
    """NumPy's and Python's functions round otherwise than the C library's: not to the bit."""
    python, compiler = answers(tmp_path / "here", "python")
    assert compiler == "False"
    for name, values in native[0].items():
        if values.dtype.kind == "f":
            np.testing.assert_allclose(python[name], values, rtol=1e-9, atol=1e-9, err_msg=name)
        else:
            assert np.array_equal(python[name], values), name


def comparison() -> str:
    versions = [f"{name} {importlib.metadata.version(name)}" for name in ("numba", "llvmlite")]
    kind = ", ".join([own_target(), *processors()[:1], *versions])
    return f"{kind}: {source_digest()}"


def compared() -> list[str]:
    """Comparisons of these kernels, each of another kind of machine."""
    lines = COMPARED.read_text("utf-8").splitlines() if COMPARED.exists() else []
    return [line for line in lines if line.endswith(f": {source_digest()}")]


@pytest.mark.slow
def test_numba_answers_the_same_to_the_bit(native, tmp_path):
    """Not optimised, which takes less time: nothing may be reordered at any level."""
    pytest.importorskip("numba")
    if comparison() in compared():
        pytest.skip(f"these kernels were compared already: {COMPARED.name}")
    jit, _ = answers(tmp_path / "here", "jit")
    for name, values in native[0].items():
        assert np.array_equal(jit[name], values, equal_nan=values.dtype.kind == "f"), name
    if not os.environ.get("CI"):
        COMPARED.write_text("".join(f"{line}\n" for line in [*compared(), comparison()]), "utf-8")


def test_an_unknown_way_is_refused(monkeypatch):
    done = subprocess.run(
        [sys.executable, "-c", "from whichroad._compile import kernel_mode; kernel_mode()"],
        env=os.environ | {"WHICHROAD_KERNELS": "fast"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "'fast'; native, jit, python or nothing was expected" in done.stderr
