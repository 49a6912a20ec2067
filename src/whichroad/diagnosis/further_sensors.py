"""Further sensors whose readings fit nothing: what the filter left out, by their names."""

import math
from collections.abc import Sequence
from typing import Any

from .._compile import Records
from ..geodesy.angles import degrees
from .finding import Finding

_LEAST = 5.0  # rows left out, to be named,
_FEW = 3.0  # or misfits where they are many of what was said:
_MANY = 0.3  # this share
_USUAL = 0.10  # largest share of misfits of a sensor that is sound
_FAR = 2.0  # sigmas by which an error that stays is larger than it is said to be, to be named


def readings_of(names: Sequence[str], sensors: Records) -> dict[str, dict[str, int]]:
    """How much of each sensor was heard, fitted nothing, and was left out: rows of the filter.

    Args:
        names: Of the sensors.
        sensors: `filter.evidence.evidence_kinds.SENSOR` of each.
    """
    return {
        name: {what: int(one[what]) for what in ("heard", "misfits", "withheld")}
        for name, one in zip(names, sensors, strict=False)
    }


def _is_wrong(one: Any) -> bool:
    """Whether so much of a sensor did not fit that it is named."""
    share = float(one["misfits"] / max(one["heard"], 1.0))
    often = one["misfits"] >= _FEW and share >= _MANY
    return bool(share > _USUAL and (often or one["withheld"] >= _LEAST))


def bias_of(sensor: Any) -> tuple[float, float, float, str]:
    """The error that stays of a sensor: learnt, its sigma, the sigma it has by itself, the unit.

    Args:
        sensor: Of `filter.evidence.evidence_kinds.SENSOR`.  Where its error is not learnt, the
            sigma is 0.
    """
    mean, variance, before = (float(one) for one in sensor["bias"])
    sigma, own = math.sqrt(max(variance, 0.0)), math.sqrt(max(before, 0.0))
    if sensor["by_angle"]:
        return -float(degrees(mean)), float(degrees(sigma)), float(degrees(own)), "deg"
    return mean, sigma, own, "m"


def further_findings(names: Sequence[str], sensors: Records) -> tuple[Finding, ...]:
    """Sensors of which rows were left out, or whose error that stays is larger than said.

    Args:
        names: Of the sensors.
        sensors: `filter.evidence.evidence_kinds.SENSOR` of each, at the end of a drive, or now.
    """
    found = []
    for name, one in zip(names, sensors, strict=False):
        share = float(one["misfits"] / max(one["heard"], 1.0))
        bias, sigma, own, unit = bias_of(one)
        if abs(bias) - _FAR * sigma > _FAR * own:
            what, part = f"m {'too much' if bias > 0.0 else 'too little'}", "offset"
            if unit == "deg":
                what, part = f"degrees {'' if bias > 0.0 else 'anti'}clockwise", "mounting"
            found.append(
                Finding(
                    f"sensor {name}: bias", "warning", bias, -_FAR * own, _FAR * own,
                    f"it is off by {abs(bias):.1f} {what} throughout; this is learnt and taken "
                    f"off; correct its {part}",
                )
            )  # fmt: skip
        if not _is_wrong(one):
            continue
        found.append(
            Finding(
                f"sensor {name}", "warning", share, 0.0, _USUAL,
                f"{100.0 * share:.0f} % of what it said did not fit the rest, and "
                f"{one['withheld']:,.0f} of {one['heard']:,.0f} readings were left out; "
                "check its sign, unit, mounting and clock, and its sigma",
            )
        )  # fmt: skip
    return tuple(found)
