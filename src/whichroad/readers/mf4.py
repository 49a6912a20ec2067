"""MF4 files by asammdf, in a process of its own: a damaged file may keep asammdf busy for ever."""

import importlib.util
import io
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..errors import ReadError
from . import mf4_worker
from .checks import Skipped, read_bytes

LEAST_TIME = 30.0  # s for a file of no size; asammdf alone takes two to start
_TIME_PER_BYTE = 10e-6  # s; asammdf needs 0.1 to 1 µs

Message = tuple[float, int, bool, bytes, bool]  # time, id, 29 bits, data, is a data frame


def messages(path: Path, skipped: Skipped) -> Iterator[Message]:
    """The CAN frames of an MF4 file.

    Args:
        path: The file.
        skipped: Where messages of asammdf are counted.

    Raises:
        ReadError: A package is missing, the file is damaged, or asammdf came to no end.
    """
    for package, extra in (("can", "can"), ("asammdf", "mf4")):
        if not _installed(package):
            raise ReadError(
                f"{path.name}: MF4; the package {package} is needed to read it; "
                f'pip install "whichroad[{extra}]"'
            )
    size = len(read_bytes(path))
    seconds = LEAST_TIME + _TIME_PER_BYTE * size
    # -P: the folder of the program holds modules with the names of packages
    command = [sys.executable, "-P", mf4_worker.__file__, str(path.resolve())]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ReadError(
            f"{path.name}: asammdf came to no end within {seconds:.0f} s; a sound MF4 file was "
            "expected; this one is probably damaged"
        ) from None
    if not done.stdout.startswith(b"PK"):
        kind, said = json.loads(done.stdout) if done.stdout else ("stopped", "no answer came")
        raise ReadError(
            f"{path.name}: MF4 cannot be read ({kind}: {said}); a CAN log in MF4 was expected"
        )
    with np.load(io.BytesIO(done.stdout)) as found:
        columns = {name: found[name] for name in found.files}
    if columns["not_understood"][0]:
        skipped["part of the log not understood"] += int(columns["not_understood"][0])
    ends = np.cumsum(columns["length"])
    data = columns["data"].tobytes()
    for time, identifier, extended, begin, end, is_data in zip(
        columns["time"].tolist(),
        columns["id"].tolist(),
        columns["extended"].tolist(),
        (ends - columns["length"]).tolist(),
        ends.tolist(),
        columns["is_data"].tolist(),
        strict=True,
    ):
        yield time, identifier, extended, data[begin:end], is_data


def _installed(package: str) -> bool:
    if package in sys.modules:
        return sys.modules[package] is not None
    return importlib.util.find_spec(package) is not None
