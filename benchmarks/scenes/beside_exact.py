"""The exact test of `unmapped`: one mapped road, or one of many unmapped ones beside it.

It knows what the filter has to assume: where an unmapped road may leave, that it is parallel
then, and the variances of wheels, lane, map and receiver.  Along the road all is known, so that
across it the state is small: place, heading, map error, lane offset and error of the receiver.
"""

import numpy as np

from whichroad.observations import Drive, WheelSpeeds

from .plain import _PLANE, _WHEEL, _WHITE, CAR, STEP, Array

LEAVES = 5e-4  # prior of an unmapped road: 2e-5 1/m over 25 m
_GAPS = np.array([0.0, *(side * gap for gap in range(7, 31) for side in (-1, 1))])  # m, right
_LINK = 5.0  # m of link per m of gap
_MAP, _MAP_LENGTH = 4.6, 1000.0  # m, of the map's error
_LANE, _LANE_LENGTH = 0.3, 60.0  # m, of the place in the lane
_TIME = 60.0  # s, of the receiver's slow error
_EVERY, _LINE = 3, 0.15  # readings between observations of the road, and their sigma, m
_Y, _H, _M, _D, _G = range(5)


def p_unmapped(drive: Drive, begin: float, speed: float) -> Array:
    """P(an unmapped road) at each reading of the wheels, (n,).

    Args:
        drive: Made by `plain.sense` along the plane's x axis.
        begin: m from the begin of the drive to where roads may part.
        speed: m/s, constant.
    """
    wheels, fixes = drive.odometry, drive.fixes
    assert isinstance(wheels, WheelSpeeds)
    assert fixes is not None
    turn = (wheels.right - wheels.left) / CAR.track_width * STEP
    _, north = _PLANE.from_geodetic(fixes.lat_deg, fixes.lon_deg)
    at = np.round((fixes.time - wheels.time[0]) / STEP).astype(int)
    seen = dict(zip(at.tolist(), (-np.asarray(north)).tolist(), strict=True))
    slow = float(fixes.cov_nn[0]) - _WHITE**2
    step = speed * STEP
    sigmas = np.array([0.0, 0.0, _MAP, _LANE, np.sqrt(slow)]) ** 2
    keep = np.exp(-np.array([0.0, 0.0, step / _MAP_LENGTH, step / _LANE_LENGTH, STEP / _TIME]))
    noise = sigmas * (1.0 - keep**2)
    noise[_Y], noise[_H] = 0.02**2, 2.0 * (_WHEEL * step / CAR.track_width) ** 2 + 1e-6
    move = np.diag(keep)
    move[_Y, _H] = step
    mean = np.zeros((len(_GAPS), 5))
    cov = np.diag([1e4, 0.01, *sigmas[2:]])
    log_p = np.log(np.where(_GAPS == 0.0, 1.0 - LEAVES, LEAVES / (len(_GAPS) - 1)))
    fix_row, road_row = np.array([1.0, 0, 0, 0, 1.0]), np.array([1.0, 0, 1.0, -1.0, 0])
    told = np.zeros(len(turn))
    for k in range(len(turn)):
        if k > 0:
            mean[:, _H] -= turn[k]
            mean, cov = mean @ move.T, move @ cov @ move.T + np.diag(noise)
        link = np.clip((k * step - begin) / np.maximum(_LINK * abs(_GAPS), 1e-9), 0.0, 1.0)
        rows = [(fix_row, np.full(len(_GAPS), seen[k]), _WHITE)] if k in seen else []
        rows += [(road_row, link * _GAPS, _LINE)] if k % _EVERY == 0 else []
        for row, value, sigma in rows:
            gain, nu = cov @ row, value - mean @ row
            s = float(gain @ row) + sigma**2
            mean, cov = mean + np.outer(nu / s, gain), cov - np.outer(gain, gain) / s
            log_p = log_p - 0.5 * nu * nu / s
        p = np.exp(log_p - log_p.max())
        told[k] = 1.0 - p[0] / p.sum()
    return told
