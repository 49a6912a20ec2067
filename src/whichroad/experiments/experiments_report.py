"""One HTML page that holds everything: pictures inside, no script, nothing from elsewhere."""

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .gst import NOISES
from .numbers import Row
from .runs import MODELS
from .summary_text import number, text

if TYPE_CHECKING:
    from .all_experiments import Outcome
    from .pictures import Picture

_STYLE = """
:root{color-scheme:light dark;--ink:#16181b;--soft:#5b6570;--line:#d9dde3;--page:#fbfbfc;
--card:#fff;--ours:#0b4f9e;--paper:#b45309}
@media(prefers-color-scheme:dark){:root{--ink:#e8eaed;--soft:#a2abb6;--line:#333a42;--page:#14171a;
--card:#1c2024;--ours:#7db3f2;--paper:#f2a65e}}
@media(prefers-color-scheme:dark){figure img{filter:invert(.9) hue-rotate(180deg)}
figure .wide{background:var(--card)!important}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--ink);font:16px/1.55 system-ui,sans-serif}
main{max-width:1080px;margin:0 auto;padding:24px 16px 64px}
h1{font-size:1.7rem;line-height:1.2;margin:.4em 0}
h2{font-size:1.3rem;margin:2.6em 0 .3em;padding-top:.6em;border-top:1px solid var(--line)}
h2 small{color:var(--soft);font-weight:400}
blockquote{margin:.6em 0;padding:.1em 0 .1em 14px;border-left:3px solid var(--line);
color:var(--soft)}
nav{display:flex;flex-wrap:wrap;gap:0 1em}
a{color:var(--ours)}
figure{margin:20px 0}
figure .wide{background:#fff;border:1px solid var(--line);border-radius:8px}
figure img{display:block;width:100%;min-width:680px;height:auto;padding:8px}
figcaption{color:var(--soft);font-size:.85rem;margin-top:6px}
.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.9rem;font-variant-numeric:tabular-nums}
th,td{text-align:left;padding:5px 10px 5px 0;border-bottom:1px solid var(--line);
vertical-align:top}
td+td,th+th{text-align:right;white-space:nowrap}
td:first-child{min-width:11em}
td small{display:block;color:var(--soft)}
.terms{color:var(--soft);font-size:.92rem}
.paper{color:var(--paper)}.ours{color:var(--ours)}
footer{margin-top:3em;color:var(--soft);font-size:.85rem}
code{font-size:.9em}
"""

_INTRO = """What the paper shows on one drive each, with known truth and over many: {drives}
simulated drives a scene, each with its own map error, car, receiver and driver. Both methods
answer the same drives; <code>whichroad.simulate</code> describes the errors."""

_TERMS = """A road <b>counts</b> while its probability is at least 0.01, and is <b>declared</b> from
0.999 on; both its directions are one road. A <b>step</b> is one second: the paper does not
state its own. <b>ANEES</b> is the squared error of the position over its covariance,
1 if the covariance is true. Brackets hold 95 % intervals, resampled over drives; of shares they are
exact."""


def write_report(path: Path, outcomes: Sequence["Outcome"], about: dict[str, Any]) -> None:
    """Write the page.

    Args:
        path: Where to.
        outcomes: The scenes.
        about: What `experiments.json` holds.
    """
    first, last = about["seeds"].split(":")
    links = "".join(f'<a href="#{o.scene.name}">{o.scene.figure}</a>' for o in outcomes)
    intro = _INTRO.format(drives=int(last) - int(first))
    body = "\n".join(_section(o) for o in outcomes)
    path.write_text(
        f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width,initial-scale=1">
<title>The paper's experiments</title><style>{_STYLE}</style></head><body><main>
<h1>The paper's experiments, with the numbers it leaves out</h1>
<p>{intro}</p>
<p class="terms">{_TERMS}</p>
<p>The paper: Smaili, El Badaoui El Najjar and Charpillet, <i>Multi-Sensor Fusion Method using
Dynamic Bayesian Network for Precise Vehicle Localization and Road Matching</i>, 2007.</p>
<nav>{links}</nav>
{body}
<footer>whichroad {html.escape(about["version"])}, <code>whichroad experiments --seeds
{about["seeds"]}</code>. All numbers: <code>experiments.json</code>; every hypothesis of the drives
that are drawn: the CSV files beside it.</footer>
</main></body></html>
""",
        encoding="utf-8",
    )


def _section(o: "Outcome") -> str:
    scene = o.scene
    paragraphs = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in o.seen)
    first, *others = (_figure(p) for p in o.pictures)
    return f"""<section id="{scene.name}">
<h2>{html.escape(scene.title)} <small>{html.escape(scene.figure)}</small></h2>
<blockquote>The paper: {html.escape(scene.claim)}</blockquote>
{paragraphs}{first}
<div class="wide" tabindex="0" role="group" aria-label="Numbers">{_table(o.rows)}</div>
{"".join(others)}</section>"""


def _figure(picture: "Picture") -> str:
    data = base64.b64encode(picture.path.read_bytes()).decode("ascii")
    caption = html.escape(picture.caption)
    return (
        f'<figure><div class="wide" tabindex="0" role="group" aria-label="Picture">'
        f'<img alt="{caption}" src="data:image/png;base64,{data}"></div>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


_HEADS = {"paper": "paper", "default": "whichroad"}


def _table(rows: Sequence[Row]) -> str:
    models = list(dict.fromkeys(row.model for row in rows))
    figures = list(dict.fromkeys(row.figure for row in rows))
    known = {(row.figure, row.model): row for row in rows}
    heads = "".join(f'<th class="{_class(m)}">{html.escape(_head(m))}</th>' for m in models)
    lines = "".join(
        f"<tr><td>{html.escape(_name(known, figure, models))}</td>"
        + "".join(f"<td>{_cell(known.get((figure, model)))}</td>" for model in models)
        + "</tr>"
        for figure in figures
    )
    return f"<table><thead><tr><th>figure</th>{heads}</tr></thead><tbody>{lines}</tbody></table>"


def _head(model: str) -> str:
    name, comma, noise = model.partition(",")
    return _HEADS.get(name, name) + comma + noise


def _class(model: str) -> str:
    return {"paper": "paper", "default": "ours"}.get(model.partition(",")[0], "")


def _name(known: dict[tuple[str, str], Row], figure: str, models: Sequence[str]) -> str:
    unit = next(known[figure, m].unit for m in models if (figure, m) in known)
    return f"{figure}, {unit}"


def _cell(row: Row | None) -> str:
    if row is None:
        return ""
    spread = (
        f"<small>95 % of {row.n}: {number(row.spread95[0])} to {number(row.spread95[1])}</small>"
        if row.spread95
        else ""
    )
    return f"{text(row)}{_brackets(row)}{spread}"


_KEY = {
    "fork": (
        "a wrong road counted for", "true road the most probable, 20 m on",
        "a wrong road declared (P >= 0.999)",
    ),
    "outage": (
        "true road the most probable at the mask's end",
        "position error at the mask's end, median", "position error at the mask's end",
        "as stated at the mask's end", "truth in the 95 % ellipse in the mask",
    ),
    "parallel": (
        "a wrong road counted for", "true road the most probable at the end",
        "a wrong road declared (P >= 0.999)",
    ),
    "junction": (
        "a wrong road counted for", "true road the most probable, 20 m on",
        "true road the most probable at the end", "a wrong road declared (P >= 0.999)", "ANEES",
    ),
    "gst": ("position error", "ANEES"),
}  # fmt: skip


def key_table(outcomes: Sequence["Outcome"]) -> str:
    """The figures that matter most, as a table in Markdown."""
    own = {m for o in outcomes for row in o.rows if (m := row.model.partition(",")[0])}
    others = sorted(own - set(MODELS))
    lines = [f"| {' | '.join(['scene', 'figure', 'paper', 'whichroad', *others])} |"]
    lines.append("|---" * (4 + len(others)) + "|")
    for o in outcomes:
        known = {(row.model, row.figure): row for row in o.rows}
        noises = [f", {n}" for n in NOISES] if o.scene.name == "gst" else [""]
        for figure in _KEY[o.scene.name]:
            for noise in noises:
                rows = [known[f"{model}{noise}", figure] for model in MODELS]
                theirs = [known.get((name, figure)) for name in others]
                cells = " | ".join(
                    "" if row is None else f"{text(row)}{_brackets(row)}"
                    for row in [*rows, *theirs]
                )
                what = f"{figure}{noise.replace(',', ', sigma')} ({rows[0].unit})"
                lines.append(f"| {o.scene.name} | {what} | {cells} |")
    return "\n".join(lines) + "\n"


def _brackets(row: Row) -> str:
    return f" [{number(row.ci95[0])}, {number(row.ci95[1])}]" if row.ci95 else ""
