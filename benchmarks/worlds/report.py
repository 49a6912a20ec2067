"""Tables of a run: by situation, worst first; and one line for each class of faults."""

from pathlib import Path

from ..exact_bounds import clopper_pearson
from .drives import Scored
from .faults import FAULTS
from .figures import Declarations, Poses, declarations, pose_rows, poses
from .scoring import AFTER, PoseSums


def _interval(pair: tuple[float, float] | None, form: str) -> str:
    return "" if pair is None else f"{pair[0]:{form}} to {pair[1]:{form}}"


def declaration_table(rows: list[Declarations]) -> str:
    """Declarations by situation."""
    lines = [
        "| situation | drives | decisions | declared % | wrong | ‰ | 95 % interval ‰ | "
        "drives with a wrong one | median s |",
        "|---|--:|--:|--:|--:|--:|---|--:|--:|",
    ]
    for r in rows:
        low, high = clopper_pearson(r.wrong, r.declared) if r.declared else (0.0, 1.0)
        lines.append(
            f"| {r.kind} | {r.drives:,} | {r.decisions:,} | "
            f"{100 * r.declared / r.decisions:.1f} | {r.wrong} | {r.per_mille:.2f} | "
            f"{1e3 * low:.2f} to {1e3 * high:.2f} | {r.wrong_drives} | {r.seconds:.1f} |"
        )
    return "\n".join(lines)


def pose_table(rows: list[Poses]) -> str:
    """Poses by place, sensors and fault."""
    lines = [
        "| which epochs | drives | above the level ‰ | 95 % interval ‰ | ANEES | 95 % interval | "
        "in 95 % | RMSE m | level m | right road % |",
        "|---|--:|--:|---|--:|---|--:|--:|--:|--:|",
    ]
    for r in rows:
        ci = r.exceeded_ci and (1e3 * r.exceeded_ci[0], 1e3 * r.exceeded_ci[1])
        lines.append(
            f"| {r.kind} | {r.drives:,} | {1e3 * r.exceeded:.2f} | {_interval(ci, '.2f')} | "
            f"{r.anees:.2f} | {_interval(r.anees_ci, '.2f')} | {100 * r.inside:.1f} | "
            f"{r.rmse:.1f} | {r.level:.1f} | {100 * r.right:.2f} |"
        )
    return "\n".join(lines)


def wrong_table(drives: list[Scored]) -> str:
    """Every wrong declaration, in the order of the drives."""
    lines = [
        "| drive | place | sensors | s | declared | true road | error m | situation | faults |",
        "|---|---|---|--:|--:|--:|--:|---|---|",
    ]
    for one in drives:
        for d, about in zip(one.decisions, one.situations, strict=True):
            if d.wrong:
                faults = sorted({e.name for e in one.events if e.begin <= d.when <= e.end + AFTER})
                lines.append(
                    f"| {one.name} | {one.place} | {one.suite} | {d.when:.1f} | {d.road} | "
                    f"{d.true_road} | {d.error:.1f} | {', '.join(sorted(about))} | "
                    f"{', '.join(faults)} |"
                )
    return "\n".join(lines)


def write_run(name: str, drives: list[Scored], folder: Path) -> None:
    """The tables of one class of faults."""
    text = (
        f"# Worlds, faults: {name}\n\n## Declarations, worst situation first\n\n"
        f"{declaration_table(declarations(drives))}\n\n## Poses, worst first\n\n"
        f"{pose_table(pose_rows(drives))}\n\n## Wrong declarations\n\n{wrong_table(drives)}\n"
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.md").write_text(text, encoding="utf-8")


def summary_line(name: str, drives: list[Scored]) -> tuple[Declarations, Poses | None, float]:
    """All of a class: decisions; epochs under its fault, else all; longest time to alert, s."""
    nothing = Declarations("all", 0, 0, 0, 0, 0, float("nan"))
    rows = next((r for r in declarations(drives) if r.kind == "all"), nothing)
    sums = [d.under.get(name, PoseSums()) if name in FAULTS else d.all for d in drives]
    return rows, poses(name, sums), max((d.alert for d in drives), default=0.0)


def summary_table(classes: dict[str, list[Scored]]) -> str:
    """One line for each class of faults, the one with the most wrong declarations first."""
    lines = [
        "| faults | drives | decisions | declared % | wrong | ‰ | 95 % interval ‰ | drives with a "
        "wrong one | median s | level m | above it ‰ | ANEES | in 95 % | RMSE m | right road % | "
        "alert s |",
        "|---|--:|--:|--:|--:|--:|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    found = {name: summary_line(name, drives) for name, drives in classes.items()}
    for name, (r, p, alert) in sorted(found.items(), key=lambda x: -x[1][0].per_mille):
        if p is None or not r.decisions:
            continue
        low, high = clopper_pearson(r.wrong, r.declared) if r.declared else (0.0, 1.0)
        lines.append(
            f"| {name} | {r.drives:,} | {r.decisions:,} | {100 * r.declared / r.decisions:.1f} | "
            f"{r.wrong} | {r.per_mille:.2f} | {1e3 * low:.2f} to {1e3 * high:.2f} | "
            f"{r.wrong_drives} | {r.seconds:.1f} | {p.level:.1f} | {1e3 * p.exceeded:.2f} | "
            f"{p.anees:.2f} | {100 * p.inside:.1f} | {p.rmse:.1f} | {100 * p.right:.2f} | "
            f"{alert:.0f} |"
        )
    return "\n".join(lines)
