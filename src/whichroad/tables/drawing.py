"""An answer as a picture for a notebook: track, path, and how probable the road was."""

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import Array
from ..ragged import row_and_place
from ..roadmap.drawing import attribution, check_folium, in_degrees, streets, strokes
from ..svg import Frame, Strokes, figure

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_LIMITS = (0.5, 0.8, 0.95, 0.99)  # of P(way) between the colours
_COLORS = ("#c51b1b", "#ee7d2f", "#eec143", "#5aa6cf", "#0b4f9e")
_OFF, _PATH = "#7d838b", "#bcd7ea"
_KEYS = [
    ("#0b4f9e", "P(way) 0.99 and more"), ("#5aa6cf", "0.95"), ("#eec143", "0.8"),
    ("#ee7d2f", "0.5"), ("#c51b1b", "less"), (_OFF, "off road"), (_PATH, "path"),
]  # fmt: skip
_ROADS = "#b9bec6"  # roads of a plot
_OWN = frozenset(("cmap", "norm", "vmin", "vmax", "scheme"))  # styles of a colour scale
_BARS = {"p_way": "P(way), probability of the road", "speed_mps": "speed (m/s)"}  # of legends
_AROUND = 200.0  # m about the track within which roads are drawn
_DOTS = 400  # points up to which each is a dot
_PIXELS = 0.3  # by which the track may be simplified


def answer_html(
    points: pa.Table, path: pa.Table, caption: str, roads: "RoadMap | None" = None
) -> str:
    """An answer as HTML.

    Args:
        points: The points, as `schema.POINTS`.
        path: The path, as `schema.PATH`; may be without columns.
        caption: Plain text below it.
        roads: The map, of which the streets near the track are drawn.
    """
    lat, lon = (points[name].to_numpy().astype(np.float64) for name in ("lat", "lon"))
    known = np.flatnonzero(np.isfinite(lat) & np.isfinite(lon))
    if not len(known):
        return f"<p>{escape(caption)}: no epoch has a position</p>"
    frame = Frame.about(lat[known], lon[known])
    layers = [] if roads is None else _streets_near(roads, frame)
    layers += _path(path)
    layers += _track(points, lat, lon, known, frame)
    credit = "" if roads is None else attribution(roads)
    return figure(layers, frame, " · ".join(filter(None, (caption, credit))), _KEYS)


def plot_answer(
    points: Any, path: Any, ax: Any, style: dict[str, Any], roads: "RoadMap | None" = None
) -> Any:
    """See `Result.plot`."""
    known = points[points.lat.notna()]
    alone = ax is None  # on axes of the caller, roads and legend are the caller's
    size = {"figsize": style["figsize"]} if "figsize" in style else _size(known) if alone else {}
    if alone and roads is not None and len(known):
        ax = _near(roads, known).plot(color=_ROADS, linewidth=0.8, zorder=0, label="roads", **size)
    if len(path):
        size = size if ax is None else {}
        ax = path.plot(ax=ax, color=_PATH, linewidth=5, zorder=1, label="path", **size)
    usual: dict[str, Any] = {"markersize": 6, "zorder": 2}
    if "color" not in style:
        column = style.get("column", "p_way")
        usual |= {"column": "p_way"} | (_steps() if column == "p_way" and not _OWN & style.keys()
                                        else {"cmap": "RdYlBu"})  # fmt: skip
        usual |= {
            "legend": True,
            "legend_kwds": {"label": _BARS.get(column, column), "shrink": 0.8, "pad": 0.02},
        }
        if not alone or not _is_number(known, column):
            del usual["legend"], usual["legend_kwds"]
    style = {name: value for name, value in style.items() if ax is None or name != "figsize"}
    ax = known.plot(ax=ax, **(usual | style))
    if alone and len(known):
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
        in_degrees(ax)
        _about(ax, known)
        if roads is not None and (credit := attribution(roads)):
            ax.annotate(
                credit, (1.0, 0.0), xycoords="axes fraction", ha="right", va="bottom", size=7
            )
    return ax


def _steps() -> dict[str, Any]:
    """The colours of P(way), those of `answer_html`."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    return {
        "cmap": ListedColormap(_COLORS), "norm": BoundaryNorm((0.0, *_LIMITS, 1.0), len(_COLORS)),
    }  # fmt: skip


def _extent(points: Any) -> tuple[float, float, float, float]:
    """West, east, south and north of the track and of what is about it, degrees."""
    lat, lon = points.lat.to_numpy(), points.lon.to_numpy()
    up = _AROUND / METRES_PER_DEGREE
    aside = up / max(float(np.cos(radians(lat.mean()))), 1e-6)
    return lon.min() - aside, lon.max() + aside, lat.min() - up, lat.max() + up


def _about(ax: Any, points: Any) -> None:
    """Show the surroundings of the track, not all of each road that reaches there."""
    west, east, south, north = _extent(points)
    ax.set(xlim=(west, east), ylim=(south, north))


def _size(points: Any) -> dict[str, tuple[float, float]]:
    """Inches of a figure in which the track, a legend and a colour bar leave little blank."""
    if not len(points):
        return {}
    west, east, south, north = _extent(points)
    wide = (east - west) * np.cos(radians(points.lat.mean()))
    return {"figsize": (9.0, float(np.clip(7.0 * (north - south) / wide, 2.5, 8.0)) + 1.0)}


def _is_number(points: Any, column: Any) -> bool:
    return isinstance(column, str) and column in points and points[column].dtype.kind in "fiu"


def _near(roads: "RoadMap", points: Any) -> Any:
    """The streets of a map within some hundred metres of the points, as a frame."""
    x, y = roads.plane.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
    low = float(x.min()) - _AROUND, float(y.min()) - _AROUND
    high = float(x.max()) + _AROUND, float(y.max()) + _AROUND
    return roads.edges_table().iloc[streets(roads, low, high)]


def explore_answer(points: Any, path: Any, style: dict[str, Any]) -> Any:
    """See `Result.explore`."""
    check_folium()
    style = dict(style)
    page = style.pop("m", None)
    if len(path):
        kept = path.drop(columns=[n for n in ("enter_time", "exit_time") if n in path])
        tiles = {n: style.pop(n) for n in ("tiles", "attr") if n in style}
        page = kept.explore(m=page, color=_COLORS[3], style_kwds={"weight": 6}, **tiles)
    known = points[points.lat.notna()]
    known = known.assign(time=known.time.astype(str)).drop(columns=["alternatives"])
    usual = {} if "color" in style else {"column": "p_way", "cmap": "RdYlBu"}
    return known.explore(m=page, **(usual | style))


def _streets_near(roads: "RoadMap", frame: Frame) -> list[Strokes]:
    x, y = roads.plane.from_geodetic(*frame.corners())
    low, high = (float(x.min()), float(y.min())), (float(x.max()), float(y.max()))
    return strokes(roads, frame, streets(roads, low, high))[0]


def _path(path: pa.Table) -> list[Strokes]:
    import shapely

    if "geometry" not in path.column_names or not path.num_rows:
        return []
    lines = shapely.from_wkb(path["geometry"].to_numpy())
    xy = shapely.get_coordinates(lines)
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(lines))]).astype(np.int64)
    return [Strokes(xy[:, 1], xy[:, 0], first, _PATH, 7.0)]


def _track(
    points: pa.Table, lat: Array, lon: Array, known: NDArray[np.int64], frame: Frame
) -> list[Strokes]:
    """The epochs by colour: dots, or lines where there are many of one drive."""
    p = points["p_way"].to_numpy().astype(np.float64)[known]
    on = points["edge_id"].is_valid().to_numpy()[known]
    look = np.where(on, np.searchsorted(_LIMITS, np.nan_to_num(p), side="right"), len(_COLORS))
    drive = points["drive_id"].dictionary_encode().combine_chunks().indices.to_numpy()[known]
    lat, lon = lat[known], lon[known]
    layers = []
    for k, color in reversed(list(enumerate((*_COLORS, _OFF)))):  # what is not sure lies above
        if len(known) <= _DOTS:
            some = np.flatnonzero(look == k)
            layer = Strokes(lat[some], lon[some], np.arange(len(some) + 1), color, 6.0)
        else:
            layer = _lines(lat, lon, (look == k), drive, color, frame)
        layers.append(layer)
    return layers


def _lines(
    lat: Array, lon: Array, chosen: NDArray[np.bool_], drive: NDArray[Any], color: str, frame: Frame
) -> Strokes:
    """Runs of the chosen epochs as simplified lines, each from the epoch before it."""
    import shapely

    before = np.concatenate([[False], (drive[1:] == drive[:-1])])
    begins = chosen & ~np.concatenate([[False], chosen[:-1] & before[1:]])
    ends = chosen & ~np.concatenate([chosen[1:] & before[1:], [False]])
    low, high = np.flatnonzero(begins), np.flatnonzero(ends) + 1
    low = np.where(before[low], low - 1, low)
    if not len(low):
        return Strokes(lat[:0], lon[:0], np.zeros(1, np.int64), color, 3.0)
    row, place = row_and_place(np.maximum(high - low, 2))  # a line has two ends
    at = np.minimum(low[row] + place, high[row] - 1)
    lines = shapely.linestrings(np.column_stack([lon, lat])[at], indices=row)
    lines = shapely.simplify(lines, _PIXELS / frame.scale)
    xy = shapely.get_coordinates(lines)
    first = np.concatenate([[0], np.cumsum(shapely.get_num_coordinates(lines))]).astype(np.int64)
    return Strokes(xy[:, 1], xy[:, 0], first, color, 3.0)
