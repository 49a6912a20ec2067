"""Where the page's files lie: ours, and those of MapLibre."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

from ..errors import SettingError
from ..native.cache import cache_folder

STATIC = Path(__file__).parent / "static"
PACKED = Path(__file__).parent / "maplibre"  # in wheels
SCRIPT = "maplibre-gl.js"


def kept_folder() -> Path | None:
    """Where checkouts keep MapLibre's versions, or None: nothing can be kept."""
    kernels = cache_folder()
    return None if kernels is None else kernels.parent / "maplibre"


def maplibre_folder() -> Path:
    """Where MapLibre GL lies: in the wheel, the user's cache, or the package `maplibre`.

    Raises:
        SettingError: It is in none of them.
    """
    for folder in _places():
        if (folder / SCRIPT).is_file():
            return folder
    raise SettingError(
        "maplibre: the map's drawing library is not in this installation, which was built without "
        'npm; it was expected for the page; pip install "whichroad[maplibre]"'
    )


def _places() -> Iterator[Path]:
    yield PACKED
    kept = kept_folder()
    if kept is not None and kept.is_dir():
        yield from sorted(kept.iterdir(), key=_version, reverse=True)
    spec = importlib.util.find_spec("maplibre")  # found without importing it
    for place in (spec.submodule_search_locations or []) if spec else []:
        yield Path(place) / "srcjs"


def _version(folder: Path) -> list[int]:
    return [int(part) for part in folder.name.rpartition("-")[2].split(".") if part.isdigit()]
