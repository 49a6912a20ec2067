"""The filter on roads against particles that never merge: what is lost is lost in merging."""

import numpy as np
import pytest

from oracles.particles import Particles, thinned
from oracles.road_scenes import SCENES, apart, filtered, fork, plain
from whichroad.settings import Settings


def test_thinning_keeps_every_weight_on_average():
    rng = np.random.default_rng(0)
    weight = rng.dirichlet(np.full(60, 0.3))
    total = np.zeros(60)
    draws = 4000
    for _ in range(draws):
        rows, left = thinned(weight, 12, rng)
        assert len(rows) in (11, 12, 13)
        total[rows] += left
    # each is either certain or drawn with weight c ≤ 1/12: sigma ≤ sqrt(w / 12 / draws)
    assert (abs(total / draws - weight) < 5.0 * np.sqrt(weight / 12 / draws) + 1e-12).all()


def test_thinning_leaves_few_particles_alone():
    weight = np.array([0.5, 0.3, 0.2])
    rows, left = thinned(weight, 3, np.random.default_rng(0))
    assert rows.tolist() == [0, 1, 2]
    assert left is weight


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("degrees", [5.0, 15.0])
def test_without_merging_the_filter_is_as_good_as_particles(degrees: float, seed: int):
    """Pruned at 1e-6, eight kept on an edge: a step may lose some 1e-5, and there are thirty."""
    scene = fork(degrees, seed)
    settings = plain(Settings(merge=0.0, components=8, prune=1e-6))
    particles = Particles(scene.roads, scene.epochs, settings, 1000, seed)
    pairs = zip(filtered(scene, settings)[0], particles.run(), strict=True)
    assert max(apart(a, b) for a, b in pairs) < 3e-4


@pytest.mark.parametrize("name", SCENES)
def test_particles_agree_with_other_particles_and_their_weights_sum_to_one(name: str):
    scene, settings = SCENES[name](1), plain(Settings())
    one, other = (
        list(Particles(scene.roads, scene.epochs, settings, 500, chance).run()) for chance in (0, 1)
    )
    assert all(abs(sum(p.values()) - 1.0) < 1e-9 for p in one)
    assert max(apart(a, b) for a, b in zip(one, other, strict=True)) < 0.01
