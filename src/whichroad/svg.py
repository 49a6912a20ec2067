"""Polylines in degrees as one inline SVG: no script, no font and no address of another place.

What lies where follows from an equirectangular projection about the middle, true to scale
within some kilometres, north up.
"""

import math
from collections.abc import Sequence
from html import escape
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geodesy.angles import radians, wrap_degrees
from .geodesy.units import METRES_PER_DEGREE
from .observations import Array

WIDTH, HEIGHT = 720.0, 440.0  # px of the largest picture
_MARGIN = 14.0  # px about what is framed
_LEAST = 100.0  # m, the least that a picture shows
_BAR = 0.2  # share of the width that the scale bar may take
_FRAME = "fill:none;stroke-linecap:round;stroke-linejoin:round"


class Strokes(NamedTuple):
    """Polylines of one look: n lines of v vertices in all."""

    lat_deg: Array  # (v,)
    lon_deg: Array  # (v,)
    first: NDArray[np.int64]  # (n + 1,) where each begins, and v
    color: str
    width: float  # px; a line of one vertex is a dot of that size


class Frame(NamedTuple):
    """From degrees to the picture."""

    lat0: float  # degrees, of the middle
    lon0: float
    scale: float  # px per degree of latitude
    width: float  # px
    height: float

    @classmethod
    def about(cls, lat_deg: Array, lon_deg: Array) -> "Frame":
        """The frame that holds (n,) places, n > 0."""
        lon_ref = float(lon_deg[0])
        east = np.asarray(wrap_degrees(lon_deg - lon_ref))
        lat0 = 0.5 * float(lat_deg.min() + lat_deg.max())
        lon0 = lon_ref + 0.5 * float(east.min() + east.max())
        least = _LEAST / METRES_PER_DEGREE
        high = max(float(np.ptp(lat_deg)), least)
        wide = max(float(np.ptp(east)) * math.cos(radians(lat0)), least)
        scale = min((WIDTH - 2 * _MARGIN) / wide, (HEIGHT - 2 * _MARGIN) / high)
        height = max(min(HEIGHT, scale * high + 2 * _MARGIN), 0.3 * HEIGHT)
        return cls(lat0, lon0, scale, WIDTH, height)

    @property
    def metres(self) -> float:
        """True metres of a pixel."""
        return METRES_PER_DEGREE / self.scale

    def corners(self) -> tuple[Array, Array]:
        """Latitudes and longitudes of the four corners, degrees."""
        up = 0.5 * self.height / self.scale
        east = 0.5 * self.width / self.scale / max(math.cos(radians(self.lat0)), 1e-6)
        lat = self.lat0 + up * np.array([-1.0, -1.0, 1.0, 1.0])
        return np.clip(lat, -90.0, 90.0), self.lon0 + east * np.array([-1.0, 1.0, -1.0, 1.0])

    def place(self, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
        """Pixels from the left and from the top."""
        east = np.asarray(wrap_degrees(lon_deg - self.lon0)) * math.cos(radians(self.lat0))
        return 0.5 * self.width + self.scale * east, 0.5 * self.height - self.scale * (
            lat_deg - self.lat0
        )


def figure(
    layers: Sequence[Strokes], frame: Frame, caption: str, keys: Sequence[tuple[str, str]] = ()
) -> str:
    """HTML of a picture with a caption below.

    Args:
        layers: What is drawn, the lowest first.
        frame: What part of the Earth is shown.
        caption: Plain text.
        keys: Colours and what they mean.
    """
    drawn = "".join(_path(layer, frame) for layer in layers)
    key = " ".join(
        f'<span style="color:{color}">&#9632;</span>&nbsp;{escape(text)}' for color, text in keys
    )
    parts = [escape(caption)] + ([key] if key else [])
    return (
        '<figure style="margin:0">'
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {frame.width:g} {frame.height:.0f}" '
        f'width="{frame.width:g}" style="max-width:100%;height:auto;background:#fff" role="img">'
        f'<g style="{_FRAME}">{drawn}</g>{_scale_bar(frame)}</svg>'
        f'<figcaption style="font:90% sans-serif">{"<br/>".join(parts)}</figcaption></figure>'
    )


def _path(layer: Strokes, frame: Frame) -> str:
    x, y = frame.place(layer.lat_deg, layer.lon_deg)
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    bounds = layer.first.tolist()
    lines = [points[low:high] for low, high in pairwise(bounds) if high > low]
    text = "".join(f"M{'L'.join(line)}" + ("h0" if len(line) == 1 else "") for line in lines)
    if not text:
        return ""
    return f'<path d="{text}" stroke="{layer.color}" stroke-width="{layer.width:g}"/>'


def _scale_bar(frame: Frame) -> str:
    """A bar of 1, 2 or 5 times a power of ten of metres, at the lower left."""
    most = _BAR * frame.width * frame.metres
    power = 10.0 ** math.floor(math.log10(most))
    metres = max(k * power for k in (1.0, 2.0, 5.0) if k * power <= most)
    length, y = metres / frame.metres, frame.height - 8.0
    text = f"{metres / 1e3:g} km" if metres >= 1e3 else f"{metres:g} m"
    return (
        f'<path d="M8 {y - 4:.0f}v4h{length:.1f}v-4" fill="none" stroke="#333"/>'
        f'<text x="12" y="{y - 5:.0f}" font-size="11" font-family="sans-serif" fill="#333" '
        f'stroke="#fff" stroke-width="3" paint-order="stroke">{text}</text>'
    )
