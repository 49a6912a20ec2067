"""The page and the report at four sizes, light and dark: axe finds nothing, nothing overlaps."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from whichroad.replay.drive_report import write_report
from whichroad.replay.open_replay import Remaking
from whichroad.replay.player import Player
from whichroad.replay.replay_server import replay_app
from whichroad.replay.truth import read_truth

from .conftest import served
from .test_browser import CHROMIUM, POST, browser, pytestmark  # noqa: F401

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")

SIZES = {"320x568": (320, 568), "390x844": (390, 844), "844x390": (844, 390),
         "1440x900": (1440, 900)}  # fmt: skip
THEMES = ("light", "dark")
FIRST = dict(zip(SIZES, THEMES * 2, strict=True))  # the theme that a page of a size is opened with
OUTSIDE = """() => [...document.querySelectorAll('button, summary, select, h1, .p, .status, dd')]
  .filter((e) => e.checkVisibility() && !e.closest('dialog') && !e.closest('ol.places'))
  .filter((e) => { const r = e.getBoundingClientRect();
    return r.left < -0.5 || r.right > innerWidth + 0.5; })
  .map((e) => e.id || e.textContent)"""
PANELS = """(names) => { const found = names.map((n) => document.getElementById(n))
  .concat([...document.querySelectorAll('.maplibregl-ctrl')])
  .filter((e) => e && e.checkVisibility());
  const over = [];
  found.forEach((a, i) => found.slice(0, i).forEach((b) => {
    const [p, q] = [a.getBoundingClientRect(), b.getBoundingClientRect()];
    const wide = Math.min(p.right, q.right) - Math.max(p.left, q.left);
    const high = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    if (wide > 1 && high > 1) {
      over.push(`${a.id || a.className} over ${b.id}: ${wide} x ${high}`); } }));
  return over; }"""
AXE = "() => axe.run({resultTypes: ['violations']}).then((found) => found.violations)"
FRAME = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
MAP_FREE = """() => { const panels = ['card', 'dock', 'tools'].map((n) =>
  document.getElementById(n).getBoundingClientRect());
  const area = panels.reduce((sum, r) => sum + r.width * r.height, 0);
  return 1 - area / (innerWidth * innerHeight); }"""


@pytest.fixture(scope="module")
def replayed(crowded: Remaking, folder: Path) -> Iterator[str]:
    truth = read_truth(folder / "truth.parquet")
    player = Player(crowded([]), crowded, position=80.0, paused=True, truth=truth)
    with served(replay_app(player, crowded.roads)) as address:
        yield address


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, crowded: Remaking) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(crowded([]), path, crowded.roads)
    return path


def violations(page: Any) -> list[str]:
    """What axe finds, one line for each element; a page is given axe once."""
    if not page.evaluate("() => 'axe' in window"):
        page.evaluate(axe.Axe().axe_script)
    found = page.evaluate(AXE)
    return [f"{one['id']}: {node['target']} {node['html'][:90]}"
            for one in found for node in one["nodes"]]  # fmt: skip


def open_at(browser: Any, address: str, size: str) -> Any:  # noqa: F811
    """A new page of a size, in its first theme."""
    width, height = SIZES[size]
    page = browser.new_page(
        viewport={"width": width, "height": height}, color_scheme=FIRST[size], bypass_csp=True
    )
    page.goto(address)
    return page


def is_legible(page: Any) -> None:
    """Assert that nothing is outside, no panel is over another one, and axe finds nothing.

    Panels are measured when a frame is laid out, so one is waited for.
    """
    page.evaluate(FRAME)
    assert page.evaluate(OUTSIDE) == []
    assert page.evaluate(PANELS, ["card", "dock", "tools"]) == []
    assert violations(page) == []


def change_theme(page: Any, size: str) -> str:
    """Give a page the other theme, as the system would; returns its name."""
    (other,) = set(THEMES) - {FIRST[size]}
    page.emulate_media(color_scheme=other)
    return other


@pytest.mark.parametrize("size", SIZES)
def test_the_page_fits_and_can_be_read(browser: Any, replayed: str, size: str):  # noqa: F811
    page = open_at(browser, replayed, size)
    page.wait_for_selector("html[data-drawn]")
    page.wait_for_selector("#drive:not([hidden])")
    for act in ("unmask", "mask"):
        page.evaluate(POST, {"action": act})
        page.wait_for_selector(f"#mask[aria-pressed={str(act == 'mask').lower()}]")
        page.evaluate(FRAME)
        assert page.evaluate(OUTSIDE) == []
        assert page.evaluate(PANELS, ["card", "dock", "tools"]) == []
        assert page.evaluate("() => document.getElementById('p').getClientRects().length") == 1
        assert page.evaluate("() => document.getElementById('p').offsetHeight") < 48
    small = min(SIZES[size]) < 400
    assert page.evaluate(MAP_FREE) > (0.42 if small else 0.6)
    assert violations(page) == []
    if small:
        free = page.evaluate(MAP_FREE)
        page.click("#fold")
        page.evaluate(FRAME)
        assert abs(page.evaluate(MAP_FREE) - free) > 0.05
        is_legible(page)
        assert max(free, page.evaluate(MAP_FREE)) > 0.5
    page.wait_for_selector(f"html[data-theme={change_theme(page, size)}]")
    is_legible(page)
    if small:
        page.click("#fold")
        is_legible(page)
    page.evaluate(POST, {"action": "unmask"})
    page.close()


@pytest.mark.parametrize("size", SIZES)
def test_the_report_fits_and_can_be_read(browser: Any, report: Path, size: str):  # noqa: F811
    page = open_at(browser, report.as_uri(), size)
    page.wait_for_selector("html[data-ready]")
    assert page.evaluate(OUTSIDE) == []
    assert page.evaluate("() => document.documentElement.scrollWidth") <= SIZES[size][0]
    assert violations(page) == []
    page.wait_for_selector(f"html[data-theme={change_theme(page, size)}]")
    assert page.evaluate(OUTSIDE) == []
    assert violations(page) == []
    page.close()


def test_page_and_report_tell_level_places_and_sensors(browser: Any, replayed: str, report: Path):  # noqa: F811
    for address in (replayed, report.as_uri()):
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(f"{address}#t=40&z=17")
        page.wait_for_selector("html[data-drawn], html[data-ready]")
        page.wait_for_function("() => document.getElementById('ahead').children.length > 1")
        ahead = page.locator("#ahead li").first.inner_text()
        assert "Sign of a long name" in ahead
        assert " m" in ahead
        assert "%" in ahead
        assert page.locator("#ladder li").count() >= 2
        page.wait_for_selector("#level:not([hidden])")
        assert "tunnel" in page.inner_text("#level")
        rows = page.locator("#sensors li").all_inner_texts()
        assert len(rows) == 5
        assert "10 Hz" in rows[1]
        assert "scale" in rows[1]
        assert "not heard" in rows[4]
        page.close()
