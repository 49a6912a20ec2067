from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.image import imread

from whichroad import plots
from whichroad.errors import DriveError
from whichroad.geodesy.plane import Plane
from whichroad.plots import hypotheses
from whichroad.plots.scene import CHI2_95, Window, ambiguous_windows, make_scene
from whichroad.tables import schema
from whichroad.tables.result import Result

N = 400  # epochs of a tenth of a second, 1 m apart
PLANE = Plane(49.4, 8.7)


def table(x, y, **columns):
    """A points table of positions in the plane; NaN becomes null."""
    lat, lon = PLANE.to_geodetic(x, y)
    columns |= {"lat": pa.array(lat, from_pandas=True), "lon": pa.array(lon, from_pandas=True)}
    time = schema.times(1.7e9 + 0.1 * np.arange(len(x)))
    return pa.table({"drive_id": ["d"] * len(x), "time": time, **columns})


@pytest.fixture
def roads():
    """Two parallel roads, 12 m apart, and one across."""
    lines = np.array([[(0, 0), (400, 0)], [(0, 12), (400, 12)], [(200, -50), (200, 80)]], float)
    arrays = SimpleNamespace(
        vertices=SimpleNamespace(x=lines[:, :, 0].ravel(), y=lines[:, :, 1].ravel()),
        edges=SimpleNamespace(first_vertex=np.array([0, 2, 4]), opposite=np.array([-1, -1, -1])),
    )
    names = {0: "Main Street", 1: "Side Lane", 2: None}
    return SimpleNamespace(
        plane=PLANE,
        arrays=arrays,
        attributes=lambda edge: {"name": names[edge]},
        edge_line=lambda edge: lines[edge],
    )


@pytest.fixture
def result():
    """Along the first road; the second is as probable about the twentieth second."""
    x, y = np.arange(N, dtype=float), np.zeros(N)
    x[:5] = np.nan  # before the first fix
    second = 0.45 * np.exp(-(((np.arange(N) - 200) / 20.0) ** 2))
    p = np.zeros((N, 6))
    p[:, 0], p[:, 1], p[:, 2] = 0.99 - second, second, 0.01
    edge = np.full((N, 6), -2, np.int32)
    edge[:, :3] = 0, 1, -1
    ones = np.ones((N, 6))
    across = np.tile([0.0, 12.0, 0.0, 0.0, 0.0, 0.0], (N, 1))
    poses = {"edge": edge, "p": p, "x": np.arange(N)[:, None] + 0 * ones, "y": across}
    covs = {"heading": 0 * ones, "cov_xx": 9 * ones, "cov_xy": ones, "cov_yy": 4 * ones}
    status = np.where(second > 0.05, "ambiguous", "on_road")
    columns = {"p_road": p[:, 0], "p_off_road": p[:, 2], "status": status}
    columns |= {"ellipse_major_m": np.full(N, 3.1), "cov_ee_m2": np.full(N, 9.0)}
    columns |= {"cov_en_m2": np.ones(N), "cov_nn_m2": np.full(N, 4.0)}
    points = table(x, y, **columns)
    return Result(points, schema.PATH.empty_table(), {}, poses | covs)


@pytest.fixture
def truth():
    return table(np.arange(N, dtype=float), np.full(N, 1.0))


def test_a_drive_becomes_four_pictures(result, roads, truth, tmp_path):
    lat, lon = PLANE.to_geodetic(np.array([0.0, 10.0]), np.array([3.0, -2.0]))
    fixes = SimpleNamespace(lat_deg=lat, lon_deg=lon, __len__=lambda: 2)
    written = plots.plot_drive(
        result, roads, truth, fixes, out=tmp_path / "new", masked=[(10, 30)],
        reckoning=truth, title="A drive",
    )  # fmt: skip
    assert [path.name for path in written] == [
        "overview.png",
        "hypotheses.png",
        "probability.png",
        "drive.png",
    ]
    for path in written:
        picture = imread(path)
        assert picture.std() > 0.01  # something is drawn
        assert path.with_suffix(".svg").read_text("utf-8").rstrip().endswith("</svg>")


def test_two_answers_are_drawn_one_above_the_other_as_png_and_svg(result, roads, truth, tmp_path):
    other = Result(result.to_arrow(), schema.PATH.empty_table(), {}, dict(result.hypotheses))
    windows = [Window("left", 5.0, 12.0), Window("right", 16.0, 24.0)]
    written = [
        plots.plot_methods(
            [("ours", result), ("theirs", other)], roads, truth, out=tmp_path / name,
            windows=windows, title="Both",
        )
        for name in ("one", "two")
    ]  # fmt: skip
    assert [path.name for path in written[0]] == ["methods.png", "methods.svg"]
    text = written[0][1].read_text("utf-8")
    assert text == written[1][1].read_text("utf-8")  # the same picture is the same file
    for word in ("ours", "theirs", "Main Street (0)", "Side Lane (1)", "Both"):
        assert f">{word}</text>" in text


def test_the_ellipses_of_a_stretch_are_apart_and_fill_the_frame(result, roads, truth):
    scene = scene_of(result, roads, truth)
    window = Window("", 5.0, 35.0)
    axes = Figure(figsize=(6, 2)).subplots()
    hypotheses.draw_zoom(axes, scene, window)
    rows = hypotheses.drawn_of(scene, window)
    east = np.unique(rows["x"])
    assert np.diff(east).min() > 2 * np.sqrt(CHI2_95 * (9 + 4) / 2)
    west, right = axes.get_xlim()
    reach = np.sqrt(CHI2_95 * 9)
    assert west < east[0] - reach
    assert right > east[-1] + reach
    assert (east[-1] - east[0] + 2 * reach) / (right - west) > 0.75


def test_a_road_has_one_colour_in_the_zooms_of_two_answers(result, roads):
    scene, window = scene_of(result, roads), Window("", 18.0, 22.0)
    colours = hypotheses.road_colours([scene, scene], window)
    assert set(colours) == {-1, 0, 1}
    assert len(set(colours.values())) == 3


def test_truth_and_fixes_may_be_unknown(result, roads, tmp_path):
    assert len(plots.plot_drive(result, roads, out=tmp_path)) == 4


def test_an_answer_without_hypotheses_is_refused(result, roads, tmp_path):
    result.hypotheses = None
    with pytest.raises(DriveError, match="hypotheses=True"):
        plots.plot_drive(result, roads, out=tmp_path)


def scene_of(result, roads, truth=None):
    return make_scene(result, roads, truth, None, [(10.0, 30.0)], None)


def test_the_window_that_is_chosen_holds_the_least_clear_moment(result, roads):
    (window,) = ambiguous_windows(scene_of(result, roads))
    assert (window.begin + window.end) / 2 == pytest.approx(20.0, abs=0.2)


def test_a_drive_without_doubt_has_a_window_too(result, roads):
    result.hypotheses["p"][:, 1:] = 0
    assert len(ambiguous_windows(scene_of(result, roads))) == 1


def test_epochs_without_position_are_gaps_and_in_no_window(result, roads):
    scene = scene_of(result, roads)
    assert np.isnan(scene.xy[:5]).all()
    assert scene.within(Window("", 0.0, 1.0)).tolist() == [5, 6, 7, 8, 9, 10]


def test_the_truth_is_drawn_at_the_times_of_the_answer(result, roads, truth):
    scene = scene_of(result, roads, truth.take(pa.array(range(0, N, 7))))
    known = np.isfinite(scene.truth[:, 0]) & np.isfinite(scene.xy[:, 0])
    apart = scene.truth[known] - scene.xy[known]
    assert apart[:, 0] == pytest.approx(0.0, abs=1e-3)
    assert apart[:, 1] == pytest.approx(1.0, abs=1e-3)


def test_the_share_inside_is_that_of_the_95_percent_ellipse(result, roads):
    rng = np.random.default_rng(1)
    errors = rng.multivariate_normal([0, 0], [[9, 1], [1, 4]], N)
    truth = table(np.arange(N) + errors[:, 0], errors[:, 1])
    scene = scene_of(result, roads, truth)
    share = scene.inside[5:].mean()
    assert abs(share - 0.95) < 3 * np.sqrt(0.95 * 0.05 / N)


def test_an_ellipse_has_the_axes_of_its_covariance():
    turn = np.radians(30)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    cov = rotation @ np.diag([9.0, 1.0]) @ rotation.T
    axes = Figure().subplots()
    shown = {"x": [5.0], "y": [6.0], "p": np.array([0.7])}
    shown |= {"cov_xx": cov[0, :1], "cov_xy": cov[0, 1:], "cov_yy": cov[1, 1:]}
    hypotheses.draw_ellipses(axes, shown, {})
    (ellipse,) = (child for child in axes.collections if isinstance(child, EllipseCollection))
    assert ellipse.get_widths() == pytest.approx([2 * 3 * np.sqrt(CHI2_95)])
    assert ellipse.get_heights() == pytest.approx([2 * 1 * np.sqrt(CHI2_95)])
    assert ellipse.get_angles() % 180 == pytest.approx([30.0])


def test_roads_far_from_the_drive_are_not_drawn(result, roads):
    roads.arrays.vertices.x[4:] += 5000
    assert len(scene_of(result, roads).roads) == 2
