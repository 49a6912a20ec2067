"""Further sensors whose readings fit nothing: what the filter left out, by their names."""

from collections.abc import Sequence

from .._compile import Records
from .finding import Finding

_LEAST = 5.0  # rows left out, to be named,
_FEW = 3.0  # or misfits where they are many of what was said:
_MANY = 0.3  # this share
_USUAL = 0.05  # largest share of misfits of a sensor that is sound


def readings_of(names: Sequence[str], sensors: Records) -> dict[str, dict[str, int]]:
    """How much of each sensor was heard, fitted nothing, and was left out: rows of the filter.

    Args:
        names: Of the sensors.
        sensors: `filter.evidence_kinds.SENSOR` of each.
    """
    return {
        name: {what: int(one[what]) for what in ("heard", "misfits", "withheld")}
        for name, one in zip(names, sensors, strict=False)
    }


def further_findings(names: Sequence[str], sensors: Records) -> tuple[Finding, ...]:
    """Sensors of which rows were left out.

    Args:
        names: Of the sensors.
        sensors: `filter.evidence_kinds.SENSOR` of each, at the end of a drive, or now.
    """
    found = []
    for name, one in zip(names, sensors, strict=False):
        share = float(one["misfits"] / max(one["heard"], 1.0))
        often = one["misfits"] >= _FEW and share >= _MANY
        if share <= _USUAL or not (often or one["withheld"] >= _LEAST):
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
