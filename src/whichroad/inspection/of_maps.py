"""What a road map holds."""

from typing import Any

from ..roadmap import RoadMap
from .section import Section


def map_section(title: str, roads: RoadMap) -> Section:
    """What a map holds, and what was left out of it.

    Args:
        title: Its file.
        roads: The map.
    """
    info = roads.info()
    skipped = info.pop("skipped", {})
    rows = [(name.replace("_", " "), _text(value)) for name, value in info.items()]
    said = tuple(f"skipped: {reason}: {count:,}" for reason, count in skipped.items())
    return Section(f"{title}: a road map", rows, said)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(inner)}" for name, inner in value.items())
    if isinstance(value, list):
        return " to ".join(map(str, value))
    return f"{value:,}" if isinstance(value, int) else str(value)
