"""Links, numbers of what is pointed at, dropped files, the truth: in a real browser."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from whichroad.errors import DriveError, ReadError, WhichroadError
from whichroad.matching import match
from whichroad.replay.drive_report import write_report
from whichroad.replay.dropped import DroppedFile
from whichroad.replay.open_replay import Remaking
from whichroad.replay.player import Player
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.replay.replay_server import replay_app
from whichroad.replay.truth import read_truth
from whichroad.roadmap import RoadMap

from .conftest import served
from .test_browser import DESK, browser, pytestmark, settled  # noqa: F401

DROP = """([name, content]) => {
  const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([bytes], name));
  dispatchEvent(new DragEvent('drop', {dataTransfer, bubbles: true, cancelable: true})); }"""
PLACE = """([lon, lat]) => { const at = whichroad.map.project([lon, lat]); return [at.x, at.y]; }"""
TOAST = "words => document.getElementById('toast').textContent.includes(words)"
SHOWN = "words => document.getElementById('numbers').textContent.includes(words)"


@pytest.fixture(scope="module")
def address(remaking: Remaking, recorded: RecordedMessages, folder: Path) -> Iterator[str]:
    truth = read_truth(folder / "truth.parquet")
    player = Player(recorded, remaking, position=80.0, paused=True, truth=truth)
    opener = DroppedFile(remaking.roads, remaking.vehicle)
    tiles = {"tiles_url": "http://127.0.0.1:9/{z}/{x}/{y}.png", "tiles_by": "Tiles & <b>us</b>"}
    with served(replay_app(player, remaking.roads, opener=opener, **tiles)) as where:
        yield where


@pytest.fixture(scope="module")
def page(browser: Any, address: str) -> Iterator[Any]:  # noqa: F811
    context = browser.new_context(viewport=DESK)
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = context.new_page()
    page.goto(f"{address}?token=secret#t=100&z=16.5")
    page.wait_for_selector("html[data-drawn]")
    page.wait_for_selector("#drive:not([hidden])")
    yield page
    context.close()


def clicked(page: Any, lon: float, lat: float) -> None:
    page.mouse.click(*page.evaluate(PLACE, [lon, lat]))


def test_a_link_leads_to_its_moment_and_is_copied(page: Any):
    page.wait_for_function("() => whichroad.state.frame.play.position_s === 100")
    page.wait_for_function("() => Math.abs(whichroad.map.getZoom() - 16.5) < 1e-6")
    page.evaluate("() => { location.hash = '#t=120&z=17'; }")
    page.wait_for_function("() => whichroad.state.frame.play.position_s === 120")
    page.click("#link-to")
    page.wait_for_function(TOAST, arg="link copied")
    copied = page.evaluate("() => navigator.clipboard.readText()")
    assert copied.endswith("#t=120.0&z=17.0")
    assert "secret" not in copied


def test_a_click_tells_the_numbers_of_a_fix_a_road_and_a_moment(page: Any, roads: RoadMap):
    frame = settled(page, 120.0)
    fix = frame["fix"]
    page.wait_for_timeout(100)  # the map stands still
    clicked(page, fix["lon"], fix["lat"])
    page.wait_for_function(SHOWN, arg="GNSS fix")
    row = page.evaluate(
        "() => { const s = whichroad.state.series, i = s.find(whichroad.state.frame.epoch_s + 6);"
        " return [s.get('lon', i), s.get('lat', i)]; }"
    )
    clicked(page, *row)
    page.wait_for_function(SHOWN, arg="P(way)")
    edge = next(e for e in range(len(roads)) if apart(page, roads, e))
    x, y = roads.at(edge, 0.5 * roads.arrays.edges.length[edge])[:2]
    lat, lon = roads.plane.to_geodetic(np.array([x]), np.array([y]))
    clicked(page, float(lon[0]), float(lat[0]))
    page.wait_for_function(SHOWN, arg="edge")
    page.keyboard.press("Escape")
    assert page.locator("#numbers").is_hidden()


def apart(page: Any, roads: RoadMap, edge: int) -> bool:
    """Whether the middle of an edge is on the map beside the panels and away from the track."""
    x, y = roads.at(edge, 0.5 * roads.arrays.edges.length[edge])[:2]
    lat, lon = roads.plane.to_geodetic(np.array([x]), np.array([y]))
    px, py = page.evaluate(PLACE, [float(lon[0]), float(lat[0])])
    there = page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.className ?? ''", [px, py])
    track = page.evaluate(
        "([x, y]) => { const s = whichroad.state.series; let least = 1e9;"
        " for (let i = 0; i < s.length; i += 1) {"
        "  const at = whichroad.map.project([s.get('lon', i), s.get('lat', i)]);"
        "  least = Math.min(least, Math.hypot(at.x - x, at.y - y)); } return least; }",
        [px, py],
    )
    return "maplibregl-canvas" in there and track > 30


def test_pointing_at_a_chart_previews_its_moment(page: Any):
    for chart in ("#race", "#strip"):
        box = page.locator(chart).bounding_box()
        page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"])
        page.wait_for_function(SHOWN, arg="P(way)")
        assert page.evaluate("() => whichroad.state.preview") >= 0
        page.mouse.move(640, 300)
        page.wait_for_function("() => whichroad.state.preview === -1")
        assert page.locator("#numbers").is_hidden()
    box, before = page.locator("#race").bounding_box(), settled(page, 120.0)
    page.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 0.5 * box["height"])
    page.wait_for_function(
        "t => whichroad.state.frame.epoch_s < t", arg=before["epoch_s"] - 5.0
    )  # a click goes there


def test_the_whole_drive_is_fitted_beside_the_panels(page: Any):
    page.click("#fit")
    box = page.evaluate("() => whichroad.state.series.box()")
    places = [page.evaluate(PLACE, [box[i], box[j]]) for i, j in ((0, 1), (2, 3))]
    card, dock = (page.locator(n).bounding_box() for n in ("#card", "#dock"))
    assert all(card["x"] + card["width"] < x < DESK["width"] for x, _ in places)
    assert all(0 < y < dock["y"] for _, y in places)
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    page.keyboard.press("f")


def test_the_vehicle_moves_between_two_messages(page: Any):
    frame = settled(page, 60.0)
    moved = page.evaluate(
        """frame => { const m = new whichroad.motion.constructor();
          const at = (s) => ({...frame, epoch_s: frame.epoch_s + s, play: {...frame.play,
            paused: false}, pose: {...frame.pose, lat: frame.pose.lat + 1e-4 * s,
            bearing_deg: (359 + 2 * s) % 360}});
          m.take(at(0), 0); m.take(at(1), 500);
          const seen = [500, 625, 750, 1000].map((t) => m.at(t).pose);
          m.take(at(60), 1500);
          return [seen.map((p) => (p.lat - frame.pose.lat) / 1e-4), seen.map((p) => p.bearing_deg),
                  m.moves(1501)]; }""",
        frame,
    )
    assert moved[0] == pytest.approx([0.0, 0.25, 0.5, 1.0], abs=1e-4)
    assert np.cos(np.radians(moved[1][2])) == pytest.approx(1.0)
    assert moved[2] is False  # a jump in time is no motion


def test_the_error_is_drawn_against_the_ellipse_where_the_truth_is_known(page: Any):
    truth = page.evaluate("() => whichroad.state.recording.truth")
    errors = np.array([np.nan if e is None else e for e in truth["error"]])
    assert np.nanmax(errors) < 15.0
    assert truth["inside"] > 0.9
    assert truth["rms"] == pytest.approx(np.sqrt(np.nanmean(errors**2)), abs=0.1)
    settled(page, 200.0)
    page.wait_for_function("() => / of .* m$/.test(document.getElementById('error').textContent)")
    assert page.locator("#errors").is_visible()


def test_the_background_has_its_attribution(page: Any):
    assert "Tiles & <b>us</b>" in page.inner_text(".maplibregl-ctrl-attrib-inner")


def test_the_report_is_saved_as_it_is_shown(page: Any, tmp_path: Path):
    with page.expect_download() as download:
        page.click("#save")
    download.value.save_as(tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text("utf-8")
    assert download.value.suggested_filename.endswith(".html")
    assert "Worth a look" in text
    assert '"poses"' in text


def test_a_log_and_an_answer_are_dropped_onto_the_page(
    page: Any, folder: Path, remaking: Remaking, recorded: RecordedMessages, tmp_path: Path
):
    def drop(name: str, content: bytes) -> None:
        page.evaluate(DROP, [name, base64.b64encode(content).decode()])

    drop("notes.nmea", b"nothing here\n")
    page.wait_for_function(TOAST, arg="notes.nmea")
    page.wait_for_function("() => /expected/.test(document.getElementById('toast').textContent)")
    assert "/tmp" not in page.inner_text("#toast")
    drop("drive.nmea", (folder / "drive.nmea").read_bytes())
    page.wait_for_function(TOAST, arg="drive.nmea is shown")
    page.wait_for_function("n => whichroad.state.recording.t.length < n", arg=len(recorded) / 2)
    assert page.evaluate("() => whichroad.state.recording.truth") is None
    points = tmp_path / "points.parquet"
    match(remaking.drive, remaking.roads, vehicle=remaking.vehicle).write(points)
    drop("answer.parquet", points.read_bytes())
    page.wait_for_function(TOAST, arg="answer.parquet is shown")
    page.wait_for_selector("#mask:disabled")
    assert page.locator("#errors").is_hidden()


def test_a_report_tells_numbers_and_copies_links(
    browser: Any,  # noqa: F811
    recorded: RecordedMessages,
    roads: RoadMap,
    tmp_path: Path,
):
    path = tmp_path / "report.html"
    write_report(recorded, path, roads)
    page = browser.new_page(viewport=DESK)
    page.goto(f"{path.as_uri()}#t=200&z=17")
    page.wait_for_selector("html[data-ready]")
    assert page.inner_text("#time").startswith("3:20")
    box = page.locator("#race").bounding_box()
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.4 * box["height"])
    page.wait_for_function(SHOWN, arg="P(way)")
    stage = page.locator("#map").bounding_box()
    page.mouse.click(stage["x"] + 0.5 * stage["width"], stage["y"] + 0.5 * stage["height"])
    page.wait_for_function(SHOWN, arg="P(way)")  # the vehicle's own moment, in the middle
    page.click("#link-to")
    page.wait_for_function("() => location.hash === '#t=200.0&z=17.0'")
    page.close()


def test_a_truth_of_another_time_is_told(recorded: RecordedMessages, tmp_path: Path):
    path = tmp_path / "truth.csv"
    path.write_text("time,lat,lon\n1.0,49.0,2.0\n2.0,49.0,2.0\n")
    with pytest.raises(DriveError, match="truth of this drive"):
        Player(recorded, truth=read_truth(path))
    path.write_text("time,lat\n1.0,49.0\n")
    with pytest.raises(ReadError, match="lon"):
        read_truth(path)


def test_the_name_of_a_dropped_file_leads_nowhere_else(roads: RoadMap):
    for name in ("", "..", "../.hidden", "a\0.csv", 60 * "\U0001f697" + ".csv"):
        with pytest.raises(WhichroadError, match="name"):
            DroppedFile(roads)(name, b"")
