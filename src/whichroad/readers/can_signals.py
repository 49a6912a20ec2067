"""Signals of a .dbc that a vehicle names, and in which frames they are."""

import difflib
from collections.abc import Iterable
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from ..errors import ReadError, comes_with
from ..settings import Vehicle
from .can_frames import EXTENDED, Names, key
from .checks import Skipped, counted_warnings, listed
from .j1939 import Senders, bare, group_of
from .names import SENSED


class Signal(NamedTuple):
    """A signal of the .dbc and where it is in its frame."""

    name: str
    frame: int  # as `can_frames.key` makes it; of J1939 as `j1939.bare` does
    about: Any  # cantools' description
    message: Any
    j1939: bool = False

    @property
    def where(self) -> str:
        """Its frame and the id in the .dbc, for people."""
        message = self.message
        group = f", PGN {group_of(self.frame)}" if self.j1939 else ""
        digits = 8 if message.is_extended_frame else 3
        return f"{message.name} ({message.frame_id:0{digits}X}{group})"


def find_signals(
    dbc: str | PathLike[str], vehicle: Vehicle, skipped: Skipped, columns: Iterable[str] = ()
) -> dict[str, Signal]:
    """Role -> signal, for the roles that the vehicle names, and columns of further sensors.

    Of messages or signals of one name the first counts.

    Raises:
        ReadError: The .dbc is not one, or does not know a signal; the closest are offered.
    """
    with comes_with("can", f"{Path(dbc).name}: a CAN database"):
        import cantools

    where = Path(dbc).name
    try:
        with counted_warnings("cantools", "message repeated in the .dbc", skipped):
            base: Any = cantools.database.load_file(str(dbc))
        messages = base.messages
    except Exception as error:  # cantools lets out whatever its parsers meet
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ReadError(f"{where}: not a CAN database ({first}); a .dbc was expected") from None
    known = {
        name: Signal(signal.name, _frame(m), signal, m, _is_j1939(m))
        for m in reversed(messages)
        for signal in m.signals
        for name in (f"{m.name}.{signal.name}", signal.name)
    }
    roles = {r: n for r, n in vehicle.signals.items() if r != "reverse_value"}
    further = {alias: vehicle.sensors.get(alias.removeprefix(SENSED)) for alias in columns}
    roles |= {alias: name for alias, name in further.items() if name and alias.startswith(SENSED)}
    names = sorted({s.name for s in known.values()})
    if not roles:
        raise ReadError(
            f"{where}: the vehicle names no [signals]; a vehicle.toml (--vehicle) was expected "
            'with lines such as wheel_rl_ticks = "SIGNAL" under [signals]; the .dbc offers '
            f"{listed(names, 40)}"
        )
    found = {}
    for role, name in roles.items():
        part = "[sensors]" if role.startswith(SENSED) else "[signals]"
        about = f"{where}: {part} {role.removeprefix(SENSED)} of the vehicle is {name!r}"
        if name not in known:
            close = difflib.get_close_matches(name, names, 3, 0.5)
            hint = f"did you mean {' or '.join(close)}? " if close else ""
            raise ReadError(
                f"{about}, which this .dbc does not know; {hint}it offers {listed(names, 40)}"
            )
        signal = known[name]
        if signal.about.multiplexer_ids:
            raise ReadError(
                f"{about}, a multiplexed signal; "
                "a signal that is in every frame of its message was expected"
            )
        found[role] = signal
    return found


def _is_j1939(message: Any) -> bool:
    return message.protocol == "j1939" and bool(message.is_extended_frame)


def _frame(message: Any) -> int:
    if _is_j1939(message):
        return bare(message.frame_id)
    return key(message.frame_id, message.is_extended_frame)


def names_of(signals: dict[str, Signal]) -> Names:
    """Under which id frames are kept; of ids of 29 bits all of the same group of J1939 are."""
    exact = {s.frame for s in signals.values() if not s.j1939}
    groups = {group_of(s.frame) for s in signals.values() if s.message.is_extended_frame}

    @lru_cache(4096)
    def name(frame: int) -> int | None:
        if frame in exact:
            return frame
        return bare(frame) if frame & EXTENDED and group_of(frame) in groups else None

    return name


def senders_of(signals: dict[str, Signal]) -> Senders:
    """Who sends the messages of J1939 that are needed."""
    return Senders({s.frame: s.message for s in signals.values() if s.j1939}.values())
