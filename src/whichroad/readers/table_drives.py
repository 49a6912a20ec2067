"""Which rows of a table are one drive."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .arrow_columns import texts
from .checks import Ints
from .names import DRIVES, Seen


class Trip(NamedTuple):
    """A drive of a table."""

    name: str
    rows: Ints


def trips_of(seen: Seen, rows: Ints, stem: str, chosen: bool = False) -> list[Trip]:
    """The rows of each drive, in the order in which drives first appear.

    A column that names the trip tells drives apart; a trip that several vehicles have
    becomes one of each; without trips the vehicle does.  A column `id` does where its
    values repeat, else it numbers rows.

    Args:
        seen: The table.
        rows: Those that are used.
        stem: The name of the only drive, where nothing tells drives apart.
        chosen: Whether the caller chose the column that names drives.
    """
    found: list[tuple[list[str], Ints]] = [(names, c[rows]) for names, c in _ids(seen, chosen)]
    if not found or not len(rows):
        return [Trip(stem, rows)]
    labels, codes = found[0]
    for names, more in found[1:]:
        labels, codes = paired(labels, codes, names, more)
    order = np.argsort(codes, kind="stable")
    bounds = np.flatnonzero(np.diff(codes[order], prepend=-1))
    pieces = sorted(np.split(order, bounds[1:]), key=lambda piece: int(piece[0]))
    return [Trip(labels[codes[piece[0]]], rows[piece]) for piece in pieces]


def paired(
    trips: list[str], trip: Ints, vehicles: list[str], vehicle: Ints
) -> tuple[list[str], Ints]:
    """Names and the name of each row, where a trip that several vehicles have becomes several.

    Args:
        trips: Names of trips.
        trip: (n,) which of them each row has.
        vehicles: Names of vehicles.
        vehicle: (n,) which of them each row has.
    """
    width = int(vehicle.max(initial=0)) + 1
    pairs, codes = np.unique(trip.astype(np.int64) * width + vehicle, return_inverse=True)
    of_trip, of_vehicle = pairs // width, pairs % width
    several = np.bincount(of_trip, minlength=len(trips)) > 1
    names = [
        f"{vehicles[v]}/{trips[t]}" if several[t] else trips[t]
        for t, v in zip(of_trip.tolist(), of_vehicle.tolist(), strict=True)
    ]
    return names, codes.astype(np.int64)


def _ids(seen: Seen, chosen: bool) -> Iterator[tuple[list[str], Ints]]:
    """Labels, and the label of each row, of the columns that tell drives apart."""
    if chosen:
        yield texts(seen.table.column(seen.found["drive_id"].place))
        return
    sure = False
    for quantity in DRIVES:
        if quantity not in seen.found:
            continue
        place, name = seen.found[quantity].place, seen.found[quantity].name
        if quantity == "row_id":
            if sure:
                return
            labels, codes = texts(seen.table.column(place))
            if 2 * len(np.unique(codes)) > len(codes):  # it numbers rows
                return
            yield labels, codes
            return
        yield texts(seen.table.column(place))
        if name == "drive_id":  # ours: it says what a drive is
            return
        sure = True
