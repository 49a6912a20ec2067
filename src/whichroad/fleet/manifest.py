"""What a run was asked for: written before its first unit, and compared when it goes on."""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import ReadError, WriteError
from ..settings import Settings, Vehicle
from ..wording import counted
from .inputs import Inputs
from .work import SCHEMA_VERSION, Task
from .work_units import Piece, Unit

NAME = "manifest.json"
_MOST = 5  # files of each kind that are named


def asked(task: Task, inputs: Inputs, order: str, identity: dict[str, Any]) -> dict[str, Any]:
    """All that the answer depends on, as JSON can hold it."""
    plain = {
        "schema": SCHEMA_VERSION.decode(),
        "version": __version__,
        "map": identity,
        "inputs": inputs.stamps(),
        "trip_id": task.trip_id,
        "columns": dict(task.columns),
        "tz": task.tz,
        "dates": task.dates,
        "order": order,
        "split_s": task.split,
        "points": task.points,
        "lag": task.lag,
        "crs": None if task.crs is None else str(task.crs),
        "vehicle": asdict(task.vehicle or Vehicle()),
        "sensors": [repr(sensor) for sensor in task.sensors],
        "places": None if task.places is None else [task.places, os.stat(task.places).st_size],
        "settings": asdict(task.settings or Settings()),
    }
    whole: dict[str, Any] = json.loads(json.dumps(plain, default=str))
    return whole


def write(out: Path, settings: dict[str, Any], units: list[Unit]) -> None:
    """Write the manifest beside and rename it.

    Raises:
        WriteError: The folder cannot be written to.
    """
    text = json.dumps({**settings, "units": units}, indent=1)
    try:
        beside = out / f".{NAME}.{os.getpid()}"
        beside.write_text(text, "utf-8")
        os.replace(beside, out / NAME)
    except OSError as error:
        raise WriteError(
            f"{out}: cannot be written to ({error.strerror}); choose another"
        ) from None


def read(out: Path) -> tuple[dict[str, Any], list[Unit]] | None:
    """What the run in a folder was asked for, and its units; None: there is none.

    Raises:
        ReadError: The manifest is damaged.
    """
    path = out / NAME
    if not path.exists():
        return None
    try:
        held = json.loads(path.read_text("utf-8"))
        units = [
            Unit(name, rows, tuple(Piece(*piece) for piece in pieces))
            for name, rows, pieces in held.pop("units")
        ]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ReadError(
            f"{path}: cannot be read ({error}); the manifest of a run was expected; choose another "
            "folder"
        ) from None
    return held, units


def said_of_end(out: Path) -> str:
    """What to say of a run that was interrupted: how far it is, and how to go on."""
    held = read(out)
    if held is None:
        return "interrupted before the first unit of work; go on by --resume"
    done = sum((out / "drives" / f"{unit.name}.parquet").exists() for unit in held[1])
    return f"interrupted: {done:,} of {counted(len(held[1]), 'unit')} done; go on by --resume"


def check_same(out: Path, held: dict[str, Any], now: dict[str, Any]) -> None:
    """Refuse to go on with other settings.

    Raises:
        WriteError: They differ; the message names what.
    """
    differs = [name for name in now if held.get(name) != now[name]]
    if differs:
        one = differs[0]
        before = held.get(one)
        said = (
            _changed(before, now[one]) if one == "inputs" and isinstance(before, list)
            else f"{one}: {_short(before)}, now {_short(now[one])}"
        )  # fmt: skip
        raise WriteError(
            f"{out}: its run was asked for with other {', '.join(differs)} ({said}); the same was "
            "expected by --resume; give the same again, or another folder"
        )


def _changed(before: list[list[Any]], now: list[list[Any]]) -> str:
    """Which files and queries came, went, or are others, by their stamps."""
    old, new = ({one[0]: one[1:] for one in stamps} for stamps in (before, now))
    kinds = {
        "added": [name for name in new if name not in old],
        "removed": [name for name in old if name not in new],
        "changed": [name for name in new if name in old and old[name] != new[name]],
    }
    return "; ".join(f"{kind}: {_named(names)}" for kind, names in kinds.items() if names)


def _named(names: list[str]) -> str:
    more = f", and {len(names) - _MOST:,} more" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + more


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
