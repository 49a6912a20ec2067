"""Which sensor does not measure what it should, and how: what the filter withheld, by its name."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime

from .._compile import Record
from ..filter.vetting.latency import found_delay
from ..filter.vetting.motion_sources import ARC, COURSE, SPEED, TURN
from ..filter.vetting.windows import BY_WHEELS
from ..geodesy.angles import degrees
from ..sensors.dead_band import LEAST
from ..sensors.seldom_read import UNFIT
from ..sensors.takeover import GYRO, WHEELS, Takeover
from ..sensors.whole_columns import BACKWARDS, STANDS, TURNLESS
from ..wording import counted
from .finding import Finding

_LEAST = 3.0  # s for which a source was withheld, to be named
_LEAST_IMPOSSIBLE = 10.0  # s, the same of odometry that did what no car can do
_IMPOSSIBLE = 4  # its place in what is counted
_UNITS = {3.6: "km/h", 1.944: "knots", 2.237: "mph", 3.281: "feet/s"}
_NEAR = 0.08  # of the ratio of a unit
_STANDS = 0.1  # ratio below which a source stands still
_OPPOSITE = -0.5  # ratio of turns below which they have the other sign
_IN_DEGREES = 5.0  # above which they are in degrees
_SILENT = 10.0  # s, to be named
_UNTURNED = 500.0  # m, the same
_LATE = 0.25  # s, to be named
_TURNS = 0.02  # of the scale of turns, to be named
_OFFSET, _SURE = 3e-4, 3.0  # rad/m of turns that are mended, and sigmas of it, to be named
_SIZE, _LEARNT_SIZE = 0.01, 0.05  # of the odometer's scale that was mended, or learnt: to be named
_BEHIND = 0.1  # s behind others on line, within which none is refused for long
_READINGS = {
    "gnss": ("fixes", "the odometry"),
    "odometry": ("odometry readings", "the fixes"),
    "readings": ("readings of further sensors", "the others"),
}
_COARSE = 0.15  # rad that a tick of each wheel turns, above which it is noted
_DEGREES = 0.1  # and above that, below which they may be in degrees
_STUCK = 0.0175  # rad that a course turns in a window, below which it hardly changes
_ALIKE = 0.8  # mean of unit vectors above which courses are off by the same angle


def sensor_findings(vetting: Record, moved: float = 0.0) -> tuple[Finding, ...]:
    """Sensors that were withheld or mended, named.

    Args:
        vetting: `filter.vetting.motion_sources.VETTING` at the end of a drive, or now.
        moved: s by which the odometry of a recorded drive was put on the clock of the fixes.
    """
    found = []
    delay = moved + found_delay(vetting["latency"])
    if abs(delay) > _LATE:
        found.append(clock_finding(delay, _LATE))
    seconds = vetting["seconds"].tolist()
    if seconds[ARC] >= _LEAST:
        found.append(_distance(vetting))
    elif seconds[_IMPOSSIBLE] >= _LEAST_IMPOSSIBLE:
        found.append(
            Finding(
                "odometry: impossible", "warning", seconds[_IMPOSSIBLE], 0.0,
                _LEAST_IMPOSSIBLE,
                f"it measured what no car can do{_when(vetting, _IMPOSSIBLE)}, and was withheld; "
                "look for a counter that stands still, jumps or wraps (counter_bits), and for the "
                "yaw rate's unit",
            )
        )  # fmt: skip
    slips = float(vetting["slip"]["seconds"])
    ways = vetting["wheel_size"]["scale"]
    factor, rate = float(ways["factor"]), float(ways["rate"])
    mended = _SIZE if abs(factor - 1.0) > _SIZE else _LEARNT_SIZE
    sized = abs(factor * rate - 1.0) > mended
    other = sized or abs(delay) > _LATE  # a receiver that is late has another speed
    if slips >= _LEAST and max(seconds[ARC], seconds[SPEED]) < _LEAST and not other:
        found.append(
            Finding(
                "odometry: slips", "warning", slips, 0.0, _LEAST,
                f"for {slips:,.0f} s in all its speed was not the receiver's, which had agreed "
                "before; its way then counted as not measured; look for wheels that slide or spin",
            )
        )  # fmt: skip
    if sized:
        found.append(_scale(ways))
    if abs(vetting["turn_size"]["scale"]["factor"] - 1.0) > _TURNS:
        found.append(_turn_scale(vetting))
    offset = vetting["turn_offset"]
    if abs(offset["mends"]) > max(_OFFSET, _SURE * math.sqrt(offset["variance"])):
        found.append(_turn_offset(float(offset["mends"])))
    if vetting["turnabouts"]:
        found.append(_column(BACKWARDS))
    if vetting["unturned"] >= _UNTURNED:
        found.append(_column(TURNLESS))
    if seconds[TURN] >= _LEAST:
        found.append(_turns(vetting))
    if seconds[SPEED] >= _LEAST:
        found.append(_speed(vetting))
    if seconds[COURSE] >= _LEAST:
        found.append(_course(vetting))
    repeated = float(vetting["repeats"]["seconds"])
    if repeated >= _LEAST:
        found.append(
            Finding(
                "gnss: repeated", "warning", repeated, 0.0, _LEAST,
                f"for {repeated:,.0f} s fixes repeated an earlier place, to the digit or within a "
                "metre, while the vehicle moved, and were withheld; look at what fills the gaps of "
                "the receiver, and leave them empty",
            )
        )  # fmt: skip
    return tuple(found)


def clock_finding(late: float, band: float) -> Finding:
    """Fixes that come late against the odometry, s, or early."""
    return Finding(
        "clock", "warning", late, -band, band,
        f"fixes are {abs(late):.1f} s {'late' if late > 0.0 else 'early'} against the "
        f"odometer; add {-late:.1f} s to gnss, or {late:.1f} s to odometry, under [clock] in "
        "vehicle.toml",
    )  # fmt: skip


def refused_finding(kind: str, behind: float, refused: float) -> Finding:
    """Readings on line of which most are refused, as others of another clock came before them.

    Args:
        kind: "gnss", "odometry", or "readings" of further sensors.
        behind: By so much they are behind the others, s; less than 0: ahead.
        refused: For how long that has been so, s.
    """
    who, others = _READINGS[kind]
    side = "behind" if behind > 0.0 else "ahead of"
    text = (
        f"{who} are {abs(behind):,.2f} s {side} {others}, and most are refused, for "
        f"{refused:,.0f} s now; correct the clock that is wrong: add {behind:.2f} s to the times "
        f"of these, or {-behind:.2f} s to those of {others}"
    )
    if behind > 0.0:
        text += "; if they only arrive late, sort all by their times before, as whichroad live does"
    return Finding(f"{kind}: clock", "warning", behind, -_BEHIND, _BEHIND, text)


def late_finding(kind: str, share: float, most: float) -> Finding:
    """Readings on line of which many are refused, as later ones of others came before them.

    Args:
        kind: As of `refused_finding`.
        share: How many of them lately.
        most: From which share on that is worth a note.
    """
    who, others = _READINGS[kind]
    return Finding(
        f"{kind}: late", "information", share, 0.0, most,
        f"of {who} {share:.0%} were refused lately: they came after {others} of later times; sort "
        "all by their times before, as whichroad live does",
    )  # fmt: skip


def set_ahead_finding(step: float) -> Finding:
    """The clock of odometry alone stepped ahead on line, so far in all, s."""
    return Finding(
        "gnss: clock", "warning", step, -_BEHIND, _BEHIND,
        f"fixes are {step:.2f} s behind the odometry since its clock stepped ahead, and are taken "
        f"as so much later; correct the clock that is wrong: add {step:.2f} s to the times of "
        f"these, or {-step:.2f} s to those of the odometry",
    )  # fmt: skip


def set_back_finding(step: float, count: int) -> Finding:
    """The clock of the sensors was set back on line, by a step at last (s), so often."""
    return Finding(
        "clock: set back", "information", step, 0.0, 0.0,
        f"odometry went on at times that it had before, {counted(count, 'time')}; the filter goes "
        f"on by the clock before, by which nothing is lost; have that clock slewed in place of "
        "stepped while driving (chrony, ntpd)",
    )  # fmt: skip


# what is wrong throughout: how much of the motion it measured, and what to do
_COLUMNS = {
    STANDS: (
        0.0, "it was 0 throughout, while the fixes moved, and was not used; look at the counters "
        "(a vehicle that is carried looks the same)",
    ),
    BACKWARDS: (
        -1.0, "it counted backwards for longer than anybody drives so, and was taken the other way "
        "round; check the sign of metres_per_tick, of the speed, or the gear",
    ),
    UNFIT: (
        0.0, "it is read as seldom as the places and does not fit the way between them, so that it "
        "was not used; look at its unit and at what it counts",
    ),
    TURNLESS: (
        0.0, "it never measured any turn, which no sensor does; its turns were not used; are both "
        "wheels the same column, or is the yaw rate always 0?",
    ),
}  # fmt: skip


def _column(what: str) -> Finding:
    ratio, advice = _COLUMNS[what]
    return Finding(f"odometry: {what}", "warning", ratio, 0.9, 1.1, advice)


def column_findings(wrong: Sequence[str]) -> tuple[Finding, ...]:
    """Odometry that was wrong throughout, named.

    Args:
        wrong: As of `sensors.whole_columns.less_wrong`.
    """
    return tuple(map(_column, wrong))


def tick_findings(turn: float) -> tuple[Finding, ...]:
    """Counters of wheels so coarse that turns are lost in their ticks.

    Args:
        turn: That they resolve, rad (`sensors.odometry.turn_of_ticks`); 0: they measure none.
    """
    if turn <= _COARSE:
        return ()
    text = (
        f"their ticks tell a turn to {degrees(turn):.0f} degrees, and smaller ones are lost; use "
        "finer counters, or give the distance as a plain odometer, with a yaw rate where there is "
        "one"
    )
    return (Finding("wheels: ticks", "information", turn, 0.0, _COARSE, text),)


def least_speed_findings(found: float) -> tuple[Finding, ...]:
    """Odometry that reads 0 below a speed, as its readings have told.

    Args:
        found: That speed, m/s; 0: there is none, or the vehicle tells it.
    """
    if not found:
        return ()
    text = (
        f"it reads 0 below {found:.2f} m/s, where the vehicle may creep; "
        f"set least_speed_mps = {found:.2f} under [wheels] in vehicle.toml (least_speed)"
    )
    return (Finding("odometry: least speed", "information", found, 0.0, LEAST, text),)


def takeover_findings(takeover: Takeover | None) -> tuple[Finding, ...]:
    """Wheels or a gyro beside them that turned otherwise than the vehicle, or said nothing.

    Args:
        takeover: At the end of a drive, or now; None: there is no such gyro.
    """
    if takeover is None:
        return ()
    found = []
    squares = {WHEELS: takeover.sums[2], GYRO: takeover.sums[0]}  # of the other one
    for who, name in ((WHEELS, "wheels"), (GYRO, "gyro")):
        seconds, silent = takeover.seconds[who], takeover.silent[who]
        if seconds >= _LEAST:
            gain = takeover.sums[1] / max(squares[who], 1e-9)
            what, advice = _turned_wrongly(who, gain)
            text = f"for {seconds:,.0f} s it turned otherwise than the rest; {advice}"
            found.append(Finding(f"{name}: {what}", "warning", gain, 0.9, 1.1, text))
        if silent >= _SILENT:
            text = f"nothing was heard of it for {silent:,.0f} s, while the other one was heard"
            found.append(Finding(f"{name}: silent", "warning", silent, 0.0, _SILENT, text))
    return tuple(found)


def _turned_wrongly(who: int, gain: float) -> tuple[str, str]:
    """What is wrong with turns that are so many times those of the other one, and what to do."""
    if gain < _OPPOSITE:
        why = ("left and right are swapped", "the yaw rate has the other sign")[who]
        return "sign of turns", f"{why}"
    if abs(gain) < _DEGREES and who == GYRO:
        return "stands still", "the gyro measured no turn; look at its cable and its unit"
    if gain > _IN_DEGREES and who == GYRO:
        return "unit of turns", "is the yaw rate in degrees a second?"
    if who == WHEELS:
        return "turns", "look for a wheel that stands still, slips or has another size"
    return "turns", "look at the yaw rate's unit and mounting"


def _when(vetting: Record, source: int) -> str:
    """From when on, and for how long, a source was withheld."""
    begin = datetime.fromtimestamp(float(vetting.since[source]), UTC)
    return f" from {begin:%H:%M:%S} UTC on, for {float(vetting.seconds[source]):,.0f} s in all"


def _ratio(vetting: Record, source: int) -> float:
    """What a source said over what the others did, while it was withheld."""
    return float(vetting.reported[source] / max(vetting.seen[source], 1e-9))


def _distance(vetting: Record) -> Finding:
    ratio, when = _ratio(vetting, ARC), _when(vetting, ARC)
    if ratio < _STANDS:
        return Finding(
            "odometry: stands still", "warning", ratio, 0.9, 1.1,
            f"it measured no motion{when}, while the fixes moved on; it was withheld; look at the "
            "counters (a vehicle that is carried looks the same)",
        )  # fmt: skip
    if 0.9 <= ratio <= 1.1:
        return Finding(
            "odometry: distance", "warning", float(vetting.seconds[ARC]), 0.0, _LEAST,
            f"it did not agree with the fixes{when}, though both moved as far on the whole; it was "
            "withheld; look for wheels that slip, counters that lag, and fixes that jump",
        )  # fmt: skip
    return Finding(
        "odometry: distance", "warning", ratio, 0.9, 1.1,
        f"it measured {ratio:.2f} of the way of the fixes{when}; it was withheld; check "
        "metres_per_tick and the unit of the speed",
    )  # fmt: skip


def _scale(ways: Record) -> Finding:
    """An odometer whose scale was found to be another one."""
    metres = float(ways.factor * ways.rate)
    when = ""
    if ways.time > -math.inf:
        when = f", as found at {datetime.fromtimestamp(float(ways.time), UTC):%H:%M:%S} UTC"
    return Finding(
        "wheels: scale", "warning", metres, 1.0 - _SIZE, 1.0 + _SIZE,
        f"one metre by the odometer is {metres:.3f} m by the fixes{when}, and is taken for that; "
        "correct metres_per_tick (other tyres, or another vehicle's numbers?) or the speed's unit",
    )  # fmt: skip


def _turn_scale(vetting: Record) -> Finding:
    """Turns whose scale was found to be another one."""
    gain = float(vetting.turn_size.scale.factor)
    name = "gyro: scale"
    text = (
        f"turns were taken {gain:.2f} times as measured, which fits best; either the yaw rate has "
        "another scale, or its offset has jumped, and no scale is right; compare it with 0 where "
        "the vehicle stands, before and after"
    )
    if vetting.steered == BY_WHEELS:
        name = "wheels: track width"
        text = (
            f"true turns are {gain:.3f} times those that are measured, and are taken so; divide "
            f"track_width by {gain:.3f}, or correct the yaw rate"
        )
    return Finding(name, "warning", gain, 1.0 - _TURNS, 1.0 + _TURNS, text)


def _turn_offset(mends: float) -> Finding:
    """A yaw rate that errs by the metre."""
    return Finding(
        "gyro: offset", "warning", -mends, -_OFFSET, _OFFSET,
        f"the yaw rate is {-mends:.4f} rad/m off: it errs by so much a metre, and not at rest; it "
        "is mended by what was learnt; if it comes from a steering wheel, correct that one's zero",
    )  # fmt: skip


def _turns(vetting: Record) -> Finding:
    told = float(vetting.reported[TURN])
    gain = float(vetting.seen[TURN]) / told if told > 0.0 else 1.0
    when = _when(vetting, TURN)
    if gain < _OPPOSITE:
        return Finding(
            "odometry: sign of turns", "warning", gain, 0.9, 1.1,
            f"it turned the other way{when}; turns were withheld; left and right wheel are "
            "swapped, or the yaw rate has the other sign",
        )  # fmt: skip
    if 0.0 <= gain < _DEGREES:
        return Finding(
            "odometry: unit of turns", "warning", gain, 0.9, 1.1,
            f"the vehicle turned by {gain:.3f} of what was measured{when}; turns were withheld; "
            "is the yaw rate in degrees a second?",
        )  # fmt: skip
    return Finding(
        "odometry: turns", "warning", gain, 0.9, 1.1,
        f"they did not agree with the fixes{when}, and were withheld; look for a wheel that "
        "stands still or has another size",
    )  # fmt: skip


def _speed(vetting: Record) -> Finding:
    ratio, when = _ratio(vetting, SPEED), _when(vetting, SPEED)
    if ratio < _STANDS:
        text = f"the receiver's speed stood at 0{when}, while its positions moved on"
    else:
        unit = next((name for by, name in _UNITS.items() if abs(ratio / by - 1.0) < _NEAR), None)
        text = f"the receiver's speed was {ratio:.2f} times that of its positions{when}"
        text += f"; it looks like {unit}" if unit else ""
    return Finding("gnss speed", "warning", ratio, 0.9, 1.1, f"{text}; it was withheld")


def _course(vetting: Record) -> Finding:
    count = max(float(vetting.reported[COURSE]), 1.0)
    c, s = (float(x) / count for x in vetting.offs)
    off, when = float(degrees(math.atan2(s, c))), _when(vetting, COURSE)
    text = f"courses did not agree with the way of the positions{when}"
    if math.hypot(c, s) > _ALIKE:
        text = f"courses were {abs(off):.0f} degrees off the way of the positions{when}"
    elif float(vetting.seen[COURSE]) / count < _STUCK:
        text = f"the course hardly changed{when}, while the vehicle turned"
    return Finding("gnss course", "warning", off, -20.0, 20.0, f"{text}; they were withheld")
