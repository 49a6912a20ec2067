"""Why an answer has its status, in words for people."""

from collections.abc import Callable, Sequence
from typing import Any

STATUS = ("on_road", "ambiguous", "off_road", "outage", "stopped", "lost")

RECENT = 3.0  # s, validity of the verdict on a fix
COUNTS = 0.05  # P from which on a third road is named
_FAR = 20.0  # m, distance from which on a fix may be disbelieved
_SIGMAS = 6.0
_LARGE = 2.0  # of the GNSS scale: a receiver alone begins with it, so that only more is learnt

_REASONS = {
    "on_road": "",
    "ambiguous": "several roads fit",
    "off_road": "no mapped road fits",
    "outage": "no GNSS fix for a while: dead reckoning and map",
    "stopped": "the vehicle stands",
    "lost": "fixes fit no hypothesis",
}


def reason(
    status: str,
    *,
    roads: Sequence[tuple[int, float]] = (),
    name: Callable[[int], str | None] = lambda _: None,
    disbelieved: float = 0.0,
    scale: float = 1.0,
    answered: bool = True,
) -> str:
    """Why an estimate has its status, for people.

    Args:
        status: One of `STATUS`.
        roads: The competing edges (negative: off the roads) and their P, most probable first.
        name: Of an edge's street, where it has one.
        disbelieved: How far away a fix of this moment lies that is not believed, m; 0: none.
        scale: How many times the reported sigmas the GNSS errors are; 0: not learnt.
        answered: Whether there is an answer at all.

    Returns:
        Parts joined by semicolons, empty where no reason is needed.
    """
    if not answered:
        return "no fix has come yet"
    words = competing(roads, name) if status == "ambiguous" and roads else _REASONS[status]
    gnss = ""
    if disbelieved > 0.0:
        gnss = f"fixes {disbelieved:.0f} m away are rejected"
        if status == "lost":
            return gnss
    elif round(scale, 1) > _LARGE and status != "outage":
        gnss = f"GNSS sigmas taken {scale:.1f} times as large"
    return "; ".join(part for part in (words, gnss) if part)


def competing(roads: Sequence[tuple[int, float]], name: Callable[[int], str | None]) -> str:
    """The roads that compete: "Kettengasse, edge 12 (0.61) or edge 40 (0.35)"."""
    return " or ".join(
        f"{title(edge, name)} ({p:.2f})"
        for rank, (edge, p) in enumerate(roads)
        if p >= COUNTS or rank < 2
    )


def title(edge: int, name: Callable[[int], str | None]) -> str:
    """What an edge is called where roads compete."""
    if edge < 0:
        return "off the roads"
    street = name(edge)
    return f"{street}, edge {edge}" if street else f"edge {edge}"


def far_off(away: Any, sigma: Any) -> Any:
    """Whether fixes that far (m) from the estimate, sigma given, are not believed."""
    return (away > _FAR) & (away > _SIGMAS * sigma)
