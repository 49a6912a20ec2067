"""How a drive's files are to be understood, where they do not say it themselves."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..errors import SettingError
from ..settings import Settings, Vehicle
from .dates import Writing
from .names import SENSED, quantity_of

if TYPE_CHECKING:
    from .table_units import Units


def own_columns(columns: Any) -> dict[str, str | int]:
    """A caller's own names of columns, by the documented names.

    Raises:
        SettingError: They are no mapping.
    """
    if columns is not None and not isinstance(columns, Mapping):
        raise SettingError(
            f"columns is {columns!r}; documented names and the columns that they stand for were "
            'expected, as a dict; give columns={"time": "ts"}'
        )
    return dict(columns or {})


def check_one(column: Any) -> None:
    """Refuse several columns, or anything else than one, for that which names trips.

    Raises:
        SettingError: It is so.
    """
    if column is not None and not isinstance(column, str | int):
        raise SettingError(
            f"the column that names trips is {column!r}; one name was expected; trips that several "
            "vehicles have are told apart by a column vehicle_id: name yours by columns=, or make "
            "one column of several"
        )


@dataclass(frozen=True, slots=True)
class Reading:
    """What the caller says of the files."""

    vehicle: Vehicle = field(default_factory=Vehicle)  # wheels, clocks, CAN signals
    settings: Settings = field(default_factory=Settings)  # sigma of fixes that report none
    crs: Any = None  # reference system of x, y and of geometries without one, as pyproj takes it
    id: str | None = None  # the column whose values tell drives apart
    columns: Mapping[str, str | int] = field(default_factory=dict)  # documented name -> own column
    tz: str | None = None  # zone of times that name none, such as Europe/Berlin
    units: "Units | None" = None  # of columns that name none; None: the values tell
    dates: str | None = None  # mdy, dmy or ymd: the order in dates such as 06/01/2026

    @property
    def written(self) -> Writing:
        """How times are written."""
        return Writing.of(self.tz, self.dates)

    @classmethod
    def of(
        cls, vehicle: Vehicle | None = None, settings: Settings | None = None, **more: Any
    ) -> "Reading":
        """The same from arguments of which None stands for the default.

        Raises:
            ReadError: There is no such zone or order of dates.
            SettingError: `columns` or `id` are not what they should be.
        """
        Writing.of(more.get("tz"), more.get("dates"))
        own = own_columns(more.get("columns"))
        check_one(more.get("id"))
        if more.get("id") is not None:
            own = {k: v for k, v in own.items() if k != "drive_id"} | {"drive_id": more["id"]}
        for alias in (alias for alias in own if not alias.startswith(SENSED)):
            quantity_of(alias)
        more["columns"] = own
        return cls(vehicle or Vehicle(), settings or Settings(), **more)
