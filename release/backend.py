"""Build backend: setuptools, and into each wheel the compiled kernels and MapLibre GL.

`pip install .` builds the library for the machine itself, or takes the one that an earlier
install of the same kernels left in the user's cache.  An editable install builds none: that
happens at first use.  WHICHROAD_KERNELS=jit builds a wheel without a library.  MapLibre comes by
npm (`maplibre_gl.py`); without npm the wheel says at use how to get it.
"""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403 - what is not said here is setuptools' own

ROOT = Path(__file__).resolve().parent.parent
COMPILER = ["llvmlite>=0.45", "numpy>=2.0"]  # of kernels; they are imported with their records

Settings = dict[str, Any] | None


def _package() -> None:
    """Make the package of this folder the one that is imported."""
    if str(ROOT / "src") not in sys.path:
        sys.path.insert(0, str(ROOT / "src"))


def _without_library() -> bool:
    return os.environ.get("WHICHROAD_KERNELS") in {"jit", "python"}


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """What to install before a wheel can be built: no compiler where none is needed."""
    needed: list[str] = build_meta.get_requires_for_build_wheel(config_settings)
    if _without_library():
        return needed
    _package()
    from whichroad.native import cache, linking

    if cache.libraries(cache.source_digest(), cache.own_target()):
        return needed
    if linking.own_linker() is None:
        needed.append("ziglang")
    return [*needed, *COMPILER]


def build_wheel(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """A wheel for this machine."""
    if _without_library():
        name = str(build_meta.build_wheel(wheel_directory, config_settings, metadata_directory))
        _with_maplibre(Path(wheel_directory) / name)
        return name
    _package()
    from whichroad.errors import WhichroadError
    from whichroad.native import progress, wheel

    try:
        library = progress.build_own()
    except WhichroadError as error:
        raise SystemExit(str(error)) from None
    with tempfile.TemporaryDirectory() as folder:
        name = build_meta.build_wheel(folder, config_settings, metadata_directory)
        _with_maplibre(Path(folder) / name)
        made = wheel.with_library(
            Path(folder) / name, library, wheel.own_tag(), Path(wheel_directory)
        )
    return made.name


def build_editable(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """A wheel that points to this folder; MapLibre goes to the user's cache."""
    _maplibre()
    return str(build_meta.build_editable(wheel_directory, config_settings, metadata_directory))


def _maplibre() -> dict[str, bytes]:
    """MapLibre's files by name; none where they cannot be had, which is said."""
    _package()
    sys.path.insert(0, str(Path(__file__).parent))
    import maplibre_gl

    from whichroad.page.static_files import kept_folder

    with tempfile.TemporaryDirectory() as spare:
        try:
            place = maplibre_gl.bring(kept_folder() or Path(spare))
            return {name: (place / name).read_bytes() for name in maplibre_gl.FILES}
        except (OSError, ValueError) as error:
            print(f"the page is built without MapLibre GL: {error}", file=sys.stderr)
            return {}
        finally:
            sys.path.remove(str(Path(__file__).parent))


def _with_maplibre(path: Path) -> None:
    """Add MapLibre to a wheel."""
    files = {f"whichroad/page/maplibre/{name}": data for name, data in _maplibre().items()}
    if files:
        from whichroad.native import wheel

        wheel.with_files(path, files)
