"""What all tests share: reproducible random examples, and where the real data lies."""

import gc
import os
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from whichroad import RoadMap

os.environ.setdefault("MPLBACKEND", "Agg")
# Matrices are small here, and another worker has the other processor: a second thread only waits.
# Before NumPy is imported; processes that tests start inherit it.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The first example of a kernel's law pays for compiling the kernel.
settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")

ROOT = Path(__file__).parents[1]

# Files that take long, the longest first.  They are begun before the others, so that none is left
# for the end, when one worker would run it and the other would wait.
LONG = (
    "native/test_ways.py", "live/test_traces.py", "page/test_browser.py",
    "experiments/test_experiments.py", "fleet/test_spark.py", "page/test_layout.py",
    "documents/test_blocks.py", "live/test_service.py", "fleet/test_fleet.py",
    "live/test_access.py", "laws/test_smoothing.py", "laws/test_digitising.py",
    "laws/test_evidence.py", "live/test_web.py", "laws/test_asking_often.py", "live/test_crash.py",
    "worlds/test_sumo.py", "laws/test_world.py", "serving/test_service.py", "page/test_commands.py",
    "test_cli.py", "simulate/test_vectorised.py", "page/test_explore.py", "filter/test_smoother.py",
    "laws/test_probability.py", "roadmap/test_overture.py", "native/test_jit.py",
    "laws/test_doubt.py", "documents/test_notebooks.py", "test_plots.py", "live/test_time.py",
    "filter/test_branching.py", "global_start/test_search.py", "exact/test_particles.py",
    "page/test_report.py", "readers/test_can.py", "roadmap/test_openlr.py",
    "experiments/test_other_answers.py", "simulate/test_simulated_drive.py",
    "live/test_receiver_sensors.py", "simulate/test_honesty.py", "scenes/test_paper_scenes.py",
    "scenes/test_consistency.py", "roadmap/test_refusals.py", "filter/test_estimate.py",
    "filter/test_vetting.py", "filter/test_step.py", "roadmap/test_laws.py", "page/test_beside.py",
    "laws/test_standing.py", "fleet/test_batches.py", "readers/test_units.py",
    "live/test_vehicles.py", "worlds/test_sensors.py", "calibration/test_calibrate.py",
    "laws/test_time.py", "filter/test_gnss_update.py",
)  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    """Let workers take files in the order below: xdist's own begins with those of many tests."""
    config.option.loadscopereorder = False


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage meanwhile, and later not among what stays: modules and tests."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let every other worker begin with the last file: each reads what the others compiled."""
    report = yield
    number = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    if isinstance(collector, pytest.Directory) and int(number) % 2:
        report.result.reverse()
    return report


@pytest.hookimpl(tryfirst=True)  # what pytest itself sorts by is the same in all workers then
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take long first, and the others in one order for all workers."""
    place = {ROOT / "tests" / name: k for k, name in enumerate(LONG)}
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: item.path)
    items.sort(key=lambda item: place.get(item.path, len(LONG)))


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real data; tests that use it are marked `data`."""
    folder = Path(os.environ.get("WHICHROAD_DATA") or ROOT.parent / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"the real data is not here: {folder} (set WHICHROAD_DATA)")
    return folder


@pytest.fixture(scope="session")
def town(tmp_path_factory: pytest.TempPathFactory) -> "RoadMap":
    """The map of the small drawn town of the demo; nobody changes it."""
    from whichroad import RoadMap
    from whichroad.simulate import draw_town

    path = tmp_path_factory.mktemp("town") / "town.osm"
    path.write_text(draw_town(), encoding="utf-8")
    return RoadMap.from_osm(path)
