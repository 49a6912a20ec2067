"""Ways between sparse fixes that no hypothesis follows any more.

By fixes of a hundred metres hundreds of ways are likely, and two dozen are followed.  What the
others had of the probability is remembered, and as far as they may lead the estimate reaches.
Fixes show soon which ways were right: of what was dropped half is forgotten at each, and where
they come more often, in some seconds.
"""

import math

from ..._compile import Record, kernel
from ...graph.index import closest, share_beyond
from ...graph.labels import Search
from ..gnss.inflation import COARSE
from ..state import CLOCK, Belief, Context, X, Y, heaviest
from .candidates import KNOWN, LEAST_ELSEWHERE, P_ELSEWHERE, SPAN, SparseFix

_KEPT = 0.5  # of what was dropped before, at the next fix,
_LASTS = 3.0  # s, and for which it is remembered where fixes come more often
_LEAST = 1e-5  # share of the likelihood that is not noted
_LEAST_SHARE = 0.5  # of the likelihood, that hypotheses have which stand for all of it
_BEFORE = 0.1  # of what was dropped later, at the fix before: most of it came from the same way


@kernel
def likelihood_left(search: Search) -> float:
    """Sum of the likelihoods of the pairs that are left, over that of the best one of all."""
    total = 0.0
    for p in range(search.run[0].pairs):
        total += math.exp(search.pair[p].score - search.run[0].best_score)
    return total


@kernel
def _is_followed(belief: Belief, first: int, edge: int) -> bool:
    """Whether a hypothesis from `first` on is on an edge."""
    found = False
    for j in range(first, belief.state[0].count):
        found = found or belief.hyp[j].edge == edge
    return bool(found)


@kernel
def _stand_for(belief: Belief, first: int, share: float) -> None:
    """Let hypotheses from `first` on stand for all that drive: they are a share of them.

    Who stands is on one road, and is followed.  Who drives may be on any of many.
    """
    for j in range(first, belief.state[0].count):
        belief.hyp[j].log_weight -= math.log(max(share, _LEAST_SHARE))


@kernel
def note_dropped(belief: Belief, ctx: Context, fix: SparseFix, whole: float, first: int) -> None:
    """Note P of what is not followed: the pairs that are left, and roads that were not looked at.

    Args:
        belief: In place.
        ctx: The drive's constants, with the pairs.
        fix: The fix.
        whole: What `likelihood_left` was before any pair was taken.
        first: The first hypothesis that has taken one; others lead to the same roads.
    """
    search = ctx.work.search
    left = 0.0
    untaken = likelihood_left(search)
    if fix.coarse:
        _stand_for(belief, first, 1.0 - untaken / whole)
    if untaken > _LEAST * whole:
        for p in range(search.run[0].pairs):
            if not _is_followed(belief, first, ctx.work.near[search.pair[p].goal].edge):
                left += math.exp(search.pair[p].score - search.run[0].best_score) / whole
    left += (1.0 - left) * fix.beyond
    dropped = belief.state[0].separation.dropped
    dropped.p = left + (1.0 - left) * _KEPT * dropped.p
    dropped.sigma = fix.sigma
    dropped.time = belief.state[0].time


@kernel
def forget_dropped(belief: Belief, ctx: Context) -> None:
    """A fix that no ways were searched for: the roads decide from fix to fix again.

    By coarse ones too many roads are likely for all of them to be followed, and none is sure until
    the place is known far better than by one of them.
    """
    state = belief.state[0]
    dropped = state.separation.dropped
    if dropped.p > 0.0:
        dropped.p *= math.exp(-max(state.time - dropped.time, 0.0) / _LASTS)
        dropped.time = state.time
    sigma = state.reported[1]
    cov = belief.hyp[heaviest(belief)].cov
    known = 0.5 * (cov[X, X] + cov[Y, Y]) < KNOWN * KNOWN
    if state.mode == CLOCK and sigma >= COARSE and not known:
        near = ctx.work.near
        found = closest(ctx.roads, state.fix_1[0], state.fix_1[1], SPAN * sigma, near)
        missed = P_ELSEWHERE * share_beyond(found, near, sigma)
        dropped.p = max(dropped.p, missed, LEAST_ELSEWHERE)
        dropped.sigma = sigma


@kernel
def drop_before(dropped: Record, later: float) -> None:
    """What was dropped later has not been followed before, either: for steps that are smoothed.

    Args:
        dropped: Of a step; P is changed.
        later: P at the step after it.
    """
    dropped.p += (1.0 - dropped.p) * _BEFORE * later


@kernel
def reach_of(dropped: Record, risk: float) -> float:
    """How far the vehicle may be from where the hypotheses are, m."""
    if dropped.p <= risk:
        return 0.0
    return float(dropped.sigma * math.sqrt(2.0 * math.log(dropped.p / risk)))
