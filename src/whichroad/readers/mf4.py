"""What asammdf prints about damaged MF4 files is counted instead."""

import gc
import importlib
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import ReadError
from .checks import Skipped, counted_warnings


def quietly(path: Path, skipped: Skipped, read: Callable[[], list[Any]]) -> list[Any]:
    """What reading an MF4 file gives, with nothing printed.

    asammdf's messages go to handlers of its own.  Files that it has half opened fail once more
    when they are deleted, which Python prints.

    Args:
        path: The file.
        skipped: Where messages are counted.
        read: Reads it.

    Raises:
        ReadError: The package asammdf is missing.
    """
    try:
        importlib.import_module("asammdf")
    except ModuleNotFoundError:
        raise ReadError(
            f"{path.name}: MF4; the package asammdf is needed to read it; "
            'pip install "whichroad[mf4]"'
        ) from None
    logger, hook = logging.getLogger("asammdf"), sys.unraisablehook
    before: tuple[Any, ...] = logger.handlers, logger.propagate
    logger.handlers, logger.propagate = [], False
    sys.unraisablehook = lambda unraisable: None
    try:
        with counted_warnings("asammdf", "part of the log not understood", skipped):
            return read()
    except Exception as error:
        held: BaseException | None = error
        while held is not None:  # what their frames hold is deleted now
            held.__traceback__, held = None, held.__context__
        gc.collect()
        raise
    finally:
        sys.unraisablehook = hook
        logger.handlers, logger.propagate = before
