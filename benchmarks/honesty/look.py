"""One drive told second by second: `python -m benchmarks.honesty.look CLASS NOISE NUMBER...`.

Without numbers: the drives of a `--resume` file that declared a wrong road.
"""

import argparse
import sqlite3
from pathlib import Path

import numpy as np

from whichroad import Settings
from whichroad.tables.status import STATUS

from ..__main__ import setting
from .drives import drive, localize
from .score import Row


def wrong_ones(memory: Path, name: str, noise: str) -> list[int]:
    """Numbers of the drives that declared a wrong road, in the file's newest version."""
    found: list[int] = []
    base = sqlite3.connect(memory)
    newest = base.execute("select key from work order by rowid desc limit 1").fetchone()[0]
    for key, blob in base.execute("select key, rows from work"):
        words = key.split(" ")
        if words[:3] == [newest.split(" ")[0], name, noise] and not words[4]:
            rows = Row(*np.frombuffer(blob, np.float32).reshape(-1, len(Row._fields)).T)
            found += (int(words[3].split(":")[0]) + np.flatnonzero(rows.wrong)).tolist()
    return sorted(found)


def tell(
    name: str, noise: str, number: int, settings: dict[str, float], around: float, rate: float
) -> None:
    """Print what was said within `around` m of the branch point, `rate` times a second."""
    one = drive(name, noise, number)
    out = localize(one, Settings(**settings), noise).output
    line, truth, scene = one.route.line, one.truth, one.scene
    along = line.along[truth.place]

    def road(number: int) -> str:
        return ("-" if number % 2 else "") + scene.names[number // 2] if number >= 0 else "off"

    print(f"\n{name} {noise} {number}: variant {number % 24}, branch at {one.route.decision:.0f} m")
    wheels = ", ".join(
        f"{what} {value:+.3%}"
        for what, value in zip(
            ("scale", "differential", "track"),
            one.buffers.drawn[:3] - np.array([1.0, 0.0, 1.5]), strict=True,
        )
    )  # fmt: skip
    print(f"wheels: {wheels}")
    print("   past  speed  driven        error of the pose        of the fix     P")
    every = max(1, round(1.0 / (rate * one.epochs.time[1])))
    for k in range(0, len(along), every):
        past = along[k] - one.route.decision
        if not -around < past < around or not out.live[k]:
            continue
        h = truth.heading[k]
        right = np.array([np.sin(h), -np.cos(h)])
        ahead = np.array([np.cos(h), np.sin(h)])
        row = out.rows[k]
        e = np.array([row.x - truth.x[k], row.y - truth.y[k]])
        fix = ""
        if one.epochs.has_fix[k]:
            f = one.epochs.fix[k, :2] - [truth.x[k], truth.y[k]] - 1.0 * ahead
            fix = f"{f @ right:+6.1f} {f @ ahead:+6.1f}"
        turn = np.degrees(np.angle(np.exp(1j * (row.heading - h))))
        m = np.array([truth.map_x[k] - truth.x[k], truth.map_y[k] - truth.y[k]])
        chances: dict[str, float] = {}
        for edge, p in zip(row.alt_edge, row.alt_p, strict=True):
            if edge >= -1:
                what = road(int(scene.road_of[edge]) if edge >= 0 else -1)
                chances[what] = chances.get(what, 0.0) + float(p)
        listing = "  ".join(f"{w} {p:.4f}" for w, p in sorted(chances.items(), key=lambda c: -c[1]))
        sigma = np.sqrt(row.cov[0] + row.cov[3])
        print(
            f"{past:7.1f} {truth.speed[k]:6.1f}  {road(int(line.road[truth.place[k]])):12} "
            f"{e @ right:+5.1f} right {e @ ahead:+5.1f} ahead {turn:+5.1f} deg of {sigma:4.1f}  "
            f"{fix:13}  map {m @ right:+5.1f}  {STATUS[row.status]:9} {listing}"
            + (f"  off {row.p_off_road:.3f}" if row.p_off_road > 1e-3 else "")
        )


def main() -> None:
    """Tell the drives that were asked for."""
    command = argparse.ArgumentParser(prog="python -m benchmarks.honesty.look", description=__doc__)
    command.add_argument("name")
    command.add_argument("noise")
    command.add_argument("number", type=int, nargs="*")
    command.add_argument("--resume", type=Path, metavar="FILE")
    command.add_argument("--around", type=float, default=150.0, metavar="M")
    command.add_argument("--hz", type=float, default=1.0, help="lines a second")
    command.add_argument("--set", type=setting, action="append", default=[])
    given = command.parse_args()
    numbers = given.number or wrong_ones(given.resume, given.name, given.noise)
    for number in numbers:
        tell(given.name, given.noise, number, dict(given.set), given.around, given.hz)


if __name__ == "__main__":
    main()
