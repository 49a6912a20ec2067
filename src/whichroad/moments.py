"""Moments and windows of time as they are written in options."""

from datetime import UTC, datetime

from .errors import SettingError

Moment = float | datetime


def parse_window(text: str) -> tuple[Moment, Moment]:
    """`START:END` of a mask as two moments; ISO times hold colons themselves.

    Raises:
        SettingError: It is no window.
    """
    for index, letter in enumerate(text):
        if letter == ":":
            begin, end = _moment(text[:index]), _moment(text[index + 1 :])
            if begin is not None and end is not None and type(begin) is type(end):
                if begin < end:  # type: ignore[operator]
                    return begin, end
                raise SettingError(f"mask {text!r} ends before it starts")
    raise SettingError(
        f"mask is {text!r}; START:END in seconds from the drive's start (120:240) or in ISO "
        "times (2026-06-01T08:02:00Z:2026-06-01T08:04:00Z) was expected"
    )


def _moment(text: str) -> Moment | None:
    """Seconds, or a time (UTC unless it has an offset), or None."""
    try:
        return float(text)
    except ValueError:
        pass
    if "T" not in text:
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return None
    return time if time.tzinfo else time.replace(tzinfo=UTC)
