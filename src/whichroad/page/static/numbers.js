// What lies under the pointer, and its numbers: a fix, a road, a moment of the drive.

import { CHI_95, STATUS, STATUSES, clock, percent } from "./look.js";

const REACH = 10; // pixels within which something is meant
const SHOWN = 4; // roads of a moment

/** The thing that is nearest to a place on the screen, if it is near. at: gives {x, y} of one. */
export function nearest(things, at, x, y, reach = REACH) {
  let best = null;
  let least = reach;
  for (const thing of things) {
    const place = at(thing);
    const away = Math.hypot(place.x - x, place.y - y);
    if (away < least) [best, least] = [thing, away];
  }
  return best;
}

/** Distance of a place from a line of places, in pixels. */
export function awayFrom(line, x, y) {
  let least = Infinity;
  for (let i = 0; i + 1 < line.length; i += 1) {
    const [a, b] = [line[i], line[i + 1]];
    const [dx, dy] = [b.x - a.x, b.y - a.y];
    const t = Math.min(Math.max(((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy || 1e-9), 0), 1);
    least = Math.min(least, Math.hypot(a.x + t * dx - x, a.y + t * dy - y));
  }
  return least;
}

export function numbersOfFix(fix, began) {
  const rows = [["time", clock(fix.epoch_s - began)]];
  if (fix.ellipse) rows.push(["95 %", `${(CHI_95 * fix.ellipse.major_m).toFixed(1)} × ${(CHI_95 * fix.ellipse.minor_m).toFixed(1)} m`]);
  rows.push(["place", `${fix.lat.toFixed(6)}, ${fix.lon.toFixed(6)}`]);
  rows.push(["used", fix.masked ? "no: masked" : fix.believed === false ? "no: too far off" : "yes"]);
  return { title: "GNSS fix", rows };
}

/** road: as the server gives an edge; p: of being on it now, if it competes. */
export function numbersOfRoad(road, p) {
  const rows = [];
  if (road.highway) rows.push(["kind", road.highway.replaceAll("_", " ")]);
  if (road.speed_limit_kmh) rows.push(["limit", `${Math.round(road.speed_limit_kmh)} km/h`]);
  if (road.length_m) rows.push(["length", `${Math.round(road.length_m)} m`]);
  if (road.edge !== undefined) rows.push(["edge", String(road.edge)]);
  rows.push(["P now", p === undefined ? "–" : percent(p)]);
  return { title: road.name || "unnamed road", rows };
}

/** Row i of a series: its way, its status, the roads that compete. */
export function numbersOfMoment(series, i, began, nameOf) {
  const status = STATUS[STATUSES[series.get("status", i)]];
  const rows = [["P(way)", percent(series.get("p", i))], ["status", status ? status.word : "waiting"]];
  const sums = new Map();
  series.eachRoad(i, (edge, p) => sums.set(nameOf(edge), (sums.get(nameOf(edge)) ?? 0) + p));
  for (const [name, p] of [...sums].slice(0, SHOWN)) if (p >= 0.005) rows.push([name, percent(p)]);
  return { title: clock(series.get("t", i) - began), rows };
}

/** A small box with numbers beside a place on the screen. */
export class Numbers {
  constructor(box) {
    this.box = box;
    box.addEventListener("click", () => this.hide());
  }

  show({ title, rows }, x, y) {
    const head = document.createElement("b");
    head.textContent = title;
    const list = document.createElement("dl");
    for (const [name, value] of rows) {
      const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
      [dt.textContent, dd.textContent] = [name, value];
      list.append(dt, dd);
    }
    this.box.replaceChildren(head, list);
    this.box.hidden = false;
    const { offsetWidth: width, offsetHeight: height } = this.box;
    const left = x + 14 + width < innerWidth ? x + 14 : x - 14 - width;
    const top = y - 14 - height > 4 ? y - 14 - height : y + 14;
    this.box.style.left = `${Math.min(Math.max(4, left), Math.max(4, innerWidth - width - 4))}px`;
    this.box.style.top = `${Math.min(Math.max(4, top), Math.max(4, innerHeight - height - 4))}px`;
  }

  hide() {
    this.box.hidden = true;
  }
}

/**
 * Shows the numbers of the row under the pointer of a chart.
 *
 * timeAt(px) gives the time of a pixel, or null; rowAt(t) what to show; onRow(i) is told the row.
 */
export function previewed(canvas, timeAt, series, numbers, shown, onRow) {
  canvas.addEventListener("pointermove", (event) => {
    const t = event.buttons ? null : timeAt(event.offsetX);
    const i = t === null ? -1 : Math.min(series().find(t + 1e-6), series().length) - 1;
    if (i < 0) return;
    numbers.show(shown(i), event.clientX, canvas.getBoundingClientRect().top);
    onRow(i);
  });
  canvas.addEventListener("pointerleave", () => {
    numbers.hide();
    onRow(-1);
  });
}
