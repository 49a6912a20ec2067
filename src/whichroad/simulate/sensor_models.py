"""What the car's sensors make of its true motion."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geodesy.angles import course_of, degrees
from ..observations import Array, Fixes, WheelCounts
from .lateral_profile import gauss_markov
from .simulation_settings import SimulationSettings

_COURSE_FROM = 1.0  # m/s, below which a receiver reports no course
_COUNTER = 65536  # largest initial count


class Wheels(NamedTuple):
    """What the wheels of one drive really are, which the user does not know."""

    scale: float  # metres driven per metre counted
    differential: float  # left over right radius, minus 1
    track_width: float  # m


class States(NamedTuple):
    """True motion at some times, shape (n,) each; positions in the plane's world frame."""

    time: Array  # s since the drive's start
    x: Array
    y: Array
    heading: Array  # rad, plane
    bend: Array  # 1/m, left positive
    travelled: Array  # true m since the course began
    speed: Array  # m/s


def draw_wheels(settings: SimulationSettings, random: np.random.Generator) -> Wheels:
    """Draw one car's true wheels."""
    scale, differential, track = random.normal(0.0, 1.0, 3)
    return Wheels(
        scale=1.0 + settings.scale_sigma * scale,
        differential=settings.differential_sigma * differential,
        track_width=settings.track_width * (1.0 + settings.track_sigma * track),
    )


def _slip(travelled: Array, settings: SimulationSettings, random: np.random.Generator) -> Array:
    """Distance that each wheel turned too far, (n, 2): ramps of a metre or two."""
    length = travelled[-1] - travelled[0]
    out = np.zeros((len(travelled), 2))
    for begin in random.uniform(
        travelled[0], travelled[-1], random.poisson(settings.slip_rate * length)
    ):
        ramp = np.clip((travelled - begin) / random.uniform(1.0, 4.0), 0.0, 1.0)
        out[:, random.integers(2)] += random.normal(0.0, settings.slip_sigma) * ramp
    return out


def wheel_counts(
    states: States,
    start: float,
    wheels: Wheels,
    settings: SimulationSettings,
    random: np.random.Generator,
) -> WheelCounts:
    """Rear wheel counters along the true motion.

    Each wheel rolls ds -+ (track / 2) dtheta; its count is that over its true metres per
    count, rounded down.

    Args:
        states: True motion at the readings, the heading not wrapped.
        start: Seconds since 1970 of the drive's start.
        wheels: The car's true wheels.
        settings: Nominal wheels, walk, slip.
        random: Source of chance.

    Returns:
        Cumulative counts, not wrapped, from an arbitrary beginning.
    """
    steps = np.diff(states.travelled, prepend=states.travelled[:1])
    walk = random.normal(0.0, settings.wheel_walk, (len(steps), 2)) * np.sqrt(steps)[:, None]
    extra = np.cumsum(walk, axis=0) + _slip(states.travelled, settings, random)
    rolled = states.travelled - states.travelled[0]
    turned = 0.5 * wheels.track_width * (states.heading - states.heading[0])
    count = np.empty((len(steps), 2))
    for side, sign in ((0, 1.0), (1, -1.0)):
        per_tick = settings.metres_per_tick * wheels.scale * (1 + sign * wheels.differential / 2)
        phase = random.integers(_COUNTER) + random.random()
        count[:, side] = np.floor((rolled - sign * turned + extra[:, side]) / per_tick + phase)
    return WheelCounts(start + states.time, count[:, 0], count[:, 1])


class Pull(NamedTuple):
    """A false position that comes, stays and wears off: what reflections do to a receiver."""

    begin: float  # m driven where it begins
    right: float  # m, to the right of the direction of travel
    time: float  # s over which it wears off
    reported: float  # m, sigma per axis that the receiver reports meanwhile, at least
    hold: float = 0.0  # m driven before it begins to wear off
    rise: float = 0.0  # m driven over which it grows to its size


class Jump(NamedTuple):
    """A receiver that is elsewhere for a while, without reporting it."""

    begin: float  # m driven where it begins
    east: float  # m
    north: float
    seconds: float  # how long


class GnssErrors(NamedTuple):
    """Errors of a drive's fixes, east and north in m, and their reported sigmas."""

    east: Array  # (n,)
    north: Array
    cov_ee: Array  # m², reported
    cov_en: Array
    cov_nn: Array
    false: NDArray[np.bool_]  # (n,), in a multipath episode


def gnss_errors(
    time: Array,
    travelled: Array,
    settings: SimulationSettings,
    random: np.random.Generator,
    moving: Array,
) -> GnssErrors:
    """Draw the position errors of fixes: slow, white, and multipath episodes.

    Args:
        time: (n,) s.
        travelled: (n,) m at the fixes.
        settings: Sizes and times.
        random: Source of chance.
        moving: (n,) s moved since the start: the slow error's clock, which stops with the car.

    Returns:
        Errors and reported covariances.
    """
    ratio, angle = np.sqrt(settings.gnss_axis_ratio), random.uniform(-np.pi, np.pi)
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    stretch = axes * np.array([ratio, 1.0 / ratio]) / np.sqrt(0.5 * (ratio**2 + ratio**-2))
    bias = random.uniform(settings.gnss_bias_low, settings.gnss_bias_high)
    unit = gauss_markov(moving, bias, settings.gnss_time, random)
    unit += random.normal(0.0, settings.gnss_white, unit.shape)
    error = unit @ stretch.T
    false = np.zeros(len(time), dtype=bool)
    length = travelled[-1] - travelled[0]
    for _ in range(random.poisson(settings.multipath_rate * length)):
        begin = np.interp(random.uniform(travelled[0], travelled[-1]), travelled, time)
        during = (time >= begin) & (time < begin + random.exponential(settings.multipath_time))
        error[during] += random.normal(0.0, settings.multipath_sigma, 2)
        false |= during
    reported = settings.gnss_reported * np.exp(
        random.normal(0.0, settings.gnss_reported_spread, len(time))
    )
    shape = stretch @ stretch.T
    return GnssErrors(
        error[:, 0],
        error[:, 1],
        reported**2 * shape[0, 0],
        reported**2 * shape[0, 1],
        reported**2 * shape[1, 1],
        false,
    )


def pulled(states: States, convergence: Array, errors: GnssErrors, pull: Pull) -> GnssErrors:
    """Fixes' errors with one more: a pull to the right that wears off.

    Args:
        states: True motion at the fixes.
        convergence: (n,) rad, of the plane there.
        errors: What the fixes have already.
        pull: Where, how far, how long.

    Returns:
        The errors, at least `pull.reported` being reported as long as the pull lasts.
    """
    driven = states.travelled - states.travelled[0]
    begin, wearing = np.interp([pull.begin, pull.begin + pull.hold], driven, states.time)
    during = (states.time >= begin) & (states.time < wearing + 3.0 * pull.time)
    worn = np.exp(-np.maximum(states.time - wearing, 0.0) / pull.time)
    grown = np.clip((driven - pull.begin) / max(pull.rise, 1e-3), 0.0, 1.0)
    size = np.where(during, pull.right * worn * grown, 0.0)
    bearing = np.pi - states.heading + convergence  # of what lies to the right
    report = (errors.cov_ee + errors.cov_nn) / 2.0
    more = np.where(during, np.maximum(pull.reported**2 / report, 1.0), 1.0)
    return GnssErrors(
        errors.east + size * np.sin(bearing),
        errors.north + size * np.cos(bearing),
        errors.cov_ee * more,
        errors.cov_en * more,
        errors.cov_nn * more,
        errors.false | during,
    )


def jumped(states: States, errors: GnssErrors, jump: Jump) -> GnssErrors:
    """Fixes' errors with one more: a jump to another place and back."""
    since = states.time - np.interp(jump.begin, states.travelled - states.travelled[0], states.time)
    during = (since >= 0.0) & (since < jump.seconds)
    return errors._replace(
        east=errors.east + during * jump.east,
        north=errors.north + during * jump.north,
        false=errors.false | during,
    )


def antenna(states: States, settings: SimulationSettings) -> tuple[Array, Array, Array, Array]:
    """Offset of the antenna from M in the plane's axes, and its velocity.

    Returns:
        (n,) m along the plane's x and y; speed, m/s; heading of its motion, rad.
    """
    ahead, left = settings.antenna_forward, settings.antenna_left
    c, s = np.cos(states.heading), np.sin(states.heading)
    forward, sideways = 1.0 - states.bend * left, states.bend * ahead
    return (
        ahead * c - left * s,
        ahead * s + left * c,
        states.speed * np.hypot(forward, sideways),
        states.heading + np.arctan2(sideways, forward),
    )


def fixes_from(
    time: Array,
    position: tuple[Array, Array],
    velocity: tuple[Array, Array],
    errors: GnssErrors,
    settings: SimulationSettings,
    random: np.random.Generator,
) -> Fixes:
    """Put fixes together: positions as they are, Doppler speed and course with noise.

    Args:
        time: (n,) s since 1970.
        position: Latitude and longitude with their errors, degrees.
        velocity: True speed (m/s) and bearing (rad clockwise from true north) of the antenna.
        errors: For the reported covariances.
        settings: Doppler noise.
        random: Source of chance.

    Returns:
        Fixes; no course is reported below 1 m/s.
    """
    n, sigma = len(time), settings.gnss_speed_sigma
    noise = random.normal(0.0, sigma, (n, 2))
    north = velocity[0] * np.cos(velocity[1]) + noise[:, 0]
    east = velocity[0] * np.sin(velocity[1]) + noise[:, 1]
    speed = np.hypot(north, east)
    sigma_bearing = np.full(n, np.inf)
    moving = speed > _COURSE_FROM
    sigma_bearing[moving] = degrees(max(sigma, 1e-3) / speed[moving])
    return Fixes(
        time=time,
        lat_deg=position[0],
        lon_deg=position[1],
        cov_ee=errors.cov_ee,
        cov_en=errors.cov_en,
        cov_nn=errors.cov_nn,
        speed=speed,
        sigma_speed=np.full(n, max(sigma, 1e-3)),
        bearing_deg=course_of(east, north),
        sigma_bearing_deg=sigma_bearing,
        flags=np.zeros(n, dtype=np.uint16),
    )
