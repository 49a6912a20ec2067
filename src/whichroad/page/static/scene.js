// What moves, drawn on a canvas above whatever map: track, roads in question, fixes, vehicle.
//
// A view projects: {project(lon, lat) -> {x, y}, width, height, bounds: [west, south, east, north]}.
// Nothing here knows the map.

import { drawPlaces } from "./beside.js";
import { CHI_95, STATUSES, colourOf, percent, roadLook, titleOf } from "./look.js";
import { roadsOf } from "./series.js";

const EARTH = 6371008.8;
const NEAR = 0.02; // hypotheses below this P are drawn thin and without a label
const STEPS = 40; // points of an ellipse
const LOOK_FROM = 30; // m; where they are smaller than a dozen pixels roads have no labels
const SHIFTS = [0, -21, 21, -42, 42, -63, 63]; // pixels by which a label makes room for another
const AHEAD = 58; // pixels from the vehicle to the label of its road

/** Draws everything of one moment.
 * scene: {series, now, frame, edges, fixes, reckoning, trail, preview: the row under the pointer, or -1} */
export function drawScene(ctx, view, scene, look) {
  ctx.clearRect(0, 0, view.width, view.height);
  ctx.lineJoin = ctx.lineCap = "round";
  const frame = scene.frame;
  if (scene.future > 0) drawTrack(ctx, view, scene.series, scene.now, scene.series.length - 1, look, scene.future);
  drawTrack(ctx, view, scene.series, scene.trail ?? 0, scene.now, look, 0.85);
  if (scene.preview >= 0) drawPreview(ctx, view, scene.series, scene.preview, look);
  if (!frame) return;
  drawRoads(ctx, view, scene, look);
  drawReckoning(ctx, view, scene, look);
  drawFixes(ctx, view, scene, look);
  drawPlaces(ctx, view, frame, look);
  if (!frame.pose) return;
  const labels = [];
  drawHypotheses(ctx, view, scene, look, labels);
  drawPills(ctx, labels, look);
  drawVehicle(ctx, view, frame, look);
}

/** The track so far, along the roads between points far apart, coloured by P(road); what is out of sight or within two pixels is passed over. */
function drawTrack(ctx, view, series, from, to, look, alpha) {
  const paths = new Map();
  let last = null; // the last place drawn to
  let side = 0; // on which sides of the view the last row lies
  let low = 1;
  for (let i = from; i <= to; i += 1) {
    const lat = series.get("lat", i);
    const lon = series.get("lon", i);
    const here = Number.isNaN(lat) ? 16 : outside(view.bounds, lon, lat);
    const route = i > from ? series.routeTo(i) : undefined; // of a point far from the one before
    low = Math.min(low, series.get("p", i));
    if ((here & side && !route) || here & 16) {
      last = null;
    } else {
      const at = view.project(lon, lat);
      if (!last && i > from && !(side & 16)) last = view.project(series.get("lon", i - 1), series.get("lat", i - 1));
      if (last && !route && i < to && Math.abs(at.x - last.x) + Math.abs(at.y - last.y) < 2) {
        side = here;
        continue;
      }
      if (last) {
        const key = Math.round(20 * low) / 20;
        if (!paths.has(key)) paths.set(key, new Path2D());
        paths.get(key).moveTo(last.x, last.y);
        for (const [north, east] of route ?? []) {
          const over = view.project(east, north);
          paths.get(key).lineTo(over.x, over.y);
        }
        paths.get(key).lineTo(at.x, at.y);
      }
      last = at;
    }
    side = here;
    low = 1;
  }
  ctx.globalAlpha = alpha;
  ctx.lineWidth = 4;
  for (const [p, path] of paths) {
    ctx.strokeStyle = colourOf(p, look);
    ctx.stroke(path);
  }
  ctx.globalAlpha = 1;
}

/** A ring about the place of a row. */
function drawPreview(ctx, view, series, row, look) {
  const lat = series.get("lat", row);
  if (Number.isNaN(lat)) return;
  const at = view.project(series.get("lon", row), lat);
  for (const [width, colour] of [[6, look.paper], [3, look.ink]]) {
    ctx.beginPath();
    ctx.arc(at.x, at.y, 9, 0, 7);
    ctx.lineWidth = width;
    ctx.strokeStyle = colour;
    ctx.stroke();
  }
}

/** The sides of a box (west, south, east, north) that a place is beyond, as bits. */
function outside([west, south, east, north], lon, lat) {
  return (lon < west ? 1 : 0) | (lon > east ? 2 : 0) | (lat < south ? 4 : 0) | (lat > north ? 8 : 0);
}

/** The roads that the vehicle may be on, least probable first. */
function drawRoads(ctx, view, scene, look) {
  for (const [edge, p] of [...scene.roads].reverse()) {
    const known = scene.edges.get(edge);
    if (!known || p < 0.001) continue;
    const line = known.line.map(([lon, lat]) => view.project(lon, lat));
    const path = new Path2D();
    line.forEach((at, i) => (i ? path.lineTo(at.x, at.y) : path.moveTo(at.x, at.y)));
    ctx.strokeStyle = colourOfRoad(edge, scene.edges, look);
    ctx.globalAlpha = 0.1 + 0.36 * Math.sqrt(p);
    ctx.lineWidth = 15;
    ctx.stroke(path);
    ctx.globalAlpha = 0.3 + 0.6 * Math.sqrt(p);
    ctx.lineWidth = 1.5;
    ctx.stroke(path);
  }
  ctx.globalAlpha = 1;
}

function drawFixes(ctx, view, scene, look) {
  const fixes = scene.fixes;
  const now = scene.frame.epoch_s;
  fixes.forEach((fix, rank) => {
    const age = now - fix.epoch_s;
    if (age < -0.5) return;
    const at = view.project(fix.lon, fix.lat);
    const newest = fixes.length - rank;
    const fade = Math.max(0.12, 1 - age / 45);
    ctx.strokeStyle = ctx.fillStyle = fix.masked ? look.masked : look.fix;
    if (fix.ellipse && newest <= 4 && age < 8) {
      ctx.globalAlpha = fade * (newest === 1 ? 0.9 : 0.3);
      ctx.lineWidth = 1.2;
      ctx.setLineDash(fix.masked ? [2, 4] : []);
      ctx.stroke(ellipsePath(view, fix, fix.ellipse));
      ctx.setLineDash([]);
    }
    ctx.globalAlpha = fade;
    ctx.lineWidth = 1.6;
    ctx.beginPath();
    if (fix.masked || fix.believed === false) {
      ctx.moveTo(at.x - 3, at.y - 3);
      ctx.lineTo(at.x + 3, at.y + 3);
      ctx.moveTo(at.x + 3, at.y - 3);
      ctx.lineTo(at.x - 3, at.y + 3);
      ctx.stroke();
    } else {
      ctx.arc(at.x, at.y, 3, 0, 7);
      ctx.fill();
      ctx.globalAlpha = 0.8 * fade;
      ctx.lineWidth = 1;
      ctx.strokeStyle = look.paper;
      ctx.stroke();
    }
  });
  ctx.globalAlpha = 1;
}

/** Wheels alone: dashed, with an empty arrow at its end. */
function drawReckoning(ctx, view, scene, look) {
  const track = scene.reckoning;
  if (track.length < 2) return;
  ctx.strokeStyle = look.reckoning;
  ctx.lineWidth = 2;
  ctx.setLineDash([6, 5]);
  ctx.beginPath();
  track.forEach(([lon, lat], i) => {
    const at = view.project(lon, lat);
    if (i) ctx.lineTo(at.x, at.y);
    else ctx.moveTo(at.x, at.y);
  });
  ctx.stroke();
  ctx.setLineDash([]);
  const end = track[track.length - 1];
  arrow(ctx, view, { lon: end[0], lat: end[1], bearing_deg: end[2] }, 8);
  ctx.fillStyle = look.paper;
  ctx.fill();
  ctx.stroke();
}

function colourOfRoad(edge, edges, look) {
  const known = edges.get(edge);
  return roadLook(titleOf(edge ?? -1, known?.name, known?.highway), look).colour;
}

/** Every hypothesis in the colour of its road; each road's P stands on it, some distance ahead. */
function drawHypotheses(ctx, view, { frame, edges }, look, labels) {
  const shares = new Map(roadsOf(frame.hypotheses));
  if (shares.size < 2 || Math.max(...shares.values()) > 0.998) return;
  const labelled = new Set();
  const here = view.project(frame.pose.lon, frame.pose.lat);
  const there = moved(frame.pose.lon, frame.pose.lat, LOOK_FROM, 0);
  const close = Math.abs(view.project(there.lon, there.lat).x - here.x) > 12;
  for (const one of close ? frame.hypotheses : []) {
    const share = shares.get(one.edge_id ?? -1);
    if (share < NEAR || labelled.has(one.edge_id)) continue;
    labelled.add(one.edge_id);
    const pose = one.lat === null ? frame.pose : one;
    const at = view.project(pose.lon, pose.lat);
    const known = edges.get(one.edge_id);
    const foot = known && footOn(known.line.map(([lon, lat]) => view.project(lon, lat)), at);
    labels.push({ ...(foot ? foot.ahead : at), text: percent(share), colour: colourOfRoad(one.edge_id, edges, look), foot });
  }
  for (const one of [...frame.hypotheses].reverse()) {
    if (one.lat === null || one.p < 0.002) continue;
    const strong = one.p >= NEAR;
    ctx.strokeStyle = colourOfRoad(one.edge_id, edges, look);
    ctx.globalAlpha = strong ? 1 : 0.55;
    ctx.lineWidth = strong ? 1.6 : 1;
    if (one.ellipse) ctx.stroke(ellipsePath(view, one, one.ellipse));
    arrow(ctx, view, one, strong ? 9 : 6);
    ctx.lineWidth = 2;
    ctx.fillStyle = look.paper;
    ctx.fill();
    ctx.stroke();
  }
  ctx.globalAlpha = 1;
}

function drawVehicle(ctx, view, frame, look) {
  const status = STATUSES.includes(frame.status) ? frame.status : "lost";
  const colour = colourOf(frame.p_way, look);
  if (frame.ellipse) {
    const path = ellipsePath(view, frame.pose, frame.ellipse);
    ctx.fillStyle = colour;
    ctx.globalAlpha = 0.16;
    ctx.fill(path);
    ctx.globalAlpha = 0.95;
    ctx.strokeStyle = colour;
    ctx.lineWidth = 2;
    ctx.setLineDash(frame.dead_reckoning || status === "outage" ? [7, 5] : []);
    ctx.stroke(path);
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }
  const { matched_lat: lat, matched_lon: lon } = frame.road;
  if (lat !== null && lat !== undefined) {
    const foot = view.project(lon, lat);
    const at = view.project(frame.pose.lon, frame.pose.lat);
    ctx.strokeStyle = ctx.fillStyle = look.ink;
    ctx.lineWidth = 1;
    ctx.beginPath();
    ctx.moveTo(at.x, at.y);
    ctx.lineTo(foot.x, foot.y);
    ctx.stroke();
    ctx.beginPath();
    ctx.arc(foot.x, foot.y, 2.2, 0, 7);
    ctx.fill();
  }
  ctx.shadowColor = "rgba(0,0,0,0.35)";
  ctx.shadowBlur = 6;
  arrow(ctx, view, frame.pose, 15);
  ctx.lineWidth = 5;
  ctx.strokeStyle = "#ffffff";
  ctx.stroke();
  ctx.shadowBlur = 0;
  ctx.shadowColor = "transparent";
  ctx.fillStyle = colour;
  ctx.fill();
}

/** Traces an arrow head at a pose, as large as asked for (pixels); returns where it is. */
function arrow(ctx, view, pose, size) {
  const at = view.project(pose.lon, pose.lat);
  const ahead = offset(pose.lon, pose.lat, pose.bearing_deg ?? 0, 1);
  const tip = view.project(ahead.lon, ahead.lat);
  const angle = Math.atan2(tip.y - at.y, tip.x - at.x);
  const turn = (forward, left) => [
    at.x + size * (forward * Math.cos(angle) + left * Math.sin(angle)),
    at.y + size * (forward * Math.sin(angle) - left * Math.cos(angle)),
  ];
  ctx.beginPath();
  if (pose.bearing_deg === null || pose.bearing_deg === undefined) {
    ctx.arc(at.x, at.y, 0.5 * size, 0, 7);
    return at;
  }
  ctx.moveTo(...turn(1, 0));
  ctx.lineTo(...turn(-0.8, 0.75));
  ctx.lineTo(...turn(-0.42, 0));
  ctx.lineTo(...turn(-0.8, -0.75));
  ctx.closePath();
  return at;
}

/** The 95 % ellipse of a 1 sigma ellipse about a place. */
function ellipsePath(view, place, ellipse) {
  const path = new Path2D();
  const turn = (ellipse.bearing_deg * Math.PI) / 180;
  for (let k = 0; k < STEPS; k += 1) {
    const angle = (2 * Math.PI * k) / STEPS;
    const along = CHI_95 * ellipse.major_m * Math.cos(angle);
    const across = CHI_95 * ellipse.minor_m * Math.sin(angle);
    const east = along * Math.sin(turn) + across * Math.cos(turn);
    const north = along * Math.cos(turn) - across * Math.sin(turn);
    const { lon, lat } = moved(place.lon, place.lat, east, north);
    const at = view.project(lon, lat);
    if (k) path.lineTo(at.x, at.y);
    else path.moveTo(at.x, at.y);
  }
  path.closePath();
  return path;
}

function moved(lon, lat, east, north) {
  const degree = 180 / (Math.PI * EARTH);
  return { lon: lon + (east * degree) / Math.cos((lat * Math.PI) / 180), lat: lat + north * degree };
}

function offset(lon, lat, bearing, metres) {
  const angle = (bearing * Math.PI) / 180;
  return moved(lon, lat, metres * Math.sin(angle), metres * Math.cos(angle));
}

/** The point of a line that is nearest to a place, and one some pixels ahead of it, or behind. */
function footOn(line, at) {
  let best = null;
  for (let i = 0; i + 1 < line.length; i += 1) {
    const [a, b] = [line[i], line[i + 1]];
    const [dx, dy] = [b.x - a.x, b.y - a.y];
    const square = dx * dx + dy * dy || 1e-9;
    const t = Math.min(Math.max(((at.x - a.x) * dx + (at.y - a.y) * dy) / square, 0), 1);
    const [x, y] = [a.x + t * dx, a.y + t * dy];
    const away = Math.hypot(x - at.x, y - at.y);
    if (!best || away < best.away) best = { x, y, away, i };
  }
  if (!best) return null;
  const forth = walked(best, line.slice(best.i + 1));
  if (forth.left < 0.4 * AHEAD) return { ...best, ahead: forth };
  const back = walked(best, line.slice(0, best.i + 1).reverse());
  return { ...best, ahead: back.left < forth.left ? back : forth };
}

/** Some pixels along a line; `left` is what the line was too short for. */
function walked(from, line) {
  let left = AHEAD;
  let { x, y } = from;
  for (const next of line) {
    const long = Math.hypot(next.x - x, next.y - y);
    const share = Math.min(left / (long || 1e-9), 1);
    [x, y] = [x + share * (next.x - x), y + share * (next.y - y)];
    left -= share * long;
    if (left <= 1e-6) break;
  }
  return { x, y, left };
}

/** Labels, the most probable first; one that would hide another stands above or below it. */
function drawPills(ctx, labels, look) {
  const taken = [];
  ctx.font = "600 11px system-ui, sans-serif";
  for (const label of labels) {
    const free = (shift) => !taken.some(({ x, y }) => Math.abs(x - label.x) < 50 && Math.abs(y - label.y - shift) < 20);
    const shift = SHIFTS.find(free);
    if (shift === undefined) continue;
    taken.push({ ...label, y: label.y + shift });
    drawPill(ctx, taken[taken.length - 1], look);
  }
}

function drawPill(ctx, { x, y, text, colour }, look) {
  const width = ctx.measureText(text).width + 12;
  const [left, top] = [x - width / 2, y - 9];
  ctx.beginPath();
  ctx.roundRect(left, top, width, 18, 9);
  ctx.fillStyle = look.paper;
  ctx.fill();
  ctx.strokeStyle = colour;
  ctx.lineWidth = 2;
  ctx.stroke();
  ctx.fillStyle = look.ink;
  ctx.fillText(text, left + 6, top + 13);
}
