"""A magnetic compass: its declination is a setting, and iron an error that lasts."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from ..errors import SettingError, comes_with
from ..geodesy.angles import wrap_bearing
from .kinds import Heading


@dataclass(frozen=True)
class Compass:
    """Magnetic bearings of the vehicle's axis."""

    name: str = "compass"
    columns: tuple[str, ...] = ("compass_deg",)
    declination_deg: float = 0.0  # of the needle, east of true north; `declination` knows it
    sigma_deg: float = 5.0
    bias_sigma_deg: float = 0.0  # sigma of what stays: mounting, a declination that is not known
    lasts_m: float = 300.0  # iron of the vehicle errs by its direction, that of streets by place

    def rows(self, reading: Mapping[str, float]) -> list[Heading]:
        """The bearing from true north."""
        (column,) = self.columns
        bearing = wrap_bearing(reading[column] + self.declination_deg)
        return [
            Heading(bearing, self.sigma_deg, lasts_m=self.lasts_m, bias_sigma=self.bias_sigma_deg)
        ]


def declination(lat_deg: float, lon_deg: float, time: float) -> float:
    """How far a needle points east of true north, degrees, by the World Magnetic Model.

    Args:
        lat_deg: WGS84.
        lon_deg: WGS84.
        time: s since 1970 UTC.

    Raises:
        SettingError: The package pygeomag is missing (the extra `compass`), or its model does not
            hold then.
    """
    with comes_with("compass", "declination"):
        from pygeomag import GeoMag
    when = datetime.fromtimestamp(time, UTC)
    year = when.year + (when.timetuple().tm_yday - 1) / 365.25
    try:
        model = GeoMag(base_year=int(year))
        return float(model.calculate(glat=lat_deg, glon=lon_deg, alt=0.0, time=year).d)
    except ValueError as error:
        raise SettingError(
            f"declination: in {when.year} ({error}); a year that pygeomag's model holds for was "
            "expected; upgrade pygeomag, or give declination_deg to Compass"
        ) from None
