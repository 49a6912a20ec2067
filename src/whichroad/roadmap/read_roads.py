"""Streets of any table or file of roads, by its schema."""

from pathlib import Path
from typing import Any

from .open_table import open_sheet
from .overture import read_overture
from .overture_rows import segments_in
from .road_tables import read_edges
from .streets import Streets
from .sumo import is_net, read_net


def read_roads(
    table: Any, crs: Any, directed: bool | None, gap: float | None = None
) -> tuple[Streets, str]:
    """As `RoadMap.from_edges` takes them.

    Returns:
        The streets, and what to call the table.

    Raises:
        MapError: No geometry was found, or its coordinate system is unknown.
    """
    if (segments := segments_in(table)) is not None:
        return read_overture(segments)
    if is_net(table):
        return read_net(Path(table), crs)
    sheet = open_sheet(table)
    if (segments := segments_in(sheet)) is not None:
        return read_overture(segments)
    return read_edges(sheet, crs, directed, gap)
