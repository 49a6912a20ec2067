"""On line, odometry that reads 0 below a speed: what was held against the fixes is taken back."""

from ..filter.vetting.motion_sources import ARC
from .epoch_filter import EpochFilter

_BLAMED, _CREPT = 2.0, 5.0  # times the fixes' variances; m, by which places may be wrong then
_FACTORS = ("gnss_factor", "innovation_factor", "windowed_factor", "bias_factor")


def heed_least_speed(now: EpochFilter, least: float, before: float) -> None:
    """Odometry has read 0 while the vehicle crept until now, and fixes seemed to err.

    Args:
        now: The filter.
        least: Speed below which it reads 0, m/s.
        before: What that was thought to be, m/s.
    """
    state = now.belief.state[0]
    vetting = state.vetting
    vetting.slow.least = least
    if before > 0.0:
        return
    vetting.refused[ARC], vetting.score[ARC], vetting.seconds[ARC] = 0, 0.0, 0.0
    if state.gnss_factor > _BLAMED:  # begin anew at the next fix
        state.misfits = now.ctx.par.lost_after[0]
        for name in _FACTORS:
            state[name] = 1.0
    elif now.started:
        now.widen_along(_CREPT)
