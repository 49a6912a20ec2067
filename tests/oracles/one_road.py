"""A hypothesis on one straight road, as one joint Gaussian."""

import math

import numpy as np
from numpy.typing import NDArray

from whichroad.filter.state import GX, GY, MX, MY, B, D, H, K, N, X, Y
from whichroad.settings import Settings

from .joint import Joint
from .textbook import jacobian

Array = NDArray[np.float64]

LANE = 1.75  # m right of the centre line
STEP = np.array([1e-2, 1e-2, 1e-4, 1e-4, 1e-6, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])


def wheel_motion(mean: Array, arc: float) -> Array:
    """Equation (1) for a straight increment, with scale and drift."""
    out = mean.copy()
    half = 0.5 * mean[B] * arc
    c, s = math.cos(mean[H]), math.sin(mean[H])
    out[X] += mean[K] * arc * (c - s * half)
    out[Y] += mean[K] * arc * (s + c * half)
    out[H] += mean[B] * arc
    return out


def aged(
    keep: dict[int, float], target: dict[int, float], spread: dict[int, float]
) -> tuple[Array, Array, Array]:
    """Gauss-Markov step of some states: transition, constant, noise."""
    f, c, q = np.eye(N), np.zeros(N), np.zeros((N, N))
    for state, phi in keep.items():
        f[state, state] = phi
        c[state] = (1.0 - phi) * target.get(state, 0.0)
        q[state, state] = (1.0 - phi**2) * spread.get(state, 1.0) ** 2
    return f, c, q


class OneRoad:
    """The joint Gaussian of a hypothesis on a straight road along x at height y.

    It is linearised where the filter was: at the mean before each step.

    Args:
        fix: The first one, (5,), its ellipse a circle.
        heading: The first one, rad.
        heading_sigma: rad.
        edge: Number of the road.
        y: Its height, m.
        par: The model's numbers.
    """

    def __init__(
        self, fix: Array, heading: float, heading_sigma: float, edge: int, y: float, par: Settings
    ) -> None:
        self.edge, self.y, self.par = edge, y, par
        self.travelled = self.moving = 0.0
        mean = np.zeros(N)
        mean[[X, Y, H, K, D]] = fix[0], fix[1], heading, 1.0, LANE
        self.worse = par.gnss_start / math.hypot(1.0, par.gnss_white_ratio)  # slow and white
        sigma = self.worse * fix[2]
        spread = np.zeros(N)
        spread[[X, Y]] = sigma * math.hypot(1.0, par.gnss_white_ratio)
        spread[[H, K, B, D]] = heading_sigma, par.scale_sigma, par.drift_sigma, par.lane_sigma
        spread[[MX, MY, GX, GY]] = par.map_sigma, par.map_sigma, 1.0, 1.0
        cov = np.diag(spread**2)
        cov[[X, GX, Y, GY], [GX, X, GY, Y]] = -sigma
        self.joint = Joint(mean, cov)

    def move(self, mean: Array, arc: float, dt: float) -> None:
        """Drive straight on for `arc` metres, the filter's mean being where it was before."""
        par = self.par
        f = jacobian(lambda m: wheel_motion(m, arc), mean, STEP)
        turn = np.eye(N)
        turn[:2, :2] = [[np.cos(mean[H]), -np.sin(mean[H])], [np.sin(mean[H]), np.cos(mean[H])]]
        q = np.zeros(N)
        q[[X, Y, H, K, B]] = (
            np.array([par.along_noise**2, par.lateral_noise**2, par.heading_noise**2, 1e-10,
                      par.yaw_bias_noise**2]) * arc
        )  # fmt: skip
        self.joint.move(f, wheel_motion(mean, arc) - f @ mean, turn @ np.diag(q) @ turn.T)
        self.travelled += arc
        self.moving += dt

    def see_fix(self, mean: Array, fix: Array) -> None:
        """Age the GNSS error, one beyond three sigmas more slowly, then observe both axes."""
        lasts = self.par.gnss_time * max(1.0, math.hypot(mean[GX], mean[GY]) / 3.0)
        phi = math.exp(-self.moving / lasts)
        self.joint.move(*aged({GX: phi, GY: phi}, {}, {}))
        self.moving = 0.0
        sigma = self.worse * fix[2]
        for axis, state in ((X, GX), (Y, GY)):
            row = np.zeros(N)
            row[axis], row[state] = 1.0, sigma
            self.joint.see(row, fix[axis], (self.par.gnss_white_ratio * sigma) ** 2)

    def see_road(self) -> None:
        """Age lane and map, then observe offset and heading, whose errors last 5 m."""
        par = self.par
        thin = min(max(5.0 / self.travelled, 0.5), 4.0) if self.travelled else 1.0
        lane, far = (math.exp(-self.travelled / a) for a in (par.lane_length, par.map_length))
        spread = {D: par.lane_sigma, MX: par.map_sigma, MY: par.map_sigma}
        self.joint.move(*aged({D: lane, MX: far, MY: far}, {D: LANE}, spread))
        self.travelled = 0.0
        lateral, heading = np.zeros(N), np.zeros(N)
        lateral[[Y, MY]], lateral[D] = -1.0, -1.0
        heading[H] = 1.0
        self.joint.see(lateral, -self.y, thin * par.relative_sigma**2)
        self.joint.see(heading, 0.0, thin * par.edge_heading_sigma**2)
