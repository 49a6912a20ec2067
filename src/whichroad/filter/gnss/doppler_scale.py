"""The scale of a receiver's sigmas by its positions and Doppler velocities alone.

No road is asked.  So where a vehicle drives on beside a mapped road, on a ferry, a train or a road
that the map lacks, its fixes and velocities agree, though roads say that the receiver errs:

    y   = exp(−Δt / T) y + Δz − v̄ Δt,    T = 15 s
    λ²  = mean of ½ |y|² / (r² (ρ² + T / (T + 80 s)))

with z the fixes, v̄ the mean of the velocities at both, and r² the reported variance.
"""

import math

from ..._compile import Record, kernel

_SECOND, _NEXT = 0.95, 2.5  # s between fixes that are compared: at least, and at most
_WINDOW = 15.0  # s, over which the error is seen to change
_SHARE = 0.25 + _WINDOW / (_WINDOW + 80.0)  # of the reported variance, that is seen so
_PRIOR, _REMEMBERED = 5.0, 40.0  # s, of the mean: as the other factors have
_HELD = 300.0  # s, for which the largest one is remembered: streets change
_MOST = 9.0  # cap of one fix's contribution, relative to its expectation
_DOPPLER, _SLOW = 1.0, 2.0  # m/s: sigma of a measured speed; courses may lack below it
_FAR = 40.0  # chi-square beside a road, beyond what maps and receivers are usually off by
_RECENT, _LATELY = 10.0, 30.0  # s, since the error was seen, and since fixes lay so far beside
_TIMES = 2.0  # what is seen, that the factor may be


@kernel
def compare_with_velocity(state: Record, epoch: Record) -> None:
    """Compare the way between two fixes with the velocities reported at both.

    Args:
        state: In place.
        epoch: With a fix.
    """
    seen = state.separation.doppler
    if state.separation.unmapped.chi2 > _FAR:
        seen.until = epoch.time + _LATELY
    since = epoch.time - seen.time
    has_course = epoch.course_sigma < 1e6
    if since < _SECOND or epoch.speed_sigma >= _DOPPLER:
        return
    if not has_course and epoch.speed > _SLOW:
        return
    vx, vy = seen.velocity[0], seen.velocity[1]
    if has_course:
        vx = epoch.speed * math.cos(epoch.course)
        vy = epoch.speed * math.sin(epoch.course)
    else:  # it goes on as before
        before = max(math.hypot(vx, vy), 0.01)
        vx *= epoch.speed / before
        vy *= epoch.speed / before
    fix = epoch.fix
    if since < _NEXT:
        kept = math.exp(-since / _WINDOW)
        dx = (fix[0] - seen.place[0]) / state.scale - 0.5 * since * (vx + seen.velocity[0])
        dy = (fix[1] - seen.place[1]) / state.scale - 0.5 * since * (vy + seen.velocity[1])
        seen.error[0] = kept * seen.error[0] + dx
        seen.error[1] = kept * seen.error[1] + dy
        _average(seen, fix[2] * fix[3], since)
    else:
        seen.error[0] = seen.error[1] = 0.0
    seen.place[0] = fix[0]
    seen.place[1] = fix[1]
    seen.velocity[0] = vx
    seen.velocity[1] = vy
    seen.time = epoch.time


@kernel
def _average(seen: Record, reported: float, since: float) -> None:
    """The mean of squared errors over the reported variance, m², and its largest value of late."""
    seen.lasted += since
    square = 0.5 * (seen.error[0] ** 2 + seen.error[1] ** 2) / (_SHARE * reported)
    gain = max(since / (_PRIOR + seen.lasted), 1.0 - math.exp(-since / _REMEMBERED))
    seen.factor += gain * (min(square, _MOST * max(seen.factor, 1.0)) - seen.factor)
    seen.shown = max(seen.factor, seen.shown * math.exp(-since / _HELD))


@kernel
def largest_factor(state: Record) -> float:
    """The largest factor that fixes themselves bear out; inf where nothing speaks against more.

    Fixes that lie farther beside a road than maps and receivers usually err are another road's,
    unless they drift against the velocities.
    """
    seen = state.separation.doppler
    recent = state.time - seen.time < _RECENT
    return float(_TIMES * seen.shown) if recent and state.time < seen.until else math.inf
