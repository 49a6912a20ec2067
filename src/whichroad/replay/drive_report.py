"""A report of one drive as one HTML file: map, track, hypotheses and charts."""

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import WriteError
from ..page.layer import drawn_near, edge_of
from ..page.standalone import standalone
from ..roadmap.drawing import attribution
from ..tables.status import STATUS
from ..writers import replacing
from .recorded_messages import RecordedMessages
from .report_columns import columns_beside
from .stretches import stretches_of
from .timeline import thinned, timeline

if TYPE_CHECKING:
    from ..roadmap import RoadMap

ROWS = 5000  # epochs in a report
_MARGIN = 400.0  # m of roads about the track


def check_report(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Refuse a name that a report cannot have, before the work is done.

    Raises:
        WriteError: It does not end in .html, or is there already and `force` is not set.
    """
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise WriteError(f"{path}: the suffix is {path.suffix!r}; .html was expected")
    if path.exists() and not force:
        raise WriteError(f"{path}: exists; a new name was expected; --force replaces it")


def write_report(
    recorded: RecordedMessages,
    path: str | os.PathLike[str],
    roads: "RoadMap | None" = None,
    *,
    force: bool = False,
) -> None:
    """Write the report of a drive.

    Args:
        recorded: Of one drive.
        path: An .html file.
        roads: The map; those near the track are drawn.
        force: Replace a file that is there.

    Raises:
        WriteError: The file cannot be written.
    """
    check_report(path, force=force)
    text = report_text(recorded, roads)
    with replacing(Path(path), force=force) as part:
        Path(part).write_text(text, encoding="utf-8")


def report_text(recorded: RecordedMessages, roads: "RoadMap | None" = None) -> str:
    """The report of a drive as HTML.

    Args:
        recorded: Of one drive.
        roads: The map; those near the track are drawn.
    """
    return standalone(f"{recorded.drive_id} · whichroad", report_data(recorded, roads))


def report_data(recorded: RecordedMessages, roads: "RoadMap | None" = None) -> dict[str, Any]:
    """What the report's script draws.

    Args:
        recorded: Of one drive.
        roads: The map.
    """
    at = thinned(recorded.time, recorded.columns["p_way"], ROWS)
    c = recorded.columns
    lat, lon = recorded.track()
    box = [lon.min(), lat.min(), lon.max(), lat.max()] if len(lat) else [0.0, 0.0, 0.0, 0.0]
    near = [] if roads is None or not len(lat) else drawn_near(roads, lat, lon, _MARGIN)
    words = sorted(set(recorded.reason))
    return {
        "drive_id": recorded.drive_id,
        "began": datetime.fromtimestamp(float(recorded.time[0]), UTC).isoformat(timespec="seconds"),
        "box": [round(float(v), 6) for v in box],
        "line": timeline(recorded, ROWS),
        "more": {
            "bearing": _column(c, "bearing_deg", at, 1),
            "speed": _column(c, "speed_mps", at, 2),
            "major": _column(c, "ellipse_major_m", at, 2),
            "minor": _column(c, "ellipse_minor_m", at, 2),
            "axis": _column(c, "ellipse_bearing_deg", at, 1),
            "matched_lat": _column(c, "matched_lat", at, 7),
            "matched_lon": _column(c, "matched_lon", at, 7),
            "protection": _column(c, "protection_level_m", at, 1),
            "scale": _column(c, "gnss_scale", at, 2),
            "edge": recorded.edge[at].tolist(),
            "reason": [words.index(recorded.reason[k]) for k in at],
        },
        "reasons": words,
        "poses": _poses(recorded, at),
        "roads": near,
        "attribution": "" if roads is None else attribution(roads),
        "edges": _edges(recorded, roads, at),
        "summary": _summary(recorded),
        "places": stretches_of(recorded, roads),
        "beside": columns_beside(recorded, at),
    }


def _column(c: dict[str, Any], name: str, at: NDArray[Any], digits: int) -> list[float | None]:
    values = c.get(name)
    if values is None:
        return [None] * len(at)
    return [v if np.isfinite(v) else None for v in np.round(values[at], digits).tolist()]


def _poses(recorded: RecordedMessages, at: NDArray[Any]) -> list[list[list[float | None]]]:
    """Poses of the alternatives, where there is a choice: p, edge, pose, ellipse."""
    rows: list[list[list[float | None]]] = []
    for k in at.tolist():
        alternatives = [
            one for one in recorded.hypotheses(k) if one["lat"] is not None and one["p"] > 0.002
        ]
        rows.append(
            [
                [
                    round(one["p"], 4), -1 if one["edge_id"] is None else one["edge_id"],
                    round(one["lat"], 7), round(one["lon"], 7), round(one["bearing_deg"], 1),
                    *(round(one["ellipse"][n], 2) for n in ("major_m", "minor_m", "bearing_deg")),
                ]
                for one in alternatives
            ]
            if len(alternatives) > 1
            else []
        )  # fmt: skip
    return rows


def _edges(recorded: RecordedMessages, roads: "RoadMap | None", at: NDArray[Any]) -> dict[str, Any]:
    """Line and street of every edge that is named."""
    if roads is None:
        return {}
    named = np.unique(recorded.choices.edge[at][recorded.choices.p[at] >= 0.002])
    return {str(edge): edge_of(roads, edge) for edge in named.tolist() if 0 <= edge < len(roads)}


def _summary(recorded: RecordedMessages) -> dict[str, Any]:
    """The drive in a few numbers."""
    c, n = recorded.columns, len(recorded)
    known = np.isfinite(c["lat"])
    share = {word: float(np.mean(recorded.status == i)) for i, word in enumerate(STATUS)}
    return {
        "epochs": n,
        "duration_s": round(recorded.length, 1),
        "driven_m": round(recorded.driven, 1),
        "mean_p": round(float(c["p_way"][known].mean()), 4) if known.any() else 0.0,
        "major_95_m": round(2.448 * float(np.median(c["ellipse_major_m"][known])), 2)
        if known.any()
        else None,
        "fixes": len(recorded.signals.fix_times),
        "fixes_masked": int(recorded.is_masked(recorded.signals.fix_times).sum()),
        "status": {word: round(part, 4) for word, part in share.items() if part > 0.0},
    }
