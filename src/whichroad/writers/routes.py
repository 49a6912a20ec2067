"""SUMO's routes, `.rou.xml`: each drive a vehicle with the edges that it drove."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import pyarrow as pa

from ..errors import WriteError
from ..tables.schema import TIME

_NEEDED = {"source_id", "forward", "enter_time", "broken_rule"}


def write(table: pa.Table, path: Path) -> None:
    """Write a path by source as routes; a gap begins a new vehicle.

    A street driven against the way in which it was drawn is `-` and its id, as netconvert names
    it.  Departures count from the first one.

    Raises:
        WriteError: The table is no path by the roads of the source.
    """
    names = set(table.column_names)
    if not names >= _NEEDED or "from_node" in names:
        raise WriteError(
            f"{path}: routes are of the edges of a network; a path by the roads of the source was "
            "expected; give --by-source, or write RoadMap.by_source of it by writers.write_table"
        )
    times = table["enter_time"].cast(TIME).cast(pa.int64()).to_pylist()
    rows = table.select(["source_id", "forward", "broken_rule"]).to_pylist()
    drives = table["drive_id"].to_pylist() if "drive_id" in names else ["drive"] * len(rows)
    vehicles: list[tuple[str, int, list[str]]] = []
    count: dict[str, int] = {}
    before = None
    for drive, row, at in zip(drives, rows, times, strict=True):
        if drive != before or row["broken_rule"] == "gap":
            before, count[drive] = drive, count.get(drive, 0) + 1
            number = "" if count[drive] == 1 else f".{count[drive]}"
            vehicles.append((f"{drive}{number}", at, []))
        edge = row["source_id"] if row["forward"] else f"-{row['source_id']}"
        edges = vehicles[-1][2]
        if not edges or edges[-1] != edge:
            edges.append(edge)
    start = min((at for _, at, _ in vehicles), default=0)
    with open(path, "w", encoding="utf-8") as sink:
        sink.write('<?xml version="1.0" encoding="UTF-8"?>\n<routes>\n')
        for name, at, edges in sorted(vehicles, key=lambda one: one[1]):
            sink.write(
                f'  <vehicle id={quoteattr(name)} depart="{1e-6 * (at - start):.2f}">'
                f"<route edges={quoteattr(' '.join(edges))}/></vehicle>\n"
            )
        sink.write("</routes>\n")
