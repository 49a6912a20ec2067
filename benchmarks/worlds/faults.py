"""The one table of faults: what each is, how often it comes, how long it lasts.

These rates are frozen with the baseline in docs/worlds.md; a change needs a note there.
`share` is the probability that a drive has the fault where all are drawn (`--faults all`); of
faults of the map, that the map of a world has it.  Where one fault is asked for by its name,
every drive has it, and no other.
"""

from dataclasses import dataclass

import numpy as np

WHOLE = (np.inf, np.inf)  # s, of what lasts for the whole drive


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault."""

    part: str  # "receiver", "odometry" or "map"
    share: float
    seconds: tuple[float, float]  # how long it lasts, uniform; `WHOLE`: from the start to the end
    times: int  # how often it comes in a drive that has it
    what: str
    suites: str = ""  # only in drives with these sensors; empty: in all


@dataclass(frozen=True, slots=True)
class Event:
    """One fault of one drive."""

    name: str
    begin: float  # s from the drive's start
    end: float


_DOPPLER = "wheels gnss fast odometer"
_ODOMETRY = "wheels yaw odometer"

FAULTS = {
    # receivers
    "canyon": Fault("receiver", 0.25, (40, 200), 2, "two-state multipath of 8 to 40 m"),
    "jump": Fault("receiver", 0.15, (10, 60), 2, "re-acquired 15 to 80 m off, pulled in slowly"),
    "outage": Fault("receiver", 0.25, (20, 180), 1, "no fixes"),
    "lag": Fault("receiver", 0.15, WHOLE, 1, "receiver's filter lags 0.5 to 2 s, rounds corners"),
    "sigma": Fault("receiver", 0.15, WHOLE, 1, "reported sigma 2 to 3 times too small"),
    "nagoya": Fault("receiver", 0.1, WHOLE, 1, "errors and covariances of a real city drive"),
    "kubicka": Fault("receiver", 0.1, WHOLE, 1, "errors of real drives world-wide, 5 m reported"),
    "comma": Fault("receiver", 0.05, WHOLE, 1, "errors of a real u-blox, 3 m reported"),
    "standstill": Fault("receiver", 0.1, WHOLE, 1, "fixes drift up to 60 m while the car stands"),
    "speed_spike": Fault("receiver", 0.05, (0.1, 0.1), 2, "one speed of 40 to 171 m/s", _DOPPLER),
    "speed_kmh": Fault("receiver", 0.02, WHOLE, 1, "km/h read as m/s", _DOPPLER),
    "speed_stuck": Fault("receiver", 0.02, WHOLE, 1, "speed always 0", _DOPPLER),
    "course_stuck": Fault("receiver", 0.02, WHOLE, 1, "course always 0", _DOPPLER),
    "course_reversed": Fault("receiver", 0.02, WHOLE, 1, "course + 180", _DOPPLER),
    "pulled": Fault(
        "receiver", 0.0, (60, 60), 1, "pulled away by 1 to 10 m/s, then back", _ODOMETRY
    ),
    "frozen": Fault("receiver", 0.0, (5, 30), 3, "fixes repeat the last place"),
    "frozen_zero": Fault("receiver", 0.0, (5, 30), 3, "the same, with speed 0"),
    "every_third": Fault("receiver", 0.0, WHOLE, 1, "two of three fixes repeat the one before"),
    # wheels and gyros
    "slip": Fault("odometry", 0.3, (0.5, 3), 4, "a wheel or both 10 to 60 % too fast", "wheels"),
    "tyre": Fault("odometry", 0.05, (1e9, 1e9), 1, "left wheel 0.5 to 5 % off from now", "wheels"),
    "stand": Fault("odometry", 0.03, (20, 180), 1, "both counters stand still", "wheels"),
    "stuck": Fault("odometry", 0.05, (0.3, 60), 2, "one counter stands still", "wheels"),
    "dead": Fault("odometry", 0.01, WHOLE, 1, "left counter always 0", "wheels"),
    "dropped": Fault("odometry", 0.05, (10, 60), 2, "2 to 10 % of the counts lost", "wheels"),
    "bus_gap": Fault("odometry", 0.1, (1, 60), 2, "no odometry, counters go on", _ODOMETRY),
    "repeats": Fault("odometry", 0.05, (1, 10), 3, "old counts repeated, then caught up", "wheels"),
    "swapped": Fault("odometry", 0.01, WHOLE, 1, "left and right wheel swapped", "wheels"),
    "gyro_bias": Fault("odometry", 0.1, WHOLE, 1, "bias of 1 to 6 mrad/s that walks", "yaw"),
    "yaw_sign": Fault("odometry", 0.01, WHOLE, 1, "yaw rate of the other sign", "yaw"),
    "yaw_degrees": Fault("odometry", 0.01, WHOLE, 1, "deg/s read as rad/s", "yaw"),
    # tables that are filled wrongly
    "zeros": Fault("odometry", 0.0, WHOLE, 1, "odometry and receiver's speed always 0", _ODOMETRY),
    "backwards": Fault("odometry", 0.0, WHOLE, 1, "distances count backwards", _ODOMETRY),
    "no_turn": Fault(
        "odometry", 0.0, WHOLE, 1, "both wheels the same, or yaw rate 0", "wheels yaw"
    ),
    "odometry_kmh": Fault("odometry", 0.0, WHOLE, 1, "km/h read as m/s", _ODOMETRY),
    "speed_10": Fault("receiver", 0.0, WHOLE, 1, "speed always 10 m/s", _DOPPLER),
    "late": Fault("receiver", 0.0, WHOLE, 1, "times of fixes 1 s late", _ODOMETRY),
    "odometry_late": Fault("odometry", 0.0, WHOLE, 1, "its times 1 s late", _ODOMETRY),
    "odometry_18": Fault("odometry", 0.0, WHOLE, 1, "its times 18 s late", _ODOMETRY),
    # maps
    "shift": Fault("map", 0.1, WHOLE, 1, "10 to 30 m off as a whole"),
    "warp": Fault("map", 0.15, WHOLE, 1, "5 to 8 m over some 300 m"),
    "chords": Fault("map", 0.15, WHOLE, 1, "redrawn with chords up to 8 m beside the road"),
    "missing": Fault("map", 0.2, WHOLE, 1, "5 % of the streets are missing"),
    "invented": Fault("map", 0.15, WHOLE, 1, "5 % more streets, half of them beside others"),
    "oneway": Fault("map", 0.1, WHOLE, 1, "5 % of the streets one-way the wrong way"),
    "lanes_wrong": Fault("map", 0.1, WHOLE, 1, "half of the lane counts drawn at random"),
    "lanes_absent": Fault("map", 0.1, WHOLE, 1, "no lane counts"),
}

SUITES = {"wheels": 0.5, "yaw": 0.15, "gnss": 0.15, "fixes": 0.1, "fast": 0.1}
"""Share of drives with wheel counters; speed and gyro; GNSS alone with speed and course at 1 Hz;
with positions alone; with speed and course at 10 Hz.  The first two have fixes at 1 Hz too."""
BY_NAME = ("odometer",)  # fixes at 1 Hz and a distance without turns: where it is asked for


def suite_of(chosen: list[str], random: np.random.Generator) -> str:
    """The sensors of a drive; such that faults asked for by name can happen."""
    able = [
        s
        for s in SUITES
        if all(not FAULTS[f].suites or s in FAULTS[f].suites.split() for f in chosen)
    ]
    share = np.array([SUITES[s] for s in able])
    return str(random.choice(able, p=share / share.sum()))


def draw_events(
    chosen: list[str] | None, part: str, suite: str, duration: float, random: np.random.Generator
) -> list[Event]:
    """Faults of one part in one drive.

    Args:
        chosen: These; None: all, each with its share.
        part: "receiver", "odometry" or "map".
        suite: Sensors of the drive; "": any.
        duration: s, of the drive.
        random: Of this drive.

    Returns:
        Faults in the order of their beginnings.
    """
    events = []
    for name, fault in FAULTS.items():
        if fault.share == 0.0 and name not in (chosen or ()):
            continue  # only by its name; nothing is drawn, so that all others stay as they are
        drawn = random.random(fault.times + 1), random.uniform(*_finite(fault.seconds), fault.times)
        if fault.part != part or (fault.suites and suite and suite not in fault.suites.split()):
            continue
        if name not in chosen if chosen is not None else drawn[0][0] > fault.share:
            continue
        if fault.seconds == WHOLE:
            events.append(Event(name, 0.0, duration))
            continue
        for u, seconds in zip(drawn[0][1:], drawn[1], strict=True):
            begin = 40.0 + u * max(duration - 80.0, 10.0)
            events.append(Event(name, float(begin), float(min(begin + seconds, duration))))
    return sorted(events, key=lambda e: e.begin)


def _finite(seconds: tuple[float, float]) -> tuple[float, float]:
    return (0.0, 1.0) if seconds == WHOLE else seconds


def during(time: np.ndarray, events: list[Event], name: str) -> np.ndarray:
    """Whether each time is within a fault of a name, (n,)."""
    inside = np.zeros(len(time), bool)
    for e in events:
        if e.name == name:
            inside |= (time >= e.begin) & (time <= e.end)
    return inside


def has(events: list[Event], name: str) -> bool:
    """Whether there is a fault of a name."""
    return any(e.name == name for e in events)
