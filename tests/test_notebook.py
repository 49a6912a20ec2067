"""What a notebook shows of a map and of an answer, and their `plot` and `explore`."""

import pickle
import re
import sys
from xml.etree import ElementTree

import folium
import geopandas
import matplotlib.axes
import matplotlib.pyplot
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import shapely

import whichroad
from whichroad.errors import SettingError
from whichroad.geodesy.plane import Plane
from whichroad.svg import HEIGHT, WIDTH, Frame

PLANE = Plane(49.4, 8.7)
N = 60
STREETS, PATH = ("#b9bec6", "#8b929c"), "#bcd7ea"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def roads() -> whichroad.RoadMap:
    """A street of 1 km to the east, with one to the north at every 100 m."""
    points = [[(100.0 * k, 0.0), (100.0 * k + 100.0, 0.0)] for k in range(10)]
    points += [[(100.0 * k, 0.0), (100.0 * k, 300.0)] for k in range(11)]
    lines = []
    for line in points:
        lat, lon = PLANE.to_geodetic(*np.array(line).T)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
    kinds = ["primary"] * 10 + ["residential"] * 11
    frame = geopandas.GeoDataFrame(
        {"highway": kinds, "name": "A <b> & c"}, geometry=lines, crs=4326
    )
    return whichroad.RoadMap.from_edges(frame)


def drive(n: int = N) -> pd.DataFrame:
    """To the east, 12 m a second, or as many fixes on the same way."""
    lat, lon = PLANE.to_geodetic(np.linspace(5.0, 720.0, n), np.zeros(n))
    return pd.DataFrame({"time": 1.6e9 + np.linspace(0.0, N, n), "lat": lat, "lon": lon})


@pytest.fixture(scope="module")
def result(roads) -> whichroad.Result:
    return whichroad.match(drive(), roads)


def parsed(html: str) -> ElementTree.Element:
    """The picture; XML that loads nothing."""
    root = ElementTree.fromstring(html.replace("&nbsp;", " "))
    assert "script" not in {element.tag.rpartition("}")[2] for element in root.iter()}
    addresses = set(re.findall(r"\w+://[^\"']+", html))
    assert addresses <= {"http://www.w3.org/2000/svg"}
    assert not re.search(r"\b(?:src|href|url)\b", html)
    return root


def lines_of(root: ElementTree.Element, without: tuple[str, ...] = ()) -> list[np.ndarray]:
    """The lines of the drawing, pixels, but for those of some colours."""
    [group] = root.iter(f"{SVG}g")
    found = []
    for path in group:
        if path.get("stroke") in without:
            continue
        for part in path.get("d", "").split("M")[1:]:
            pairs = part.removesuffix("h0").split("L")
            found.append(np.array([[float(v) for v in pair.split()] for pair in pairs]))
    return found


def test_a_map_shows_itself_true_to_scale(roads):
    html = roads._repr_html_()
    root = parsed(html)
    lines = lines_of(root)
    xy = np.vstack(lines)
    wide, high = np.ptp(xy, axis=0)
    assert wide / high == pytest.approx(1000.0 / 300.0, rel=0.01)
    assert (xy >= 0.0).all()
    assert (xy <= [WIDTH, HEIGHT]).all()
    east = [line for line in lines if np.ptp(line[:, 1]) < 1.0]
    assert sum(np.ptp(line[:, 0]) for line in east) == pytest.approx(wide, rel=0.01)
    assert all(line[:, 1].max() == pytest.approx(xy[:, 1].max(), abs=0.6) for line in east)
    assert "4 km of streets" in html
    # the bar is as long as it says
    [bar] = [p for p in root.iter(f"{SVG}path") if "stroke" in p.attrib and "v4h" in p.get("d", "")]
    length = float(re.search(r"h([\d.]+)", bar.get("d", ""))[1])
    [text] = [t.text for t in root.iter(f"{SVG}text")]
    assert length / wide == pytest.approx(float(text.split()[0]) / 1000.0, rel=0.01)


def test_an_answer_shows_its_track_on_the_streets(result, roads):
    html = result._repr_html_()
    lines = lines_of(parsed(html))
    dots = np.vstack([line for line in lines if len(line) == 1])
    assert len(dots) == N
    # each where it is among the streets, which are drawn too
    points = result.points
    x, _ = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
    order = np.argsort(dots[:, 0])
    scale = np.ptp(dots[:, 0]) / np.ptp(x)
    np.testing.assert_allclose(
        dots[order, 0] - dots[:, 0].min(), scale * (np.sort(x) - x.min()), atol=0.2
    )
    across = [line for line in lines if len(line) == 2 and np.ptp(line[:, 0]) < 1.0]
    assert any(np.ptp(line[:, 1]) == pytest.approx(300.0 * scale, rel=0.02) for line in across)
    assert "60 epochs" in html
    alone = whichroad.Result(result.to_arrow(), result.path_arrow(), result.summary)
    assert len(lines_of(parsed(alone._repr_html_()))) < len(lines)


@pytest.mark.parametrize("n", [450, 3000])
def test_a_long_answer_is_drawn_as_lines_that_cover_every_epoch(roads, n: int):
    both = pd.concat([drive(n).assign(trip="a"), drive(n).assign(trip="b", lat=49.402)])
    result = whichroad.match(both, roads)
    html = result._repr_html_()
    assert len(html) < 60_000
    lines = lines_of(parsed(html), without=(*STREETS, PATH))
    assert all(len(line) > 1 for line in lines)
    assert all(np.ptp(line[:, 1]) < 5.0 for line in lines)  # none joins the two drives
    levels = np.array([line[:, 1].mean() for line in lines])
    high = levels < levels.mean()
    assert levels[~high].min() - levels[high].max() > 20.0
    wide = result.points.groupby("drive_id").lon.agg(np.ptp)
    scale = np.ptp(np.vstack(lines)[:, 0]) / np.ptp(result.points.lon)
    for level, name in ((high, "b"), (~high, "a")):  # b lies in the north
        spans = [
            (line[:, 0].min(), line[:, 0].max()) for line, k in zip(lines, level, strict=True) if k
        ]
        spans.sort()
        reach = spans[0][0]
        for begin, end in spans:
            assert begin <= reach + 1.0  # no gap between the lines of a drive
            reach = max(reach, end)
        assert reach - spans[0][0] == pytest.approx(scale * wide[name], rel=0.01)


def test_an_answer_without_a_position_says_so(result):
    points = result.to_arrow()
    at = points.column_names.index("lat")
    points = points.set_column(at, "lat", pa.nulls(N, pa.float64()))
    empty = whichroad.Result(points, result.path_arrow(), {"drive_id": "<b>"})
    assert "no epoch has a position" in empty._repr_html_()
    assert "<b>" not in empty._repr_html_()


def test_what_a_map_is_called_is_no_markup(roads):
    mine = pickle.loads(pickle.dumps(roads))
    mine._about["source"] = "<script>alert(1)</script>"
    assert "<script" not in mine._repr_html_()
    assert "&lt;script" in mine._repr_html_()


def test_a_frame_holds_what_lies_on_both_sides_of_the_date_line():
    frame = Frame.about(np.array([0.0, 0.1]), np.array([179.9, -179.9]))
    x, y = frame.place(np.array([0.0, 0.1]), np.array([179.9, -179.9]))
    assert 0.0 < x[0] < x[1] < WIDTH
    assert HEIGHT > y[0] > y[1] > 0.0


def test_plot_draws_on_axes_as_geopandas_does(result, roads):
    ax = roads.plot()
    assert isinstance(ax, matplotlib.axes.Axes)
    streets = len(ax.collections[0].get_paths())
    assert streets == 21
    again = result.plot(ax=ax, legend=True, markersize=20)
    assert again is ax
    path, points = ax.collections[1:3]
    assert len(path.get_paths()) == len(result.path)
    np.testing.assert_allclose(points.get_offsets()[:, 0], result.points.lon)
    np.testing.assert_allclose(points.get_array(), result.points.p_way)
    other = result.plot(column="speed_mps", figsize=(3, 2))
    assert other is not ax
    assert other.figure.get_size_inches().tolist() == [3.0, 2.0]
    assert result.plot(color="black") is not None
    alone = result.plot()
    roads_near, path = alone.collections[:2]
    assert len(roads_near.get_paths()) == streets - 1  # one lies more than 200 m away
    assert [text.get_text() for text in alone.get_legend().get_texts()] == ["roads", "path"]
    assert alone.figure.axes[1].get_ylabel() == "P(way), probability of the road"
    matplotlib.pyplot.close("all")


def test_explore_is_a_page_of_folium(result, roads):
    page = result.explore(tiles=None)
    assert isinstance(page, folium.Map)
    html = page.get_root().render()
    assert "p_way" in html
    assert "broken_rule" in html
    assert isinstance(roads.explore(tiles=None), folium.Map)


def test_explore_without_folium_says_what_to_install(result, roads, monkeypatch):
    monkeypatch.setitem(sys.modules, "folium", None)
    for one in (result, roads):
        with pytest.raises(SettingError, match=r"folium is missing.*whichroad\[explore\]"):
            one.explore()
