"""A gyro at rest: standing means no turn, so that what it says then is its bias."""

from .._compile import Record, kernel
from .gaussian import update_state
from .motion import GYRO_PACE
from .state import B, Belief
from .vetting.windows import AT_REST

_RESTS = 0.05  # m/s by the odometer, below which the vehicle stands
_TURNS = 0.03  # rad/s beyond which a gyro turns, whatever the odometer says
_WALK = 1e-3  # rad/√s, random walk of a gyro's turn,
_UNEVEN = 3e-4  # and rad/s by which its bias differs from reading to reading


@kernel
def rest(belief: Belief, epoch: Record, dt: float) -> None:
    """Where the vehicle stands, learn the gyro's bias, and turn nothing.

    All hypotheses have the same bias, nearly: their weights stay as they are.

    Args:
        belief: In place.
        epoch: By a gyro; in place: at rest it has no turn.
        dt: Its duration, s.
    """
    if dt <= 0.0 or abs(epoch.arc) > _RESTS * dt or epoch.odometry_valid != 1:
        return
    rate = epoch.turn / dt
    if abs(rate) > _TURNS:
        return
    value = -rate / GYRO_PACE
    variance = (_WALK * _WALK / dt + _UNEVEN * _UNEVEN) / (GYRO_PACE * GYRO_PACE)
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        update_state(hyp.mu, hyp.cov, B, value - hyp.mu[B], variance, belief.state[0].scale)
    epoch.turn = 0.0
    epoch.forward = epoch.arc
    epoch.left = 0.0
    epoch.gyro = AT_REST
