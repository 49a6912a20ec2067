// Words and figures beside the map; an element is touched only when its text changes.

import { fillAhead, fillLevel, fillSensors } from "./beside.js";
import { STATUS, colourOf, percent, roadLook, titleOf } from "./look.js";

const LISTED = 5; // roads in the list

const byId = (id) => document.getElementById(id);

function setText(id, text) {
  const element = byId(id);
  if (element && element.textContent !== text) element.textContent = text;
}

function number(value, unit, digits = 0) {
  return value === null || value === undefined || Number.isNaN(value) ? "–" : `${value.toFixed(digits)} ${unit}`;
}

/** Fills the panel from a message. roads: [[edge, p], ...]; known: edges by id. */
export function fillPanel(frame, roads, known, look) {
  const road = frame.road ?? {};
  const name = road.edge_id === null || road.edge_id === undefined
    ? frame.answered ? "Off the roads" : "Waiting for a fix"
    : titleOf(road.edge_id, road.name, road.highway);
  setText("road", name);
  setText("road-kind", kindOf(road));
  fillLimit(road.speed_limit_kmh);
  fillStatus(frame, look);
  const p = road.edge_id === null || road.edge_id === undefined ? frame.p_off_road : frame.p_way;
  setText("p", frame.answered ? percent(p) : "–");
  byId("p").style.color = frame.answered ? `color-mix(in srgb, ${colourOf(p, look)} 78%, var(--ink))` : "";
  fillRoads(roads, known, look);
  setText("speed-now", number(frame.pose ? 3.6 * (frame.pose.speed_mps ?? NaN) : null, "km/h"));
  setText("bearing", frame.pose ? compass(frame.pose.bearing_deg) : "–");
  setText("radius", number(frame.radius95_m ?? (frame.ellipse && 2.448 * frame.ellipse.major_m), "m", 1));
  setText("protection", number(frame.protection_m, "m", 1));
  setText("scale", frame.answered && frame.gnss_scale ? `× ${frame.gnss_scale.toFixed(1)}` : "–");
  const latency = frame.latency_ms ?? {};
  setText("latency", latency.p99 === null || latency.p99 === undefined ? "–"
    : `${latency.p50.toFixed(1)} / ${latency.p99.toFixed(1)} ms`);
  fillLevel(frame.levels);
  fillAhead(frame.ahead ?? null, frame.nearby ?? []);
  fillSensors(frame.sensors ?? [], frame.heard ?? []);
}

function kindOf(road) {
  if (!road.highway) return road.name ? `edge ${road.edge_id}` : "";
  return `${road.highway.replaceAll("_", " ")} · edge ${road.edge_id}`;
}

function compass(bearing) {
  const points = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
  return `${points[Math.round(bearing / 45) % 8]} ${Math.round(bearing)}°`;
}

function fillLimit(limit) {
  const sign = byId("limit");
  sign.hidden = !limit;
  if (limit) setText("limit", String(Math.round(limit)));
}

function fillStatus(frame, look) {
  const status = STATUS[frame.status] ?? STATUS.lost;
  const pill = byId("status");
  const word = frame.gnss_masked && frame.status !== "ambiguous" && frame.status !== "lost"
    ? "GNSS masked" : status.word;
  setText("status", frame.answered ? word : "waiting");
  pill.style.setProperty("--status", frame.answered ? status[look.name] : look.faint);
  setText("reason", reasonOf(frame));
}

/** The reason; the roads that compete are in the list already. */
function reasonOf(frame) {
  if (frame.status === "ambiguous") return ["several roads fit", ...frame.reason.split("; ").slice(1)].join("; ");
  return frame.reason || (frame.dead_reckoning ? "no sensor delivers: predicted ahead" : "");
}

function fillRoads(roads, known, look) {
  const list = byId("roads");
  const shown = roads.filter(([, p], rank) => p >= 0.001 || rank === 0).slice(0, LISTED);
  while (list.children.length < shown.length) list.append(rowOf());
  while (list.children.length > shown.length) list.lastChild.remove();
  shown.forEach(([edge, p], i) => {
    const [bar, name, share] = list.children[i].children;
    const title = titleOf(edge, known.get(edge)?.name, known.get(edge)?.highway);
    const kind = known.get(edge)?.kind;
    const suffix = edge >= 0 && known.has(edge) ? ` ${edge}${kind ? ` · ${kind}` : ""}` : "";
    if (name.dataset.title !== title + suffix) {
      name.dataset.title = title + suffix;
      name.textContent = title;
      const id = document.createElement("small");
      id.textContent = suffix;
      name.append(id);
    }
    const text = percent(p);
    if (share.textContent !== text) share.textContent = text;
    bar.style.transform = `scaleX(${p.toFixed(3)})`;
    bar.style.background = roadLook(title, look).colour;
  });
}

function rowOf() {
  const row = document.createElement("li");
  for (const kind of ["bar", "name", "share"]) {
    const part = document.createElement("span");
    part.className = kind;
    row.append(part);
  }
  return row;
}
