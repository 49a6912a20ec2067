"""Where the page's files lie: ours, and those of MapLibre."""

import importlib.util
from pathlib import Path

from ..errors import SettingError

STATIC = Path(__file__).parent / "static"


def maplibre_folder() -> Path:
    """Where the package `maplibre` keeps MapLibre GL; found without importing it.

    Raises:
        SettingError: It is not installed.
    """
    spec = importlib.util.find_spec("maplibre")
    for place in (spec.submodule_search_locations or []) if spec else []:
        folder = Path(place) / "srcjs"
        if (folder / "maplibre-gl.js").is_file():
            return folder
    raise SettingError(
        "maplibre: the package that brings the map's drawing library is not installed; it was "
        'expected for the page; pip install "whichroad[live]"'
    )
