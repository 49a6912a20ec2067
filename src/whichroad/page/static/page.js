// The page: messages in, map, panel and charts out; buttons and keys back to the server.

import { drawDrive, drawRace, sharp } from "./chart.js";
import { drawErrors, drawTruth } from "./errors.js";
import { followLinks, takeDrops, tellOfMap } from "./explore.js";
import { Edges, Feed, control, fetchJson, here } from "./feed.js";
import { copyLink, linked } from "./links.js";
import { LOOK, STATUSES, clock, keepTheme, themeWished, titleOf } from "./look.js";
import { Motion } from "./motion.js";
import { Numbers, numbersOfMoment, previewed } from "./numbers.js";
import { fillPanel } from "./panel.js";
import { drawScene } from "./scene.js";
import { Recent, Series, fixesAt, fixesOf, fromTimeline, reckoningAt, roadsOf } from "./series.js";
import { WorldMap } from "./worldmap.js";

const about = JSON.parse(document.getElementById("about").textContent);
const byId = (id) => document.getElementById(id);
const HOURS = 40000; // rows kept: more than an hour at 10 Hz
const CLOSE = 0.09; // s; rows closer than this are one
const FIXES = 60;
const BEHIND = 45;
const AHEAD = 15; // s of the race that lie ahead in a replay
const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 25];

const state = {
  frame: null, look: LOOK[themeWished()], follow: true, placed: false, recorded: false,
  series: new Series(HOURS), now: -1, fixes: new Recent(FIXES), reckoning: new Recent(3000),
  roads: [], version: null, dirty: false, stale: true, preview: -1, shown: null,
};
const world = new WorldMap("map", about, state.look, here);
const map = world.map;
const edges = new Edges(() => refresh());
const overlay = byId("overlay");
const motion = new Motion();
const numbers = new Numbers(byId("numbers"));

// ---- messages in

function take(message) {
  if (message.type === "timeline") return void loadTimeline();
  if (message.type !== "estimate") return;
  const before = state.frame;
  state.frame = message;
  motion.take(message, performance.now());
  state.roads = roadsOf(message.hypotheses);
  if (before && message.epoch_s < before.epoch_s - 1e-6) forget(message);
  keepRow(message);
  keepFix(message.fix);
  keepReckoning(message.reckoning);
  edges.need(state.roads.slice(0, 6).map(([edge]) => edge));
  if (!before) followLinks(goTo, (z) => map.setZoom(z));
  if (about.timeline && !state.recorded) {
    state.recorded = true;
    loadTimeline();
  }
  refresh();
}

/** To a moment of the drive that a link names; of now there is only one. */
function goTo(t) {
  if (state.frame.play.mode === "replay") seek(t);
}

/** When the times that are shown begin: with the drive, or with the day. */
function began() {
  const { epoch_s: now, play } = state.frame;
  if (state.recording) return state.recording.begin;
  return play.mode === "replay" ? now - (play.position_s ?? 0) : 86400 * Math.floor(now / 86400);
}

function nameOf(edge) {
  return titleOf(edge, edges.get(edge)?.name, edges.get(edge)?.highway);
}

/** Time went backwards.  The track of a recording that was turned back is no longer so; that of sensors whose clock was set back was driven all the same. */
function forget(message) {
  state.fixes.clear();
  state.reckoning.clear();
  if (message.play.mode === "live") state.series.endBefore(message.epoch_s - CLOSE);
  else if (!state.recording) state.series.clear();
}

function keepRow(message) {
  const series = state.series;
  if (state.recording) {
    state.now = Math.min(series.find(message.epoch_s + 1e-3), series.length) - 1;
    return;
  }
  if (!series.length || message.epoch_s - series.end >= CLOSE) {
    const lat = message.pose?.lat;
    const status = message.answered ? STATUSES.indexOf(message.status) : -1;
    series.push(
      {
        t: message.epoch_s, lat, lon: message.pose?.lon, p: message.p_way, off: message.p_off_road,
        status, masked: message.gnss_masked ? 1 : 0, major: message.ellipse?.major_m,
      },
      state.roads,
    );
  }
  state.now = series.length - 1;
}

function keepFix(fix) {
  if (fix && fix.epoch_s !== state.fixes.last?.epoch_s) state.fixes.push(fix);
}

function keepReckoning(one) {
  const track = state.reckoning;
  if (!one) return track.clear();
  if (track.since !== one.since_epoch_s) {
    track.clear();
    track.since = one.since_epoch_s;
  }
  const last = track.last;
  if (!last || Math.abs(last[0] - one.lon) + Math.abs(last[1] - one.lat) > 1e-6) {
    track.push([one.lon, one.lat, one.bearing_deg]);
  }
}

/** The whole of a recorded drive, for the strip to scrub in. */
async function loadTimeline() {
  const recording = await fetchJson("timeline").catch(() => null);
  if (recording?.begin !== state.recording?.begin) state.placed = false; // another drive
  state.recording = recording;
  if (!recording) return;
  state.preview = -1;
  byId("errors").hidden = byId("error-box").hidden = !recording.truth;
  measureDock();
  state.series = fromTimeline(recording, recording.begin);
  recording.drawn = fixesOf(recording, recording.begin);
  if (state.frame) keepRow(state.frame);
  refresh();
}

/** Card and attribution end above the dock, whatever it holds. */
function measureDock() {
  byId("app").style.setProperty("--dock", `${byId("dock").offsetHeight}px`);
}

// ---- drawing

/** Draws in the next frame; without `all` only what moves between two messages. */
function refresh(all = true) {
  state.stale ||= all;
  if (state.dirty) return;
  state.dirty = true;
  requestAnimationFrame(() => {
    state.dirty = false;
    if (state.frame) draw();
  });
}

function draw() {
  const now = performance.now();
  state.shown = motion.at(now);
  if (state.stale) {
    state.stale = false;
    fillPanel(state.frame, state.roads, edges, state.look);
    fillControls(state.frame);
    drawCharts(state.frame);
  }
  const { shown } = state;
  if (!(state.follow && shown.pose && camera(shown))) drawOverlay();
  if (motion.moves(now)) refresh(false);
}

/** Brings the vehicle to the middle; true where the map draws itself anew, overlay and all. */
function camera(frame) {
  const { lon, lat } = frame.pose;
  if (!state.placed) {
    state.placed = true;
    map.jumpTo({ center: [lon, lat], zoom: linked().z ?? 17, padding: paddings() });
    return true;
  }
  const at = map.getCenter();
  if (Math.abs(at.lng - lon) + Math.abs(at.lat - lat) < 2e-7) return false;
  map.jumpTo({ center: [lon, lat], padding: paddings() });
  return true;
}

/** What of the map the panels hide. */
function paddings(more = 0) {
  const whole = byId("map").getBoundingClientRect();
  const card = byId("card").getBoundingClientRect();
  const dock = byId("dock").getBoundingClientRect();
  const beside = card.width < 0.6 * whole.width;
  return {
    top: more, right: more, left: more + (beside ? card.right : 0),
    bottom: more + Math.max(0, whole.bottom - Math.min(dock.top, beside ? dock.top : card.top)),
  };
}

function drawOverlay() {
  const { ctx, width, height } = sharp(overlay);
  const recorded = Boolean(state.recording);
  const frame = state.shown ?? state.frame;
  const time = frame?.epoch_s ?? 0;
  const now = motion.moves(performance.now()) ? Math.max(0, state.now - 1) : state.now;
  const view = world.view(width, height);
  drawScene(
    ctx, view,
    {
      series: state.series, now, frame, edges, roads: state.roads, fixes: fixesShown(), preview: state.preview,
      reckoning: recorded ? reckoningAt(state.recording, state.now) : state.reckoning.items, future: recorded ? 0.28 : 0,
      trail: recorded ? 0 : Math.max(0, state.series.find(time - 600) - 1),
    },
    state.look,
  );
  const truth = state.recording?.truth;
  if (truth) drawTruth(ctx, view, truth, state.now, frame?.pose, state.look);
}

/** The last fixes. */
function fixesShown() {
  if (state.recording) return fixesAt(state.recording.drawn, state.frame?.epoch_s ?? 0);
  return state.fixes.items.slice(-FIXES);
}

function drawCharts(frame) {
  const now = frame.epoch_s;
  const span = state.recording ? [now - BEHIND, now + AHEAD] : [now - BEHIND - AHEAD, now];
  state.raceAt = drawRace(byId("race"), state.series, now, span, state.look, nameOf);
  const { length_s: length, position_s: position } = frame.play;
  const known = length !== null && length > 0;
  if (byId("drive").hidden === known) {
    byId("drive").hidden = !known;
    measureDock();
  }
  if (!known) return;
  state.began = now - (position ?? 0);
  const whole = state.recording ? undefined : [state.began, state.began + length];
  drawError();
  state.timeAt = drawDrive(byId("strip"), state.series, now, state.look, whole, !state.recording);
}

/** Where the truth is known: the error now, and over the drive. */
function drawError() {
  const truth = state.recording?.truth;
  if (!truth) return;
  const [error, bound] = [truth.error[state.now] ?? null, truth.bound[state.now] ?? null];
  byId("error").textContent = error === null || bound === null ? "–" : `${error.toFixed(1)} of ${bound.toFixed(1)} m`;
  drawErrors(byId("errors"), state.recording.t, truth, state.frame.epoch_s - state.recording.begin, state.look);
}

map.on("render", drawOverlay);

// ---- buttons and keys

function fillControls(frame) {
  const { play } = frame;
  const replay = play.mode === "replay";
  byId("play-group").hidden = !replay;
  press("mask", frame.gnss_masked);
  const fixed = state.recording?.maskable === false;
  byId("mask").disabled = fixed;
  byId("mask").title = fixed ? "A result without its drive: replay the drive to mask GNSS" : "Withhold GNSS from the filter (M)";
  byId("mask").lastElementChild.textContent = frame.gnss_masked ? "GNSS masked" : "Mask GNSS";
  press("pause", play.paused);
  byId("pause").setAttribute("aria-label", play.paused ? "Play" : "Pause");
  byId("step").disabled = !play.paused;
  const wanted = play.speed === null ? "max" : String(play.speed);
  if (byId("speed").value !== wanted && document.activeElement !== byId("speed")) byId("speed").value = wanted;
  const begin = frame.epoch_s - (play.position_s ?? 0);
  const time = replay && play.length_s !== null
    ? `${clock(play.position_s ?? 0)} / ${clock(play.length_s)}`
    : new Date(1000 * frame.epoch_s).toISOString().slice(11, 19) + " UTC";
  if (byId("time").textContent !== time) byId("time").textContent = time;
  const strip = byId("strip");
  if (replay && play.length_s !== null) {
    strip.setAttribute("aria-valuemax", play.length_s.toFixed(0));
    strip.setAttribute("aria-valuenow", (frame.epoch_s - begin).toFixed(0));
    strip.setAttribute("aria-valuetext", clock(play.position_s ?? 0));
  }
}

function press(id, on) {
  byId(id).setAttribute("aria-pressed", String(Boolean(on)));
}

async function ask(action, value) {
  const refused = await control(action, value).catch(() => "the service does not answer");
  if (refused) toast(refused);
}

let toastTimer = 0;
function toast(text) {
  byId("toast").textContent = text;
  byId("toast").classList.add("shown");
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => byId("toast").classList.remove("shown"), 4000);
}

function follow(on) {
  state.follow = on;
  press("follow", on);
  if (on && state.frame?.pose) {
    state.placed = map.getZoom() > 13;
    if (!camera(state.frame)) drawOverlay();
  }
}

function seek(seconds) {
  const length = state.frame?.play.length_s ?? 0;
  ask("seek", Math.min(Math.max(seconds, 0), length));
}

function faster(by) {
  const now = state.frame?.play.speed ?? SPEEDS[SPEEDS.length - 1];
  const at = SPEEDS.findIndex((speed) => speed >= now);
  ask("speed", SPEEDS[Math.min(Math.max(at + by, 0), SPEEDS.length - 1)]);
}

function theme() {
  const name = state.look.name === "dark" ? "light" : "dark";
  keepTheme(name);
  wear(name);
}

/** Panels to their headline, or as they were; only where the screen is small. */
function fold(on) {
  byId("app").classList.toggle("folded", on);
  byId("fold").setAttribute("aria-expanded", String(!on));
  refresh();
}

function legend(open) {
  if (open) byId("legend").show();
  else byId("legend").close();
}

function wear(name) {
  state.look = LOOK[name];
  document.documentElement.dataset.theme = name;
  world.recolour(state.look);
  refresh();
}

/** Shows the whole drive, or what is known of it. */
function fit() {
  const box = state.series.box();
  if (!box) return;
  follow(false);
  map.fitBounds([[box[0], box[1]], [box[2], box[3]]], { padding: paddings(40), maxZoom: 17, animate: false });
}

async function link() {
  const position = state.frame?.play.mode === "replay" ? state.frame.play.position_s : null;
  toast(await copyLink(position, map.getZoom()));
}

function save() {
  const anchor = document.createElement("a");
  anchor.href = here("report");
  anchor.download = "";
  anchor.click();
}

const acts = {
  mask: () => ask(state.frame?.gnss_masked ? "unmask" : "mask"),
  pause: () => ask(state.frame?.play.paused ? "resume" : "pause"),
  step: () => ask("step"),
  follow: () => follow(!state.follow),
  theme, fit, save,
  "link-to": link,
  in: () => map.zoomIn({ around: state.follow ? map.getCenter() : undefined }),
  out: () => map.zoomOut(),
  help: () => legend(!byId("legend").open),
  fold: () => fold(!byId("app").classList.contains("folded")),
};
for (const [id, act] of Object.entries(acts)) byId(id).addEventListener("click", act);
byId("legend-close").addEventListener("click", acts.help);
byId("speed").addEventListener("change", (event) => {
  ask("speed", event.target.value === "max" ? null : Number(event.target.value));
  event.target.blur();
});

const KEYS = {
  " ": acts.pause, k: acts.pause, m: acts.mask, f: acts.follow, t: theme, "?": acts.help, h: acts.help, p: acts.fold, 0: fit, l: link,
  "+": acts.in, "=": acts.in, "-": acts.out, ".": acts.step, ">": () => faster(1), "<": () => faster(-1),
  ArrowRight: (shift) => seek((state.frame?.play.position_s ?? 0) + (shift ? 30 : 5)),
  ArrowLeft: (shift) => seek((state.frame?.play.position_s ?? 0) - (shift ? 30 : 5)),
  Home: () => seek(0),
  Escape: () => {
    legend(false);
    numbers.hide();
  },
};
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
  const act = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
  if (!act || (event.key === " " && event.target.tagName === "BUTTON")) return;
  event.preventDefault();
  act(event.shiftKey);
});

const strip = byId("strip");
let lastSeek = 0;
function scrub(event) {
  if (!state.timeAt || performance.now() - lastSeek < 80) return;
  lastSeek = performance.now();
  seek(state.timeAt(event.offsetX) - state.began);
}
strip.addEventListener("pointerdown", (event) => {
  strip.setPointerCapture(event.pointerId);
  lastSeek = 0;
  scrub(event);
});
strip.addEventListener("pointermove", (event) => event.buttons && scrub(event));
strip.addEventListener("pointerup", (event) => {
  lastSeek = 0;
  scrub(event);
});

function preview(row) {
  state.preview = row;
  drawOverlay();
}
const told = (row) => numbersOfMoment(state.series, row, began(), nameOf);
previewed(byId("race"), (px) => state.raceAt?.(px) ?? null, () => state.series, numbers, told, preview);
previewed(strip, (px) => state.timeAt?.(px) ?? null, () => state.series, numbers, told, preview);
byId("race").addEventListener("click", (event) => {
  const t = state.raceAt?.(event.offsetX) ?? null;
  if (t !== null && state.recording) seek(t - state.recording.begin);
});
tellOfMap(world, numbers, { state, fixes: fixesShown, began, nameOf, overlay });
takeDrops(byId("app"), about.timeline, toast);
byId("save").hidden = !about.timeline;

map.on("dragstart", () => follow(false));
map.on("wheel", () => map.scrollZoom.enable(state.follow ? { around: "center" } : {}));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => wear(themeWished()));
addEventListener("resize", () => refresh());
new ResizeObserver(measureDock).observe(byId("dock"));
byId("more").open = innerWidth > 720;
if (innerWidth <= 720 && innerHeight <= 640) fold(true); // or the panels would hide most of the map

new Feed(take, (word) => {
  byId("app").classList.toggle("lost", word === "closed");
  if (word === "closed") toast("connection lost: trying again");
  byId("link").dataset.state = word;
  byId("link").title = { open: "connected", connecting: "connecting", closed: "connection lost: trying again" }[word];
});
map.on("sourcedata", function first(event) {
  if (event.sourceId !== "roads" || !event.tile || event.tile.state !== "loaded") return;
  map.off("sourcedata", first);
  map.once("render", () => requestAnimationFrame(() => {
    document.documentElement.dataset.drawn = performance.now().toFixed(0);
  }));
});
window.whichroad = { state, map, edges, take, motion };
