"""A drive with stops and corners, as a table whose truth is known."""

import numpy as np
import pandas as pd

T0 = 1_780_315_200.0  # 2026-06-01 12:00 UTC
N = 240
METRES = 1.0 / 111_195.0  # degrees of latitude


def town(seed=0, n=N, step=1.0, noise=1.0, lat=49.4, lon=8.7):
    """A drive with stops and corners: times, places, speeds, yaw rates; SI."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, n * step, 0.1)
    speed = np.clip(8.0 + 7.0 * np.sin(2 * np.pi * t / 47.0 + random.uniform(0, 6)), 0.0, None)
    turning = np.sin(2 * np.pi * t / 61.0 + random.uniform(0, 6))
    yaw = 0.25 * np.clip(turning - 0.8, 0.0, None) * 5.0 * (speed > 1)
    heading = np.cumsum(yaw) * 0.1
    east, north = np.cumsum(speed * np.cos(heading)) * 0.1, np.cumsum(speed * np.sin(heading)) * 0.1
    at = np.searchsorted(t, step * np.arange(n))
    wobble = noise * random.normal(size=(2, n))
    return pd.DataFrame({
        "time": T0 + t[at],
        "lat": lat + (north[at] + wobble[0]) * METRES,
        "lon": lon + (east[at] + wobble[1]) * METRES / np.cos(np.radians(lat)),
        "true_speed": speed[at],
        "true_yaw": yaw[at],
    })  # fmt: skip
