"""What is seen, in sentences made from the numbers: never a claim that was not measured."""

from collections.abc import Callable, Sequence

from .gst import FIXED, PER_FIX
from .numbers import Row
from .rides import MODELS
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
    return [*first, _lives(find), _trust(find, " in the mask" if scene.name == "outage" else "")]


def text(row: Row, digits: int | None = None) -> str:
    """A value with as many digits as it is worth."""
    if row.value is None:
        return "none"
    if digits is None:
        size = abs(row.value)
        digits = 0 if size >= 99.95 or size == 0.0 else 1 if size >= 1.0 else 2
    return f"{row.value:.{digits}f}"


def _both(find: Find, figure: str, unit: str) -> str:
    """`x unit by the paper's method, y unit by ours`."""
    paper, ours = (find(model, figure) for model in MODELS)
    return f"{text(paper)}{unit} by the paper's method and {text(ours)}{unit} by ours"


def _claim(find: Find) -> list[str]:
    return [
        "The true road ends as the most probable one in "
        + _both(find, "true road the most probable at the end", " % of the drives")
        + "; a wrong road was declared at some time (P >= 0.999) in "
        + _both(find, "a wrong road declared (P >= 0.999)", " %")
        + "."
    ]


def _mask(find: Find) -> list[str]:
    alone = find("default", "wheels alone at its end, RMS")
    return [
        "After 1.5 km without GPS the true road is the most probable one in "
        + _both(find, "true road the most probable, at its end", " % of the drives")
        + ".",
        "The position is off by "
        + _both(find, "position error at its end, RMS", " m")
        + f" (wheels alone: {text(alone)} m); stated are "
        + _both(find, "position error at its end, stated", " m")
        + ".",
    ]


def _lives(find: Find) -> str:
    said = []
    for model, whose in (("paper", "the paper's method"), ("default", "ours")):
        row = find(model, "a wrong road counted for")
        if row.value is None or row.spread95 is None:
            said.append(f"by {whose} never")
            continue
        metres = find(model, "a wrong road counted for (m)")
        low, high = row.spread95
        said.append(
            f"by {whose} for {text(row)} steps of a second ({text(metres, 0)} m; 95 % of them "
            f"{low:.1f} to {high:.1f} steps)"
        )
    return "A wrong road counted (P >= 0.01), in the median, " + ", ".join(said) + "."


def _verdict(anees: float) -> str:
    """What an ANEES says in words."""
    if anees > 1.3:
        return f"sure beyond its errors (ANEES {anees:.1f})"
    if anees < 0.7:
        return f"more cautious than need be (ANEES {anees:.2f})"
    return f"honest (ANEES {anees:.2f})"


def _trust(find: Find, note: str) -> str:
    paper, ours = (find(model, f"ANEES{note}").value or 0.0 for model in MODELS)
    return (
        f"The covariance of the paper's method is {_verdict(paper)}, ours is {_verdict(ours)}; the "
        "95 % ellipse holds the truth in "
        + _both(find, f"truth in the 95 % ellipse{note}", " % of the epochs")
        + "."
    )


def _gst(find: Find) -> list[str]:
    said = []
    for model, whose in (("paper", "the paper's method"), ("default", "whichroad")):
        told, fixed = (f"{model}, {noise}" for noise in (PER_FIX, FIXED))
        won = find(told, "drives in which the fixes' own covariance is better")
        error = [find(kind, "position error, RMS") for kind in (told, fixed)]
        open_sky = [find(kind, "position error under open sky, RMS") for kind in (told, fixed)]
        anees = [find(kind, "ANEES").value or 0.0 for kind in (told, fixed)]
        said.append(
            f"With {whose} the covariance of each fix is the better one in {text(won)} % of the "
            f"drives: {text(error[0])} m against {text(error[1])} m with one for all, "
            f"{text(open_sky[0])} against {text(open_sky[1])} m under open sky; with it the filter "
            f"is {_verdict(anees[0])}, without {_verdict(anees[1])}."
        )
    return said
