"""Summary of the figures in sentences that are made from the numbers."""

from collections.abc import Callable, Sequence

from .gst import FIXED, PER_FIX
from .numbers import Row
from .runs import MODELS
from .scenes import Scene

Find = Callable[[str, str], Row]


def seen(scene: Scene, rows: Sequence[Row]) -> list[str]:
    """Sentences about one scene."""
    known = {(row.model, row.figure): row for row in rows}

    def find(model: str, figure: str) -> Row:
        return known[model, figure]

    if scene.name == "gst":
        return _gst(find)
    first = _mask(find) if scene.name == "outage" else _claim(find)
    return [
        *first,
        _lifetimes(find),
        _trust(find, " in the mask" if scene.name == "outage" else ""),
    ]


def text(row: Row) -> str:
    """A row's value."""
    return "none" if row.value is None else number(row.value)


def number(value: float) -> str:
    """A number with three digits at most."""
    size = abs(value)
    if size >= 99.95:
        return f"{value:.0f}"
    return f"{value:.{1 if size >= 9.995 else 2}f}".rstrip("0").rstrip(".")


def _both(find: Find, figure: str, unit: str) -> str:
    """`x unit by the paper's method, y unit by ours`."""
    paper, ours = (text(find(model, figure)) for model in MODELS)
    if paper == ours:
        return f"{paper}{unit} by both methods"
    return f"{paper}{unit} by the paper's method and {ours}{unit} by ours"


def _claim(find: Find) -> list[str]:
    return [
        "From the decision on the true road is the most probable one all along in "
        + _both(find, "true road the most probable all along", " % of the drives")
        + ", and at the end in "
        + _both(find, "true road the most probable at the end", " %")
        + ". A wrong road was declared at some time (P >= 0.999) in "
        + _both(find, "a wrong road declared (P >= 0.999)", " %")
        + "."
    ]


def _mask(find: Find) -> list[str]:
    alone = find("default", "wheels alone at the mask's end")
    return [
        "After 1.5 km without GPS the true road is the most probable one in "
        + _both(find, "true road the most probable at the mask's end", " % of the drives")
        + ".",
        "There the position is off by "
        + _both(find, "position error at the mask's end, median", " m")
        + " in the median, by "
        + _both(find, "position error at the mask's end", " m")
        + f" RMS (wheels alone: {text(alone)} m); stated are "
        + _both(find, "as stated at the mask's end", " m")
        + ".",
    ]


def _lifetimes(find: Find) -> str:
    stated = []
    for model, whose in (("paper", "the paper's method"), ("default", "ours")):
        row = find(model, "a wrong road counted for")
        if row.value is None or row.spread95 is None:
            stated.append(f"by {whose} never")
            continue
        metres = find(model, "a wrong road counted over")
        low, high = row.spread95
        stated.append(
            f"by {whose} for {text(row)} steps of a second ({text(metres)} m; 95 % of them "
            f"{number(low)} to {number(high)} steps)"
        )
    return "A wrong road counted (P >= 0.01), in the median, " + ", ".join(stated) + "."


def _verdict(row: Row) -> str:
    """An ANEES and its interval in words."""
    assert row.value is not None
    assert row.ci95 is not None
    low, high = row.ci95
    stated = f"ANEES {text(row)}, 95 %: {number(low)} to {number(high)}"
    if low > 1.1:
        return f"over-confident ({stated})"
    return f"over-cautious ({stated})" if high < 0.9 else f"honest ({stated})"


def _trust(find: Find, note: str) -> str:
    paper, ours = (_verdict(find(model, f"ANEES{note}")) for model in MODELS)
    return (
        f"The covariance of the paper's method is {paper}, ours is {ours}; the 95 % ellipse holds "
        "the truth in " + _both(find, f"truth in the 95 % ellipse{note}", " % of the epochs") + "."
    )


def _gst(find: Find) -> list[str]:
    stated = []
    for model, whose in (("paper", "the paper's method"), ("default", "whichroad")):
        per_fix, fixed = (f"{model}, {noise}" for noise in (PER_FIX, FIXED))
        won = find(per_fix, "drives in which the fixes' own covariance is better")
        error = [find(kind, "position error") for kind in (per_fix, fixed)]
        open_sky = [find(kind, "position error under open sky") for kind in (per_fix, fixed)]
        anees = [_verdict(find(kind, "ANEES")) for kind in (per_fix, fixed)]
        stated.append(
            f"With {whose} the covariance of each fix is the better one in {text(won)} % of the "
            f"drives: {text(error[0])} m against {text(error[1])} m with one for all, "
            f"{text(open_sky[0])} against {text(open_sky[1])} m under open sky; with it the filter "
            f"is {anees[0]}, without {anees[1]}."
        )
    return stated
