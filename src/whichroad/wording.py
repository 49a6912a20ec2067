"""How messages write counts and times."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime

_UNDATED = 1e8  # s since 1970 below which a clock names no date


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number with its noun, "1 fix" or "1,200 fixes".

    Args:
        number: How many.
        noun: The singular.
        plural: The plural; None: the singular and an s.
    """
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def by_reason(counts: Mapping[str, int] | Iterable[tuple[str, int]]) -> str:
    """What was skipped and how often, "line cut short: 2, bad number: 1"."""
    pairs = counts.items() if isinstance(counts, Mapping) else counts
    return ", ".join(f"{reason}: {number:,}" for reason, number in pairs)


def moment(seconds: float) -> str:
    """A time as ISO 8601 in UTC, to the second; in seconds where the clock names no date.

    Args:
        seconds: s since 1970, or since the clock began.
    """
    if abs(seconds) < _UNDATED:
        return f"{seconds:,.0f} s"
    try:
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")[:-6] + "Z"
    except (OverflowError, OSError, ValueError):
        return f"{seconds:.4g} s"
