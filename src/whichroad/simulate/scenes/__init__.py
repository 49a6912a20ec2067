"""Small maps with one thing to decide on each, and the routes through them.

Every scene is drawn in metres, compiled by the same code as any map, and comes with lines
for `vectorised`.  A *road* is all edges between two branch points in one driving direction:
its number is 2 k + (0 as it was drawn, 1 against that), k being the name's place; streets
`a/1` and `a/2` are parts of one road `a`.
"""

import numpy as np

from .drawings import SCENES
from .scene_builder import Route, Scene, SceneBuilder, build_scene


def draw_scene(kind: str, variant: int) -> Scene:
    """Draw and compile one of the scenes.

    Args:
        kind: A key of `SCENES`.
        variant: Which of its geometries: same number, same scene.
    """
    random = np.random.default_rng([list(SCENES).index(kind), variant])
    builder = SCENES[kind](random, variant)
    return build_scene(builder, float(random.uniform(-np.pi, np.pi)))


__all__ = ["SCENES", "Route", "Scene", "SceneBuilder", "draw_scene"]
