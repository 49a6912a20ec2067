"""Do the settings fit the data, and if not, which one does not?

What is read here was summed up by `statistics`.  What the sums are in drives that do fit was
found by simulation; the bands leave fewer than one in a hundred of such drives outside.
"""

import math
from collections.abc import Sequence
from typing import Any

from .._compile import Record, Records
from ..filter.state import CLOCK
from ..filter.summary.estimate import Output
from ..settings import Settings, Vehicle
from .finding import Finding as Finding
from .map_offset import MapError, headings_finding, offset_finding
from .sensors import clock_finding, sensor_findings
from .statistics import ConsistencyStatistics, rows_of

_ENOUGH = 3000.0  # s of moving, from which on the bands below hold unwidened
_LEAST = 600.0  # s of moving, below which there is no verdict
_TIME = 1.55  # largest ratio between T and its setting, either direction
_SURELY = 3.5  # that ratio where a too large sigma explains the data as well
_CHANCE = 2.5  # sigmas of log T by which chance may move it
_SIGMA = 1.18  # largest σ over the reported one, where T is right
_SIGMA_TOO = 1.25  # largest σ over the reported one, where T is wrong
_USUAL_WHITE = 1.5  # white variance over that of the settings, up to which it is as reported
_SMALL = 0.7  # σ ratio below which the receiver reports too large errors
_SCALE = 4.0  # largest scale and drift, in sigmas of the settings
_GAIN = 0.035  # largest relative error of turns
_LATE = 0.2  # s, largest offset between clocks
_ANTENNA = 1.5  # m, largest error of the lever arm,
_FINE_ANTENNA, _OF_REPORTED = 0.4, 4.0  # and of fine receivers: m, and times the reported sigma
_AHEAD = 1.25  # ahead it may be as much larger: a track width 3 % off looks like that
_PRECISE = 0.3  # m, reported sigma below which the place of the antenna matters
_TIMES = 0.025  # s by which times of fixes may scatter
_ALONG, _OF_TOLD = 1.5, 4.0  # errors along the way over those across it, and over the told sigma
_ADDS_UP = 2.6  # the same after 10 s over those after 2 s, where the wheels err
_COARSEST = 500.0  # m, of the settings
_SURE = 4.0  # significance of a measured offset, in sigmas
_MAP = 1.1  # largest mean square map error over that of the settings


def diagnose(answer: Any) -> list[Finding]:
    """Find sensors, settings and maps that do not fit the data.

    Args:
        answer: A `Result`, a `Localizer`, or a recorded drive as `localize_recorded` gives it.

    Returns:
        Findings (docs/reference/findings.md), empty where everything fits.  Sensors are named
        after seconds.  Settings take ten minutes of driving with wheels and fixes: GNSS alone
        cannot decide.
    """
    return list(answer.diagnosis)


def findings(
    statistics: ConsistencyStatistics, vetting: Record | None = None,
    map_error: MapError | None = None, moved: float = 0.0,
) -> tuple[Finding, ...]:  # fmt: skip
    """What does not fit, so far: sensors that the filter withheld, else settings.

    Wheels first, then clocks and antenna, the map, the fixes' own errors: each is judged
    by those before, so that it is not judged as long as those do not fit.
    """
    withheld = () if vetting is None else sensor_findings(vetting, moved)
    times = _scattered_times(statistics)
    if withheld:  # a scale may have been learnt of fixes at wrong times
        return (*times, *withheld) if is_scale(withheld) else withheld
    turned = headings_finding(map_error, statistics.settings)
    note = times + _untold_antenna(statistics)
    if statistics.moving < _LEAST:
        return turned + note
    found = _wheels(statistics) or _shift(statistics)
    of_map = offset_finding(map_error) + turned
    if any(one.what == "antenna" for one in found):
        note = tuple(one for one in note if one.what != "antenna: not told")
    return (*(found or of_map or _map(statistics) or _gnss(statistics)), *note)


def is_scale(withheld: Sequence[Finding]) -> bool:
    """Whether nothing else was found of sensors than that the odometry's scale was learnt."""
    return {one.what for one in withheld} == {"wheels: scale"}


def _wider(statistics: ConsistencyStatistics, band: float) -> float:
    """The band about 1 (a ratio), wider for drives that are shorter."""
    return float(band ** math.sqrt(max(1.0, _ENOUGH / statistics.moving)))


def _wheels(statistics: ConsistencyStatistics) -> list[Finding]:
    found = []
    s, scale = statistics.settings, statistics.scale
    band = _SCALE * s.scale_sigma
    scale_off = abs(scale - 1.0) > band
    if scale_off:
        found.append(
            Finding(
                "wheels: scale", "warning", scale, 1.0 - band, 1.0 + band,
                f"one metre by the odometer is {scale:.3f} m; correct metres_per_tick (tyres?) "
                "or the speed's unit",
            )
        )  # fmt: skip
    gain, drift = statistics.turns()
    band = max(_GAIN, 2.5 * s.turn_noise)
    if abs(gain - 1.0) > band and not (scale_off and abs(gain - scale) < 1.5 * band):
        width = statistics.vehicle.track_width / gain
        found.append(
            Finding(
                "wheels: track width", "warning", gain, 1.0 - band, 1.0 + band,
                f"true turns are at least {gain:.3f} times those of the wheels; set "
                f"track_width to {width:.2f} m or beyond, or correct the yaw rate",
            )
        )  # fmt: skip
    band = _SCALE * s.drift_sigma
    if abs(drift) > band:
        found.append(
            Finding(
                "wheels: left against right", "warning", drift, -band, band,
                f"on straight roads the heading drifts by {1000.0 * drift:.2f} rad/km; correct "
                "metres_per_tick of one side (tyres?) or the yaw rate's offset",
            )
        )  # fmt: skip
    return found


def _side(metres: float, positive: str, negative: str) -> str:
    """A distance to either side, "1.2 m ahead" or "0.3 m behind"."""
    return f"{abs(metres):.1f} m {positive if metres >= 0.0 else negative}"


def _shift(statistics: ConsistencyStatistics) -> list[Finding]:
    found = []
    late, antenna, sigma_late, sigma_antenna = statistics.shift()
    band = max(_LATE, _SURE * sigma_late)
    if abs(late) > band:
        found.append(clock_finding(late, band))
    least = min(_ANTENNA, max(_FINE_ANTENNA, _OF_REPORTED * statistics.reported))
    band = max(least, _SURE * sigma_antenna)
    fine = 1.0 if least == _ANTENNA else math.hypot(antenna.real / _AHEAD, antenna.imag) / least
    if statistics.steered and abs(antenna) > band and fine >= 1.0:
        right = antenna + complex(
            statistics.vehicle.antenna_forward, statistics.vehicle.antenna_left
        )
        found.append(
            Finding(
                "antenna", "warning", abs(antenna), 0.0, band,
                f"the antenna seems to be {_side(right.real, 'ahead', 'behind')} and "
                f"{_side(right.imag, 'to the left', 'to the right')} of the middle of the rear "
                f"axle; set forward_m = {right.real:.1f} and left_m = {right.imag:.1f} under "
                "[antenna] in vehicle.toml (antenna_forward, antenna_left), or better what you "
                "measure: of an error ahead hardly more than half shows",
            )
        )  # fmt: skip
    return found


def _untold_antenna(statistics: ConsistencyStatistics) -> tuple[Finding, ...]:
    """A note where fixes are so exact that the place of the antenna matters, and none is told."""
    car = statistics.vehicle
    told = car.antenna_forward != 0.0 or car.antenna_left != 0.0
    if told or not statistics.moving or not statistics.counted or statistics.reported >= _PRECISE:
        return ()
    return (
        Finding(
            "antenna: not told", "information", statistics.reported, _PRECISE, _COARSEST,
            "the fixes are so exact that the place of the antenna matters, which is taken to be "
            "the middle of the rear axle; if it is elsewhere, set forward_m and left_m under "
            "[antenna] in vehicle.toml (antenna_forward, antenna_left)",
        ),
    )  # fmt: skip


def _scattered_times(statistics: ConsistencyStatistics) -> tuple[Finding, ...]:
    """Fixes that leave the way ahead and behind, far beyond what they tell, and not aside."""
    sigma, along, later, across = statistics.times()
    if not statistics.counted or not statistics.steered or sigma <= _TIMES:
        return ()
    if later > _ADDS_UP * along or along <= max(_ALONG * across, _OF_TOLD * statistics.reported):
        return ()
    return (
        Finding(
            "gnss: times", "warning", sigma, 0.0, _TIMES,
            f"fixes are {along:.1f} m off along the way and {across:.1f} m across it; times that "
            f"are wrong by {sigma:.2f} s explain it; are the fixes, or the odometry, stamped on "
            "arrival? give the times of the measurements, or larger sigmas",
        ),
    )  # fmt: skip


def _map(statistics: ConsistencyStatistics) -> list[Finding]:
    """The map's error as the filter sees it, which it holds for smaller than it is."""
    cells = statistics.metres / statistics.settings.map_length
    if cells < 5.0:
        return []
    high = 0.6 + (_MAP - 0.6) * math.sqrt(max(1.0, 90.0 / cells))
    square = statistics.map_error
    if square <= high:
        return []
    larger = statistics.settings.map_sigma * math.sqrt(2.0 * square)
    return [
        Finding(
            "map_sigma", "warning", math.sqrt(square), 0.0, math.sqrt(high),
            f"the map error is {statistics.settings.map_sigma * math.sqrt(square):.1f} m, as far "
            f"as it shows; each drive learns it; map_sigma = "
            f"{larger:.0f} says it from the start",
        )
    ]  # fmt: skip


def _chance(statistics: ConsistencyStatistics, time: float) -> float:
    """A ratio between T and its setting that chance makes: of few errors T is known badly."""
    errors = statistics.moving / (2.0 * max(time, 1.0) * statistics.settings.gnss_time)
    return math.exp(min(_CHANCE * math.sqrt(2.0 / errors), 20.0))


def _gnss(statistics: ConsistencyStatistics) -> list[Finding]:
    found = []
    if statistics.hidden or not statistics.steered:
        return []  # fixes as good as the wheels are not judged by them
    white, size, time, size_if_right = statistics.errors()
    band = _wider(statistics, _TIME)
    if time > 1.0 and white <= size_if_right * statistics.settings.gnss_white_ratio**2:
        band = _wider(statistics, _SURELY)
    band = max(band, _chance(statistics, time))
    time_off = not 1.0 / band <= time <= band
    if time_off:
        right = time * statistics.settings.gnss_time
        found.append(
            Finding(
                "gnss_time", "warning", right, statistics.settings.gnss_time / band,
                statistics.settings.gnss_time * band,
                f"GNSS errors persist for {right:.0f} s of driving; set gnss_time to that",
            )
        )  # fmt: skip
    sigma = math.sqrt(size if time_off else size_if_right)
    high, low = _wider(statistics, _SIGMA_TOO if time_off else _SIGMA), _wider(statistics, _SMALL)
    if sigma > high:
        usual = white <= _USUAL_WHITE * statistics.settings.gnss_white_ratio**2
        found.append(Finding("gnss sigma", "warning", sigma, low, high, _too_large(sigma, usual)))
    elif sigma < low and not time_off:
        found.append(
            Finding(
                "gnss sigma", "information", sigma, low, high,
                f"GNSS errors are {sigma:.1f} times the reported sigmas; smaller ones would "
                "let the filter decide sooner",
            )
        )  # fmt: skip
    return found


def _too_large(sigma: float, usual: bool) -> str:
    """What GNSS errors that are too large may be; `usual`: from one fix to the next they are not.

    A receiver that understates its errors does so for those that are new in each fix, too.
    """
    if not usual:
        return (
            f"GNSS errors are {sigma:.1f} times the reported sigmas; the filter adapts to that "
            "only partly; report larger sigmas"
        )
    return (
        f"over a minute the fixes leave the way by the wheels {sigma:.1f} times as far as the "
        "reported sigmas say, from one fix to the next they do not; either the wheels' heading "
        "drifts: look at tyres, slip and coarse counters; or GNSS errors last for less than "
        "gnss_time, and are as large as reported: then set gnss_time to less; or those that last "
        "are larger: then report larger sigmas"
    )


def findings_of(
    epochs: Records, output: Output, mode: int, settings: Settings, vehicle: Vehicle,
    vetting: Record, map_error: MapError | None = None, moved: float = 0.0,
) -> tuple[Finding, ...]:  # fmt: skip
    """What does not fit in a recorded drive; in clock mode the receiver's own columns alone.

    Args:
        epochs: (n,) EPOCH.
        output: (n,) the filter's estimates.
        mode: WHEELS, DISTANCE or CLOCK.
        settings: The model's numbers.
        vehicle: The car.
        vetting: What the filter withheld, `filter.vetting.motion_sources.VETTING`.
        map_error: What it has learnt of the map.
        moved: s by which the odometry was put on the clock of the fixes.
    """
    if mode == CLOCK:
        return sensor_findings(vetting)
    statistics = ConsistencyStatistics(settings, vehicle)
    statistics.take(rows_of(epochs, output))
    return findings(statistics, vetting, map_error, moved)
