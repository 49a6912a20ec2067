"""What the exact networks refuse, and that they say why."""

import numpy as np
import pytest

from oracles.switching import incinerator
from whichroad import WhichroadError
from whichroad.exact import (
    Discrete,
    Gaussian,
    Network,
    NetworkError,
    Sensor,
    SwitchingModel,
    infer,
    infer_window,
    unroll,
)

S = Discrete("S", [0.4, 0.6])
X = Gaussian("X", [0.0], [[1.0]])

REFUSED = {
    "sums to 0.9": [Discrete("T", [0.4, 0.5])],
    "not negative": [Discrete("T", [1.5, -0.5])],
    "shape": [S, Discrete("T", [0.5, 0.5], ["S"])],
    "is there already": [Discrete("T", [1.0]), Discrete("T", [1.0])],
    "parents before children": [Discrete("T", [[0.5, 0.5]] * 2, ["S"]), S],
    "is Gaussian": [X, Discrete("T", [0.5, 0.5], ["X"])],
    "named twice": [S, Discrete("T", np.full((2, 2, 2), 0.5), ["S", "S"])],
    "not finite": [Gaussian("T", [np.nan], [[1.0]])],
    "no array of numbers": [Gaussian("T", ["east"], [[1.0]])],
    "its mean has shape": [S, Gaussian("T", np.zeros((3, 1)), [[1.0]], modes=["S"])],
    "its cov has shape": [Gaussian("T", [0.0, 0.0], [1.0, 1.0])],
    "its weights of X has shape": [X, Gaussian("T", [0.0], [[1.0]], {"X": [1.0]})],
    "a variance of -1": [Gaussian("T", [0.0], [[-1.0]])],
    "not symmetric": [Gaussian("T", [0.0, 0.0], [[1.0, 0.5], [0.0, 1.0]])],
    "negative eigenvalue": [Gaussian("T", [0.0, 0.0], [[1.0, 2.0], [2.0, 1.0]])],
    "no Gaussian node given before": [S, Gaussian("T", [0.0], [[1.0]], {"S": [[1.0]]})],
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_network_that_makes_no_sense_is_refused_with_the_reason(why: str):
    with pytest.raises(NetworkError, match=why):
        Network(REFUSED[why])


def test_the_error_is_one_of_ours_and_a_value_error():
    assert issubclass(NetworkError, WhichroadError)
    assert issubclass(NetworkError, ValueError)


@pytest.mark.parametrize(
    ("evidence", "why"),
    [
        ({"Q": 1}, "no such node"),
        ({"W": 2}, "whole number from 0 to 1"),
        ({"W": 0.5}, "whole number from 0 to 1"),
        ({"W": -1}, "whole number from 0 to 1"),
        ({"L": [1.0, 2.0]}, "shape"),
        ({"L": np.inf}, "not finite"),
        ({"L": "bright"}, "no array of numbers"),
    ],
)
def test_evidence_that_does_not_fit_is_refused(evidence, why: str):
    with pytest.raises(NetworkError, match=why):
        infer(incinerator(), evidence)


def test_impossible_evidence_is_refused():
    network = Network([S, Discrete("T", [[1.0, 0.0], [1.0, 0.0]], ["S"])])
    with pytest.raises(NetworkError, match="probability zero"):
        infer(network, {"T": 1})


def test_an_observation_without_a_density_is_refused():
    """Z is X exactly, and both were seen: no density, whatever the values."""
    network = Network([X, Gaussian("Z", [0.0], [[0.0]], {"X": [[1.0]]})])
    with pytest.raises(NetworkError, match="no density"):
        infer(network, {"X": 1.0, "Z": 1.0})


def test_a_window_that_is_too_long_is_refused_before_it_is_computed():
    model = SwitchingModel(
        [0.25] * 4, np.full((4, 4), 0.25), [0.0], [[1.0]], [[1.0]], [0.0], [[1.0]],
        {"GPS": Sensor([[1.0]], [0.0], [[1.0]])},
    )  # fmt: skip
    with pytest.raises(NetworkError, match="shorten the window"):
        infer_window(model, [{"GPS": 0.0}] * 20)


def test_windows_that_do_not_fit_their_models_are_refused():
    model = SwitchingModel([1.0], [[1.0]], [0.0], [[1.0]], [[1.0]], [0.0], [[1.0]], {})
    with pytest.raises(NetworkError, match="no sensor GPS"):
        unroll(model, [{"GPS": 1.0}])
    with pytest.raises(NetworkError, match="2 models and 1 slices"):
        unroll([model, model], [{}])
    with pytest.raises(NetworkError, match="one slice or more"):
        unroll(model, [])


@pytest.mark.parametrize(
    ("question", "why"),
    [
        (lambda a: a.probability("E"), "discrete node"),
        (lambda a: a.probability("B", "B"), "named twice"),
        (lambda a: a.moments("B"), "Gaussian node"),
        (lambda a: a.mixture("B"), "Gaussian node"),
        (lambda a: a.moments("E", ["Q"]), "unobserved discrete node"),
        (lambda a: a.moments("E", ["B", "B"]), "unobserved discrete node"),
    ],
)
def test_questions_that_make_no_sense_are_refused(question, why: str):
    answer = infer(incinerator())
    with pytest.raises(NetworkError, match=why):
        question(answer)
