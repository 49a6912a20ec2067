"""How a hypothesis moves: by its wheels in the plane, or along its road.

The process model is stated here and nowhere else: what the state becomes, its derivatives F,
and the process noise Q.
"""

import math
from typing import NamedTuple

from .._compile import Matrix, Record, Vector, kernel
from ..graph.geometry import wrap
from ._simd import add_times, new_row, set_times, set_to
from .speed_process import speed_process
from .state import CLOCK, MX, MY, B, H, K, N, X, Y
from .vetting.windows import BY_GYRO, BY_WHEELS, UNTURNED, is_alone

GYRO_PACE = 16.7  # m/s, at which the drift of wheels (3e-4 rad/m) is a gyro's (5e-3 rad/s)
_CORNER = math.pi / 2  # rad; the turn whose error is the turn noise times itself
_LASTING = 2.8  # times the speed's variance a second, where braking lasts for seconds unseen
_RATE_NOISE = 1e-10  # 1/m, random walk of an odometer's scale (variance)
_SPEED_JITTER = 0.01  # m²/s along the road beside the speed's random walk
_LEAST_RATE = 0.5  # κ or m/s, below which a road's turn is not told by it
_BLIND_TURN = 0.09  # rad²/s, random walk of the heading off the roads without odometry,
ACROSS = 0.015  # m²/m across the way; vehicles follow no line exactly
_STRAIGHT, _TURNING = 0.0025, 0.02  # rad²/m, and with an odometer; where courses were heard
_PIECE, _MOST_PIECES = 6.0, 10_000  # m, longest piece of an arc; of an arc
_UNMEASURED = 0.04  # squared error of extrapolated motion, relative
_UNMEASURED_TURN = 0.01  # rad²/m, heading noise of extrapolated motion
_SPEEDS, _LASTS = 5.0, 15.0  # m/s and s, σ and τ of a speed that nothing measures


class Increment(NamedTuple):
    """A displacement in the frame of its beginning, odometer units."""

    arc: float  # δs, m (or seconds), negative in reverse
    turn: float  # δθ, rad
    forward: float  # u
    left: float
    clock: float  # m by which the drift b turns it, see `drift_clock`


class Noise(NamedTuple):
    """Process noise of one increment: variances."""

    along: float  # m²
    across: float  # m²
    heading: float  # rad²
    rate: float  # of κ
    drift: float  # of b
    cross: float  # covariance of κ and the abscissa


class ChordMoments(NamedTuple):
    """Of the chord of a way of one metre, in the frame of the mean heading at its beginning."""

    mean: float  # along
    along: float  # mean square
    across: float


@kernel
def arc_chord(arc: float, turn: float) -> tuple[float, float]:
    """Displacement of M in its own frame after an arc (equation 1).

    The paper takes the arc for its chord; the chord is arc · sin(δθ/2)/(δθ/2):

        u = chord · (cos δθ/2, sin δθ/2)

    Args:
        arc: δs, m, negative in reverse.
        turn: δθ, rad.

    Returns:
        Forward and leftward displacement, m.
    """
    half = 0.5 * turn
    chord = arc * (1.0 - half * half / 6.0) if abs(half) < 1e-4 else arc * math.sin(half) / half
    return chord * math.cos(half), chord * math.sin(half)


@kernel
def pieces_of(arc: float) -> int:
    """Equal pieces in which an arc (m) is predicted."""
    return max(1, math.ceil(min(abs(arc) / _PIECE, _MOST_PIECES)))


@kernel
def drift_clock(epoch: Record, dt: float) -> float:
    """By how much b turns the vehicle: the arc of wheels, the time of a gyro, m.

    What is wrong with wheels lasts for a distance, the bias of a gyro for a time.  A gyro's
    clock counts `GYRO_PACE` metres a second; it stands where the vehicle's standing was used.
    """
    if epoch.gyro == BY_WHEELS or epoch.gyro == UNTURNED:
        return float(epoch.arc)
    return GYRO_PACE * dt if epoch.gyro == BY_GYRO or is_alone(epoch) else 0.0


@kernel
def increment_of(epoch: Record, pieces: int, dt: float) -> Increment:
    """One of equal pieces of an epoch's odometry (of dt seconds), on the same circle."""
    part = 1.0 if pieces == 1 else 1.0 / pieces
    turn = epoch.turn * part
    forward = epoch.forward
    left = epoch.left
    if pieces > 1:
        forward, left = arc_chord(epoch.arc * part, turn)
    return Increment(epoch.arc * part, turn, forward, left, drift_clock(epoch, dt) * part)


@kernel
def wheel_noise(par: Record, metres: float, turn: float) -> Noise:
    """Process noise of wheel odometry over so many metres and a turn (rad)."""
    return Noise(
        par.along_noise**2 * metres, par.lateral_noise**2 * metres,
        par.heading_noise**2 * metres + par.turn_noise**2 * _CORNER * abs(turn),
        _RATE_NOISE * metres, par.yaw_bias_noise**2 * metres, 0.0,
    )  # fmt: skip


@kernel
def extrapolated(noise: Noise, before: float, metres: float) -> Noise:
    """Process noise where motion is not measured but extrapolated.

    The speed is wrong by a fifth (one sigma) for as long as nothing shows it: over L metres
    the variance along the heading is (0.2 L)², however many epochs they are split into.

    Args:
        noise: Of measured motion.
        before: Metres extrapolated since the last fix or measurement.
        metres: Metres of this increment.
    """
    after = before + metres
    return Noise(
        noise.along + _UNMEASURED * (after * after - before * before), noise.across,
        noise.heading + _UNMEASURED_TURN * metres, noise.rate, noise.drift, noise.cross,
    )  # fmt: skip


@kernel
def unseen_way(silent: float, dt: float) -> float:
    """Variance (m²) that dt seconds add to the way of a vehicle unseen for `silent` s by then.

    Its speed is that of `speed_process`, with V the variance of the way: V(t + Δt) − V(t).
    """
    before = speed_process(max(silent - dt, 0.0), _SPEEDS, _LASTS).variance
    return float(speed_process(silent, _SPEEDS, _LASTS).variance - before)


@kernel
def driven_unseen(noise: Noise, silent: float, dt: float) -> Noise:
    """The same of a vehicle that may have accelerated or braked meanwhile, also from rest.

    Args:
        noise: Of extrapolated motion.
        silent: Since the last measurement until the end, s.
        dt: Of this increment, s.
    """
    along = noise.along + unseen_way(silent, dt)
    return Noise(along, noise.across, noise.heading, noise.rate, noise.drift, noise.cross)


@kernel
def blind_noise(
    par: Record, odometer: float, metres: float, mode: int, unseen: bool, courses: bool
) -> Noise:
    """Process noise without a heading sensor, over metres (DISTANCE) or seconds (CLOCK).

    Without an odometer the speed walks at random: with q its variance a second,

        Q = q [t, t²/2; t²/2, t³/3]         of κ and the abscissa

    An acceleration lasts for some seconds.  Where the speed was not reported for as long, its
    changes add up, and q is larger.  Across its way a vehicle errs as much off the roads as on
    them: who stands, or drives straight on, says nothing of which it is, however often asked.

    Args:
        par: The parameters.
        odometer: Metres or seconds.
        metres: Driven meanwhile.
        mode: DISTANCE or CLOCK.
        unseen: Whether no speed was reported in the last seconds.
        courses: Whether courses were heard, so that the heading is the vehicle's own.
    """
    if mode == CLOCK:
        rate = (_LASTING if unseen else 1.0) * par.acceleration_noise**2 * odometer
        along = rate * odometer * odometer / 3.0 + _SPEED_JITTER * odometer
        return Noise(
            along, ACROSS * metres, _BLIND_TURN * odometer, rate, 0.0, rate * odometer / 2.0
        )
    along = (3.0 * par.along_noise) ** 2 * metres
    turn = _TURNING if courses else _STRAIGHT
    return Noise(along, ACROSS * metres, turn * metres, _RATE_NOISE * metres, 0.0, 0.0)


@kernel
def predict_plane(mean: Vector, cov: Matrix, step: Increment, scale: float, q: Noise) -> None:
    """Move a hypothesis by an increment in its own frame (equation 1, with calibration).

        v   = u + (b δc / 2) J u            drift turns the increment by half; its clock c
        p⁺  = p + κ R(θ) v
        θ⁺  = θ + δθ + b δc
        P⁺  = F P Fᵀ + Q

    Args:
        mean: State, (N,), in place.
        cov: Covariance, (N, N), in place.
        step: The increment.
        scale: Local scale of the plane.
        q: Process noise.
    """
    c = math.cos(mean[H])
    s = math.sin(mean[H])
    clock = step.clock
    kappa = mean[K]
    half_drift = 0.5 * mean[B] * clock
    vx = step.forward - half_drift * step.left
    vy = step.left + half_drift * step.forward
    rx = c * vx - s * vy
    ry = s * vx + c * vy
    dx = kappa * rx
    dy = kappa * ry
    bx = -0.5 * kappa * clock * (c * step.left + s * step.forward)
    by = 0.5 * kappa * clock * (c * step.forward - s * step.left)
    mean[X] += scale * dx
    mean[Y] += scale * dy
    mean[H] = wrap(mean[H] + step.turn + mean[B] * clock)
    add_times(cov[X], -dy, cov[H])
    add_times(cov[X], rx, cov[K])
    add_times(cov[X], bx, cov[B])
    add_times(cov[Y], dx, cov[H])
    add_times(cov[Y], ry, cov[K])
    add_times(cov[Y], by, cov[B])
    add_times(cov[H], clock, cov[B])
    for j in range(K, N):
        cov[j, X] = cov[X, j]
        cov[j, Y] = cov[Y, j]
        cov[j, H] = cov[H, j]
    for i in range(3):
        ph = cov[i, H]
        pk = cov[i, K]
        pb = cov[i, B]
        cov[i, X] += -dy * ph + rx * pk + bx * pb
        cov[i, Y] += dx * ph + ry * pk + by * pb
        cov[i, H] = ph + clock * pb
    qxy = (q.along - q.across) * c * s
    cov[X, X] += q.along * c * c + q.across * s * s
    cov[Y, Y] += q.along * s * s + q.across * c * c
    cov[X, Y] += qxy
    cov[Y, X] += qxy
    cov[H, H] += q.heading
    cov[K, K] += q.rate
    cov[B, B] += q.drift
    if q.cross != 0.0:
        cov[X, K] += q.cross * c
        cov[Y, K] += q.cross * s
        cov[K, X] = cov[X, K]
        cov[K, Y] = cov[Y, K]


@kernel
def chord_moments(heading: float, walked: float) -> ChordMoments:
    """Moments of the chord of a way whose heading is not known, for a way of one metre.

    The heading is Gaussian at first, and walks at random along the way.  By θ̄, the mean heading
    over the way, of variance w, and g, the mean square of the chord,

        E[chord] = exp(−σ²/2) (1 − exp(−a)) / a =: m,     a = q / 2,
        g = 2 (a − 1 + exp(−a)) / a²,
        E[along²] = g (1 + exp(−2w)) / 2,   E[across²] = g (1 − exp(−2w)) / 2

    Args:
        heading: σ², variance at first, rad².
        walked: q, what is added to it over the way, rad².
    """
    a = max(0.5 * walked, 1e-4)
    mean = math.exp(-0.5 * heading) * (1.0 - math.exp(-a)) / a
    square = 2.0 * (a - 1.0 + math.exp(-a)) / (a * a)
    twice = math.exp(-2.0 * (heading + walked / 3.0))
    return ChordMoments(mean, 0.5 * square * (1.0 + twice), 0.5 * square * (1.0 - twice))


@kernel
def predict_road(cov: Matrix, odometer: float, turn: float, tx: float, ty: float, q: Noise) -> None:
    """Covariance of a hypothesis that follows its road without a heading sensor.

    With p = c(s) + n d − m, moving on by κ δ turns what surrounds the road with it:

        δp⁺ = R (δp + δm) − δm + t⁺ δ δκ,    R the road's turn from s to s⁺

    The mean is set by the caller, who knows the road, and so is the heading.

    Args:
        cov: Covariance, (N, N), in place.
        odometer: δ, odometer metres (or seconds).
        turn: Turn of the road between the two abscissae, rad.
        tx: New unit tangent, x.
        ty: New unit tangent, y.
        q: Process noise along the road, of κ, and between them.
    """
    c = 1.0
    s = 0.0
    if turn != 0.0:
        c = math.cos(turn)
        s = math.sin(turn)
    sx = new_row()  # p + m, which the road turns
    sy = new_row()
    set_to(sx, cov[X])
    add_times(sx, 1.0, cov[MX])
    set_to(sy, cov[Y])
    add_times(sy, 1.0, cov[MY])
    set_times(cov[X], c, sx)
    add_times(cov[X], -s, sy)
    add_times(cov[X], -1.0, cov[MX])
    add_times(cov[X], tx * odometer, cov[K])
    set_times(cov[Y], s, sx)
    add_times(cov[Y], c, sy)
    add_times(cov[Y], -1.0, cov[MY])
    add_times(cov[Y], ty * odometer, cov[K])
    for j in range(2, N):
        cov[j, X] = cov[X, j]
        cov[j, Y] = cov[Y, j]
    for i in range(2):
        px = cov[i, X] + cov[i, MX]
        py = cov[i, Y] + cov[i, MY]
        pk = odometer * cov[i, K]
        cov[i, X] = c * px - s * py - cov[i, MX] + tx * pk
        cov[i, Y] = s * px + c * py - cov[i, MY] + ty * pk
    cov[X, X] += q.along * tx * tx
    cov[Y, Y] += q.along * ty * ty
    cov[X, Y] += q.along * tx * ty
    cov[Y, X] = cov[X, Y]
    cov[K, K] += q.rate
    cov[X, K] += q.cross * tx
    cov[Y, K] += q.cross * ty
    cov[K, X] = cov[X, K]
    cov[K, Y] = cov[Y, K]


@kernel
def rate_of_turn(turn: float, rate: float) -> float:
    """Derivative by κ of the turn of the road that was driven: θ' = turn / κ; 0 at rest."""
    return turn / rate if abs(rate) > _LEAST_RATE else 0.0


@kernel
def turn_by_road(mean: Vector, cov: Matrix, turn: float, variance: float) -> None:
    """Turn a known heading with the road, before `predict_road`.

    θ⁺ = θ + turn + e,    turn proportional to κ,    e ~ variance
    """
    rate = rate_of_turn(turn, mean[K])
    mean[H] = wrap(mean[H] + turn)
    if rate != 0.0:
        add_times(cov[H], rate, cov[K])
        for j in range(N):
            cov[j, H] = cov[H, j]
        cov[H, H] += rate * cov[H, K]
    cov[H, H] += variance


@kernel
def add_across(cov: Matrix, variance: float, tx: float, ty: float) -> None:
    """Add variance (m²) across the direction t."""
    cov[X, X] += variance * ty * ty
    cov[Y, Y] += variance * tx * tx
    cov[X, Y] -= variance * tx * ty
    cov[Y, X] = cov[X, Y]
