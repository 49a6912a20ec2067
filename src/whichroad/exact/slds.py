"""The switching Kalman filter of the paper's section 3.1, unrolled into a static network.

    P(S_t = j | S_t-1 = i)  = B(i, j)                                the road
    X_t | X_t-1, S_t = i    ~ N(A_i X_t-1 + μ_i, Q_i)                the vehicle
    Y_t | X_t, S_t = i      ~ N(C_i X_t + ν_i, R_i)                  each sensor

The paper's Figure 6 is this with two sensors, GPS_k, alike for all modes, and Carto_k,
of which each road has its own.  Slice t, counted from 1, has the nodes `S1`, `X1` and
one for each sensor that spoke: `GPS1`, `Carto1`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from .gaussian_network import Discrete, Gaussian, Network, NetworkError, Value
from .inference import Posterior, infer

Observations = Sequence[Mapping[str, Value | None]]


@dataclass(frozen=True, slots=True)
class Sensor:
    """Y | X, S = i ~ N(C_i X + ν_i, R_i).

    The axis K of the modes may be left out where all modes see the same.

    Attributes:
        c: Observation matrix C, shape (K, M, D).
        nu: Offset ν, shape (K, M).
        r: Noise covariance R, shape (K, M, M).
    """

    c: ArrayLike
    nu: ArrayLike
    r: ArrayLike


@dataclass(frozen=True, slots=True)
class SwitchingModel:
    """A switching linear Gaussian system.

    Attributes:
        initial: P(S_1), shape (K,).
        transition: B; transition[i, j] = P(S_t = j | S_t-1 = i), shape (K, K).
        mean: Of X_1 given S_1, shape (K, D) or (D,).
        cov: Of X_1 given S_1, shape (K, D, D) or (D, D).
        a: Motion matrix A, shape (K, D, D) or (D, D).
        mu: Drift μ, shape (K, D) or (D,).
        q: Motion noise Q, shape (K, D, D) or (D, D).
        sensors: By name.
    """

    initial: ArrayLike
    transition: ArrayLike
    mean: ArrayLike
    cov: ArrayLike
    a: ArrayLike
    mu: ArrayLike
    q: ArrayLike
    sensors: Mapping[str, Sensor]


def unroll(models: SwitchingModel | Sequence[SwitchingModel], window: Observations) -> Network:
    """The static network of a window.

    Args:
        models: One for all slices, or one for each; `initial`, `mean` and `cov` are the
            first one's.
        window: For each slice, sensor to value; a sensor that is missing or None there
            did not report, and has no node.

    Raises:
        NetworkError: For an empty window, unknown sensors, and what `Network` refuses.
    """
    each = [models] * len(window) if isinstance(models, SwitchingModel) else list(models)
    if not window or len(each) != len(window):
        raise NetworkError(
            f"there are {len(each)} models and {len(window)} slices of observations; one model, "
            "or one for each of one slice or more, was expected"
        )
    nodes: list[Discrete | Gaussian] = []
    for t, (model, seen) in enumerate(zip(each, window, strict=True), start=1):
        s, x, before = f"S{t}", f"X{t}", f"X{t - 1}"
        if t == 1:
            nodes.append(Discrete(s, model.initial))
            nodes.append(Gaussian(x, model.mean, model.cov, {}, (s,)))
        else:
            nodes.append(Discrete(s, model.transition, (f"S{t - 1}",)))
            nodes.append(Gaussian(x, model.mu, model.q, {before: model.a}, (s,)))
        for name, value in seen.items():
            if name not in model.sensors:
                raise NetworkError(
                    f"slice {t}: there is no sensor {name}; the sensors are "
                    f"{', '.join(model.sensors) or 'none'}"
                )
            if value is not None:
                sensor = model.sensors[name]
                nodes.append(Gaussian(f"{name}{t}", sensor.nu, sensor.r, {x: sensor.c}, (s,)))
    return Network(nodes)


def infer_window(
    models: SwitchingModel | Sequence[SwitchingModel], window: Observations
) -> Posterior:
    """P(X_t, S_t | Y_1:T) of every slice of a window, exactly.

    The cost is that of K^T Gaussians; `Posterior.mixture` of the last slice holds them.

    Args:
        models: One for all slices, or one for each.
        window: What each slice saw, by the sensor's name, as `unroll` takes it.

    Raises:
        NetworkError: As `unroll` and `infer`.
    """
    network = unroll(models, window)
    evidence = {
        f"{name}{t}": value
        for t, seen in enumerate(window, start=1)
        for name, value in seen.items()
        if value is not None
    }
    forward = [f"X{t}" for t in range(1, len(window) + 1)]
    return infer(network, evidence, forward)
