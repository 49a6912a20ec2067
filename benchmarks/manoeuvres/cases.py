"""The table of scenes: each drive with its sensors, what is wrong with them, and its control."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from whichroad import GeoFix

from ..worlds.drives import START
from ..worlds.maps import Plane
from . import scenes
from .motion import Motion
from .sensors import SUITES, Heard, Receiver, fixes, of_sigma, wheel_ticks
from .streets import Plan

HOUR = 3600.0
_SETTLED = 3.0  # s, after which a wrong stamp has no excuse
_PLAIN = ("wheels", "odometer")
_MOVED = ("wheels", "yaw", "odometer")
_THREE = (*_PLAIN, "odometer and Doppler")
_ALONE = ("Doppler", "fixes")
_NO_TURNS = ("odometer", "odometer and Doppler", "Doppler", "fixes")
_SIGNS = ("wheels", "wheels without a sign", "yaw, speed without a sign", *_NO_TURNS[:2])

Clock = Callable[[list[Heard], float], list[Heard]]  # of readings and the moment it goes wrong


@dataclass(frozen=True, slots=True)
class Case:
    """One row: a drive with its sensors."""

    what: str
    draw: Callable[[np.random.Generator], Plan]
    suites: tuple[str, ...]
    receiver: Receiver = field(default_factory=Receiver)
    factor: float = 1.0  # of what both wheels count, from the moment on
    clock: Clock | None = None
    live: bool = False  # answered on line only
    counts: tuple[float, float] | None = None  # s after the moment, s it lasts; None: all counts


def lying(ahead: float) -> Clock:
    """One fix is stamped `ahead` s too late."""

    def change(heard: list[Heard], moment: float) -> list[Heard]:
        later = (k for k, h in enumerate(heard) if h.when > moment)
        k = next((k for k in later if isinstance(heard[k].reading, GeoFix)), None)
        return [_shifted(h, ahead) if n == k else h for n, h in enumerate(heard)]

    return change


def set_back(heard: list[Heard], moment: float) -> list[Heard]:
    """From a moment on all stamps are an hour too early."""
    return [_shifted(h, -HOUR) if h.when > moment else h for h in heard]


def silent(seconds: float, dark: float = 0.0) -> Clock:
    """No sensor says anything for so long, and the receiver not for `dark` s more."""

    def change(heard: list[Heard], moment: float) -> list[Heard]:
        back = moment + seconds
        fixed = back + dark
        return [
            h
            for h in heard
            if not moment <= h.when < (fixed if isinstance(h.reading, GeoFix) else back)
        ]

    return change


def whole_seconds(heard: list[Heard], _: float) -> list[Heard]:
    """Times of fixes are cut to whole seconds."""
    return [
        Heard(h.when, replace(h.reading, time=math.floor(h.when)))
        if isinstance(h.reading, GeoFix)
        else h
        for h in heard
    ]


def _shifted(heard: Heard, seconds: float) -> Heard:
    return Heard(heard.when, replace(heard.reading, time=heard.when + seconds))


def sense(
    case: Case, suite: str, motion: Motion, moment: float, plane: Plane, random: np.random.Generator
) -> list[Heard]:
    """What the sensors of a drive say, in the order in which it comes.

    Args:
        case: Its errors.
        suite: Of `SUITES`.
        motion: The drive.
        moment: When a fault begins, s.
        plane: In which it lies.
        random: Of its errors; receiver and odometry draw apart.
    """
    of_fixes, of_odometry = random.spawn(2)
    odometry, doppler = SUITES[suite]
    if odometry is wheel_ticks and case.factor != 1.0:
        factor = np.where(motion.time < moment, 1.0, case.factor)
        odometry = partial(wheel_ticks, factor=factor)
    heard = fixes(motion, case.receiver, doppler, plane, of_fixes)
    heard += odometry(motion, of_odometry) if odometry else []
    heard.sort(key=lambda h: h.when)
    return case.clock(heard, START + moment) if case.clock else heard


def _control(what: str, suites: tuple[str, ...], *cases: Case) -> list[Case]:
    """Cases, and the drive of the first one with nothing wrong."""
    sound = replace(cases[0], what=what, suites=suites, receiver=Receiver(), factor=1.0, clock=None)
    return [*cases, sound]


_LONG = partial(scenes.town, turns=40)


def _stamp(ahead: float) -> Case:
    return Case(
        f"{ahead:.0f} s ahead", scenes.town, ("Doppler", "fixes"), clock=lying(ahead), live=True,
        counts=(ahead + _SETTLED, 0.0),
    )  # fmt: skip


def _silence(seconds: float, dark: float = 0.0) -> Case:
    what = f"{seconds:.0f} s{', then dark' if dark else ''}"
    return Case(
        what, _LONG, _MOVED, clock=silent(seconds, dark), live=True, counts=(0.0, seconds + dark)
    )


def _reversing(metres: float, cruise: float) -> Case:
    draw = partial(scenes.backwards, metres=metres, cruise=cruise)
    return Case(f"{metres:.0f} m", draw, ("wheels", "yaw"))


SCENES: dict[str, list[Case]] = {
    "town": [
        Case("sound", scenes.town, ("wheels", "yaw", "odometer", "Doppler", "fixes")),
        Case("on line", scenes.town, ("wheels", "Doppler", "fixes"), live=True),
    ],
    "u_turn": [
        Case("in the street", scenes.u_turn, _THREE),
        Case("driven on", partial(scenes.u_turn, turned=False), _THREE),
    ],
    "yard": [
        Case("unmapped", scenes.yard, _THREE),
        Case("mapped", partial(scenes.yard, mapped=True), _THREE),
    ],
    "side_street": [
        Case("unmapped", scenes.side_street, _THREE),
        Case("mapped", partial(scenes.side_street, mapped=True), _THREE),
    ],
    "gaps": [
        Case("up to 3 m", scenes.gaps, ("wheels", *_NO_TURNS)),
        Case("none", partial(scenes.gaps, cut=False), ("wheels", *_NO_TURNS)),
    ],
    "reversing": [_reversing(80.0, 5.0), _reversing(290.0, 3.5), _reversing(0.0, 0.0)],
    "no sign": [
        Case("out of a drive", scenes.backed_out, _SIGNS),
        Case("three points", scenes.three_points, _SIGNS),
        Case("80 m", partial(scenes.backwards, metres=80.0, cruise=3.0), _SIGNS),
        Case("forwards", partial(scenes.backwards, metres=0.0, cruise=0.0), _SIGNS),
    ],
    "coarse": [
        *(Case(f"{s:.0f} m", _LONG, ("wheels",), of_sigma(s, 5.0)) for s in (30.0, 60.0, 200.0)),
        Case("3 m", _LONG, ("wheels",), of_sigma(3.0, 5.0)),
    ],
    "fine": [
        *(Case(f"{s:g} m", scenes.town, _NO_TURNS, of_sigma(s)) for s in (0.3, 0.02)),
        Case("0.02 m, 5 Hz", scenes.town, _NO_TURNS, of_sigma(0.02, 0.2)),
        *(Case(f"{s:g} m, 10 Hz", scenes.town, _ALONE, of_sigma(s, 0.1)) for s in (0.02, 0.08)),
        *(
            Case(f"0.3 m, {draw.__name__}", draw, _NO_TURNS, of_sigma(0.3))
            for draw in (scenes.yard, scenes.u_turn, scenes.side_street, scenes.gaps)
        ),
        Case("2 m", scenes.town, _NO_TURNS),
    ],
    "minutes": [
        Case("a fix a minute", _LONG, ("wheels", "yaw"), Receiver(period=60.0)),
        Case("a fix a second", _LONG, ("wheels", "yaw")),
    ],
    "stamp": _control("right", ("Doppler", "fixes"), _stamp(2.0), _stamp(5.0), _stamp(10.0)),
    "clock": _control(
        "right", ("wheels", "Doppler"),
        Case("an hour back", scenes.town, ("wheels", "Doppler"), clock=set_back, live=True,
             counts=(0.0, 0.0)),
    ),
    "silence": _control(
        "none", _MOVED,
        _silence(5.0), _silence(10.0), _silence(30.0), _silence(5.0, 60.0), _silence(30.0, 60.0),
    ),
    "seconds": _control(
        "as they are", _PLAIN, Case("whole", scenes.town, _PLAIN, clock=whole_seconds)
    ),
    "tyres": _control(
        "right", ("wheels",),
        Case("3 % more", _LONG, ("wheels",), factor=1.03, counts=(0.0, math.inf)),
        Case("3 % less", _LONG, ("wheels",), factor=0.97, counts=(0.0, math.inf)),
    ),
}  # fmt: skip
"""Scenes by name; the last case of each is the control, of `town` all are."""
