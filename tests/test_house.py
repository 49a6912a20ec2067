"""House rules: the public names, the contracts, and that the documents speak the truth."""

import ast
import functools
import importlib
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import whichroad

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src" / "whichroad").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py")) + sorted((ROOT / "benchmarks").rglob("*.py"))
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
DOCUMENTS += sorted((ROOT / "benchmarks").rglob("*.md"))

PUBLIC = [
    "calibrate",
    "match",
    "match_many",
    "map_of",
    "speeds",
    "RoadMap",
    "Localizer",
    "Estimate",
    "Hypothesis",
    "Places",
    "Pose",
    "RelativePlace",
    "GeoFix",
    "WheelTicks",
    "WheelSpeed",
    "Distance",
    "SpeedYaw",
    "YawRate",
    "StartPose",
    "Settings",
    "Vehicle",
    "read_drive",
    "read_vehicle",
    "simulate_drive",
    "diagnose",
    "Result",
    "WhichroadError",
    "ReadError",
    "MapError",
    "DriveError",
    "WriteError",
    "SettingError",
]

HEAVY = [
    "numpy",
    "numba",
    "llvmlite",
    "pandas",
    "geopandas",
    "pyarrow",
    "shapely",
    "pyproj",
    "osmium",
    "matplotlib",
    "can",
    "cantools",
]


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """What a module holds, which nobody changes."""
    return ast.parse(path.read_text("utf-8"))


def title(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


# The surface


def test_the_public_names_are_these_and_no_others():
    assert sorted(whichroad.__all__) == sorted(PUBLIC)
    assert set(PUBLIC) <= set(dir(whichroad))


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_can_be_imported_and_says_what_it_is(name: str):
    assert getattr(whichroad, name).__doc__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = whichroad.no_such_name


@pytest.mark.parametrize("module", ["whichroad", "whichroad.cli"])
def test_importing_the_front_door_imports_nothing_heavy(module: str):
    code = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(HEAVY) & set(done.stdout.split()) == set()


def test_help_imports_nothing_heavy():
    code = "import sys; from whichroad.cli import main\ntry: main()\nfinally: print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=True
    )
    assert set(HEAVY) & set(done.stdout.split()) == set()


def test_the_process_of_a_posted_trace_does_not_import_what_serves():
    code = "import sys, whichroad.live.trace_worker; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"starlette", "uvicorn", "asyncio"} & set(done.stdout.split()) == set()


# The floors


def test_imports_go_down_only():
    assert importlib.util.find_spec("importlinter"), (
        'import-linter is missing: pip install ".[dev]"'
    )
    code = "from importlinter.cli import lint_imports_command as c; c()"
    done = subprocess.run(
        [sys.executable, "-c", code, "--no-cache"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def exported(tree: ast.Module) -> list[ast.AST]:
    """The module, its public functions and classes, and their public methods."""
    found: list[ast.AST] = [tree]
    for node in tree.body:
        if _is_public(node):
            found.append(node)
            if isinstance(node, ast.ClassDef):
                found += [n for n in node.body if _is_public(n)]
    return found


def _is_public(node: ast.stmt) -> bool:
    if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
        return False
    return "overload" not in [ast.unparse(d) for d in node.decorator_list]


def test_what_is_public_has_a_docstring():
    nodes = ((path, node) for path in SOURCES for node in exported(tree_of(path)))
    bare = [(title(p), getattr(n, "name", "")) for p, n in nodes if not ast.get_docstring(n)]
    assert bare == []


def kernels() -> list[ast.FunctionDef]:
    """All kernels of the compiled core."""
    found = []
    for folder in ("filter", "graph"):
        for path in sorted((ROOT / "src" / "whichroad" / folder).rglob("*.py")):
            for node in tree_of(path).body:
                marks = [ast.unparse(d) for d in getattr(node, "decorator_list", [])]
                if any(mark.startswith(("kernel", "entry")) for mark in marks):
                    assert isinstance(node, ast.FunctionDef)
                    found.append(node)
    return found


def test_kernels_take_at_most_eight_arguments():
    assert len(kernels()) > 200
    assert [k.name for k in kernels() if len(k.args.args) > 8] == []


def test_only_what_adds_up_row_by_row_is_longer_than_forty_lines():
    long = []
    for kernel in kernels():
        body = kernel.body[1:] if ast.get_docstring(kernel) else kernel.body
        if (body[-1].end_lineno or 0) - body[0].lineno + 1 > 40:
            long.append(kernel.name)
    assert set(long) <= {
        "_average_energy", "_covariances", "_road_noise", "observe_position", "predict_plane",
        "predict_road",
    }  # fmt: skip


LINES = 400
# files whose length was discussed: one algorithm each, which reads worse in two files
DISCUSSED: dict[str, int] = {
    "src/whichroad/graph/route_search.py": 500,
    "src/whichroad/filter/lookback/smoother.py": 420,
    "src/whichroad/filter/state.py": 420,
}


def test_a_module_is_short():
    lines = {title(path): len(path.read_text("utf-8").splitlines()) for path in SOURCES}
    assert {name: n for name, n in lines.items() if n > DISCUSSED.get(name, LINES)} == {}


def test_no_module_is_a_drawer_for_odds_and_ends():
    drawers = {"utils", "util", "helpers", "helper", "common", "base", "misc"}
    assert [title(path) for path in SOURCES if path.stem in drawers] == []


def test_library_code_neither_prints_nor_exits():
    ends = {"print", "exit", "quit", "sys.exit", "os._exit"}
    library = [p for p in SOURCES if p.parent.name != "cli" and p.stem != "__main__"]
    calls = [
        f"{title(path)}, line {node.lineno}"
        for path in library
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ends
    ]
    assert calls == []


# Degrees

CONVERSIONS = {"radians", "degrees", "deg2rad", "rad2deg"}
TURNS = {180, 360, 3.6, 1852}  # degrees of a turn and its half, km/h and knots of m/s


# Words of our own for which filtering, tracking and graphs have theirs
OWN_WORDS = {
    "said", "told", "tell", "tells", "say", "says", "room", "rooms", "stay", "stays", "doubt",
    "spread", "wander", "quick", "fresh", "drove", "travel", "travelled", "memory", "gone", "cut",
    "remember", "recall", "retrace", "look", "parcel", "fleet", "together",
}  # fmt: skip
CORE = ("filter", "graph", "native", "batch", "online")


def names_of(tree: ast.AST) -> set[str]:
    """The names that a module gives, or uses as attributes."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name | ast.Attribute | ast.arg | ast.FunctionDef | ast.ClassDef):
            found.add(
                getattr(node, "id", None) or getattr(node, "attr", None)
                or getattr(node, "arg", None) or getattr(node, "name", "")
            )  # fmt: skip
    return found


def test_names_in_the_core_are_the_fields_own():
    own = {
        name for path in SOURCES if {*path.parts} & {*CORE} for name in names_of(tree_of(path))
        if OWN_WORDS & set(name.strip("_").lower().split("_"))
    }  # fmt: skip
    assert own - {"travel_variance", "paper_stay"} == set()  # fields of records


def converts(node: ast.AST) -> bool:
    """Whether an expression converts degrees, or a unit of speed, by itself."""
    if isinstance(node, ast.Attribute):
        return node.attr in CONVERSIONS and ast.unparse(node.value) in {"math", "np", "numpy"}
    if isinstance(node, ast.ImportFrom):
        names = {alias.name for alias in node.names}
        return node.module in {"math", "numpy"} and bool(CONVERSIONS & names)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div | ast.Mod):
        sides = [side.value for side in (node.left, node.right) if isinstance(side, ast.Constant)]
        return any(side in TURNS for side in sides if isinstance(side, int | float))
    return False


def test_degrees_are_converted_by_geodesy_alone():
    others = [path for path in SOURCES if path.parent.name != "geodesy"]
    found = [(p, node) for p in others for node in ast.walk(tree_of(p)) if converts(node)]
    assert [f"{title(p)}, line {node.lineno}: {ast.unparse(node)}" for p, node in found] == []


# No file may name the machine that it was written on.
PRIVATE = re.compile(
    "|".join(["/" + "root/", "/" + "work/", "/" + "tmp/w/", "/" + "home/", "C:" + r"\\"])
)


def test_no_file_names_a_path_of_one_machine():
    files = [*SOURCES, *TESTS, *DOCUMENTS, ROOT / "pyproject.toml", ROOT / ".ci" / "run"]
    assert [title(path) for path in files if PRIVATE.search(path.read_text("utf-8"))] == []


# The documents

NAME = re.compile(r"`([a-z_]+(?:\.[A-Za-z_][A-Za-z_0-9]*)+)(?:\(\))?`")
SUFFIXES = [
    "md",
    "toml",
    "py",
    "csv",
    "parquet",
    "json",
    "geojson",
    "gpx",
    "osm",
    "pbf",
    "gz",
    "bz2",
    "nmea",
    "log",
    "dbc",
    "png",
    "wkt",
    "txt",
]
FILE = re.compile(r"`((?:src|tests|docs|benchmarks|\.ci)/[\w./-]*)`")
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")


def resolve(name: str) -> object:
    """The object that `room.function` names inside whichroad."""
    parts = name.removeprefix("whichroad.").split(".")
    thing: object = whichroad
    path = "whichroad"
    for part in parts:
        path = f"{path}.{part}"
        thing = getattr(thing, part) if hasattr(thing, part) else importlib.import_module(path)
    return thing


def names(path: Path) -> list[str]:
    found = NAME.findall(path.read_text("utf-8"))
    return sorted({n for n in found if n.rpartition(".")[2] not in SUFFIXES})


@pytest.mark.parametrize(
    "document",
    [
        "docs/model.md",
        "docs/sensors-that-fail.md",
        "docs/architecture.md",
        "docs/glossary.md",
        *(f"docs/model/{path.name}" for path in sorted((ROOT / "docs" / "model").iterdir())),
    ],
)
def test_what_the_documents_name_exists(document: str):
    missing = []
    for name in names(ROOT / document):
        try:
            resolve(name)
        except (ImportError, AttributeError):
            missing.append(name)
    assert missing == []


@pytest.mark.parametrize("path", DOCUMENTS, ids=title)
def test_files_and_links_of_a_document_exist(path: Path):
    text = path.read_text("utf-8")
    missing = [f for f in FILE.findall(text) if not (ROOT / f).exists()]
    missing += [f for f in LINK.findall(text) if not (path.parent / f).exists()]
    assert missing == []
