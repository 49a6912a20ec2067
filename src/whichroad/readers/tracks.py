"""Tracks as rows of named values, which files of geometries and objects in memory consist of."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from ..observations import Drive
from .drive_tables import drives_of
from .reading import Reading
from .source import Source
from .tables_in_memory import in_memory


class Track(NamedTuple):
    """Rows that are one drive, or that their ids tell apart."""

    name: str  # empty: the source's
    rows: list[dict[str, Any]]


def drives_of_tracks(tracks: Sequence[Track], source: Source, reading: Reading) -> list[Drive]:
    """The drives of tracks, each named by its track.

    Args:
        tracks: At least one of them has rows.
        source: Where they come from.
        reading: What the caller says of it.
    """
    paths = (source.path,) if source.path else ()
    drives: list[Drive] = []
    seen: Counter[str] = Counter()
    for track in tracks:
        if not track.rows:
            continue
        stem = f"{source.stem}/{track.name}" if track.name else source.stem
        table = in_memory(track.rows, reading)
        for drive in drives_of(table, reading, Counter(), source.name, stem, paths):
            seen[drive.drive_id] += 1
            count = seen[drive.drive_id]
            name = drive.drive_id if count == 1 else f"{drive.drive_id}-{count}"
            drives.append(replace(drive, drive_id=name))
    return drives
