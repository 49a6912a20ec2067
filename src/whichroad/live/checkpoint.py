"""What the filter knows, on disk twice a second, so that a crash costs less than one."""

import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import WriteError
from ..online import Localizer
from .decode import CanStream
from .state import bridge, fingerprint, from_bytes, restore, state_of, to_bytes

EVERY = 0.5  # s
OLDEST = 60.0  # s after which a state says nothing about where the vehicle is
_FORMAT = 1


class Checkpoint:
    """One file that always holds a whole state.

    Args:
        path: The file; its folder must be writable.
        localizer: Whose state it is.
        buses: Streams whose counters are kept with it, by name.

    Attributes:
        counted: What `CanStream.resume` takes of each stream of the state taken up.

    Raises:
        WriteError: The folder cannot be written to.
    """

    def __init__(
        self, path: Path, localizer: Localizer, buses: Mapping[str, CanStream] | None = None
    ) -> None:
        self._path, self._localizer = path, localizer
        self._buses = {} if buses is None else buses
        self.counted: dict[str, dict[str, list[float]]] = {}
        self._map = fingerprint(localizer.roads)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
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

    def taken(self) -> Callable[[], None]:
        """The state that is, as a call that writes it: from any thread, one at a time."""
        state = state_of(self._localizer)
        about = {
            "format": _FORMAT, "map": self._map, "lag": self._localizer.lag,
            "written": time.time(),
            "counted": {name: stream.counted() for name, stream in self._buses.items()},
        }  # fmt: skip

        def write() -> None:
            part = self._part
            part.write_bytes(to_bytes(state, about))
            os.replace(part, self._path)

        return write

    def resume(self, *, replay: bool) -> tuple[float | None, str]:
        """Take up the state of the file, if it is one and not too old.

        Args:
            replay: Time is a recording's: the state is as good as it was.

        Returns:
            The event time that the filter is at (None: it starts anew), and why, in words.
        """
        try:
            found = from_bytes(self._path.read_bytes())
        except OSError:
            return None, "there is no earlier state"
        if found is None:
            return None, "the earlier state is damaged; starting anew"
        state, about = found
        age = 0.0 if replay else time.time() - about["written"]
        if about.get("format") != _FORMAT or about.get("map") != self._map:
            return None, "the earlier state is of another map or version; starting anew"
        if about.get("lag") != self._localizer.lag:
            return None, "the earlier state was kept with another --lag; starting anew"
        if not state.started:
            return None, "the earlier state knows nothing; starting anew"
        if not 0.0 <= age <= OLDEST:
            return None, f"the earlier state is {age:.0f} s old; starting anew"
        restore(self._localizer, state)
        self.counted = about.get("counted", {})
        if not replay:
            bridge(self._localizer, state.time + age)
        return state.time + age, f"resumed a state {age:.1f} s old"
