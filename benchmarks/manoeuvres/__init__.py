"""Manoeuvres that maps do not draw, and sensors of odd kinds: a third simulator, by kinematics.

A vehicle follows polylines at speeds that it can drive; it turns within the street, drives where
the map has nothing, backs up.  Receivers are coarse or fine, clocks lie.  Each scene stands beside
a control: the same streets with nothing wrong.  No line is shared with `whichroad.simulate` and
the drives of `worlds`; answers are scored as theirs are.
"""

import zlib
from dataclasses import dataclass

import numpy as np

from whichroad import Settings

from .. import Figure, Options, seeds_text
from ..worlds.drives import said_of
from ..worlds.online import ON_LINE
from .answers import answered
from .cases import SCENES, Case, sense
from .counting import HEAD, Counted, count, figures, line, which
from .scenes import moment
from .streets import draw_map

SEEDS = range(1100, 1112)


@dataclass(frozen=True, slots=True)
class How:
    """How all drives are answered."""

    settings: Settings | None = None
    lag: str | None = None


def run(options: Options) -> list[Figure]:
    """Each scene that was asked for with each of its sets of sensors, a line for each."""
    seeds = options.seeds or SEEDS
    how = How(options.settings(), options.more.get("lag"))
    found: list[Figure] = []
    options.say(HEAD)
    for scene in names(options.more.get("scenes")):
        for case in SCENES[scene]:
            for suite in case.suites:
                name = f"{scene}, {case.what}: {suite}"
                drives = [one(scene, case, suite, seed, how) for seed in seeds]
                options.say(line(name, drives))
                found += figures(name, drives, seeds_text(seeds))
    return found


def names(text: str | None) -> list[str]:
    """Scenes of a comma-separated list; nothing: all."""
    chosen = text.split(",") if text else list(SCENES)
    for name in chosen:
        if name not in SCENES:
            raise SystemExit(f"{name!r} is no scene; one of {', '.join(SCENES)}")
    return chosen


def one(scene: str, case: Case, suite: str, seed: int, how: How) -> Counted:
    """One drive, answered and counted.

    Cases of a scene draw alike: a control has the drive, the map's error and the noise of the
    others where their streets and readings are the same.
    """
    random = np.random.default_rng([seed, zlib.crc32(scene.encode())])
    of_drive, of_map, of_moment, of_sensors = random.spawn(4)
    plan = case.draw(of_drive)
    motion, ground = plan.motion, draw_map(plan, of_map)
    begin = moment(motion, of_moment)
    heard = sense(case, suite, motion, begin, ground.plane, of_sensors)
    answer = answered(heard, ground.roads, how.settings, ON_LINE if case.live else how.lag)
    said, _ = said_of(answer.to_arrow(), motion, ground)
    warned = tuple(f.what for f in answer.diagnosis if f.level == "warning")
    return count(said, which(said, begin, case.counts), warned)
