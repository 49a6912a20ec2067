"""Point objects attached to a map, and what is asked of them."""

import struct
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from ..errors import SettingError
from ..filter.places.ahead import find_ahead
from ..filter.places.nearby import find_nearby
from ..filter.places.point_objects import FINDING, STANCE, Findings, new_findings, take_stances
from ..filter.state import CAPACITY, Belief
from ..graph.network import records
from ..roadmap import RoadMap
from .place_table import read_places
from .snapping import snap

FARTHEST_M = 5000.0  # that one may look ahead
AHEAD_M = 500.0  # that one looks ahead along the road, unless told otherwise,
NEARBY_M = 50.0  # and about the vehicle
_FINDING = struct.Struct("=qddd")
assert _FINDING.size == FINDING.itemsize


class RelativePlace(NamedTuple):
    """A point object relative to the vehicle."""

    id: int | str
    distance_m: float  # along the road, if it is passed; or in a straight line
    sigma_m: float
    p: float  # of passing it, or of being so near


class _Thread(threading.local):
    """Buffers of one thread, and the kernels bound to them."""

    work: Findings | None = None
    stance: memoryview
    found: memoryview
    ahead: Callable[..., int]
    nearby: Callable[..., int]


class Places:
    """Point objects on a map: signs, cameras, charging points, surveyed marks.

    Example:
        >>> places = Places("cameras.geojson", roads)                   # doctest: +SKIP
        >>> places.skipped, places.beside
        >>> Localizer(roads, places=places).update(fix).ahead(500.0)

    Args:
        table: Path or table with `lat` and `lon`, `edge_id` and `abscissa_m`, or points as
            geometry; optionally `id`, `bearing_deg` (of the traffic that it is for), `sigma_m`
            and `on_map` (whether it shares the map's error).
        roads: The map.
        crs: Reference system of a geometry that names none, e.g. "EPSG:3067".

    Attributes:
        ids: (P,) of the places.
        skipped: Rows without a position, or at none of this map, by reason.
        beside: Places that no road passes, by reason: never ahead, though they may be near.

    Raises:
        ReadError: It is no table of places.
        SettingError: It has no place.
    """

    def __init__(self, table: Any, roads: RoadMap, crs: Any = None) -> None:
        read = read_places(table, crs)
        snapped = snap(read, roads)
        if not len(snapped.rows):
            why = ", ".join(f"{n} {reason}" for reason, n in snapped.skipped.items())
            raise SettingError(
                f"{read.where}: {len(read.ids)} rows and no place ({why or 'it is empty'}); at "
                "least one was expected; check its columns lat and lon"
            )
        self.roads = roads
        self.ids: list[Any] = [read.ids[row] for row in snapped.rows.tolist()]
        self.skipped, self.beside = snapped.skipped, snapped.beside
        self.arrays = snapped.arrays
        self._farthest = float(self.arrays.place.sigma.max())
        self._thread = _Thread()

    def __len__(self) -> int:
        return len(self.ids)

    def __repr__(self) -> str:
        return f"Places({len(self)} on {self.roads.origin!r}, {sum(self.beside.values())} beside)"

    def __getstate__(self) -> dict[str, Any]:
        return {k: v for k, v in self.__dict__.items() if k != "_thread"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._thread = _Thread()

    def notes(self) -> list[str]:
        """What could not be used, one sentence for each reason."""
        return [f"places: {n} {why}; left out" for why, n in self.skipped.items()] + [
            f"places: {n} {why}; never ahead" for why, n in self.beside.items()
        ]

    def ahead(
        self, stances: bytes | memoryview, within: float, known: float = 1.0
    ) -> list[RelativePlace]:
        """The places that the vehicle will come past, nearest first.

        Args:
            stances: Records of `filter.places.point_objects.STANCE`.
            within: Distance along the road, m.
            known: P(one of these is right).

        Raises:
            SettingError: The distance is none between 0 and 5000 m.
        """
        _check_reach("ahead", within)
        thread = self._ready()
        return self._found(thread, thread.ahead(_put(thread, stances), within, known))

    def nearby(
        self, stances: bytes | memoryview, radius: float, known: float = 1.0
    ) -> list[RelativePlace]:
        """The places within a radius of the vehicle, nearest first.

        Args:
            stances: Records of `filter.places.point_objects.STANCE`.
            radius: m.
            known: P(one of these is right).

        Raises:
            SettingError: The radius is none between 0 and 5000 m.
        """
        _check_reach("nearby", radius)
        thread = self._ready()
        return self._found(thread, thread.nearby(_put(thread, stances), radius, known))

    def _ready(self) -> _Thread:
        """This thread's buffers."""
        thread = self._thread
        if thread.work is None:
            roads = self.roads.arrays
            thread.work = work = new_findings(len(self), CAPACITY)
            thread.stance = memoryview(work.stance.view("u1"))
            thread.found = memoryview(work.found.view("u1"))
            thread.ahead = find_ahead.bind(..., ..., ..., roads, self.arrays, work)
            thread.nearby = find_nearby.bind(
                ..., ..., ..., self._farthest, roads, self.arrays, work
            )
        return thread

    def _found(self, thread: _Thread, count: int) -> list[RelativePlace]:
        ids, new = self.ids, tuple.__new__  # half the time of the class
        rows = _FINDING.iter_unpack(thread.found[: count * _FINDING.size])
        return [new(RelativePlace, (ids[k], metres, sigma, p)) for k, metres, sigma, p in rows]


def _check_reach(question: str, metres: float) -> None:
    if not 0.0 <= metres <= FARTHEST_M:
        raise SettingError(
            f"{question}: {metres!r} m; a distance from 0 to {FARTHEST_M:g} m was expected"
        )


def _put(thread: _Thread, stances: bytes | memoryview) -> int:
    """Copy stances into the buffer; returns how many."""
    thread.stance[: len(stances)] = stances
    return len(stances) // STANCE.itemsize


def places_on(places: Any, roads: RoadMap) -> Places | None:
    """Places from themselves, from a table, or none.

    Raises:
        ReadError: It is no table of places.
        SettingError: It has no place, or they are of another map.
    """
    if places is None:
        return None
    if not isinstance(places, Places):
        return Places(places, roads)
    if places.roads is not roads and places.roads.fingerprint != roads.fingerprint:
        raise SettingError(
            f"places: they are on {places.roads.origin!r}, and the map is {roads.origin!r}; "
            "the same map was expected; attach the table to this one"
        )
    return places


class StanceReader:
    """Copies the hypotheses of beliefs as places see them."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._stances = records(CAPACITY, STANCE)
        self._bytes = memoryview(self._stances.view("u1"))
        self._calls: dict[int, tuple[Belief, Callable[[], int]]] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._begin()

    def of(self, belief: Belief) -> bytes:
        """Records of `filter.places.point_objects.STANCE` of the living hypotheses."""
        known = self._calls.get(id(belief))
        if known is None:
            known = belief, take_stances.bind(belief, self._stances)
            self._calls[id(belief)] = known
        count = known[1]()
        return self._bytes[: count * STANCE.itemsize].tobytes()
