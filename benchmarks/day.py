"""A day at 10 Hz, time compressed: does the memory of the service and of its page stay flat?

The service runs as a user starts it, with a recording, a checkpoint, NMEA out and a listener, and
is asked for its history every second.  It plays a drive with wheels and fixes at 10 Hz over and
over.  So fast it publishes few messages; hence its parts also publish one after each fix of a
day, to a history, to NMEA and to the broadcaster.  The page is headless Chromium's: it takes a
message for every tenth of a second of a day, draws as often as it can, and meets new roads all
the time.

    python -m benchmarks day [--seconds S] [--classes service,messages,page]
"""

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whichroad import Localizer, RoadMap
from whichroad.live.app import Service
from whichroad.live.broadcaster import Broadcaster
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.nmea_output import sentences
from whichroad.live.playback import RecordedObservations
from whichroad.observations import WheelCounts

from . import Figure, Options
from .live.process import Listener, Served
from .live.throughput import tables
from .live.world import World, world
from .page import chromium, replayed

RATE = 10.0  # fixes and wheel readings a second
SPEED = 1000.0  # times real time, or as fast as it can
FLAT = "<= 1.1"
_FEED = """async ([from, count, edges]) => {
  const frame = structuredClone(whichroad.state.frame);
  if (from === 0) {
    whichroad.state.recording = null;
    whichroad.state.series = new whichroad.state.series.constructor(40000); // as of a live page
  } else {
    frame.epoch_s = whichroad.state.frame.epoch_s;
  }
  for (let i = from; i < from + count; i += 1) {
    frame.epoch_s += 0.1;
    frame.seq = i;
    frame.pose.lat += i % 20000 < 10000 ? 1e-6 : -1e-6;
    frame.fix = {...frame.fix, epoch_s: frame.epoch_s, lat: frame.pose.lat, lon: frame.pose.lon};
    const edge = Math.floor(i / 200) % edges;
    frame.hypotheses = [0, 1].map((k) => (
      {...frame.hypotheses[0], p: k ? 0.3 : 0.7, edge_id: (edge + k) % edges}));
    whichroad.take(structuredClone(frame));
    if (i % 1000 === 0) await new Promise((done) => setTimeout(done, 0));
  }
  await new Promise((done) => setTimeout(done, 500));
  gc();
  return [performance.memory.usedJSHeapSize / 1e6, document.getElementsByTagName('*').length,
          whichroad.state.series.length];
}"""


def run(options: Options) -> list[Figure]:
    """One after the other."""
    hours = float(options.more.get("seconds", 86_400.0)) / 3600.0
    parts = {"service": service, "messages": messages, "page": page}
    wanted = str(options.more.get("classes", ",".join(parts))).split(",")
    return [figure for name in wanted for figure in parts[name](options, hours)]


def service(options: Options, hours: float) -> list[Figure]:
    """Resident memory of `whichroad live` after a quarter of the time, and after all of it."""
    seen = []
    with world() as here:
        here = slower(here)
        files = tables(here)
        play = ("--play", files[0], "--play", files[1], "--laps", 100_000)
        play += ("--speed", SPEED)
        out = ("--record", here.folder / "rec", "--state", here.folder / "state")
        out += ("--nmea-out", "tcp://127.0.0.1:0")
        with Served(*here.options(), *play, *out, out=True) as served:
            first = served.answered()["epoch_s"]
            listener, asked, driven = Listener(served.port), 0.0, 0.0
            while driven < 3600.0 * hours:
                listener.read()
                listener.heard.clear()
                if time.monotonic() - asked < 1.0:
                    continue
                asked = time.monotonic()
                said, _ = served.get("/estimate"), served.get("/history")
                driven = said["epoch_s"] - first
                seen.append((driven / 3600.0, served.memory(), said["seq"]))
                if len(seen) % 20 == 0:
                    options.say(f"service: {driven / 3600.0:.1f} h, {seen[-1][1]:.0f} MB")
            served.kill()
    at, memory, seq = np.array(seen).T
    early = float(np.median(memory[(at > 0.2 * hours) & (at < 0.3 * hours)]))
    late = float(np.median(memory[at > 0.9 * hours]))
    n = int(seq[-1] - seq[0])
    return [
        Figure(f"service: memory after {hours:g} h over that after a quarter", late / early, FLAT,
               "", n),
        Figure(f"service: memory after {hours:g} h at 10 Hz", late, "", "MB", n),
    ]  # fmt: skip


def messages(options: Options, hours: float) -> list[Figure]:
    """Resident memory of this process while every fix of the day gives a message."""
    seen, count, end = [], 0, int(3600.0 * RATE * hours)
    with world() as here:
        here = slower(here)
        loop = FilterLoop(Localizer(RoadMap.open(here.map), vehicle=here.vehicle), window=0.0)
        service = Service(loop, Broadcaster())
        loop.sinks.append(lambda text, message: sentences(message))
        played = RecordedObservations(here.drive, 100_000)
        for i in range(len(played)):
            if loop.observe([played[i]]):
                loop.publish()
                count += 1
                if count % (end // 48) == 0:
                    seen.append(resident())
                    options.say(f"messages: {count / 36_000:.1f} h, {seen[-1]:.0f} MB")
            if count == end:
                break
        kept = len(next(iter(service.vehicles.values())).history)
    early, late = float(np.median(seen[10:14])), float(np.median(seen[-4:]))
    return [
        Figure(f"messages: memory after {hours:g} h over that after a quarter", late / early, FLAT,
               "", count),
        Figure(f"messages: memory after {hours:g} h at 10 Hz", late, "", "MB", count),
        Figure("messages: kept in the history", float(kept), "<= 1501", "", count),
    ]  # fmt: skip


def resident() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def slower(here: World) -> World:
    """The world's drive with wheels at the rate of its fixes."""
    log = here.drive.odometry
    every = WheelCounts(log.time[::10], log.left[::10], log.right[::10])
    return replace(here, drive=replace(here.drive, odometry=every))


def page(options: Options, hours: float) -> list[Figure]:
    """Memory and elements of the page, likewise."""
    messages = int(3600.0 * RATE * hours)
    piece = messages // 24
    seen: list[Any] = []
    with world() as here:
        roads = RoadMap.open(here.map)
        with replayed(roads, length_m=3000.0) as address, chromium() as browser:
            opened = browser.new_page(viewport={"width": 1280, "height": 800})
            opened.goto(address)
            opened.wait_for_selector("html[data-drawn]")
            opened.wait_for_function("() => whichroad.state.frame && whichroad.state.recording")
            opened.evaluate(
                "() => fetch('control', {method: 'POST', body: JSON.stringify({action: 'pause'})})"
            )
            opened.wait_for_timeout(1000)
            for k in range(24):
                seen.append(opened.evaluate(_FEED, [k * piece, piece, len(roads)]))
                options.say(f"page: {(k + 1) * hours / 24:g} h, {seen[-1][0]:.1f} MB")
            browser.close()
    heap, elements, rows = np.array(seen).T
    early, late = float(np.median(heap[5:7])), float(np.median(heap[-2:]))
    return [
        Figure(f"page: memory after {hours:g} h over that after a quarter", late / early, FLAT, "",
               messages),
        Figure(f"page: memory after {hours:g} h at 10 Hz", late, "", "MB", messages),
        Figure("page: elements after it, over those after a quarter",
               float(elements[-1] / elements[5]), "<= 1.02", "", messages),
        Figure("page: rows kept", float(rows[-1]), "<= 40000", "", messages),
    ]  # fmt: skip
