"""The filter's own reduction against the exact posterior, where both describe one model.

Roads are straight lines, the transition between them is fixed, and so is what the wheels
say, so that everything is linear: a switching Kalman filter as the paper's section 3.1
writes it.  The same numbers go to `whichroad.exact` and through the production kernels.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes import living, network, straight_road
from whichroad._compile import Record
from whichroad.exact import Sensor, SwitchingModel, infer_window
from whichroad.filter.gaussian import condition
from whichroad.filter.hypotheses.reduction import reduce
from whichroad.filter.state import (
    GX,
    GY,
    WHEELS,
    Belief,
    Context,
    H,
    N,
    X,
    Y,
    new_belief,
    new_path,
    new_work,
    normalise,
    rescale,
    spawn,
)
from whichroad.settings import Settings, Vehicle, parameters

Array = NDArray[np.float64]

STATE = [X, Y, H, GX, GY]  # those of the filter's states that the suites use
STEP = 5.0  # m
LATERAL, HEADING = 2.0, math.radians(4.0)  # sigma of a road's rows
GNSS = 3.0  # m: sigma of the slow GNSS error; the white one is half of it


class Suite(NamedTuple):
    """Straight roads and a drive along one of them, or along one after the other."""

    point: Array  # (K, 2) a point of each road, m
    heading: Array  # (K,) rad
    transition: Array  # (K, K)
    course: Array  # (T,) what the vehicle's heading is when all goes well, rad
    truth: NDArray[np.int64]  # (T,) the road that is driven
    across: float  # m: doubt across the road at the start
    fixes: bool


def fork(degrees: float, seed: int, *, fixes: bool) -> Suite:
    """Two roads part at the origin; the vehicle takes either, 11 steps."""
    rng = np.random.default_rng([seed, 1])
    heading = np.array([0.0, -math.radians(degrees)])
    taken = int(rng.integers(2))
    return Suite(
        np.zeros((2, 2)), heading, np.array([[0.9, 0.1], [0.1, 0.9]]), np.full(11, heading[taken]),
        np.full(11, taken), 3.0, fixes,
    )  # fmt: skip


def parallel(gap: float, seed: int, *, fixes: bool) -> Suite:
    """Two roads beside each other, 11 steps."""
    rng = np.random.default_rng([seed, 2])
    return Suite(
        np.array([[0.0, 0.0], [0.0, -gap]]), np.zeros(2), np.array([[0.95, 0.05], [0.05, 0.95]]),
        np.zeros(11), np.full(11, rng.integers(2)), gap / 2.0, fixes,
    )  # fmt: skip


def roundabout(seed: int, *, fixes: bool) -> Suite:
    """Three arcs of a ring of 12 m radius as tangents, and an exit of 7 degrees; 7 steps."""
    rng = np.random.default_rng([seed, 3])
    at = np.array([0.0, 0.4, 0.8]) * math.pi / 2.0
    point = 12.0 * np.column_stack([np.sin(at), 1.0 - np.cos(at)])
    stays, leaves = rng.random() < 0.5, at[1] - math.radians(7.0)
    transition = np.array(
        [[0.5, 0.3, 0.0, 0.2], [0.0, 0.5, 0.3, 0.2], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )
    truth = np.array([0, 0, 1, 1, 2, 2, 2] if stays else [0, 0, 1, 3, 3, 3, 3])
    heading = np.append(at, leaves)
    return Suite(
        np.vstack([point, point[1]]), heading, transition, heading[truth], truth, 3.0, fixes
    )


def _matrices(suite: Suite, t: int) -> tuple[Array, Array, Array]:
    """Motion of the STATE in slice t: A, μ, Q, with the wheels' turn as known."""
    course, before = suite.course[t], suite.course[max(t - 1, 0)]
    a = np.eye(5)
    a[:2, 2] = STEP * np.array([-math.sin(course), math.cos(course)])
    mu = np.zeros(5)
    mu[:2] = STEP * np.array([math.cos(course), math.sin(course)]) - a[:2, 2] * course
    mu[2] = course - before
    # x moves with the new heading: h⁺ = h + δθ + w, p⁺ = p + L (t + n (h⁺ − course))
    turn = np.eye(5)
    turn[:2, 2] = a[:2, 2]
    mu[:2] += a[:2, 2] * mu[2]
    keep = math.exp(-0.5 / 60.0)  # half a second a step
    a[3:, 3:] *= keep
    along = np.array([math.cos(course), math.sin(course)])
    q = np.diag([0.0, 0.0, math.radians(0.7) ** 2, 1.0 - keep**2, 1.0 - keep**2])
    q = turn @ q @ turn.T
    q[:2, :2] += 0.1**2 * np.outer(along, along) + 0.05**2 * np.eye(2)
    return a, mu, q


def model_of(suite: Suite) -> list[SwitchingModel]:
    """One switching model for each slice."""
    k = len(suite.heading)
    nx, ny = np.sin(suite.heading), -np.cos(suite.heading)
    c = np.zeros((k, 2, 5))
    c[:, 0, 0], c[:, 0, 1], c[:, 1, 2] = nx, ny, 1.0
    nu = np.column_stack([-nx * suite.point[:, 0] - ny * suite.point[:, 1], -suite.heading])
    carto = Sensor(c, nu, np.diag([LATERAL**2, HEADING**2]))
    see = np.zeros((2, 5))
    see[:, :2], see[:, 3:] = np.eye(2), GNSS * np.eye(2)
    gps = Sensor(see, np.zeros(2), (0.5 * GNSS) ** 2 * np.eye(2))
    first = suite.truth[0]
    mean = np.append([*suite.point[first], suite.heading[first]], [0.0, 0.0])
    cov = np.diag([5.0**2, suite.across**2, math.radians(2.0) ** 2, 1.0, 1.0])
    initial = np.full(k, 1.0 / k)
    return [
        SwitchingModel(
            initial, suite.transition, mean, cov, *_matrices(suite, t), {"Carto": carto, "GPS": gps}
        )
        for t in range(len(suite.truth))
    ]


def window_of(suite: Suite, models: Sequence[SwitchingModel], seed: int) -> list[dict[str, Any]]:
    """What is seen on a drive: on the road, and with every fix one draw of its error.

    The map's pseudo-observations are zero; what is random is the start, the wheels and GNSS.
    """
    rng = np.random.default_rng([seed, 4])
    x = rng.multivariate_normal(np.asarray(models[0].mean), np.asarray(models[0].cov))
    window: list[dict[str, Any]] = []
    for t, model in enumerate(models):
        if t:
            x = np.asarray(model.a) @ x + model.mu
            x += rng.multivariate_normal(np.zeros(5), np.asarray(model.q))
        gps = model.sensors["GPS"]
        z = np.asarray(gps.c) @ x + rng.multivariate_normal(np.zeros(2), np.asarray(gps.r))
        window.append({"Carto": [0.0, 0.0], "GPS": z if suite.fixes else None})
    return window


def exact_modes(models: Sequence[SwitchingModel], window: Sequence[Any]) -> Array:
    """P(S_t | Y_1:t) for every t, (T, K), by the junction tree of every prefix."""
    ends = range(1, len(window) + 1)
    return np.array([infer_window(models[:t], window[:t]).probability(f"S{t}") for t in ends])


def reduced_modes(
    suite: Suite, models: Sequence[SwitchingModel], window: Sequence[Any], settings: Settings
) -> tuple[Array, NDArray[np.int64]]:
    """The same by the filter's kernels, and how many hypotheses it kept, (T,)."""
    k = len(suite.heading)
    belief, path, row = new_belief(), new_path(1 << 12), np.zeros(N)
    roads = network(straight_road())  # which the reduction does not look at
    ctx = Context(parameters(settings, Vehicle(), WHEELS), roads, new_work())
    state = belief.state[0]
    state.scale, state.count = 1.0, k
    for i in range(k):
        hyp = belief.hyp[i]
        hyp["mu"][STATE] = models[0].mean
        hyp["cov"][np.ix_(STATE, STATE)] = models[0].cov
        hyp.edge, hyp.log_weight = i, math.log(1.0 / k)
    normalise(belief)
    p, kept = np.zeros((len(window), k)), np.zeros(len(window), np.int64)
    for t, (model, seen) in enumerate(zip(models, window, strict=True)):
        if t:
            _branch(belief, suite.transition)
        for hyp in living(belief):
            if t:
                _move(hyp, model)
            for name, value in seen.items():
                if value is not None:
                    hyp.log_weight += _see(hyp, model.sensors[name], value, row)
            _track(hyp, suite)
        reduce(belief, path, ctx)
        alive = living(belief)
        kept[t] = len(alive)
        p[t] = np.bincount(alive.edge, alive.weight, k)
    return p, kept


SUITES = {
    "fork of 5 degrees": lambda seed, fixes: fork(5.0, seed, fixes=fixes),
    "fork of 15 degrees": lambda seed, fixes: fork(15.0, seed, fixes=fixes),
    "parallel, 8 m": lambda seed, fixes: parallel(8.0, seed, fixes=fixes),
    "parallel, 12 m": lambda seed, fixes: parallel(12.0, seed, fixes=fixes),
    "roundabout": lambda seed, fixes: roundabout(seed, fixes=fixes),
}


def _branch(belief: Belief, transition: Array) -> None:
    """Every hypothesis goes to every road that may follow."""
    for i, hyp in enumerate(living(belief)):
        come = int(hyp.edge)
        for j in np.flatnonzero(transition[come]).tolist():
            if j != come:
                spawn(belief, i, float(transition[come, j]), j, 0)
        rescale(hyp, float(transition[come, come]))


def _move(hyp: Record, model: SwitchingModel) -> None:
    a, at = np.asarray(model.a), np.ix_(STATE, STATE)
    mean, cov = hyp["mu"], hyp["cov"]
    mean[STATE] = a @ mean[STATE] + model.mu
    cov[at] = a @ cov[at] @ a.T + model.q


def _see(hyp: Record, sensor: Sensor, value: Any, row: Array) -> float:
    """Scalar rows, one after the other; their errors are independent."""
    edge, gain = hyp.edge, 0.0
    c, nu, r = (
        np.asarray(m)[edge] if np.ndim(m) > d else np.asarray(m)
        for m, d in ((sensor.c, 2), (sensor.nu, 1), (sensor.r, 2))
    )
    for m in range(len(nu)):
        row[:] = 0.0
        row[STATE] = c[m]
        innovation = value[m] - nu[m] - c[m] @ hyp["mu"][STATE]
        gain += condition(hyp["mu"], hyp["cov"], row, innovation, r[m, m], 1.0)
    return gain


def _track(hyp: Record, suite: Suite) -> None:
    """Abscissa and its sigma, by which the reduction judges what is alike."""
    edge = hyp.edge
    along = np.array([math.cos(suite.heading[edge]), math.sin(suite.heading[edge])])
    hyp.along = along @ (hyp["mu"][:2] - suite.point[edge])
    hyp.along_sigma = math.sqrt(along @ hyp["cov"][:2, :2] @ along)
