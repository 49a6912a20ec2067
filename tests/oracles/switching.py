"""Random switching models, random networks, and Lauritzen's waste incinerator."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from whichroad.exact import Discrete, Gaussian, Network, Sensor, SwitchingModel

Array = NDArray[np.float64]


def _covariance(rng: np.random.Generator, shape: tuple[int, ...], d: int, rank: int) -> Array:
    """Random covariances of some rank: eigenvalues of 0.1 to 3, or zero."""
    turn = np.linalg.qr(rng.normal(size=(*shape, d, d)))[0][..., :rank]
    return (turn * rng.uniform(0.1, 3.0, (*shape, 1, rank))) @ np.swapaxes(turn, -1, -2)


def random_switching(
    seed: int, *, singular: bool = True
) -> tuple[SwitchingModel, list[dict[str, Any]]]:
    """A model of K ≤ 4 modes and D ≤ 4 dimensions, and a window of T ≤ 7 slices of it.

    Some sensors are silent in some slices, some transitions impossible, and in every
    third model the motion noise is singular where that is wanted.  The observations are
    drawn from the model.
    """
    rng = np.random.default_rng([seed, 77])
    k, length, d = int(rng.integers(2, 5)), int(rng.integers(2, 8)), int(rng.integers(1, 5))
    transition = rng.dirichlet(np.ones(k), k)
    if seed % 4 == 1:
        transition[0, -1] = 0.0
        transition /= transition.sum(axis=1, keepdims=True)
    rank = d - 1 if singular and seed % 3 == 2 and d > 1 else d
    sensors = {}
    for name in ("Carto", "GPS"):
        m = int(rng.integers(1, 4))
        of = (k,) if name == "Carto" else ()
        sensors[name] = Sensor(
            rng.normal(size=(*of, m, d)), rng.normal(size=(*of, m)), _covariance(rng, of, m, m)
        )
    model = SwitchingModel(
        rng.dirichlet(np.ones(k)), transition, rng.normal(size=(k, d)),
        _covariance(rng, (k,), d, d), 0.6 * rng.normal(size=(k, d, d)), rng.normal(size=(k, d)),
        _covariance(rng, (k,), d, rank), sensors,
    )  # fmt: skip
    return model, _draw(rng, model, length)


def _draw(rng: np.random.Generator, model: Any, length: int) -> list[dict[str, Any]]:
    k = len(model.initial)
    s = int(rng.choice(k, p=model.initial))
    x = rng.multivariate_normal(model.mean[s], model.cov[s])
    window: list[dict[str, Any]] = []
    for t in range(length):
        if t:
            s = int(rng.choice(k, p=model.transition[s]))
            x = rng.multivariate_normal(model.a[s] @ x + model.mu[s], model.q[s])
        seen: dict[str, Any] = {}
        for name, share in (("Carto", 0.9), ("GPS", 0.5)):
            sensor = model.sensors[name]
            c, nu, r = (a[s] if name == "Carto" else a for a in (sensor.c, sensor.nu, sensor.r))
            value = rng.multivariate_normal(c @ x + nu, r)
            seen[name] = value if rng.random() < share else None
        window.append(seen)
    return window


def random_network(seed: int) -> tuple[Network, dict[str, Any]]:
    """A network of up to five discrete and six Gaussian nodes, and evidence on some of them."""
    rng = np.random.default_rng([seed, 78])
    nodes: list[Discrete | Gaussian] = []
    sizes: dict[str, int] = {}
    for i in range(int(rng.integers(1, 6))):
        parents = [n for n in sizes if rng.random() < 0.4]
        shape = [sizes[p] for p in parents]
        sizes[f"S{i}"] = int(rng.integers(2, 4))
        nodes.append(
            Discrete(f"S{i}", rng.dirichlet(np.ones(sizes[f"S{i}"]), tuple(shape)), parents)
        )
    width: dict[str, int] = {}
    for i in range(int(rng.integers(1, 7))):
        modes = [n for n in sizes if rng.random() < 0.4]
        rng.shuffle(modes)
        of = tuple(sizes[m] for m in modes)
        d = int(rng.integers(1, 3))
        parents_of = {
            n: rng.normal(size=(*of, d, w)) for n, w in width.items() if rng.random() < 0.5
        }
        mean, cov = rng.normal(size=(*of, d)), _covariance(rng, of, d, d)
        nodes.append(Gaussian(f"X{i}", mean, cov, parents_of, modes))
        width[f"X{i}"] = d
    evidence: dict[str, Any] = {
        n: int(rng.integers(0, size)) for n, size in sizes.items() if rng.random() < 0.2
    }
    evidence |= {n: rng.normal(size=w) for n, w in width.items() if rng.random() < 0.4}
    return Network(nodes), evidence


def incinerator() -> Network:
    """Lauritzen (1992): emissions of a waste incinerator.

    Modes count from zero: B stable, unstable; F intact, defect; W industrial, household.
    """

    def mean(rows: Any) -> Array:
        return np.array(rows, float)[..., None]

    def variance(rows: Any) -> Array:
        return np.array(rows, float)[..., None, None]

    return Network(
        [
            Discrete("B", [0.85, 0.15]),
            Discrete("F", [0.95, 0.05]),
            Discrete("W", [2 / 7, 5 / 7]),
            Gaussian(
                "E", mean([[-3.9, -3.2], [-0.4, -0.5]]), variance([[2e-5, 2e-5], [1e-4, 1e-4]]),
                modes=("F", "W"),
            ),
            Gaussian(
                "D", mean([[6.5, 7.5], [6.0, 7.0]]), variance([[0.03, 0.1], [0.04, 0.1]]),
                {"E": [[1.0]]}, ("W", "B"),
            ),
            Gaussian("C", mean([-2.0, -1.0]), variance([0.1, 0.3]), modes=("B",)),
            Gaussian("L", [3.0], [[0.25]], {"D": [[-0.5]]}),
            Gaussian("Min", mean([0.5, -0.5]), variance([0.01, 0.005]), modes=("W",)),
            Gaussian("Mout", [0.0], [[0.002]], {"D": [[1.0]], "Min": [[1.0]]}),
        ]
    )  # fmt: skip
