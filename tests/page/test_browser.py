"""The page and the report in a real browser: headless Chromium, its WebGL in software."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from whichroad.replay.drive_report import write_report
from whichroad.replay.open_replay import Remaking
from whichroad.replay.player import Player
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.replay.replay_server import replay_app
from whichroad.roadmap import RoadMap

from .conftest import served

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

CHROMIUM = os.environ.get("WHICHROAD_CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
NO_CHROMIUM = "no Chromium is on the PATH (WHICHROAD_CHROMIUM may name one)"
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
FLAGS = [
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-gpu-compositing",  # the map alone is drawn by WebGL, which is slow in software
]
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
POST = "asked => fetch('control', {method: 'POST', body: JSON.stringify(asked)})"
FRAME = "() => whichroad.state.frame"
POSITION = "() => whichroad.state.frame.play.position_s"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if CHROMIUM is None:  # who takes the fixture from elsewhere has not asked
        pytest.skip(NO_CHROMIUM)
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def opened(
    browser: Any, remaking: Remaking, recorded: RecordedMessages
) -> Iterator[tuple[Any, list[str]]]:
    """The page on the paper's drive, and what it complained of."""
    player = Player(recorded, remaking, position=80.0, paused=True)
    with served(replay_app(player, remaking.roads)) as address:
        page = browser.new_page(viewport=DESK)
        complaints: list[str] = []
        page.on("console", lambda said: complaints.append(said.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(address)
        page.wait_for_selector("html[data-drawn]")
        page.wait_for_selector("#drive:not([hidden])")
        yield page, complaints
        page.close()


@pytest.fixture
def page(opened: tuple[Any, list[str]]) -> Iterator[Any]:
    """The page at 80 s, paused, GNSS not masked; it must not complain."""
    page, complaints = opened
    page.set_viewport_size(DESK)
    page.evaluate(POST, {"action": "pause"})
    settled(page, 0.0)
    page.evaluate(POST, {"action": "unmask"})
    settled(page, 80.0)
    complaints.clear()
    yield page
    assert complaints == []


def settled(page: Any, seconds: float) -> Any:
    """The message after the clock was turned to so many seconds."""
    page.evaluate(POST, {"action": "seek", "value": seconds})
    for _ in range(200):
        frame = page.evaluate(FRAME)
        if frame and abs(frame["play"]["position_s"] - seconds) < 1e-6:
            return frame
        page.wait_for_timeout(20)
    raise AssertionError("the page was not told")


def test_roads_are_drawn_and_named(page: Any):
    for _ in range(200):
        drawn, named = page.evaluate(
            "() => ['road', 'name'].map(layer => "
            "whichroad.map.queryRenderedFeatures({layers: [layer]}).length)"
        )
        if drawn and named:
            return
        page.wait_for_timeout(20)
    raise AssertionError("no road or no name was drawn")


def test_the_vehicle_moves_when_played_and_the_map_follows(page: Any):
    before = page.evaluate(FRAME)["pose"]
    page.keyboard.press("Space")
    for _ in range(300):
        now = page.evaluate(FRAME)["pose"]
        if abs(now["lat"] - before["lat"]) + abs(now["lon"] - before["lon"]) > 1e-4:
            break
        page.wait_for_timeout(20)
    page.keyboard.press("Space")
    frame = settled(page, 100.0)
    for _ in range(100):
        centre = page.evaluate("() => whichroad.map.getCenter()")
        if abs(centre["lat"] - frame["pose"]["lat"]) < 1e-6:
            break
        page.wait_for_timeout(20)
    assert centre["lat"] == pytest.approx(frame["pose"]["lat"], abs=1e-6)
    assert centre["lng"] == pytest.approx(frame["pose"]["lon"], abs=1e-6)


def test_masking_gnss_grows_the_ellipse_and_shows_wheels_alone(
    page: Any, recorded: RecordedMessages
):
    settled(page, 90.0)
    page.click("#mask")
    page.wait_for_selector("#mask[aria-pressed=true]")
    frame = settled(page, 129.0)
    with_gnss = recorded.columns["ellipse_major_m"][recorded.at(129.0)]
    assert frame["ellipse"]["major_m"] > 1.2 * with_gnss
    assert frame["reckoning"]["travelled_m"] > 100
    assert frame["fix"]["masked"]
    page.keyboard.press("m")
    page.wait_for_selector("#mask[aria-pressed=false]")


def test_at_a_junction_without_gnss_the_hypotheses_split_and_are_listed(
    page: Any, recorded: RecordedMessages
):
    settled(page, 90.0)
    page.keyboard.press("m")
    page.wait_for_selector("#mask[aria-pressed=true]")
    line = page.evaluate("() => fetch('timeline').then(answer => answer.json())")
    tops = [max(p for _, p in shares) for shares in line["roads"]]
    dark = [(p, t) for p, t in zip(tops, line["t"], strict=True) if 95 < t < 140]
    frame = settled(page, min(dark)[1])
    edges = {one["edge_id"] for one in frame["hypotheses"] if one["p"] > 0.02}
    assert len(edges) >= 2
    page.wait_for_selector("#roads li:nth-child(2)")
    page.wait_for_function(
        "doubt => (document.getElementById('status').textContent === 'ambiguous') === doubt",
        arg=frame["p_way"] < 0.95,
    )
    listed = page.locator("#roads li").count()
    assert listed >= len(edges)
    for seconds, status in ((0.5, "ambiguous"), (2.0, "stopped")):  # it may face either way
        assert settled(page, seconds)["p_way"] < 0.95
        page.wait_for_function(
            "status => document.getElementById('status').textContent === status", arg=status
        )


def test_the_timeline_is_a_slider_for_mouse_and_keys(page: Any, recorded: RecordedMessages):
    box = page.locator("#strip").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 10)
    middle = 0.5 * recorded.length
    for _ in range(200):
        at = page.evaluate(FRAME)["play"]["position_s"]
        if abs(at - middle) < 0.01 * recorded.length:
            break
        page.wait_for_timeout(20)
    assert at == pytest.approx(middle, abs=0.01 * recorded.length)
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("t => whichroad.state.frame.play.position_s < t", arg=at - 4.0)
    back = page.evaluate(POSITION)
    assert back == pytest.approx(at - 5.0, abs=0.1)
    page.keyboard.press(".")
    page.wait_for_function("t => whichroad.state.frame.play.position_s > t", arg=back)
    assert 0 < page.evaluate(POSITION) - (at - 5.0) < 0.3
    assert page.locator("#strip").get_attribute("aria-valuetext")


def test_following_ends_when_the_map_is_dragged_and_begins_again_by_its_key(page: Any):
    page.mouse.move(800, 300)
    page.mouse.down()
    page.mouse.move(700, 250, steps=4)
    page.mouse.up()
    page.wait_for_selector("#follow[aria-pressed=false]")
    page.keyboard.press("f")
    page.wait_for_selector("#follow[aria-pressed=true]")


def test_light_and_dark_follow_the_system_until_they_are_chosen(page: Any):
    assert page.locator("html").get_attribute("data-theme") == "light"
    page.emulate_media(color_scheme="dark")
    page.wait_for_selector("html[data-theme=dark]")
    page.keyboard.press("t")
    page.wait_for_selector("html[data-theme=light]")
    page.emulate_media(color_scheme="light")
    page.emulate_media(color_scheme="dark")
    assert page.locator("html").get_attribute("data-theme") == "light"
    page.evaluate("() => localStorage.clear()")
    page.emulate_media(color_scheme="light")


def test_on_a_phone_nothing_is_wider_than_the_screen_and_the_map_is_seen(page: Any):
    page.set_viewport_size(PHONE)
    page.wait_for_timeout(300)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= PHONE["width"]
    boxes = {name: page.locator(f"#{name}").bounding_box() for name in ("card", "dock", "tools")}
    for box in boxes.values():
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE["width"]
        assert box["y"] + box["height"] <= PHONE["height"]
    assert boxes["card"]["y"] > 0.3 * PHONE["height"]
    page.click("#help")
    assert page.locator("#legend").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator("#legend").is_visible()


def test_what_is_remembered_is_bounded(page: Any):
    sizes = page.evaluate(
        """async () => {
          const { Series, Recent } = await import(new URL('static/series.js', location.href));
          const series = new Series(100), recent = new Recent(10);
          for (let i = 0; i < 10000; i += 1) {
            series.push({t: i, p: 1}, [[1, 1]]);
            recent.push(i);
          }
          return [series.length, series.begin, series.end, series.find(9950), recent.items.length,
                  recent.last];
        }"""
    )
    assert sizes[:4] == [100, 9900, 9999, 50]
    assert sizes[4] <= 20
    assert sizes[5] == 9999


def test_a_result_without_its_drive_cannot_be_masked(
    browser: Any, recorded: RecordedMessages, roads: RoadMap
):
    with served(replay_app(Player(recorded), roads)) as address:
        page = browser.new_page(viewport=DESK)
        page.goto(address)
        page.wait_for_selector("#mask:disabled")
        page.close()


def test_a_connection_that_breaks_is_told_and_taken_up_again(
    browser: Any, recorded: RecordedMessages, roads: RoadMap
):
    page = browser.new_page(viewport=DESK)
    with served(replay_app(Player(recorded), roads)) as address:
        page.goto(address)
        page.wait_for_selector("#link[data-state=open]")
    page.wait_for_selector("#app.lost")
    page.close()


def test_a_report_opens_offline_and_its_places_lead_somewhere(
    browser: Any, recorded: RecordedMessages, roads: RoadMap, tmp_path: Path
):
    path = tmp_path / "report.html"
    write_report(recorded, path, roads)
    context = browser.new_context(viewport=DESK, offline=True)
    page = context.new_page()
    complaints: list[str] = []
    page.on("console", lambda said: complaints.append(said.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(path.as_uri())
    page.wait_for_selector("html[data-ready=report]")
    page.wait_for_selector("#places button")
    before = page.inner_text("#time")
    page.locator("#places button").nth(1).click()
    page.wait_for_selector("#places li:nth-child(2) button[aria-current=true]")
    assert page.inner_text("#time") != before
    assert page.inner_text("#status") in ("ambiguous", "no GNSS", "off the roads", "lost")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("t")
    page.wait_for_selector("html[data-theme=dark]")
    page.evaluate("() => { location.hash = '#t=310&z=18'; }")
    page.wait_for_function("() => document.getElementById('time').textContent.startsWith('5:10')")
    page.set_viewport_size(PHONE)
    page.wait_for_timeout(200)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= PHONE["width"]
    context.close()
    assert complaints == []
