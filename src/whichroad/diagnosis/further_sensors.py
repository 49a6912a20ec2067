"""Further sensors whose readings fit nothing: what the filter left out, by their names."""

from collections.abc import Mapping, Sequence
from typing import Any

from .._compile import Records
from .finding import Finding

_LEAST = 5.0  # rows left out, to be named,
_FEW = 3.0  # or misfits where they are many of what was said:
_MANY = 0.3  # this share
_USUAL = 0.10  # largest share of misfits of a sensor that is sound


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


def notes_of(counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    """A sentence for each sensor that is named, for tables of many trips.

    Args:
        counts: As `readings_of` gives them.
    """
    return [
        f"sensor {name}: {one['misfits']:,} of {one['heard']:,} readings did not fit the rest, "
        f"{one['withheld']:,} were left out"
        for name, one in counts.items()
        if _is_wrong(one)
    ]


def _is_wrong(one: Any) -> bool:
    """Whether so much of a sensor did not fit that it is named."""
    share = float(one["misfits"] / max(one["heard"], 1.0))
    often = one["misfits"] >= _FEW and share >= _MANY
    return bool(share > _USUAL and (often or one["withheld"] >= _LEAST))


def further_findings(names: Sequence[str], sensors: Records) -> tuple[Finding, ...]:
    """Sensors of which rows were left out.

    Args:
        names: Of the sensors.
        sensors: `filter.evidence.evidence_kinds.SENSOR` of each, at the end of a drive, or now.
    """
    found = []
    for name, one in zip(names, sensors, strict=False):
        share = float(one["misfits"] / max(one["heard"], 1.0))
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
