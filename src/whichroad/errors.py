"""What can go wrong, as one small tree.

    WhichroadError
    ├── ReadError      a file could not be understood (names file and line)
    ├── MapError       the road map cannot serve, or is not a map
    ├── DriveError     nothing in the drive could be answered
    ├── WriteError     the output cannot be written
    ├── SettingError   a setting is out of bounds or contradicts another (also a ValueError)
    └── NetworkError   a network of `whichroad.exact`, its evidence or a question about it makes
                       no sense (also a ValueError; defined there)

Every message reads `where: what was seen; what was expected; what to do`.
"""

import errno
import re
from collections.abc import Iterator
from contextlib import contextmanager

_FULL = (errno.ENOSPC, errno.EDQUOT)
_SCALAR = re.compile(r"\bnp\.(?:float|int|uint|bool|str|datetime|timedelta)\d*_?\(([^()]*)\)")


class WhichroadError(Exception):
    """Base of every error that whichroad raises on purpose; numbers of NumPy read as numbers."""

    def __init__(self, message: object = "", *more: object) -> None:
        text = _SCALAR.sub(r"\1", message) if isinstance(message, str) else message
        super().__init__(text, *more)


class ReadError(WhichroadError):
    """A file or stream could not be understood."""


class MapError(WhichroadError):
    """The road map cannot serve this drive, or is not a road map."""


class DriveError(WhichroadError):
    """Nothing in the drive could be answered."""


class WriteError(WhichroadError):
    """An output cannot be written."""


class SettingError(WhichroadError, ValueError):
    """A setting is out of bounds or contradicts another."""


def first_line(error: Exception) -> str:
    """What another library's error says, in one line; its kind where it says nothing."""
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def refused(path: object, error: OSError, else_: str) -> WriteError:
    """The error of an output that the system refuses: a full disk is called one.

    Args:
        path: The output.
        error: What the system said.
        else_: What was expected and what to do where the disk is not full.
    """
    if error.errno in _FULL:
        return WriteError(
            f"{path}: the disk is full; space for the whole output was expected; make space, or "
            "choose another disk"
        )
    return WriteError(f"{path}: cannot be written ({error.strerror or error}); {else_}")


@contextmanager
def comes_with(extra: str, what: str) -> Iterator[None]:
    """What is imported within comes with an extra of the package.

    Args:
        extra: Its name.
        what: What needs it, for the error.

    Raises:
        SettingError: One of the packages is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        raise SettingError(
            f"{what}: the package {package} is missing; it was expected for this; install it by "
            f'pip install "whichroad[{extra}]", or ".[{extra}]" in the source folder'
        ) from None
