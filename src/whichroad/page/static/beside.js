// What is beside the road's name: its level, the places ahead and near, the sensors as heard.

import { clock, percent } from "./look.js";

const REACH_M = 500; // of the ladder
const ROWS_AHEAD = 3; // places in the list
const ROWS_NEAR = 2;
const LEVELS_FROM = 0.01; // P of a bridge or a tunnel that is worth a word
const HEARD_S = 2; // s after a reading, within which a sensor without a rate has just begun
const NAMED_FROM = 0.3; // P from which on a place has its name on the map

const ICONS = {
  bridge: "M2 16h20M4 16v-3a8 8 0 0 1 16 0v3M12 5v8",
  tunnel: "M3 20v-8a9 9 0 0 1 18 0v8M8.500 20v-7a3.500 3.500 0 0 1 7 0v7",
  ground: "M2 17h20M7 17v-4M12 17v-4M17 17v-4",
};

const box = (id) => document.getElementById(id);

function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Makes a list as long as it has to be; a row has parts of these classes. */
function rowsOf(list, count, parts) {
  while (list.children.length < count) {
    const row = document.createElement("li");
    for (const kind of parts) {
      const part = document.createElement("span");
      part.className = kind;
      row.append(part);
    }
    list.append(row);
  }
  while (list.children.length > count) list.lastChild.remove();
  return [...list.children];
}

// ---- the level

/** Words of a level: {level, kind, p}. */
export function levelWord({ level, kind }) {
  if (kind === "ground") return level === 0 ? "ground" : `level ${level > 0 ? "+" : "−"}${Math.abs(level)}`;
  return Math.abs(level) > 1 ? `${kind} ${level > 0 ? "+" : "−"}${Math.abs(level)}` : kind;
}

/** Bridges and tunnels that the road may be on or in; nothing where all is on the ground. */
export function fillLevel(levels) {
  const known = (levels ?? []).filter((one) => one.kind !== null && one.p >= LEVELS_FROM);
  const shown = known.some((one) => one.kind !== "ground" || one.level !== 0) ? known.slice(0, 3) : [];
  box("level").hidden = !shown.length;
  rowsOf(box("level"), shown.length, ["icon", "word", "share"]).forEach((row, i) => {
    const [icon, word, share] = row.children;
    if (icon.dataset.kind !== shown[i].kind) {
      icon.dataset.kind = shown[i].kind;
      icon.innerHTML = `<svg viewBox="0 0 24 24" aria-hidden="true"><path d="${ICONS[shown[i].kind]}"/></svg>`;
    }
    row.dataset.kind = shown[i].kind;
    row.style.setProperty("--strength", `${Math.round(12 + 20 * shown[i].p)}%`);
    say(word, levelWord(shown[i]));
    say(share, percent(shown[i].p));
  });
}

// ---- places

const metresOf = (one) => `${one.distance_m.toFixed(0)} ± ${one.sigma_m < 10 ? one.sigma_m.toFixed(one.sigma_m < 1 ? 1 : 0) : one.sigma_m.toFixed(0)} m`;

const isSame = (a, b) => a.id === b.id && a.lat === b.lat && a.lon === b.lon;

/** Places ahead as a ladder and a list, those near below them; null: there are no places. */
export function fillAhead(ahead, nearby) {
  box("beside").hidden = !ahead;
  if (!ahead) return;
  const ladder = box("ladder");
  rowsOf(ladder, ahead.length, ["whisker", "mark"]).forEach((row, i) => {
    const { distance_m: metres, sigma_m: sigma, p } = ahead[i];
    const [low, at, high] = [metres - sigma, metres, metres + sigma].map((m) => Math.min(Math.max(m / REACH_M, 0), 1));
    row.style.opacity = (0.25 + 0.75 * p).toFixed(2);
    row.children[0].style.transform = `translateX(${(100 * low).toFixed(2)}%) scaleX(${(high - low).toFixed(4)})`;
    row.children[1].style.transform = `translateX(${(100 * at).toFixed(2)}%)`;
  });
  const others = nearby.filter((one) => !ahead.some((there) => isSame(one, there)));
  const shown = [
    ...ahead.slice(0, ROWS_AHEAD).map((one) => [one, "ahead"]),
    ...others.slice(0, ROWS_NEAR).map((one) => [one, "near"]),
  ];
  rowsOf(box("ahead"), shown.length, ["mark", "name", "metres", "share"]).forEach((row, i) => {
    const [one, kind] = shown[i];
    row.dataset.kind = kind;
    row.title = kind === "ahead" ? "along the road, if it is passed; P of passing it" : "in a straight line; P of being within 50 m";
    const [, name, metres, share] = row.children;
    say(name, String(one.id));
    say(metres, metresOf(one));
    say(share, percent(one.p));
  });
  const more = Math.max(ahead.length - ROWS_AHEAD, 0) + Math.max(others.length - ROWS_NEAR, 0);
  say(box("ahead-more"), !ahead.length ? "no place within 500 m" : more ? `${more} more` : "");
}

/** All places of a moment, each once: those ahead, then those that are only near. */
export function placesOf(frame) {
  const ahead = frame?.ahead ?? [];
  const others = (frame?.nearby ?? []).filter((one) => !ahead.some((there) => isSame(one, there)));
  return [...ahead.map((one) => ({ ...one, isAhead: true })), ...others];
}

/** Numbers of a place that is clicked. */
export function numbersOfPlace(frame, place) {
  const rows = [];
  for (const [word, list] of [["ahead", frame.ahead], ["near", frame.nearby]]) {
    const one = (list ?? []).find((there) => isSame(there, place));
    if (one) rows.push([word, metresOf(one)], [word === "ahead" ? "P(passed)" : "P(within 50 m)", percent(one.p)]);
  }
  return { title: String(place.id), rows };
}

/** Diamonds on the map: filled ahead, hollow where only near; the nearest ones with names. */
export function drawPlaces(ctx, view, frame, look) {
  const places = placesOf(frame);
  const taken = [];
  ctx.font = "600 11px system-ui, sans-serif";
  for (const place of places.reverse()) {
    const { x, y } = view.project(place.lon, place.lat);
    if (x < -20 || y < -20 || x > view.width + 20 || y > view.height + 20) continue;
    ctx.globalAlpha = 0.3 + 0.7 * place.p;
    ctx.beginPath();
    ctx.moveTo(x, y - 8);
    ctx.lineTo(x + 8, y);
    ctx.lineTo(x, y + 8);
    ctx.lineTo(x - 8, y);
    ctx.closePath();
    ctx.lineWidth = 4.5;
    ctx.strokeStyle = look.paper;
    ctx.stroke();
    ctx.lineWidth = 2;
    ctx.strokeStyle = look.place;
    ctx.fillStyle = place.isAhead ? look.place : look.paper;
    ctx.fill();
    ctx.stroke();
  }
  for (const place of places.reverse()) {
    if (place.p < NAMED_FROM || taken.length >= 4) continue;
    const { x, y } = view.project(place.lon, place.lat);
    const text = String(place.id).length > 22 ? `${String(place.id).slice(0, 21)}…` : String(place.id);
    const long = ctx.measureText(text).width;
    if (taken.some(([a, b, l]) => Math.abs(y - b) < 16 && x < a + l + 8 && a < x + long + 8)) continue;
    taken.push([x, y, long]);
    ctx.globalAlpha = 0.5 + 0.5 * place.p;
    ctx.lineWidth = 3.5;
    ctx.strokeStyle = look.halo;
    ctx.strokeText(text, x + 12, y + 4);
    ctx.fillStyle = look.place;
    ctx.fillText(text, x + 12, y + 4);
  }
  ctx.globalAlpha = 1;
}

// ---- sensors

const SENSOR = { gnss: "GNSS", wheels: "wheels", odometer: "odometer", speed_and_gyro: "speed and gyro", gyro: "gyro", file: "file" };
const UNITS = { "m/m": "", "deg/s": " °/s", "deg/km": " °/km" };

/** A number with as many digits as its sigma is worth. */
function withSigma(value, sigma) {
  const digits = Math.min(Math.max(Math.ceil(-Math.log10(sigma || 1)) + (sigma < 1 ? 1 : 0), 0), 5);
  return `${value.toFixed(digits).replace("-", "−")} ± ${sigma.toFixed(digits)}`;
}

/** What was learnt, in words; the receiver's errors are among the figures. */
function learntOf(one) {
  return one.learnt.filter(({ sigma }) => sigma !== null)
    .map(({ what, value, sigma, unit }) => `${what} ${withSigma(value, sigma)}${UNITS[unit] ?? ` ${unit}`}`).join(" · ");
}

function rateOf(rate) {
  return `${rate.toFixed(rate < 9.95 ? 1 : 0)} Hz`;
}

/** One row for each sensor that was heard, then inputs that do not deliver. */
export function sensorRows(sensors, heard) {
  const rows = heard.map((one) => {
    const doubted = one.doubted ?? [];
    const heardNow = one.rate_hz > 0 || (one.age_s !== null && one.age_s <= HEARD_S);
    const silent = one.age_s === null ? "not heard" : `silent ${clock(one.age_s)}`;
    const whole = doubted.includes("readings") || doubted.includes("fixes");
    const parts = [learntOf(one)];
    if (doubted.length && !whole) parts.unshift(`${doubted.join(" and ")} withheld`);
    if (one.withheld) parts.push(`${one.withheld.toLocaleString("en")} readings left out`);
    return {
      name: SENSOR[one.name] ?? one.name,
      state: heardNow ? (doubted.length ? "doubted" : "ok") : one.age_s === null ? "waiting" : "silent",
      rate: one.rate_hz > 0 ? rateOf(one.rate_hz) : heardNow ? "heard" : silent,
      word: whole ? (one.name === "gnss" ? "does not fit" : "withheld") : "",
      more: parts.filter(Boolean).join(" · "),
      title: one.further && one.misfits !== null ? `${one.misfits} readings fitted nothing` : "",
    };
  });
  for (const one of sensors) {
    if (heard.length && (one.ok || one.state === "ended" || one.kind === "file")) continue;
    const old = one.age_s !== null && one.age_s > 2 ? ` ${clock(one.age_s)}` : "";
    rows.push({
      name: heard.length ? one.name : SENSOR[one.kind] ?? one.kind, state: one.ok ? "ok" : one.state,
      rate: one.ok ? rateOf(one.rate_hz) : one.state + old, word: "", more: "",
      title: `${one.name}: ${one.count.toLocaleString("en")} readings, ${one.skipped} skipped`,
    });
  }
  return rows;
}

/** Fills the list of sensors. sensors: the inputs; heard: what came in on them. */
export function fillSensors(sensors, heard) {
  const rows = sensorRows(sensors, heard);
  rowsOf(box("sensors"), rows.length, ["dot", "name", "rate", "word", "learnt"]).forEach((row, i) => {
    const [, name, rate, word, more] = row.children;
    row.dataset.state = rows[i].state;
    row.dataset.wide = String(rows[i].more !== "");
    row.title = rows[i].title;
    say(name, rows[i].name);
    say(rate, rows[i].rate);
    say(word, rows[i].word);
    say(more, rows[i].more);
  });
}

// ---- the report's columns

/** Level, places and sensors of row k of a report, as messages have them. */
export function besideAt(beside, k) {
  const places = (rows) => rows && rows[k].map(([i, metres, sigma, p]) => {
    const [id, lat, lon] = beside.points[i];
    return { id, lat, lon, distance_m: metres, sigma_m: sigma, p };
  });
  return {
    levels: beside.levels.known[beside.levels.row[k]].map(([level, kind, p]) => ({ level, kind, p })),
    ahead: places(beside.ahead),
    nearby: places(beside.nearby),
    heard: beside.heard.map(({ name, further, said, states }) => {
      const [doubted, misfits, withheld, learnt] = states.known[states.row[k]];
      const rate = said[k];
      return {
        name, further, doubted, misfits, withheld, rate_hz: Math.max(rate ?? 0, 0),
        age_s: rate === null ? null : Math.max(-rate, 0),
        learnt: learnt.map(([what, value, sigma, unit]) => ({ what, value, sigma, unit })),
      };
    }),
  };
}
