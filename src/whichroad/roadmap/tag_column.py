"""Tags of OpenStreetMap in one column of a table, as GDAL, QGIS and osm2pgsql write them."""

import json
import re
from collections import Counter
from typing import Any

from numpy.typing import NDArray

from .sheet import plain

NAMES = ("other_tags", "all_tags", "tags")
_WORD = r'"((?:[^"\\]|\\.)*)"'
_PAIR = re.compile(rf"\s*{_WORD}\s*=>\s*(?:{_WORD}|NULL)\s*(?:,|$)", re.DOTALL)  # of hstore
_ESCAPED = re.compile(r"\\(.)", re.DOTALL)

Tags = dict[str, str]


def tags_in(column: NDArray[Any], skipped: Counter[str]) -> list[Tags]:
    """The tags of each cell, which is the text of an hstore or of a JSON object.

    Args:
        column: (n,) texts, or nothing where a road has no further tags.
        skipped: Counts texts that are cut short or neither of both.
    """
    cells = [cell if isinstance(cell, str) else "" for cell in plain(column).tolist()]
    known = {text: _read(text.strip()) for text in set(cells)}
    if bad := sum(not known[text][1] for text in cells):
        skipped["tags that were cut short or not understood"] += bad
    return [known[text][0] for text in cells]


def _read(text: str) -> tuple[Tags, bool]:
    """The tags of a text, and whether it was understood to its end."""
    if text.startswith("{"):
        try:
            found = json.loads(text).items()
            return {key: str(value) for key, value in found if value is not None}, True
        except ValueError:
            return {}, False
    tags: Tags = {}
    at = 0
    while pair := _PAIR.match(text, at):
        if pair[2] is not None:
            tags[_plain(pair[1])] = _plain(pair[2])
        at = pair.end()
    return tags, at == len(text)


def _plain(word: str) -> str:
    return _ESCAPED.sub(r"\1", word)
