// The report: one drive in one file, with a cursor that can be moved through it.

import { besideAt, numbersOfPlace, placesOf } from "./beside.js";
import { drawDrive, drawRace, sharp } from "./chart.js";
import { LOOK, STATUS, STATUSES, clock, keepTheme, lookOf, percent, themeWished, titleOf } from "./look.js";
import { copyLink, linked } from "./links.js";
import { Numbers, awayFrom, nearest, numbersOfFix, numbersOfMoment, numbersOfRoad, previewed } from "./numbers.js";
import { fillPanel } from "./panel.js";
import { PaperMap } from "./papermap.js";
import { drawScene } from "./scene.js";
import { fixesAt, fixesOf, fromTimeline, reckoningAt, roadsOf } from "./series.js";

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const { line, more } = data;
const series = fromTimeline(line, 0);
const edges = new Map(Object.entries(data.edges).map(([id, edge]) => [Number(id), edge]));
const fixes = fixesOf(line, 0);
const now = { look: LOOK[themeWished()], t: 0, k: 0, frame: null, follow: false, playing: false, timeAt: null, raceAt: null, preview: -1 };
const map = new PaperMap(element("map"), data.box, data.roads, (free) => {
  if (free) now.follow = false;
  refresh();
});

const dots = data.places.map(({ kind, worst }) => {
  const i = Math.max(0, series.find(worst + 1e-3) - 1);
  return { kind, worst, lon: series.get("lon", i), lat: series.get("lat", i) };
});
const numbers = new Numbers(element("numbers"));
const nameOf = (edge) => titleOf(edge, edges.get(edge)?.name, edges.get(edge)?.highway);

/** A tap leads to a place worth a look; of a fix, the track or a road it shows the numbers. */
map.onTap = (x, y) => {
  numbers.hide();
  const place = nearest(dots, (dot) => dot, x, y, 14);
  if (place) visit(place.worst);
  const found = place ? numbersOfMoment(series, Math.max(0, series.find(place.worst + 1e-3) - 1), 0, nameOf) : told(x, y);
  const box = element("map").getBoundingClientRect();
  if (found) numbers.show(found, box.left + x, box.top + y);
};

/** Numbers of what lies at a place on the map, if anything does. */
function told(x, y) {
  const view = map.view();
  const on = ([lon, lat]) => view.project(lon, lat);
  const fix = nearest(fixesAt(fixes, now.t), (one) => on([one.lon, one.lat]), x, y);
  if (fix) return numbersOfFix(fix, 0);
  const place = nearest(placesOf(now.frame), (one) => on([one.lon, one.lat]), x, y);
  if (place) return numbersOfPlace(now.frame, place);
  const rows = Array.from({ length: series.length }, (_, i) => i).filter((i) => !Number.isNaN(series.get("lat", i)));
  const row = nearest(rows, (i) => on([series.get("lon", i), series.get("lat", i)]), x, y);
  if (row !== null) return numbersOfMoment(series, row, 0, nameOf);
  const shares = new Map();
  series.eachRoad(now.k, (edge, p) => shares.set(edge, p));
  const roads = [
    ...[...edges].map(([edge, road]) => ({ ...road, edge })),
    ...data.roads.map(([, name, path]) => ({ name, line: path })),
  ];
  const road = roads.find((one) => awayFrom(one.line.map(on), x, y) < 9);
  return road && numbersOfRoad(road, shares.get(road.edge));
}

/** The message that the live service would have sent of row k. */
function frameOf(k) {
  const edge = more.edge[k];
  const known = edges.get(edge) ?? {};
  const poses = data.poses[k].map(([p, e, lat, lon, bearing, major, minor, axis]) => ({
    p, edge_id: e < 0 ? null : e, lat, lon, bearing_deg: bearing,
    ellipse: { major_m: major, minor_m: minor, bearing_deg: axis },
  }));
  const answered = line.lat[k] !== null;
  return {
    epoch_s: line.t[k], answered, status: STATUSES[line.status[k]], reason: data.reasons[more.reason[k]],
    pose: answered ? { lat: line.lat[k], lon: line.lon[k], bearing_deg: more.bearing[k], speed_mps: more.speed[k] } : null,
    ellipse: more.major[k] === null ? null : { major_m: more.major[k], minor_m: more.minor[k], bearing_deg: more.axis[k] },
    p_way: line.p[k], p_off_road: line.off[k], protection_m: more.protection[k], gnss_scale: more.scale[k],
    gnss_masked: line.masked[k] === 1, hypotheses: poses, sensors: [], ...besideAt(data.beside, k),
    road: {
      edge_id: edge < 0 ? null : edge, name: known.name, highway: known.highway,
      speed_limit_kmh: known.speed_limit_kmh, matched_lat: more.matched_lat[k], matched_lon: more.matched_lon[k],
    },
  };
}

let waiting = false;
function refresh() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    draw();
  });
}

function draw() {
  const { ctx, width, height } = sharp(element("map"));
  now.k = Math.max(0, Math.min(series.find(now.t + 1e-3), series.length) - 1);
  now.frame = frameOf(now.k);
  const roads = [];
  series.eachRoad(now.k, (edge, p) => roads.push([edge, p]));
  if (now.follow && now.frame.pose) map.lookAt(now.frame.pose.lon, now.frame.pose.lat);
  map.draw(ctx, now.look);
  const layer = sharp(element("overlay"));
  drawScene(
    layer.ctx, { ...map.view(), width, height },
    { series, now: now.k, frame: now.frame, edges, roads, fixes: fixesAt(fixes, now.t), reckoning: reckoningAt(line, now.k), future: 0.6, trail: 0, preview: now.preview },
    now.look,
  );
  drawDots(layer.ctx, map.view());
  fillPanel(now.frame, roads.length ? roads : roadsOf(now.frame.hypotheses), edges, now.look);
  element("time").textContent = `${clock(now.t)} / ${clock(series.end)}`;
  element("play").setAttribute("aria-pressed", String(now.playing));
  element("follow").setAttribute("aria-pressed", String(now.follow));
  now.raceAt = drawRace(element("race"), series, now.t, [now.t - 30, now.t + 30], now.look, nameOf);
  now.timeAt = drawDrive(element("strip"), series, now.t, now.look);
  element("strip").setAttribute("aria-valuenow", now.t.toFixed(0));
  element("strip").setAttribute("aria-valuetext", clock(now.t));
  markPlace();
}

/** The places to check, as dots on the map. */
function drawDots(ctx, view) {
  const { pose } = now.frame;
  const car = pose ? view.project(pose.lon, pose.lat) : { x: -99, y: -99 };
  dots.forEach((dot) => {
    const at = view.project(dot.lon, dot.lat);
    [dot.x, dot.y] = [at.x, at.y];
    if (Math.hypot(at.x - car.x, at.y - car.y) < 20) return;
    ctx.beginPath();
    ctx.arc(at.x, at.y, 4.5, 0, 7);
    ctx.fillStyle = lookOf(dot.kind)[now.look.name];
    ctx.strokeStyle = now.look.paper;
    ctx.lineWidth = 1.5;
    ctx.fill();
    ctx.stroke();
  });
}

function go(t) {
  now.t = Math.min(Math.max(t, series.begin), series.end);
  refresh();
}

const ZOOM = 17.2; // of web maps, about 50 degrees north, at a pixel a metre

/** The moment and the magnification that the address names. */
function goToLink() {
  const { t, z } = linked();
  if (t !== null) visit(series.begin + t);
  if (z !== null) map.magnification = 2 ** (z - ZOOM);
}

async function link() {
  element("toast").textContent = await copyLink(now.t - series.begin, ZOOM + Math.log2(map.magnification));
  element("toast").classList.add("shown");
  setTimeout(() => element("toast").classList.remove("shown"), 4000);
}

/** Close enough to see hypotheses apart. */
function visit(t) {
  if (map.magnification < 2.2) map.magnification = 2.6;
  now.follow = true;
  go(t);
}

// ---- words

function fillHead() {
  const { summary } = data;
  const km = summary.driven_m / 1000;
  element("title").textContent = data.drive_id;
  element("when").textContent = `${data.began.slice(0, 10)}, ${data.began.slice(11, 16)} UTC`;
  const shown = [
    ["driven", `${km.toFixed(km < 10 ? 2 : 1)} km`], ["in", clock(summary.duration_s)],
    ["mean P(way)", percent(summary.mean_p)],
    ["95 % ellipse, median", summary.major_95_m === null ? "–" : `${summary.major_95_m.toFixed(1)} m`],
    ["fixes", summary.fixes ? summary.fixes.toLocaleString("en") + (summary.fixes_masked ? `, ${summary.fixes_masked} masked` : "") : "–"],
  ];
  element("summary").replaceChildren(...shown.map(([name, value]) => {
    const box = document.createElement("div");
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    [dt.textContent, dd.textContent] = [name, value];
    box.append(dt, dd);
    return box;
  }));
}

function fillCredit() {
  element("credit").textContent = data.attribution;
}

function fillShares() {
  element("shares").replaceChildren(...Object.entries(data.summary.status).map(([word, share]) => {
    const part = document.createElement("span");
    part.style.flexGrow = share;
    part.style.background = STATUS[word][now.look.name];
    part.title = `${STATUS[word].word}: ${percent(share)} of the time`;
    return part;
  }));
  element("share-words").textContent = Object.entries(data.summary.status)
    .sort((a, b) => b[1] - a[1]).map(([word, share]) => `${STATUS[word].word} ${percent(share)}`).join(" · ");
}

function fillPlaces() {
  element("places-count").textContent = data.places.length || "none";
  element("places").replaceChildren(...data.places.map((place) => {
    const button = document.createElement("button");
    button.dataset.begin = place.begin;
    button.dataset.end = place.end;
    const dot = document.createElement("i");
    dot.style.background = lookOf(place.kind)[now.look.name];
    const when = document.createElement("span");
    when.className = "when";
    when.textContent = clock(place.begin);
    const what = document.createElement("span");
    what.className = "what";
    what.textContent = place.roads.join(STATUS[place.kind] ? " or " : ", ") || lookOf(place.kind).word;
    const how = document.createElement("span");
    how.className = "how";
    const long = place.end - place.begin;
    how.textContent = `${lookOf(place.kind).word}, ${long < 10 ? long.toFixed(1) : long.toFixed(0)} s${place.kind === "ambiguous" ? `, down to ${percent(place.p)}` : ""}`;
    button.append(dot, when, what, how);
    button.addEventListener("click", () => visit(place.worst));
    const row = document.createElement("li");
    row.append(button);
    return row;
  }));
}

function markPlace() {
  for (const button of element("places").querySelectorAll("button")) {
    const here = now.t >= Number(button.dataset.begin) - 0.05 && now.t <= Number(button.dataset.end) + 0.05;
    if (here) button.setAttribute("aria-current", "true");
    else button.removeAttribute("aria-current");
  }
}

// ---- buttons and keys

let last = 0;
function play(on) {
  now.playing = on;
  last = performance.now();
  if (on && now.t >= series.end) now.t = series.begin;
  if (on) {
    now.follow = true;
    if (map.magnification < 1) map.magnification = 1.6;
    requestAnimationFrame(tick);
  }
  refresh();
}

function tick(time) {
  if (!now.playing) return;
  go(now.t + (Math.min(time - last, 200) / 1000) * 4);
  last = time;
  if (now.t >= series.end) play(false);
  else requestAnimationFrame(tick);
}

function wear(name) {
  now.look = LOOK[name];
  document.documentElement.dataset.theme = name;
  fillShares();
  fillPlaces();
  refresh();
}

const doings = {
  play: () => play(!now.playing),
  follow: () => (now.follow ? ((now.follow = false), refresh()) : visit(now.t)),
  fit: () => {
    now.follow = false;
    map.fit();
    refresh();
  },
  "link-to": () => link(),
  in: () => map.zoom(1.6),
  out: () => map.zoom(1 / 1.6),
  theme: () => {
    const name = now.look.name === "dark" ? "light" : "dark";
    keepTheme(name);
    wear(name);
  },
};
for (const [id, act] of Object.entries(doings)) element(id).addEventListener("click", act);

function nextPlace(by) {
  const begins = data.places.map((place) => place.worst);
  const next = by > 0 ? begins.find((t) => t > now.t + 0.05) : begins.filter((t) => t < now.t - 0.05).pop();
  if (next !== undefined) visit(next);
}

const STROKES = {
  " ": doings.play, f: doings.follow, t: doings.theme, "+": doings.in, "=": doings.in, "-": doings.out,
  0: doings.fit, l: doings["link-to"], Escape: () => numbers.hide(), n: () => nextPlace(1), p: () => nextPlace(-1), ".": () => go(line.t[Math.min(now.k + 1, line.t.length - 1)]),
  ArrowRight: (shift) => go(now.t + (shift ? 30 : 5)), ArrowLeft: (shift) => go(now.t - (shift ? 30 : 5)),
  Home: () => go(series.begin), End: () => go(series.end),
};
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const act = STROKES[event.key] ?? STROKES[event.key.toLowerCase()];
  if (!act || (event.key === " " && event.target.tagName === "BUTTON")) return;
  event.preventDefault();
  act(event.shiftKey);
});
for (const kind of ["pointerdown", "pointermove"]) {
  element("strip").addEventListener(kind, (event) => {
    if (kind === "pointerdown") element("strip").setPointerCapture(event.pointerId);
    if (event.buttons && now.timeAt) go(now.timeAt(event.offsetX));
  });
}
element("race").addEventListener("click", (event) => {
  element("strip").focus();
  const t = now.raceAt?.(event.offsetX) ?? null;
  if (t !== null) go(t);
});
for (const [id, timeAt] of [["race", (px) => now.raceAt?.(px) ?? null], ["strip", (px) => now.timeAt?.(px) ?? null]]) {
  previewed(element(id), timeAt, () => series, numbers, (row) => numbersOfMoment(series, row, 0, nameOf), (row) => {
    now.preview = row;
    refresh();
  });
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => wear(themeWished()));
addEventListener("resize", refresh);

element("strip").setAttribute("aria-valuemax", series.end.toFixed(0));
fillHead();
fillCredit();
fillShares();
fillPlaces();
now.t = series.begin;
map.fit();
goToLink();
addEventListener("hashchange", goToLink);
draw(); // at once: the page is ready when its first moment is drawn
document.documentElement.dataset.ready = "report";
