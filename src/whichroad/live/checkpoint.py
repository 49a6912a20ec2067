"""What the filter knows, on disk twice a second, so that a crash costs less than one."""

import json
import math
import os
import struct
import time
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..errors import MapError, ReadError, SettingError, WriteError
from ..online import Localizer, State
from ..writers import check_place
from .decode import CanStream

EVERY = 0.5  # s
OLDEST = 60.0  # s after which a state says nothing about where the vehicle is
_MAGIC = b"whichroad service 5\n"
_NUMBERS = struct.Struct("<II")  # check sum of all that follows, length of the JSON


class Checkpoint:
    """One file that always holds a whole state.

    Args:
        path: The file; its folder must be there and writable.
        localizer: Whose state it is.
        buses: Streams whose counters are kept with it, by name.

    Attributes:
        counted: What `CanStream.resume` takes of each stream of the state taken up.
        age: s since the state taken up was written.
        published: Time of the newest estimate that was published before it was written, s;
            -inf: none was.

    Raises:
        WriteError: The folder cannot be written to.
    """

    def __init__(
        self, path: Path, localizer: Localizer, buses: Mapping[str, CanStream] | None = None
    ) -> None:
        self._path, self._localizer = path, localizer
        self._buses = {} if buses is None else buses
        self.counted: dict[str, dict[str, list[float]]] = {}
        self.age, self.published = 0.0, -math.inf
        check_place(path, force=True)
        try:
            self._part.write_bytes(b"")
            self._part.unlink()
        except OSError as error:
            raise WriteError(
                f"{path}: cannot be written ({error.strerror}); a file in a writable folder was "
                "expected; choose another with --state"
            ) from None

    @property
    def _part(self) -> Path:
        return self._path.with_name(self._path.name + ".part")

    def taken(self, published: float = -math.inf) -> Callable[[], None]:
        """The state that is, as a call that writes it: from any thread, one at a time.

        The call raises OSError where it cannot.  The file then holds the state before.

        Args:
            published: Time of the newest published estimate, s.
        """
        state = self._localizer.state()
        about = {
            "written": time.time(),
            "published": published if math.isfinite(published) else None,
            "counted": {name: stream.counted() for name, stream in self._buses.items()},
        }

        def write() -> None:
            part = self._part
            part.write_bytes(_with(about, state.to_bytes()))
            os.replace(part, self._path)

        return write

    def resume(self, *, replay: bool) -> tuple[float | None, str]:
        """Take up the state of the file, if it is one and not too old.

        Args:
            replay: Time is a recording's: the state is as good as it was.

        Returns:
            The event time that the filter is at (None: it starts anew), and why, in words.
            It is left there: the first observation ends the pause.
        """
        try:
            about, data = read_checkpoint(self._path)
            state = State.from_bytes(data)
        except OSError:
            return None, "there is no earlier state"
        except ReadError:
            return None, "the earlier state is damaged, or of another version; starting anew"
        age = 0.0 if replay else time.time() - about["written"]
        if state.made.lag != self._localizer.lag:
            return None, "the earlier state was kept with another --lag; starting anew"
        if not state.count:
            return None, "the earlier state has no pose yet; starting anew"
        if not 0.0 <= age <= OLDEST:
            return None, f"the earlier state is {age:.0f} s old; starting anew"
        try:
            self._localizer.restore(state)
        except MapError:
            return None, "the earlier state is of another map; starting anew"
        except SettingError:
            return None, "the earlier state is of another vehicle or other sensors; starting anew"
        self.counted, self.age = about["counted"], age
        known = about.get("published")
        self.published = -math.inf if known is None else known
        return state.time, f"resumed a state {age:.1f} s old"


def _with(about: dict[str, Any], state: bytes) -> bytes:
    """What is said about a state, and the state, as bytes that tell when they are damaged."""
    text = json.dumps(about).encode()
    numbers = struct.pack("<I", len(text))
    return _MAGIC + _NUMBERS.pack(zlib.crc32(numbers + text), len(text)) + text + state


def read_checkpoint(path: Path) -> tuple[dict[str, Any], bytes]:
    """What is said about the state in a file, and the state as `State.from_bytes` takes it.

    Raises:
        OSError: There is no such file.
        ReadError: It is damaged, or something else.
    """
    data = path.read_bytes()
    begin = len(_MAGIC) + _NUMBERS.size
    if data.startswith(_MAGIC) and len(data) >= begin:
        check, size = _NUMBERS.unpack_from(data, len(_MAGIC))
        if zlib.crc32(data[begin - 4 : begin + size]) == check:
            return json.loads(data[begin : begin + size]), data[begin + size :]
    raise ReadError(f"{path}: {len(data):,} bytes that are damaged or no state of the service")
