"""What all tests share: reproducible random examples, and where the real data lies."""

import os
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
