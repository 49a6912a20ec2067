"""The paper's loop (Figure 7), taken literally: predict, Y₁, Y_carto, the most probable.

What the text leaves open, and what is taken here:

- The time between two steps (Figure 11 counts "seven steps"): one second, by default.
- The heading at the start, where nothing reports one: each candidate's, with equal chances
  (Figure 8).

Our additions: a speed where there is no odometry, which the paper always has, and a new start
after fixes that fit nothing for long.
"""

import math

from ._jit import Vector, entry, kernel
from .along import forward_only
from .angles import wrap
from .belief import (
    LAST_FIX,
    MISFITS,
    NO_EDGE,
    NOW,
    SPEED,
    STARTED,
    STOOD,
    Belief,
    H,
    K,
    N,
    X,
    Y,
    normalise,
)
from .epoch import CLOCK, DISTANCE, WHEELS, Epochs
from .gnss import observe_fix, observe_state
from .grid import near, vertex_at
from .motion import predict_free
from .network import Roads
from .output import LOST, OUTAGE, V_H, V_X, V_XX, V_Y, Output, say
from .paper import STEPPED, Bench, Literal, most_probable, switch
from .parameters import Parameters

_ANYWHERE = 1000.0  # m, sigma of the position before the first fix


@kernel
def predict(
    belief: Belief, epochs: Epochs, k: int, dt: float, mode: int, scale: float, par: Parameters
) -> None:
    """Equation (1) for every hypothesis, and its Jacobian for the covariance.

    δs and δθ come from the wheels.  With a mere odometer δθ = 0 and the heading walks;
    without one, too, the vehicle keeps its speed, which is then the state K.
    """
    metres = abs(epochs.arc[k])
    arc = epochs.arc[k]
    forward = epochs.forward[k]
    left = epochs.left[k]
    q_along = par.along_noise**2 * metres
    q_across = par.lateral_noise**2 * metres
    q_heading = par.heading_noise**2 * metres + (par.turn_noise * epochs.turn[k]) ** 2
    q_rate = 0.0
    if mode == CLOCK:
        arc = dt
        forward = dt
        left = 0.0
        q_rate = par.acceleration_noise**2 * dt
        q_along = q_rate * dt * dt / 3.0 + 0.01 * dt
        q_across = 0.25 * q_along
        q_heading = 0.09 * dt
    elif mode == DISTANCE:
        q_heading = 0.0025 * metres
    elif epochs.moved[k] == 0:
        q_along += 0.04 * metres * metres
        q_heading += 0.01 * metres
    for i in range(belief.size[0]):
        predict_free(
            belief.mean[i], belief.cov[i], forward, left, epochs.turn[k], arc, scale,
            q_along, q_across, q_heading, q_rate, 0.0,
        )  # fmt: skip


@kernel
def _fresh(
    belief: Belief, i: int, fix: Vector, heading: float, heading_sigma: float, rate: float,
    rate_sigma: float,
) -> None:  # fmt: skip
    """Row i: anywhere about a fix, with this heading, on no road yet."""
    for a in range(N):
        belief.mean[i, a] = 0.0
        for b in range(N):
            belief.cov[i, a, b] = 0.0
    belief.mean[i, X] = fix[0]
    belief.mean[i, Y] = fix[1]
    belief.mean[i, H] = wrap(heading)
    belief.mean[i, K] = rate
    belief.cov[i, X, X] = _ANYWHERE**2
    belief.cov[i, Y, Y] = _ANYWHERE**2
    belief.cov[i, H, H] = heading_sigma**2
    belief.cov[i, K, K] = rate_sigma**2
    belief.edge[i] = NO_EDGE
    belief.log_weight[i] = 0.0


@kernel
def begin(
    belief: Belief, roads: Roads, bench: Bench, scale: float, epochs: Epochs, k: int, mode: int,
    lever: Vector, literal: Literal,
) -> bool:  # fmt: skip
    """Start, or start anew, from the fix of epoch k.

    Without a course every candidate starts a hypothesis of its own heading.

    Returns:
        False, and nothing is changed, where there is neither a course nor a candidate.
    """
    rate = 1.0
    rate_sigma = 0.0
    if mode == CLOCK:
        rate = epochs.speed[k] if epochs.speed_sigma[k] < 10.0 else 6.0
        rate_sigma = min(epochs.speed_sigma[k], 8.0)
    fix = epochs.fix[k]
    moving = epochs.speed_sigma[k] > 1e6 or epochs.speed[k] > 2.0
    count = near(
        roads, fix[0], fix[1], literal.paper_radius, bench.edge, bench.s, bench.lateral,
        bench.distance,
    )  # fmt: skip
    if epochs.course_sigma[k] < 0.5 and moving:
        sigma = epochs.course_sigma[k] + 0.03
        _fresh(belief, 0, fix, epochs.course[k], sigma, rate, rate_sigma)
        count = 1
    else:
        for j in range(count):
            v = vertex_at(roads, bench.edge[j], bench.s[j])
            heading = math.atan2(roads.y[v + 1] - roads.y[v], roads.x[v + 1] - roads.x[v])
            _fresh(belief, j, fix, heading, literal.paper_heading_sigma, rate, rate_sigma)
    if count == 0:
        return False
    belief.size[0] = count
    belief.clock[STARTED] = 1.0
    belief.clock[MISFITS] = 0.0
    belief.clock[LAST_FIX] = epochs.time[k]
    normalise(belief)
    observe_fix(belief, fix, bench.no_bias, 1.0, scale, lever, 1.0, math.inf, False, bench.row)
    switch(belief, roads, bench, scale, literal)
    return True


@kernel
def observe_gnss(
    belief: Belief, bench: Bench, scale: float, epochs: Epochs, k: int, mode: int, lever: Vector,
    par: Parameters,
) -> float:  # fmt: skip
    """Y₁ with the covariance Q^gps that the receiver reports, independent from fix to fix.

    Without wheels the course, and without any odometer the speed, are observed as well.

    Returns:
        Chi-square of the fix under the hypothesis that fits it best.
    """
    chi2 = observe_fix(
        belief, epochs.fix[k], bench.no_bias, 1.0, scale, lever, 1.0, math.inf, False, bench.row
    )
    moving = epochs.speed_sigma[k] > 1e6 or epochs.speed[k] > 2.0
    if mode != WHEELS and epochs.course_sigma[k] < 1.0 and moving:
        variance = epochs.course_sigma[k] ** 2 + 0.0025
        observe_state(belief, H, epochs.course[k], variance, scale, bench.row)
    if mode == CLOCK and epochs.speed_sigma[k] < 20.0:
        variance = epochs.speed_sigma[k] ** 2 + 0.04
        observe_state(belief, K, epochs.speed[k], variance, scale, bench.row)
    normalise(belief)
    belief.clock[LAST_FIX] = epochs.time[k]
    belief.clock[MISFITS] = belief.clock[MISFITS] + 1.0 if chi2 > 4.0 * par.gnss_gate else 0.0
    return chi2


@kernel
def tell(
    belief: Belief, roads: Roads, output: Output, k: int, scale: float, outage_after: float,
    ambiguous_below: float, risk: float, chi2: float,
) -> None:  # fmt: skip
    """Write epoch k: as `core.output.say`, but the pose of the most probable hypothesis only."""
    say(belief, roads, output, k, scale, outage_after, ambiguous_below, risk, 0.0, chi2)
    top = most_probable(belief)
    out = output.value[k]
    out[V_X] = belief.mean[top, X]
    out[V_Y] = belief.mean[top, Y]
    out[V_H] = belief.mean[top, H]
    v = V_XX
    for a in range(3):
        for b in range(a, 3):
            out[v] = belief.cov[top, a, b]
            v += 1
    if output.edge[k] == NO_EDGE:
        output.alt_p[k, 0] = 0.0
        gone = belief.clock[NOW] - belief.clock[LAST_FIX]
        output.status[k] = OUTAGE if gone > outage_after else LOST


@entry
def run_paper(
    belief: Belief, roads: Roads, bench: Bench, epochs: Epochs, output: Output, first: int,
    last: int, mode: int, lever: Vector, par: Parameters, literal: Literal, outage_after: float,
    ambiguous_below: float,
) -> None:  # fmt: skip
    """Localize over epochs first … last − 1 by the paper's Figure 7.

    Args:
        belief: The state of the filter, in place; empty before the first fix.
        roads: The network.
        bench: Scratch.
        epochs: What the sensors said.
        output: Filled for the same rows.
        first: First epoch.
        last: One past the last.
        mode: `core.drive.WHEELS`, DISTANCE or CLOCK.
        lever: Antenna ahead and left of M, m, (2,).
        par: The noise of odometry, shared with the default filter.
        literal: The paper's numbers.
        outage_after: Seconds without a fix that make an outage.
        ambiguous_below: P(edge) below which the road is ambiguous.
    """
    clock = belief.clock
    for k in range(first, last):
        dt = epochs.time[k] - clock[NOW]
        clock[NOW] = epochs.time[k]
        chi2 = 0.0
        if clock[STARTED] == 0.0:
            if epochs.has_fix[k] == 0:
                continue
            scale = 1.0 + roads.curvature * (epochs.fix[k, 0] ** 2 + epochs.fix[k, 1] ** 2)
            if not begin(belief, roads, bench, scale, epochs, k, mode, lever, literal):
                continue
            dt = 0.0
        else:
            scale = 1.0 + roads.curvature * (belief.mean[0, X] ** 2 + belief.mean[0, Y] ** 2)
            predict(belief, epochs, k, dt, mode, scale, par)
            if mode == CLOCK:
                forward_only(belief, bench.row, scale)
                normalise(belief)
            if epochs.has_fix[k] == 1:
                chi2 = observe_gnss(belief, bench, scale, epochs, k, mode, lever, par)
            if clock[NOW] - clock[STEPPED] > literal.paper_step - 1e-3:
                switch(belief, roads, bench, scale, literal)
            if clock[MISFITS] >= par.lost_after and epochs.has_fix[k] == 1:
                begin(belief, roads, bench, scale, epochs, k, mode, lever, literal)
        rate = belief.mean[most_probable(belief), K]
        if mode == CLOCK:
            clock[SPEED] = rate
        elif dt > 1e-6:
            clock[SPEED] = epochs.arc[k] / dt
        clock[STOOD] = clock[STOOD] + dt if abs(clock[SPEED]) < 0.05 else 0.0
        tell(
            belief, roads, output, k, scale, outage_after, ambiguous_below, par.protection_risk,
            chi2,
        )  # fmt: skip
