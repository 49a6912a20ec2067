"""From what a receiver reported to `Fixes`: places checked, covariances chosen, rows in order.

All formats that give positions end here, so that a covariance means the same from
each.  NaN marks what a row does not report; none leaves this module.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..geodesy.angles import degrees, radians, wrap_bearing
from ..geodesy.units import KMH
from ..observations import (
    ASSUMED,
    FROM_HDOP,
    FROM_QUALITY,
    INTERPOLATED,
    LATE_PLACE,
    MOVING,
    NO_CORRELATION,
    OTHER_UNIT,
    RECKONED_PLACE,
    ROUNDED,
    SCATTERED,
    SIGMA_SPEED,
    STRAY,
    Array,
    Fixes,
    GeoFix,
)
from ..sensors.validation import NO_VARIANCE, NOT_A_COVARIANCE, TOO_VAGUE, WORST
from ..settings import Settings
from .checks import Bools, Ints, Skipped, in_order, is_place, keep
from .coarse_steps import coarse_steps
from .fix_quality import LEAST_SIGMA, NO_FIX, RECKONED, error_ratios
from .interpolated_places import interpolated
from .known_grids import Lattice
from .late_places import Places
from .late_speeds import Columns, in_time
from .other_units import other_units
from .rounded_places import rounding
from .scattered_places import scatter
from .stray_places import strays
from .unmeasured import unmeasured

# A receiver's ellipse is one sigma (variance ratio 1) or 95 % (2.45², u-blox): rounding to
# two digits moves the ratio by up to a quarter.
CREDIBLE = ((0.75, 1.33), (4.5, 8.0))
RADIUS_68 = 1.515  # 68 % radius over the sigma per axis, for a round error
_UNKNOWN_HDOP = (99.0, 99.9, 99.99)  # u-blox writes 99.99, others less digits
_ROUNDED = 1e-4  # of numbers in single precision
_UNLIKE = 4.0  # times the variance that is told, above which places scatter more than they may
IMPOSSIBLE = "impossible position"
WITHOUT_FIX = "no fix by its quality, 0"
NO_HDOP = "HDOP of 99, 99.9 or 99.99 (taken as unknown)"
NO_SPEED = "negative receiver speed (ignored)"
NO_COURSE = "course of -1 (ignored)"
NO_ACCURACY = "accuracy or sigma of 0 or less (settings' default used)"


@dataclass(slots=True)
class Reported:
    """What the rows of a log report, NaN where nothing; shape (n,) each."""

    time: Array  # s since 1970 UTC
    lat_deg: Array
    lon_deg: Array
    cov_ee: Array | None = None  # m²
    cov_en: Array | None = None
    cov_nn: Array | None = None
    no_correlation: Bools | None = None  # the reported ellipse was not credible
    hdop: Array | None = None
    quality: Array | None = None  # as of GGA
    speed: Array | None = None  # m/s
    sigma_speed: Array | None = None
    bearing_deg: Array | None = None

    def rows(self, index: NDArray[np.int64]) -> "Reported":
        """The rows at `index`, each at most once."""
        if len(index) == len(self.time) and (np.diff(index) > 0).all():
            return self
        chosen: dict[str, Any] = {
            f.name: None if (column := getattr(self, f.name)) is None else column[index]
            for f in fields(self)
        }
        return Reported(**chosen)


def from_ellipse(major: Array, minor: Array, bearing_deg: Array) -> tuple[Array, Array, Array]:
    """Covariance (ee, en, nn) of an ellipse whose major axis lies `bearing_deg` from north."""
    sin, cos = np.sin(radians(bearing_deg)), np.cos(radians(bearing_deg))
    a, b = major * major, minor * minor
    return a * sin * sin + b * cos * cos, (a - b) * sin * cos, a * cos * cos + b * sin * sin


def from_gst(
    sigma_lat: Array, sigma_lon: Array, major: Array, minor: Array, bearing_deg: Array
) -> tuple[Array, Array, Array, Bools]:
    """Covariance of a GST sentence: sigmas set the scale, the ellipse the correlation.

    Receivers differ in what they call the axes (one sigma, 95 %, nonsense), not in what
    they call sigmas.

    Args:
        sigma_lat: Standard deviation of latitude, m, shape (n,); zero or NaN: not reported.
        sigma_lon: That of longitude.
        major: Semi-major axis of the ellipse, m.
        minor: Semi-minor axis.
        bearing_deg: Direction of the major axis, degrees clockwise from north.

    Returns:
        cov_ee, cov_en, cov_nn in m², NaN where the sigmas are missing, and whether the
        ellipse was missing or not credible, so that the correlation is 0.
    """
    good = (sigma_lat > 0) & (sigma_lon > 0)
    nn, ee = np.where(good, sigma_lat**2, np.nan), np.where(good, sigma_lon**2, np.nan)
    e_ee, e_en, e_nn = from_ellipse(major, minor, bearing_deg)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        ratio = (e_ee + e_nn) / (ee + nn)
        correlation = e_en / np.sqrt(e_ee * e_nn)
    credible = np.zeros(ratio.shape, np.bool_)
    for low, high in CREDIBLE:
        credible |= (ratio > low) & (ratio < high)
    credible &= np.abs(correlation) < 0.9999  # a needle is no ellipse
    en = np.where(credible, np.where(credible, correlation, 0.0) * np.sqrt(ee * nn), 0.0)
    return ee, np.where(good, en, np.nan), nn, good & ~credible


def make_fixes(
    reported: Reported, settings: Settings, skipped: Skipped, grid: Lattice | None = None
) -> Fixes:
    """Check, order and complete what a log reported.

    Impossible places and places without a fix are skipped, as are those whose error is beyond
    all use; late rows are put in order, repeated times dropped, all counted.  A fix without
    covariance gets HDOP times the range error, or the settings' default, both by its quality,
    and a flag for it.  Places that no vehicle reaches from the others get one too.

    Args:
        reported: The rows that carry a position.
        settings: Gives `default_sigma_m` and `user_range_error_m`.
        skipped: Where to count.
        grid: That of the table of which this is a drive.
    """
    lat, lon = reported.lat_deg, reported.lon_deg
    possible = np.isfinite(reported.time) & is_place(lat, lon)
    r = reported.rows(np.flatnonzero(keep(possible, IMPOSSIBLE, skipped)))
    if r.quality is not None:
        r = r.rows(np.flatnonzero(keep(r.quality != NO_FIX, WITHOUT_FIX, skipped)))
    r = r.rows(np.flatnonzero(keep(~is_vague(r), TOO_VAGUE, skipped)))
    r = r.rows(in_order(r.time, skipped))
    fixes = completed(r, np.zeros(min(len(r.time), 1), np.int64), settings, skipped, grid)
    sigma = np.sqrt(np.maximum(fixes.cov_ee, fixes.cov_nn))
    sigma[(fixes.flags & SCATTERED) > 0] = np.inf  # all places are off
    fixes.flags[strays(fixes.time, fixes.lat_deg, fixes.lon_deg, sigma)] |= STRAY
    return fixes


def completed(
    r: Reported, first: Ints, settings: Settings, skipped: Skipped, grid: Lattice | None = None
) -> Fixes:
    """Fixes with covariances, speeds and courses of rows that `make_fixes` has checked.

    Args:
        r: Of drives, one after the other.
        first: Where each of them begins.
        settings: As of `make_fixes`.
        skipped: Likewise.
        grid: Likewise.
    """
    cov_ee, cov_en, cov_nn, flags = _covariance(r, settings, skipped)
    lat, rounded = r.lat_deg, rounding(r.lat_deg, r.lon_deg, first, grid)
    if rounded is not None:
        lat, cov_ee, cov_nn = lat + rounded.lat_deg, cov_ee + rounded.ee, cov_nn + rounded.nn
        flags |= np.where(rounded.nn > 0.0, ROUNDED, 0).astype(np.uint16)
    noise = scatter(r.time, r.lat_deg, r.lon_deg, first)
    if noise is not None:
        unlike = noise.sigma**2 > _UNLIKE * np.maximum(cov_ee, cov_nn)
        flags |= np.where(unlike, SCATTERED, 0).astype(np.uint16)
        taken = np.where(unlike & noise.sparse & ((flags & ASSUMED) > 0), noise.sigma**2, 0.0)
        cov_ee, cov_nn = np.maximum(cov_ee, taken), np.maximum(cov_nn, taken)
    # phones write -1 for unknown values
    speed = _without(r.speed, None if r.speed is None else r.speed < 0, NO_SPEED, skipped)
    course = r.bearing_deg
    course = _without(course, None if course is None else course == -1.0, NO_COURSE, skipped)
    made = interpolated(r.time, r.lat_deg, r.lon_deg, first)
    if made is not None:
        flags |= np.where(made, INTERPOLATED, 0).astype(np.uint16)
    wrong = unmeasured(r.time, r.lat_deg, r.lon_deg, speed, course, first)
    if wrong is not None:
        flags |= wrong.flags
        speed = wrong.pace
        course = None if course is None else np.where(wrong.no_course, np.nan, course)
    told = Columns(speed, r.sigma_speed, course)
    nowhere = np.zeros(len(r.time), np.bool_)
    places = Places(lat, r.lon_deg, cov_ee, cov_en, cov_nn, nowhere)
    if made is None and wrong is None:
        places, told = in_time(r.time, places, told, first, skipped)
        flags |= np.where(places.unknown, LATE_PLACE, 0).astype(np.uint16)
    measured = told.speed
    if wrong is not None and measured is not None:
        measured = np.where(wrong.no_speed, np.nan, measured)
    sigma = np.sqrt(np.maximum(cov_ee, cov_nn))
    other = other_units(r.time, (places.lat, places.lon), sigma, measured, first)
    coarse = coarse_steps(r.time, places.lat, places.lon, told.speed, told.course, first)
    speed, sigma_speed = _or_unknown(told.speed, told.sigma_speed, len(r.time))
    if coarse is not None:
        speed = speed + coarse.more
        flags |= coarse.flags
    bearing, sigma_bearing = _course(told.course, speed, sigma_speed)
    if coarse is not None:
        given = False if told.sigma_speed is None else told.sigma_speed >= coarse.speed_sigma
        sigma_speed = np.where(given, sigma_speed, np.hypot(sigma_speed, coarse.speed_sigma))
        sigma_bearing = np.hypot(sigma_bearing, coarse.course_sigma)
    if wrong is not None:
        speed = np.where(wrong.no_speed, 0.0, speed)
        sigma_speed = np.where(wrong.no_speed, np.inf, sigma_speed)
    if other is not None:  # a speed that is not used has still told that courses are known
        flags |= np.where(other, OTHER_UNIT, 0).astype(np.uint16)
        sigma_speed = np.where(other, np.inf, sigma_speed)
        sigma_bearing = np.where(other, sigma_bearing / KMH, sigma_bearing)
    return Fixes(
        time=r.time,
        lat_deg=places.lat,
        lon_deg=places.lon,
        cov_ee=places.cov_ee,
        cov_en=places.cov_en,
        cov_nn=places.cov_nn,
        speed=speed,
        sigma_speed=sigma_speed,
        bearing_deg=bearing,
        sigma_bearing_deg=sigma_bearing,
        flags=flags,
    )


def is_vague(r: Reported) -> Bools:
    """Whether the reported error of each fix is so large that it says nothing."""
    if r.cov_ee is None or r.cov_nn is None:
        return np.zeros(len(r.time), np.bool_)
    worst = np.fmax(r.cov_ee, r.cov_nn)
    return np.asarray((worst > WORST**2) & np.isfinite(worst))


def _column(values: Array | None, n: int) -> Array:
    return np.full(n, np.nan) if values is None else values


def _covariance(
    r: Reported, settings: Settings, skipped: Skipped
) -> tuple[Array, Array, Array, NDArray[np.uint16]]:
    n = len(r.time)
    ee, nn, hdop = _column(r.cov_ee, n), _column(r.cov_nn, n), _column(r.hdop, n)
    en = np.zeros(n) if r.cov_en is None else r.cov_en
    given = ~(np.isnan(ee) & np.isnan(nn))
    with np.errstate(over="ignore", invalid="ignore"):
        good = (ee > 0) & (nn > 0) & (ee * nn > en * en) & np.isfinite(ee * nn)
    none = given & ((ee <= 0) | (nn <= 0))
    keep(~none, NO_VARIANCE, skipped)
    keep(good | ~given | none, NOT_A_COVARIANCE, skipped)
    by_hdop = ~given & (hdop > 0) & np.isfinite(hdop)
    by_hdop &= keep(~(by_hdop & says_no_hdop(hdop)), NO_HDOP, skipped)
    sigma = np.where(by_hdop, hdop * settings.user_range_error_m, settings.default_sigma_m)
    flags = np.where(good, 0, np.where(by_hdop, FROM_HDOP, ASSUMED)).astype(np.uint16)
    if r.quality is not None:
        ratio = error_ratios(r.quality)
        sigma = np.where(ratio == 1.0, sigma, np.maximum(ratio * sigma, LEAST_SIGMA))
        flags |= np.where(~good & (ratio != 1.0), FROM_QUALITY, 0).astype(np.uint16)
        flags |= np.where(r.quality == RECKONED, RECKONED_PLACE, 0).astype(np.uint16)
    if r.no_correlation is not None:
        flags |= np.where(good & r.no_correlation, NO_CORRELATION, 0).astype(np.uint16)
    ee, nn = np.where(good, ee, sigma**2), np.where(good, nn, sigma**2)
    return ee, np.where(good, en, 0.0), nn, flags


def says_no_hdop(hdop: Array) -> Bools:
    """Whether a HDOP, (n,), is one that receivers write where they know none."""
    same = [np.abs(hdop - unknown) < _ROUNDED for unknown in _UNKNOWN_HDOP]
    return np.asarray(np.logical_or.reduce(same))


def _without(
    values: Array | None, wrong: Bools | None, reason: str, skipped: Skipped
) -> Array | None:
    """Values, NaN where they are wrong; those are counted."""
    if values is None or wrong is None or not wrong.any():
        return values
    return np.where(keep(~wrong, reason, skipped), values, np.nan)


def _or_unknown(value: Array | None, sigma: Array | None, n: int) -> tuple[Array, Array]:
    """Speeds and their sigmas; infinite where there is none."""
    if value is None:
        return np.zeros(n), np.full(n, np.inf)
    sigma = _column(sigma, n)
    known = np.isfinite(value) & (np.abs(value) < 1e3)
    sigma = np.where(np.isfinite(sigma) & (sigma > 0), sigma, SIGMA_SPEED)
    return np.where(known, value, 0.0), np.where(known, sigma, np.inf)


def _course(bearing: Array | None, speed: Array, sigma_speed: Array) -> tuple[Array, Array]:
    """Courses over ground and their sigmas; only a moving receiver has one."""
    if bearing is None:
        return np.zeros(len(speed)), np.full(len(speed), np.inf)
    known = np.isfinite(bearing) & (np.abs(bearing) <= 720)
    known &= np.isfinite(sigma_speed) & (speed > MOVING)
    angle = degrees(np.arctan2(np.where(known, sigma_speed, 1.0), speed))
    return wrap_bearing(np.where(known, bearing, 0.0)), np.where(known, angle, np.inf)


def as_records(fixes: Fixes) -> list[GeoFix]:
    """One `GeoFix` per row, for the on-line filter."""
    columns = [
        getattr(fixes, f.name).tolist() for f in fields(GeoFix)
    ]  # fields of the two share their names
    return [GeoFix(*row) for row in zip(*columns, strict=True)]
