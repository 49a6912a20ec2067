"""JSON: lists of records with places, wherever they lie in a file, as drives.

What is nested in a record is named by its path, `device.id`.  Lists that lie alike, as those of
several trips do, are parts of one table where ids tell drives apart.  Else each is a drive.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import compress
from typing import Any, NamedTuple

from ..observations import Drive
from .names import find
from .reading import Reading
from .source import Source
from .tracks import Track, drives_of_tracks

OTHER_LIST = "place in another list of the file"
_HOMES = re.compile(r"^(?:location|position|coords?|point|gps|latlng)\.")
_IDS = ("drive_id", "vehicle_id")  # quantities that a list may have from what stands beside it
_NAMES = ("name", "id")  # of the object that holds a list
_LOOKED_AT = 100  # records with places, in which other lists of places are looked for


class _Place(NamedTuple):
    """Where in a file something lies."""

    names: tuple[str, ...]  # keys, outermost first; in a list the object's own, or empty
    shape: tuple[str, ...]  # the same without names of objects
    ids: dict[str, Any]  # of trip and vehicle, that stand beside it or above

    def below(self, name: str, shape: str = "") -> "_Place":
        return self._replace(names=(*self.names, name), shape=(*self.shape, shape))


class _Part(NamedTuple):
    """A list of flat records with places."""

    rows: list[dict[str, Any]]
    at: _Place
    columns: frozenset[str]
    found: frozenset[str]  # the quantities of these


def drives_of_records(content: Any, source: Source, reading: Reading) -> list[Drive]:
    """The drives of the lists that lie alike and have most places, best with times.

    Args:
        content: Of the file.
        source: The file.
        reading: What the caller says of it.

    Returns:
        An empty list where no list has places.  The first counts what other lists hold.
    """
    own = str(reading.columns.get("drive_id", "")) or None
    parts = list(_parts(content, _Place((), (), {}), own))
    if not parts:
        return []
    size: Counter[tuple[str, ...]] = Counter()
    for part in parts:
        size[part.at.shape] += len(part.rows)
    best = max(parts, key=lambda part: ("time" in part.found, size[part.at.shape]))
    chosen = [part for part in parts if _alike(part, best)]
    tracks = _tracks(chosen, own)
    first, *others = drives_of_tracks(tracks, source, reading)
    left = sum(len(part.rows) for part in parts) - sum(len(part.rows) for part in chosen)
    if left:
        first = replace(first, skipped=first.skipped | {OTHER_LIST: left})
    if len(tracks) > 1:
        note = f"{len(tracks):,} lists of places without an id of trips: each was read as a drive"
        first = replace(first, notes=(*first.notes, note))
    return [first, *others]


def flat_record(record: dict[str, Any], path: str = "") -> dict[str, Any]:
    """A record without nesting; what lies in `location`, `coords` and the like loses that name."""
    flat: dict[str, Any] = {}
    for key, value in record.items():
        name = f"{path}{key}"
        if isinstance(value, dict):
            inner = flat_record(value, f"{name}.")
            flat |= {k: v for k, v in inner.items() if k not in flat}
        elif not isinstance(value, list):
            flat.setdefault(_HOMES.sub("", name), value)
    return flat


def dicts(values: Any) -> Iterator[dict[str, Any]]:
    """The objects of a list; none of anything else."""
    return (v for v in (values if isinstance(values, list) else ()) if isinstance(v, dict))


def _alike(part: _Part, best: _Part) -> bool:
    """Whether two lists lie alike: under the same keys, or as deep and with the same columns."""
    if part.at.shape == best.at.shape:
        return True
    return len(part.at.shape) == len(best.at.shape) and part.columns == best.columns


def _tracks(parts: list[_Part], own: str | None) -> list[Track]:
    """One table where ids tell its drives apart, else one for each list, named by where it lies."""
    differs = [len(set(names)) > 1 for names in zip(*(p.at.names for p in parts), strict=True)]
    trips = all(own in part.columns or "drive_id" in part.found for part in parts)
    vehicles = all("vehicle_id" in part.found for part in parts)
    if len(parts) == 1 or trips or (vehicles and not any(differs)):
        return [Track("", [row for part in parts for row in part.rows])]
    named = [
        Track("/".join(filter(None, compress(part.at.names, differs))) or str(k), part.rows)
        for k, part in enumerate(parts)
    ]
    if vehicles:
        return [Track("", [{"trip_id": name} | row for name, rows in named for row in rows])]
    return named


def _parts(content: Any, at: _Place, own: str | None) -> Iterator[_Part]:
    """All lists of records with places; `own` is the column that the caller says names drives."""
    if isinstance(content, dict):
        at = at._replace(ids=at.ids | _ids(content, own))
        columns = {k: v for k, v in content.items() if isinstance(v, list)}
        if {"lat", "lon"} <= find(list(columns)).keys():  # a table, column by column
            cells = zip(*columns.values(), strict=False)
            yield from _part([dict(zip(columns, row, strict=True)) for row in cells], at)
        for key, value in content.items():
            yield from _parts(value, at.below(key, key if isinstance(value, list) else ""), own)
    elif isinstance(content, list):
        yield from (table := _part([flat_record(r) for r in content if isinstance(r, dict)], at))
        found = False
        for number, inner in enumerate(content):
            if isinstance(inner, list) or (isinstance(inner, dict) and _nests(inner)):
                for part in _parts(inner, at.below(_name(inner)), own):
                    found = True
                    yield part
            if table and not found and number == _LOOKED_AT:
                return


def _part(rows: list[dict[str, Any]], at: _Place) -> list[_Part]:
    """The part that rows are, where they have places, else none."""
    rows = [at.ids | row for row in rows] if at.ids else rows
    columns = dict.fromkeys(name for row in rows for name in row)
    found = find(list(columns)).keys()
    whole = {"lat", "lon"} <= found
    return [_Part(rows, at, frozenset(columns), frozenset(found))] if whole else []


def _ids(content: dict[str, Any], own: str | None) -> dict[str, Any]:
    """The ids of trip and vehicle that an object has, for the records of lists in it."""
    flat = flat_record(content)
    found = find(list(flat))
    names = {own, *(found[quantity].name for quantity in _IDS if quantity in found)}
    return {name: value for name, value in flat.items() if name in names}


def _name(inner: Any) -> str:
    """The name of an object in a list, else its id; empty: it has none."""
    told = [inner[key] for key in _NAMES if key in inner] if isinstance(inner, dict) else []
    return next((str(name) for name in told if isinstance(name, str | int) and name != ""), "")


def _nests(record: dict[str, Any]) -> bool:
    """Whether a record may hold lists of records."""
    return any(isinstance(v, dict) or (isinstance(v, list) and v) for v in record.values())
