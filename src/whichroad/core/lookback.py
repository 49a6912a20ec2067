"""Looking back: what is known now of where the vehicle was then.

Kim's smoother over the graph of merged hypotheses (`core.memory`), with γ for P(edge) and
Rauch, Tung and Striebel's equations for the pose.  From the last step backwards, with f the
stored share that j owes to i:

    γᵢ   = Σⱼ γⱼ f(j ← i)
    G    = Pᵢ Fᵀ (P⁻)⁻¹
    xᵢⱼ  = xᵢ + G (xⱼ − x⁻),   Pᵢⱼ = Pᵢ + G (Pⱼ − P⁻) Gᵀ

and i is the mixture of the (xᵢⱼ, Pᵢⱼ), its moments taken.  What no link accounts for (a
beginning) leaves the step before as the filter had it.
"""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Cube, Hyper, Matrix, Vector, entry, kernel, part
from .angles import wrap
from .belief import (
    GNSS_SCALE,
    KEPT,
    LAST_FIX,
    MISFITS,
    NOW,
    SPEED,
    STOOD,
    Belief,
    H,
    K,
    N,
    Route,
    X,
    Y,
    new_belief,
)
from .epoch import CLOCK, Epochs
from .gain import Bench, add_link, new_bench
from .memory import STEP_FIX, STEP_MISFITS, STEP_SCALE, STEP_SPEED, STEP_STOOD, Memory
from .network import Roads
from .output import V_CHI2, V_H, V_SPEED, V_X, V_Y, Output, say
from .parameters import Parameters
from .rows import add_times, set_to
from .transition import predict_link

_LIGHT = 1e-6  # probability that is smoothed, but whose pose is not
_NOTHING = 1e-12  # probability that is not told, and surely not
_UNSEEN = 0.5 * _NOTHING  # before all are made to sum to one
_STANDS = 0.05  # m/s


class View(NamedTuple):
    """What a look back is worked out on: two steps' hypotheses, and what is told of one."""

    p: Matrix  # (2, KEPT)
    mean: Cube  # (2, KEPT, N)
    cov: Hyper  # (2, KEPT, N, N)
    bench: Bench
    row: Vector  # (N,)
    then_mean: Vector  # (N,)
    then_cov: Matrix  # (N, N)
    belief: Belief


def new_view() -> View:
    """Scratch space for one thread."""
    return View(
        np.zeros((2, KEPT)), np.zeros((2, KEPT, N)), np.zeros((2, KEPT, N, N)), new_bench(),
        np.zeros(N), np.zeros(N), np.zeros((N, N)), new_belief(),
    )  # fmt: skip


@kernel
def recall(memory: Memory, node: int, mean: Vector, cov: Matrix) -> None:
    """The state of a node as the filter had it."""
    at = 0
    for a in range(N):
        mean[a] = memory.mean[node, a]
        for b in range(a + 1):
            cov[a, b] = memory.cov[node, at]
            cov[b, a] = memory.cov[node, at]
            at += 1


@kernel
def begin_view(memory: Memory, view: View, step: int, slot: int) -> None:
    """Fill a slot with a step as the filter had it."""
    first = memory.first_node[step]
    for i in range(memory.first_node[step + 1] - first):
        view.p[slot, i] = memory.p[first + i]
        recall(memory, first + i, view.mean[slot, i], view.cov[slot, i])


@part
def _settle(view: View, slot: int, i: int, scale: float) -> None:
    """From deviations to a state; one that lost its covariance stays as filtered."""
    mean = view.mean[slot, i]
    cov = view.cov[slot, i]
    sound = True
    for a in range(N):
        sound = sound and cov[a, a] >= 0.0
    sound = sound and cov[X, X] * cov[Y, Y] > cov[Y, X] ** 2
    if sound:
        mean[X] *= scale
        mean[Y] *= scale
        add_times(mean, 1.0, view.then_mean)
        for a in range(N):
            for b in range(a):
                cov[b, a] = cov[a, b]
    else:
        set_to(mean, view.then_mean)
        for a in range(N):
            set_to(cov[a], view.then_cov[a])
    mean[H] = wrap(mean[H])


@kernel
def step_back(
    memory: Memory, view: View, roads: Roads, route: Route, step: int, slot: int, poses: bool,
    mode: int, side: float, par: Parameters,
) -> None:  # fmt: skip
    """From a step in one slot of the view to the one before it in the other.

    Args:
        memory: The graph.
        view: Its slot holds the step, smoothed; the other one is filled.
        roads: The network.
        route: Its tree of edges.
        step: Number of the step.
        slot: 0 or 1.
        poses: Whether poses are smoothed too.
        mode: WHEELS, DISTANCE or CLOCK.
        side: 1 where one drives on the right, −1 on the left.
        par: The settings.
    """
    here = memory.first_node[step]
    then = memory.first_node[step - 1]
    after = memory.first_node[step + 1]
    n = here - then
    other = 1 - slot
    known = 0.0
    for j in range(here, after):
        for link in range(memory.first_link[j], memory.first_link[j + 1]):
            known += view.p[slot, j - here] * memory.share[link]
    rest = max(1.0 - known, 0.0)
    if rest < 1e-6:
        rest = 0.0
    scale = 1.0 + roads.curvature * (memory.mean[then, X] ** 2 + memory.mean[then, Y] ** 2)
    for i in range(n):
        view.p[other, i] = rest * memory.p[then + i]
    for j in range(here, after):
        for link in range(memory.first_link[j], memory.first_link[j + 1]):
            view.p[other, memory.origin[link]] += view.p[slot, j - here] * memory.share[link]
    sum_p = 0.0
    for i in range(n):
        sum_p += view.p[other, i]
        if not poses or view.p[other, i] < _UNSEEN:  # nobody will look at its pose
            continue
        recall(memory, then + i, view.then_mean, view.then_cov)
        mean = view.mean[other, i]
        cov = view.cov[other, i]
        for a in range(N):
            mean[a] = 0.0
            set_to(cov[a], view.then_cov[a])
        so_far = told = rest * memory.p[then + i]
        for j in range(here, after):
            for link in range(memory.first_link[j], memory.first_link[j + 1]):
                if memory.origin[link] != i:
                    continue
                weight = view.p[slot, j - here] * memory.share[link]
                so_far += weight
                if weight < 1e-3 * so_far or weight < _LIGHT:
                    continue
                predict_link(
                    view.bench, view.row, memory, roads, route, step, then + i, j,
                    view.then_mean, view.then_cov, mode, scale, side, par,
                )  # fmt: skip
                told += weight
                add_link(
                    view.bench, view.mean[slot, j - here], view.cov[slot, j - here],
                    view.then_cov, mean, cov, weight / told, scale,
                )  # fmt: skip
        _settle(view, other, i, scale)
    for i in range(n):
        view.p[other, i] /= sum_p


@kernel
def take_up(memory: Memory, view: View, step: int, slot: int, mode: int) -> None:
    """Make the slot a belief, as which it can be told."""
    belief = view.belief
    first = memory.first_node[step]
    n = 0
    speed = 0.0
    for i in range(memory.first_node[step + 1] - first):
        p = view.p[slot, i]
        if p < _NOTHING:
            continue
        belief.probability[n] = p
        belief.log_weight[n] = math.log(p)
        belief.edge[n] = memory.edge[first + i]
        belief.segment[n] = memory.segment[first + i]
        belief.node[n] = memory.tree[first + i]
        set_to(belief.mean[n], view.mean[slot, i])
        for a in range(N):
            set_to(belief.cov[n, a], view.cov[slot, i, a])
        speed += p * belief.mean[n, K]
        n += 1
    belief.size[0] = n
    past = memory.past[step]
    clock = belief.clock
    clock[NOW] = memory.time[step]
    clock[SPEED] = speed if mode == CLOCK else past[STEP_SPEED]
    clock[LAST_FIX] = past[STEP_FIX]
    clock[MISFITS] = past[STEP_MISFITS]
    clock[STOOD] = past[STEP_STOOD]
    clock[GNSS_SCALE] = past[STEP_SCALE]


@kernel
def tell(
    view: View, roads: Roads, epochs: Epochs, filtered: Output, told: Output, start: int,
    until: int, mode: int, outage_after: float, ambiguous_below: float, risk: float,
    unknown: float,
) -> None:  # fmt: skip
    """Write what is known of a step that was taken up, and of the epochs until the next.

    Nothing was observed in these, so that they differ from the step by what was driven, as
    the filter saw it.
    """
    belief = view.belief
    clock = belief.clock
    x = filtered.value[start, V_X]
    y = filtered.value[start, V_Y]
    heading = filtered.value[start, V_H]
    for k in range(start, until):
        value = filtered.value[k]
        scale = 1.0 + roads.curvature * (value[V_X] ** 2 + value[V_Y] ** 2)
        turned = wrap(value[V_H] - heading)
        for i in range(belief.size[0]):
            belief.mean[i, X] += value[V_X] - x
            belief.mean[i, Y] += value[V_Y] - y
            belief.mean[i, H] = wrap(belief.mean[i, H] + turned)
        x = value[V_X]
        y = value[V_Y]
        heading = value[V_H]
        clock[STOOD] += epochs.time[k] - clock[NOW]
        if abs(value[V_SPEED]) > _STANDS:
            clock[STOOD] = 0.0
        clock[NOW] = epochs.time[k]
        if mode != CLOCK:
            clock[SPEED] = value[V_SPEED]
        chi2 = value[V_CHI2]
        say(belief, roads, told, k, scale, outage_after, ambiguous_below, risk, unknown, chi2)


@entry
def look_back(
    memory: Memory, view: View, roads: Roads, route: Route, epochs: Epochs, filtered: Output,
    told: Output, known: int, first: int, last: int, mode: int, side: float, par: Parameters,
    outage_after: float, ambiguous_below: float,
) -> None:  # fmt: skip
    """Answer steps first … last − 1 by what was known at a later one.

    Args:
        memory: The graph; `smoothed` is written for these steps.
        view: Scratch.
        roads: The network.
        route: Its tree of edges.
        epochs: What the sensors said.
        filtered: What the filter said of them.
        told: Written.
        known: The step that is looked back from.
        first: First step to be answered.
        last: One past the last one.
        mode: WHEELS, DISTANCE or CLOCK.
        side: 1 where one drives on the right, −1 on the left.
        par: The settings.
        outage_after: Seconds without a fix that make an outage.
        ambiguous_below: P(edge) below which the road is ambiguous.
    """
    slot = 0
    begin_view(memory, view, known, slot)
    for step in range(known, first - 1, -1):
        if step < known:
            step_back(memory, view, roads, route, step + 1, slot, True, mode, side, par)
            slot = 1 - slot
        if step < last:
            node = memory.first_node[step]
            for i in range(memory.first_node[step + 1] - node):
                memory.smoothed[node + i] = view.p[slot, i]
            until = len(epochs.time)
            if step + 1 < memory.size[0]:
                until = memory.epoch[step + 1]
            take_up(memory, view, step, slot, mode)
            tell(
                view, roads, epochs, filtered, told, memory.epoch[step], until, mode,
                outage_after, ambiguous_below, par.protection_risk, par.unknown,
            )  # fmt: skip


@kernel
def surest(memory: Memory, view: View, step: int, slot: int) -> float:
    """P of the most probable edge of a step in the view, components added up."""
    first = memory.first_node[step]
    n = memory.first_node[step + 1] - first
    best = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            if memory.edge[first + i] == memory.edge[first + j]:
                total += view.p[slot, j]
        best = max(best, total)
    return best


@entry
def look_at(
    memory: Memory, view: View, roads: Roads, route: Route, told: Output, step: int, mode: int,
    side: float, par: Parameters, outage_after: float, ambiguous_below: float, sure: float,
) -> int:  # fmt: skip
    """Answer one step from the last one, and find until when the road is decided.

    Args:
        memory: The graph.
        view: Scratch; its belief is that of the step afterwards.
        roads: The network.
        route: Its tree of edges.
        told: One row, written; left alone where step < 0.
        step: The step to be answered, or -1.
        mode: WHEELS, DISTANCE or CLOCK.
        side: 1 where one drives on the right, −1 on the left.
        par: The settings.
        outage_after: Seconds without a fix that make an outage.
        ambiguous_below: P(edge) below which the road is ambiguous.
        sure: P(edge) from which on it is decided.

    Returns:
        The last step at which one edge is decided, -1 where there is none.
    """
    known = memory.size[0] - 1
    slot = 0
    decided = -1
    begin_view(memory, view, known, slot)
    for at in range(known, -1, -1):
        if at < known:
            step_back(memory, view, roads, route, at + 1, slot, at >= step >= 0, mode, side, par)
            slot = 1 - slot
        if decided < 0 and surest(memory, view, at, slot) >= sure:
            decided = at
        if at == step:
            take_up(memory, view, at, slot, mode)
            mean = view.belief.mean[0]
            scale = 1.0 + roads.curvature * (mean[X] ** 2 + mean[Y] ** 2)
            say(
                view.belief, roads, told, 0, scale, outage_after, ambiguous_below,
                par.protection_risk, par.unknown, 0.0,
            )  # fmt: skip
        if at <= step and decided >= 0:
            break
        if step < 0 and decided >= 0:
            break
    return decided
