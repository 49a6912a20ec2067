"""What rows of drives say: rates with exact bounds, reliability, consistency."""

from dataclasses import dataclass, field

import numpy as np

from .. import Figure, interval
from ..exact_bounds import clopper_pearson, upper_bound
from .score import Row

ECE_BINS = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.999, 1.01])
WRONG_GOAL = {"misspecified": 1e-2}
ANEES_GOAL = {"good": "0.9..1.1", "urban": "0.9..1.3"}
DECISIONS = ("near", "far", "end")


def reliability(p: np.ndarray, right: np.ndarray) -> list[tuple[float, float, int]]:
    """Mean probability, share right and count, for each bin that holds decisions."""
    bins = np.digitize(p, ECE_BINS) - 1
    out = []
    for b in range(len(ECE_BINS) - 1):
        here = bins == b
        if here.any():
            out.append((float(p[here].mean()), float(right[here].mean()), int(here.sum())))
    return out


def calibration_error(p: np.ndarray, right: np.ndarray) -> float:
    """Expected calibration error: mean over decisions of |share right - mean P| of their bin."""
    rows = reliability(p, right)
    return sum(n * abs(a - b) for a, b, n in rows) / max(sum(n for _, _, n in rows), 1)


@dataclass
class Summary:
    """All drives of a class and noise."""

    name: str
    noise: str
    rows: np.ndarray  # (drives, columns of `Row`)
    row: Row = field(init=False)  # (drives,) each

    def __post_init__(self) -> None:
        self.row = Row(*self.rows.T.astype(float))

    @property
    def drives(self) -> int:
        """How many."""
        return len(self.rows)

    @property
    def declared(self) -> int:
        """Drives that declared a road."""
        return int(self.row.declared.sum())

    @property
    def wrong(self) -> int:
        """Those that declared a wrong one."""
        return int(self.row.wrong.sum())

    def decisions(self, which: tuple[str, ...] = DECISIONS) -> tuple[np.ndarray, ...]:
        """P of the most probable road, whether it is right, P of the true one, Brier score."""
        parts = []
        for name in which:
            right = getattr(self.row, f"right_{name}")
            read = right >= 0
            parts.append(
                [getattr(self.row, f"{what}_{name}")[read] for what in ("p", "right", "true",
                                                                         "brier")]
            )  # fmt: skip
        return tuple(np.concatenate(column) for column in zip(*parts, strict=True))

    def ratio(self, top: str, below: str) -> tuple[float | None, tuple[float, float] | None]:
        """Pooled ratio of two columns, and its interval over drives."""
        table = np.column_stack([getattr(self.row, top), getattr(self.row, below)])
        if table[:, 1].sum() == 0:
            return None, None

        def value(t: np.ndarray) -> float:
            return float(t[:, 0].sum() / max(t[:, 1].sum(), 1.0))

        return value(table), interval(value, table, 400)


def figures_of(s: Summary, seeds: str) -> list[Figure]:
    """The figures of one class and noise."""
    label = f"{s.name} {s.noise}"

    def figure(
        what: str, value: float | None, goal: str = "", unit: str = "", n: int = 0,
        ci: tuple[float, float] | None = None,
    ) -> Figure:  # fmt: skip
        return Figure(f"{label}: {what}", value, goal, unit, n or s.drives, ci, seeds)

    limit = WRONG_GOAL.get(s.noise, 1e-3)
    p, right, true, brier = s.decisions()
    _, ends, _, _ = s.decisions(("end",))
    seconds = s.row.seconds[s.row.declared > 0]
    found = [
        figure("declared", 100.0 * s.declared / s.drives, "", "%"),
        figure(
            "wrong among declared, upper bound",
            1e3 * upper_bound(s.wrong, s.declared) if s.declared else None,
            f"<= {1e3 * limit:g}", "per mille", s.declared,
            tuple(1e3 * v for v in clopper_pearson(s.wrong, s.declared)) if s.declared else None,
        ),
        figure("wrong declarations", s.wrong, "", "", s.declared),
        figure("time to declare, median", float(np.median(seconds)) if len(seconds) else None,
               "", "s", len(seconds)),
        figure("calibration error of decisions", calibration_error(p, right), "<= 0.01", "",
               len(p)),
        figure("log score of decisions", float(-np.log(np.maximum(true, 1e-6)).mean()), "",
               "nats", len(p)),
        figure("Brier score of decisions", float(brier.mean()), "", "", len(p)),
        figure("right at the end", 100.0 * float(ends.mean()) if len(ends) else None, "", "%",
               len(ends)),
    ]  # fmt: skip
    tested = int(s.row.test_declared.sum())
    if tested:
        wrong = int(s.row.test_wrong.sum())
        again = s.row.test_seconds[s.row.test_declared > 0]
        found += [
            figure("declared by the exact test", 100.0 * tested / s.drives, "", "%"),
            figure("wrong declarations of the exact test", wrong, "", "", tested),
            figure("its time to declare, median", float(np.median(again)), "", "s", tested),
            figure("declared, over the exact test's", 100.0 * s.declared / tested, ">= 90", "%"),
        ]
    pose = [("ANEES of the position", "nees", "posed", 0.5, ANEES_GOAL.get(s.noise, ""), "")]
    pose += [
        (f"truth in the {level} % ellipse", f"inside_{level}", "posed", 100.0,
         "93..97" if level == 95 and s.noise != "misspecified" else "", "%")
        for level in (50, 90, 95, 99)
    ]  # fmt: skip
    if s.row.mapped.sum():
        goal = "0.7..1.3" if s.noise != "misspecified" else ""
        pose.append(("ANEES in the map's frame", "map_nees", "mapped", 0.5, goal, ""))
        pose.append(("truth in the map-frame 95 % ellipse", "map_inside_95", "mapped", 100.0, "",
                     "%"))  # fmt: skip
    if s.row.level_epochs.sum():
        pose += [
            ("error above the protection level", "misleading", "level_epochs", 1e3, "<= 1",
             "per mille"),
            ("hazardously misleading", "hazardous", "level_epochs", 1e3, "", "per mille"),
            ("protection level above 10 m", "unavailable", "level_epochs", 100.0, "", "%"),
            ("mean protection level", "level_sum", "level_epochs", 1.0, "", "m"),
        ]  # fmt: skip
    if s.row.away.sum():
        pose.append(("P(off road) on the missing street", "off_away", "away", 1.0, ">= 0.9", ""))
    pose.append(("P(off road) on mapped roads", "off_home", "home", 1.0, "<= 0.005", ""))
    for what, top, below, factor, goal, unit in pose:
        value, ci = s.ratio(top, below)
        found.append(
            figure(
                what, None if value is None else factor * value, goal, unit,
                ci=None if ci is None else (factor * ci[0], factor * ci[1]),
            )
        )  # fmt: skip
    return found
