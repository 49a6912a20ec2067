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

# The first example of a kernel's law pays for compiling the kernel.
settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")

ROOT = Path(__file__).parents[1]

# Files that take long, the longest first.  They are begun before the others, so that none is left
# for the end, when one worker would run it and the other would wait.
LONG = (
    "native/test_ways.py", "live/test_traces.py", "serving/test_service.py", "fleet/test_spark.py",
    "laws/test_smoothing.py", "laws/test_asking_often.py", "documents/test_blocks.py",
    "page/test_browser.py", "fleet/test_fleet.py", "laws/test_evidence.py", "page/test_layout.py",
    "experiments/test_experiments.py", "live/test_service.py", "live/test_access.py",
    "simulate/test_vectorised.py", "global_start/test_search.py", "live/test_crash.py",
    "live/test_web.py", "filter/test_vetting.py", "laws/test_world.py", "laws/test_doubt.py",
    "test_cli.py", "experiments/test_other_answers.py", "page/test_explore.py",
    "graph/test_search.py", "native/test_jit.py", "filter/test_gnss_update.py", "test_house.py",
    "laws/test_digitising.py", "documents/test_words.py", "page/test_commands.py",
    "roadmap/test_openlr.py", "test_lineage.py", "exact/test_particles.py",
    "simulate/test_honesty.py", "readers/test_can.py", "laws/test_probability.py", "test_plots.py",
    "roadmap/test_overture.py", "filter/test_branching.py", "simulate/test_simulated_drive.py",
    "fleet/test_batches.py", "readers/test_units.py", "readers/test_tools.py", "live/test_time.py",
    "scenes/test_paper_scenes.py", "test_smoother.py", "worlds/test_sumo.py",
    "laws/test_standing.py", "test_batch.py", "live/test_receiver_sensors.py",
    "roadmap/test_refusals.py", "graph/test_index.py", "filter/test_smoother.py",
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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files that take long first."""
    place = {ROOT / "tests" / name: k for k, name in enumerate(LONG)}
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
