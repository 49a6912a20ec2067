"""The strong junction tree against enumeration, gtsam, and Lauritzen's printed example."""

import itertools
from typing import Any

import numpy as np
import pytest

from oracles.enumeration import enumerate_network, enumerate_window
from oracles.switching import incinerator, random_network, random_switching
from oracles.textbook import mixture_moments
from whichroad.exact import (
    Discrete,
    Gaussian,
    Network,
    Posterior,
    Sensor,
    SwitchingModel,
    infer,
    infer_window,
)

CONTINUOUS, DISCRETE = 1e-9, 1e-12
WINDOWS, NETWORKS = range(24), range(40)  # all 200: python -m benchmarks exact


def close(a: Any, b: Any, within: float = CONTINUOUS) -> bool:
    return bool(np.allclose(a, b, rtol=within, atol=within))


def clear_of_zero(p: np.ndarray) -> np.ndarray:
    """Modes that are possible: of the others nothing is said."""
    return p > 1e-13


# Oracles


@pytest.mark.parametrize("seed", WINDOWS)
def test_a_window_agrees_with_one_kalman_filter_for_every_mode_sequence(seed: int):
    model, window = random_switching(seed)
    modes, truth = len(model.initial), enumerate_window(model, window)
    answer = infer_window(model, window)
    assert close(answer.log_likelihood, truth.log_likelihood)
    for t in range(len(window)):
        s, x = f"S{t + 1}", f"X{t + 1}"
        p = answer.probability(s)
        assert close(p, truth.of_mode(t, modes), DISCRETE)
        by_mode = answer.moments(x, [s])
        assert close(by_mode.probability, p, DISCRETE)
        for j in np.flatnonzero(clear_of_zero(p)):
            mean, cov = truth.moments(t, j)
            assert close(by_mode.mean[j], mean)
            assert close(by_mode.cov[j], cov)
        assert all(map(close, answer.moments(x).moments(), truth.moments(t)))


@pytest.mark.parametrize("seed", WINDOWS[:8])
def test_the_mixture_of_a_slice_holds_one_gaussian_for_every_mode_sequence(seed: int):
    model, window = random_switching(seed)
    truth, answer = enumerate_window(model, window), infer_window(model, window)
    for t in range(len(window)):
        mixture = answer.mixture(f"X{t + 1}")
        assert mixture.modes == tuple(f"S{i + 1}" for i in range(len(window)))
        p = mixture.probability.ravel()
        assert close(p, truth.probability, DISCRETE)
        sure = clear_of_zero(p)
        assert close(mixture.mean.reshape(truth.mean[t].shape)[sure], truth.mean[t][sure])
        assert close(mixture.cov.reshape(truth.cov[t].shape)[sure], truth.cov[t][sure])


@pytest.mark.parametrize("seed", NETWORKS)
def test_any_network_agrees_with_one_big_gaussian_for_every_configuration(seed: int):
    network, evidence = random_network(seed)
    truth, answer = enumerate_network(network, evidence), infer(network, evidence)
    assert close(answer.log_likelihood, truth.log_likelihood)
    for name, node in network.discrete.items():
        values = np.array([v[name] for v in truth.value])
        p = np.bincount(values, truth.probability, node.size)
        assert close(answer.probability(name), p, DISCRETE)
    for name in network.gaussian:
        expected = mixture_moments(truth.probability, truth.mean[name], truth.cov[name])
        assert all(map(close, answer.moments(name).moments(), expected))
        assert all(map(close, answer.mixture(name).moments(), expected))


@pytest.mark.parametrize("seed", [0, 1, 3, 6, 10, 15, 21, 24])
def test_a_window_agrees_with_the_hybrid_elimination_of_gtsam(seed: int):
    pytest.importorskip("gtsam", reason="gtsam is not installed (no wheel for this platform?)")
    from oracles.gtsam_hybrid import eliminate_window

    model, window = random_switching(seed)
    truth, answer = eliminate_window(model, window), infer_window(model, window)
    for t in range(len(window)):
        mixture = answer.mixture(f"X{t + 1}")
        p = mixture.probability.ravel()
        assert close(p, truth.probability, DISCRETE)
        sure = clear_of_zero(p)
        assert close(mixture.mean.reshape(truth.mean[t].shape)[sure], truth.mean[t][sure])
        assert close(mixture.cov.reshape(truth.cov[t].shape)[sure], truth.cov[t][sure])


# Lauritzen (1992): mean and standard deviation as printed, to half a unit of the last digit

PRIOR = {
    "E": (-3.25, 0.005, 0.709), "D": (3.04, 0.005, 0.770), "C": (-1.85, 0.005, 0.507),
    "L": (1.48, 0.005, 0.631), "Min": (-0.214, 0.0005, 0.459), "Mout": (2.83, 0.0051, 0.860),
}  # fmt: skip
GIVEN = {
    "E": (-3.90, 0.005, 0.076), "D": (3.61, 0.005, 0.326), "Min": (0.5, 0.05, 0.1),
    "Mout": (4.11, 0.005, 0.344),
}  # fmt: skip


def agrees(answer: Posterior, node: str, mean: float, half: float, sigma: float) -> bool:
    (m,), ((v,),) = answer.moments(node).moments()
    return abs(m - mean) <= half and abs(np.sqrt(v) - sigma) <= 0.00051


def test_the_waste_incinerator_has_the_printed_prior():
    answer = infer(incinerator())
    assert all(agrees(answer, node, *printed) for node, printed in PRIOR.items())
    assert close(answer.probability("B"), [0.85, 0.15])
    assert close(answer.probability("F"), [0.95, 0.05])
    assert answer.probability("W")[0] == pytest.approx(0.286, abs=0.0005)
    assert answer.log_likelihood == pytest.approx(0.0, abs=1e-12)


def test_the_waste_incinerator_has_the_printed_posterior():
    """Industrial waste, light 1.1, carbon dioxide −0.9."""
    answer = infer(incinerator(), {"W": 0, "L": 1.1, "C": -0.9})
    assert all(agrees(answer, node, *printed) for node, printed in GIVEN.items())
    assert answer.probability("B")[0] == pytest.approx(0.0122, abs=0.0001)
    assert answer.probability("F")[0] == pytest.approx(0.9995, abs=0.00005)
    # beyond print: frozen, from an enumeration of our own
    assert answer.probability("B")[0] == pytest.approx(0.0122528, abs=5e-8)
    assert answer.probability("F")[0] == pytest.approx(0.9995263, abs=5e-8)
    assert answer.log_likelihood == pytest.approx(-3.8137239, abs=5e-8)


# The tree


def _some_tree(seed: int) -> tuple[Network, Posterior]:
    network, evidence = random_network(seed)
    return network, infer(network, evidence)


@pytest.mark.parametrize("seed", NETWORKS)
def test_the_tree_is_strong(seed: int):
    """What a clique does not share with its parent is continuous, or what it shares is discrete."""
    network, answer = _some_tree(seed)
    for clique in answer.cliques:
        assert clique.variables == clique.separator | set(clique.residual)
        ends = [name in network.discrete for name in clique.residual]
        assert ends == sorted(ends)  # continuous first
        if any(ends):
            assert all(name in network.discrete for name in clique.separator)


@pytest.mark.parametrize("seed", NETWORKS)
def test_the_cliques_that_hold_a_variable_are_connected(seed: int):
    _, answer = _some_tree(seed)
    for name in set().union(*(c.variables for c in answer.cliques)):
        tops = [c for c in answer.cliques if name in c.variables and name not in c.separator]
        assert len(tops) == 1
    for clique in answer.cliques:
        if clique.parent >= 0:
            assert clique.separator <= answer.cliques[clique.parent].variables


@pytest.mark.parametrize("seed", range(6))
def test_the_order_of_elimination_changes_nothing(seed: int):
    network, evidence = random_network(seed)
    names = [n for n in network.gaussian if n not in evidence]
    answers = [
        infer(network, evidence, o)
        for o in itertools.islice(itertools.permutations(names), 0, 24, 5)
    ]
    for a in answers[1:]:
        assert close(a.log_likelihood, answers[0].log_likelihood)
        for n in names:
            assert all(map(close, a.moments(n).moments(), answers[0].moments(n).moments()))


# Laws


def walk(modes: int = 2, q: float = 1.0) -> SwitchingModel:
    """A random walk on a line that one sensor sees, with a drift for each mode."""
    return SwitchingModel(
        np.full(modes, 1.0 / modes), np.full((modes, modes), 1.0 / modes), [0.0], [[4.0]],
        [[1.0]], np.arange(modes, dtype=float)[:, None], [[q]],
        {"GPS": Sensor([[1.0]], [0.0], [[0.5]])},
    )  # fmt: skip


def test_one_mode_is_the_kalman_filter():
    """Two steps on a line, by hand: 4 → 4·½/(4½) = 4/9, + 1, → (13/9·½)/(13/9+½) = 13/35."""
    answer = infer_window(walk(1), [{"GPS": 9.0}, {"GPS": 0.0}])
    mean, cov = answer.moments("X2").moments()
    assert close(cov, [[13 / 35]])
    assert close(mean, [8.0 * (1.0 - 26 / 35)])


def test_silence_leaves_the_prior():
    """X3 = X1 + drifts of two slices, each 0 or 1, + two steps of noise."""
    answer = infer_window(walk(), [{}, {"GPS": None}, {}])
    assert answer.log_likelihood == pytest.approx(0.0, abs=1e-12)
    mean, cov = answer.moments("X3").moments()
    assert close(mean, [1.0])
    assert close(cov, [[4.0 + 2.0 + 2 * 0.25]])
    assert close(answer.probability("S3"), [0.5, 0.5])


def test_a_zero_variance_is_a_deterministic_relation():
    """Z = X + Y exactly, and Z seen: X and Y stay apart by what is left of the doubt."""
    network = Network(
        [
            Gaussian("X", [0.0], [[1.0]]),
            Gaussian("Y", [0.0], [[3.0]]),
            Gaussian("Z", [0.0], [[0.0]], {"X": [[1.0]], "Y": [[1.0]]}),
            Gaussian("W", [0.0], [[0.0]], {"Z": [[2.0]]}),
        ]
    )
    answer = infer(network, {"Z": 4.0})
    assert close(answer.moments("X").moments()[0], [1.0])
    assert close(answer.moments("X").moments()[1], [[0.75]])
    mean, cov = answer.moments("W").moments()
    assert close(mean, [8.0])
    assert close(cov, [[0.0]])


def test_a_car_without_motion_noise_is_smoothed_exactly():
    """Static X seen twice: both slices say the same, sigma² = 1 / (1/4 + 2 + 2)."""
    answer = infer_window(walk(1, q=0.0), [{"GPS": 1.0}, {"GPS": 2.0}])
    for x in ("X1", "X2"):
        mean, cov = answer.moments(x).moments()
        assert close(cov, [[1 / 4.25]])
        assert close(mean, [6 / 4.25])


def test_a_joint_probability_sums_to_its_marginals():
    model, window = random_switching(5)
    answer = infer_window(model, window)
    pair = answer.probability("S2", "S1")
    assert close(pair.sum(axis=0), answer.probability("S1"), DISCRETE)
    assert close(pair.sum(axis=1), answer.probability("S2"), DISCRETE)


def test_what_was_observed_is_certain():
    answer = infer(incinerator(), {"W": 1, "L": 1.1})
    assert close(answer.probability("W"), [0.0, 1.0], DISCRETE)
    assert close(answer.probability("W", "B")[1], answer.probability("B"))
    assert close(answer.probability("W", "B")[0], 0.0)
    mean, cov = answer.moments("L").moments()
    assert mean == [1.1]
    assert cov == [[0.0]]


def test_models_may_differ_from_slice_to_slice():
    """A drift of 3 in the second slice only."""
    still, moves = walk(1), walk(1)
    moves = SwitchingModel(
        moves.initial, moves.transition, moves.mean, moves.cov, moves.a, [[3.0]], moves.q,
        moves.sensors,
    )  # fmt: skip
    answer = infer_window([still, moves, still], [{}, {}, {}])
    assert [float(answer.moments(f"X{t}").moments()[0][0]) for t in (1, 2, 3)] == [0.0, 3.0, 3.0]


def test_a_chain_of_modes_without_gaussians_is_a_hidden_markov_model():
    """Forward-backward by hand: all sequences of a chain whose symbols are seen."""
    rng = np.random.default_rng(3)
    start, move = rng.dirichlet([1] * 3), rng.dirichlet([1] * 3, 3)
    emit = rng.dirichlet([1] * 4, 3)
    symbols = [0, 3, 1, 1, 2]
    nodes = [Discrete("S0", start), Discrete("Y0", emit, ["S0"])]
    for t in range(1, 5):
        nodes += [Discrete(f"S{t}", move, [f"S{t - 1}"]), Discrete(f"Y{t}", emit, [f"S{t}"])]
    answer = infer(Network(nodes), {f"Y{t}": y for t, y in enumerate(symbols)})
    total, marginal = 0.0, np.zeros((5, 3))
    for s in itertools.product(range(3), repeat=5):
        p = start[s[0]] * np.prod([move[a, b] for a, b in itertools.pairwise(s)])
        p *= np.prod([emit[a, y] for a, y in zip(s, symbols, strict=True)])
        total += p
        marginal[range(5), s] += p
    assert answer.log_likelihood == pytest.approx(np.log(total), abs=1e-12)
    for t in range(5):
        assert close(answer.probability(f"S{t}"), marginal[t] / total, DISCRETE)
