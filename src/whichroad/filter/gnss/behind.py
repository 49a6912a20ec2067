"""Fixes that are likely to be late, but not surely: the vehicle may be ahead of its place.

A delay is mended once it is sure, as speed changes and turns tell it (`filter.vetting.latency`).
Until then the place is behind the vehicle by the way that it drives in that time, and stays so
for a while after it has become slower, as an error of the receiver does.
"""

import math

from ..._compile import Record, kernel
from ..vetting.delay_filter import DELAY
from .separation import cover_place


@kernel
def cover_delay(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover the place ahead of it, where the vehicle is if fixes are late.

    A way d with sigma a, right with the probability p, is covered by r = d + a √(2 log(p / risk)),
    where a has the error of the estimate, too.

    Args:
        state: With that way.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    latency = state.vetting.latency
    p = latency.behind[0]
    pace = latency.behind[1]
    if p <= risk:
        return
    c = math.cos(out.heading)
    s = math.sin(out.heading)
    way = latency.estimate.state[DELAY] * pace
    variance = latency.estimate.cov[DELAY, DELAY] * pace * pace
    variance += c * c * out.cov[0] + 2.0 * c * s * out.cov[1] + s * s * out.cov[3]
    more = math.sqrt(2.0 * math.log(p / risk) * variance)
    cover_place(out, way * c, way * s, p, (more, more, more))
