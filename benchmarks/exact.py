"""How exact the exact posteriors are, and how near to exact the filter is.

The exact posteriors of random networks are held against oracles that share no code with
them; the filter's reduction, where transitions are fixed, against the exact posteriors;
the filter on road scenes, where they are not, against particles that never merge.
"""

import importlib.util
import itertools
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from whichroad.exact import Posterior, infer, infer_window

from . import ROOT, Figure, Options, seeds_text

sys.path.append(str(ROOT / "tests"))

from oracles.enumeration import enumerate_network, enumerate_window
from oracles.particles import Particles
from oracles.reduced import SUITES, exact_modes, model_of, reduced_modes, window_of
from oracles.road_scenes import SCENES, apart, filtered, plain
from oracles.switching import incinerator, random_network, random_switching
from oracles.textbook import mixture_moments

_POSSIBLE = 1e-13  # of a mode less probable than this nothing is said
_SEEDS = range(200)
_PARTICLES = 20_000


def run(options: Options) -> list[Figure]:
    """`whichroad.exact` against enumeration, gtsam and the waste incinerator."""
    seeds = options.seeds or _SEEDS
    figures = []
    for what, each in (
        ("switching windows", _windows(seeds)),
        ("networks", _networks(seeds)),
        ("switching windows, gtsam", _gtsam(seeds)),
    ):
        differences = np.array(list(each)).reshape(-1, 3)
        options.say(f"{what}: {len(differences)}")
        for k, (part, goal) in enumerate(
            (("discrete", "<= 1e-12"), ("continuous", "<= 1e-9"), ("log-likelihood", "<= 1e-9"))
        ):
            if len(differences) == 0 or np.isinf(differences[0, k]):
                continue
            figures.append(
                Figure(
                    f"{what}: {part}, largest difference", float(differences[:, k].max()), goal,
                    n=len(differences), seeds=seeds_text(seeds),
                )
            )  # fmt: skip
    return [*figures, _incinerator(), *_reduction(options), *_roads(options)]


def _reduction(options: Options) -> list[Figure]:
    """Total variation of P(S_t), every suite with and without GNSS, all steps."""
    seeds, settings = options.seeds or range(20), options.settings()
    rows, everything = [], []
    for (name, make), fixes in itertools.product(SUITES.items(), (False, True)):
        apart = []
        for seed in seeds:
            suite = make(seed, fixes)
            models = model_of(suite)
            window = window_of(suite, models, seed)
            reduced, _ = reduced_modes(suite, models, window, settings)
            apart.append(0.5 * np.abs(reduced - exact_modes(models, window)).sum(axis=1))
        everything += apart
        title = f"reduction, {name}{', GNSS' if fixes else ''}: total variation, largest"
        options.say(f"{title}: {np.max(apart):.1e}")
        rows.append(_variation(title, np.max(apart), "<= 1e-3", seeds))
    mean = float(np.concatenate(everything).mean())
    return [*rows, _variation("reduction: total variation, mean", mean, "<= 1e-4", seeds)]


def _roads(options: Options) -> list[Figure]:
    """Total variation of P(road) on road scenes, all epochs, and the particles' own error."""
    seeds, settings = options.seeds or range(5), plain(options.settings())
    rows, own = [], [0.0]
    for name, make in SCENES.items():
        far = []
        for seed in seeds:
            scene = make(seed)
            one, other = (
                list(Particles(scene.roads, scene.epochs, settings, _PARTICLES, chance).run())
                for chance in (0, 1)
            )
            own += [apart(a, b) for a, b in zip(one, other, strict=True)]
            far += [apart(a, b) for a, b in zip(filtered(scene, settings)[0], one, strict=True)]
        options.say(f"{name}: {max(far):.1e}, on average {np.mean(far):.1e}")
        rows.append(
            _variation(f"roads, {name}: total variation, largest", max(far), "<= 0.01", seeds)
        )
    title = f"roads: of one another's {_PARTICLES:,} particles, largest"
    return [*rows, _variation(title, max(own), "<= 0.001", seeds)]


def _variation(title: str, value: float, goal: str, seeds: range) -> Figure:
    return Figure(title, float(value), goal, n=len(seeds), seeds=seeds_text(seeds))


def _windows(seeds: range) -> Iterator[tuple[float, float, float]]:
    for seed in seeds:
        model, window = random_switching(seed)
        truth, answer = enumerate_window(model, window), infer_window(model, window)
        p, m = _mixtures(answer, truth.probability, truth.mean, truth.cov)
        for t in range(len(window)):
            s, x = f"S{t + 1}", f"X{t + 1}"
            by_mode = answer.moments(x, [s])
            expected = truth.of_mode(t, len(model.initial))
            p = max(p, _far(answer.probability(s), expected))
            for j in np.flatnonzero(expected > _POSSIBLE):
                mean, cov = truth.moments(t, j)
                m = max(m, _far(by_mode.mean[j], mean), _far(by_mode.cov[j], cov))
        yield p, m, abs(answer.log_likelihood - truth.log_likelihood)


def _gtsam(seeds: range) -> Iterator[tuple[float, float, float]]:
    """Against gtsam, which knows no singular noise and gives no likelihood of the evidence."""
    if not importlib.util.find_spec("gtsam"):
        return
    from oracles.gtsam_hybrid import eliminate_window

    for seed in seeds:
        model, window = random_switching(seed, singular=False)
        truth = eliminate_window(model, window)
        yield (*_mixtures(infer_window(model, window), *truth), np.inf)


def _mixtures(answer: Posterior, p: Any, mean: Any, cov: Any) -> tuple[float, float]:
    """Largest difference over the Gaussians of every mode sequence."""
    apart = [0.0, 0.0]
    for t in range(len(mean)):
        mixture = answer.mixture(f"X{t + 1}")
        sure = p > _POSSIBLE
        apart[0] = max(apart[0], _far(mixture.probability.ravel(), p))
        for ours, theirs in ((mixture.mean, mean[t]), (mixture.cov, cov[t])):
            apart[1] = max(apart[1], _far(ours.reshape(theirs.shape)[sure], theirs[sure]))
    return apart[0], apart[1]


def _networks(seeds: range) -> Iterator[tuple[float, float, float]]:
    for seed in seeds:
        network, evidence = random_network(seed)
        truth, answer = enumerate_network(network, evidence), infer(network, evidence)
        p = m = 0.0
        for name, node in network.discrete.items():
            at = np.array([v[name] for v in truth.value])
            expected = np.bincount(at, truth.probability, node.size)
            p = max(p, _far(answer.probability(name), expected))
        for name in network.gaussian:
            moments = mixture_moments(truth.probability, truth.mean[name], truth.cov[name])
            for ours, theirs in zip(answer.moments(name).moments(), moments, strict=True):
                m = max(m, _far(ours, theirs))
        yield p, m, abs(answer.log_likelihood - truth.log_likelihood)


def _far(a: Any, b: Any) -> float:
    return float(np.abs(np.asarray(a) - b).max())


def _incinerator() -> Figure:
    """Lauritzen (1992), posterior given W, L, C: the values frozen to seven digits."""
    answer = infer(incinerator(), {"W": 0, "L": 1.1, "C": -0.9})
    frozen = {"B": 0.0122528, "F": 0.9995263}
    apart = max(abs(answer.probability(n)[0] - p) for n, p in frozen.items())
    return Figure(
        "waste incinerator: P(B), P(F), log-likelihood",
        max(apart, abs(answer.log_likelihood + 3.8137239)), "<= 5e-8",
    )  # fmt: skip
