"""The page in headless Chromium: how soon roads are drawn, how smoothly it follows, what it keeps.

WebGL runs in software where there is no graphics card, which is the slowest it can be.
"""

import os
import shutil
import statistics
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from whichroad import Places, RoadMap, simulate_drive

from . import Figure, Options, Skipped

FLAGS = [
    "--no-sandbox", "--no-first-run", "--disable-background-networking", "--use-gl=angle",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
    "--js-flags=--expose-gc",
]  # fmt: skip
OPENED = 5  # times that the page is opened
FOLLOWED = 30.0  # s
MESSAGES = 360_000  # ten hours at 10 Hz
_WATCH = """
window.tasks = [];
new PerformanceObserver(list => {
  for (const task of list.getEntries()) tasks.push([task.startTime, task.duration]);
}).observe({entryTypes: ['longtask']});
"""
_FOLLOW = """async seconds => {
  tasks.length = 0;
  let drawn = 0;
  const count = () => { drawn += 1; };
  whichroad.map.on('render', count);
  await new Promise(done => setTimeout(done, 1000 * seconds));
  whichroad.map.off('render', count);
  return [drawn / seconds, Math.max(0, ...tasks.map(task => task[1]))];
}"""
_FEED = """async count => {
  const frame = structuredClone(whichroad.state.frame);
  whichroad.state.recording = null;
  whichroad.state.series.clear();
  const heap = () => { gc(); return performance.memory.usedJSHeapSize / 1e6; };
  const feed = async (from, to) => {
    for (let i = from; i < to; i += 1) {
      frame.epoch_s += 0.1;
      frame.pose.lat += 1e-6;
      if (frame.fix) { frame.fix = {...frame.fix, epoch_s: frame.epoch_s}; }
      whichroad.take(structuredClone(frame));
      if (i % 2000 === 0) await new Promise(done => setTimeout(done, 0));
    }
    await new Promise(done => setTimeout(done, 300));
    return heap();
  };
  const before = await feed(0, count / 4);
  return [before, await feed(count / 4, count)];
}"""


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless Chromium.

    Raises:
        Skipped: There is none, or nothing to drive it with.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise Skipped("playwright is not installed") from None
    found = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
    path = os.environ.get("WHICHROAD_CHROMIUM") or next(filter(None, found), None)
    if path is None:
        raise Skipped("no Chromium is on the PATH")
    with sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=path, args=FLAGS)


def run(options: Options) -> list[Figure]:
    """Open the page on a drive through Heidelberg, follow it, and feed it ten hours."""
    roads = RoadMap.from_osm(options.need("maps", "heidelberg.osm.pbf"))
    with replayed(roads) as address, chromium() as browser:
        drawn = [_opened(browser, address) for _ in range(OPENED)]
        options.say(f"first road drawn after {', '.join(f'{ms:.0f}' for ms in drawn)} ms")
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(_WATCH)
        page.goto(address)
        page.wait_for_selector("html[data-drawn]")
        page.wait_for_timeout(4000)
        rate, longest = page.evaluate(_FOLLOW, FOLLOWED)
        early, late = page.evaluate(_FEED, MESSAGES)
        browser.close()
    return [
        Figure(
            "page: first road drawn, Heidelberg", statistics.median(drawn) / 1e3, "<= 2", "s",
            OPENED,
        ),
        Figure("page: longest task while following", longest, "<= 100", "ms"),
        Figure("page: pictures a second while following at 10 Hz", rate, "", "1/s"),
        Figure(
            "page: memory after 10 hours at 10 Hz, over that after 2.5", late / early, "<= 1.2", "",
            MESSAGES,
        ),
        Figure("page: memory after 10 hours at 10 Hz", late, "", "MB"),
    ]  # fmt: skip


def _opened(browser: Any, address: str) -> float:
    """Milliseconds from the page's opening to its first drawn road, nothing cached."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.goto(address)
    page.wait_for_selector("html[data-drawn]")
    drawn = float(page.evaluate("() => document.documentElement.dataset.drawn"))
    context.close()
    return drawn


@contextmanager
def replayed(roads: RoadMap, length_m: float = 12_000.0) -> Iterator[str]:
    """A simulated drive with places about it, replayed on a free port."""
    import uvicorn

    from whichroad.live.web_server import listen
    from whichroad.replay.open_replay import Remaking, play_drive
    from whichroad.replay.replay_server import replay_app

    drive = simulate_drive(roads, seed=3, length_m=length_m, scenario="outage").drive
    door = listen("127.0.0.1", 0)
    edges = range(0, len(roads), 8)  # some of which lie ahead nearly always
    signs = Places({"edge_id": [*edges], "abscissa_m": [0.0] * len(edges)}, roads)
    app = replay_app(play_drive(Remaking(drive, roads, places=signs)), roads)
    server = uvicorn.Server(uvicorn.Config(app, log_level="error", lifespan="on"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [door]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield f"http://127.0.0.1:{door.getsockname()[1]}"
    server.should_exit = True
    thread.join(10)
