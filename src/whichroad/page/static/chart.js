// P(road) over time: the roads that compete in the last minute, and the whole drive in one strip.

import { STATUS, STATUSES, colourOf, percent, roadLook } from "./look.js";

const STRIP = 5; // height of the status strip
const LABELLED = 4; // lines with a name

/** A canvas as sharp as the screen; returns its context and size in CSS pixels. */
export function sharp(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  // drawn by the processor: few strokes, often, are not worth a round trip to the graphics card
  const ctx = canvas.getContext("2d", { willReadFrequently: true });
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { ctx, width, height };
}

/** The P of every road about now. span: [from, to] in seconds. Gives the time of a pixel. */
export function drawRace(canvas, series, now, span, look, nameOf) {
  const { ctx, width, height } = sharp(canvas);
  const box = { left: 30, right: width - (width < 520 ? 54 : 168), top: 8, bottom: height - 22 };
  ctx.clearRect(0, 0, width, height);
  const x = (t) => box.left + ((t - span[0]) / (span[1] - span[0])) * (box.right - box.left);
  const y = (p) => box.bottom - p * (box.bottom - box.top);
  drawGrid(ctx, box, y, look);
  const from = Math.max(0, series.find(span[0]) - 1);
  const to = Math.min(series.length, series.find(span[1]) + 1);
  ctx.save();
  ctx.beginPath();
  ctx.rect(box.left, 0, box.right - box.left, height);
  ctx.clip();
  drawMasks(ctx, series, from, to, x, box.top, box.bottom, look);
  const lines = linesOf(series, from, to, x, y, nameOf);
  ctx.lineJoin = "round";
  ctx.lineWidth = 2.2;
  for (const [name, line] of lines) {
    const { colour, dash } = roadLook(name, look);
    ctx.strokeStyle = colour;
    ctx.setLineDash(dash);
    ctx.stroke(line.path);
  }
  ctx.setLineDash([]);
  drawStrip(ctx, series, from, to, x, box.bottom + 4, look);
  if (span[1] > now + 1e-6) {
    ctx.fillStyle = look.paper;
    ctx.globalAlpha = 0.6;
    ctx.fillRect(x(now), 0, box.right - x(now), height);
    ctx.globalAlpha = 1;
    ctx.fillStyle = look.ink;
    ctx.fillRect(x(now) - 0.5, box.top - 4, 1.5, box.bottom - box.top + 4);
  }
  ctx.restore();
  drawNames(ctx, series, now, box, y, look, nameOf);
  drawSeconds(ctx, box, x, span, now, height, look);
  return (px) => {
    const share = (px - box.left) / (box.right - box.left);
    return share < 0 || share > 1 ? null : span[0] + share * (span[1] - span[0]);
  };
}

function drawGrid(ctx, box, y, look) {
  ctx.font = "10px system-ui, sans-serif";
  ctx.textAlign = "right";
  for (const p of [0, 0.5, 1]) {
    ctx.fillStyle = look.grid;
    ctx.fillRect(box.left, Math.round(y(p)), box.right - box.left, 1);
    ctx.fillStyle = look.faint;
    ctx.fillText(p === 0.5 ? ".5" : String(p), box.left - 7, y(p) + 3.5);
  }
  ctx.textAlign = "left";
}

/**
 * P of each road of epoch i, edges of one name added up, most probable first.
 *
 * The leading road has no more than P of the way, as the headline says: what else has its name,
 * such as the other direction, competes with it and is a line of its own.
 */
function sharesOf(series, i, nameOf) {
  const shares = new Map();
  let lead = null;
  series.eachRoad(i, (edge, p) => {
    const name = nameOf(edge);
    if (lead === null && edge >= 0) lead = name;
    shares.set(name, (shares.get(name) ?? 0) + p);
  });
  const way = series.get("p", i);
  const rest = (shares.get(lead) ?? 0) - way;
  if (way > 0 && rest >= 0.01) {
    shares.set(lead, way);
    shares.set(`${lead}, elsewhere on it`, rest);
  }
  return [...shares].sort((a, b) => b[1] - a[1]);
}

/** One path for each road that was ever probable enough. */
function linesOf(series, from, to, x, y, nameOf) {
  const lines = new Map();
  for (let i = from; i < to; i += 1) {
    const t = x(series.get("t", i));
    for (const line of lines.values()) line.now = 0;
    for (const [name, p] of sharesOf(series, i, nameOf)) {
      let line = lines.get(name);
      if (!line && p < 0.01) continue;
      if (!line) {
        line = { path: new Path2D(), last: 0, most: 0 };
        line.path.moveTo(t, y(i === from ? p : 0));
        lines.set(name, line);
      }
      line.now = p;
    }
    for (const line of lines.values()) {
      if (line.now === 0 && line.last === 0 && line.most > 0) line.path.moveTo(t, y(0));
      else line.path.lineTo(t, y(line.now));
      line.last = line.now;
      line.most = Math.max(line.most, line.now);
    }
  }
  return lines;
}

function drawMasks(ctx, series, from, to, x, top, bottom, look) {
  ctx.fillStyle = look.hatch;
  runs(series, from, to, (i) => series.get("masked", i) > 0, (a, b, on) => {
    if (on) ctx.fillRect(x(a), top, Math.max(1, x(b) - x(a)), bottom - top);
  });
}

function drawStrip(ctx, series, from, to, x, top, look) {
  runs(series, from, to, (i) => series.get("status", i), (a, b, status) => {
    ctx.fillStyle = STATUS[STATUSES[status]]?.[look.name] ?? look.faint;
    ctx.fillRect(x(a), top, Math.max(0.75, x(b) - x(a)), STRIP);
  });
}

/** Visits stretches with the same value: (begin, end, value). */
function runs(series, from, to, valueOf, visit) {
  let begin = from;
  for (let i = from + 1; i <= to; i += 1) {
    if (i === to || valueOf(i) !== valueOf(begin)) {
      if (begin < to) visit(series.get("t", begin), series.get("t", Math.min(i, to - 1)), valueOf(begin));
      begin = i;
    }
  }
}

function drawNames(ctx, series, now, box, y, look, nameOf) {
  const at = Math.min(series.find(now + 1e-6), series.length) - 1;
  if (at < 0) return;
  const shown = [];
  for (const [name, p] of sharesOf(series, at, nameOf)) {
    if (p >= 0.01 && shown.length < LABELLED) shown.push({ name, p, y: y(p) });
  }
  let last = -100;
  ctx.font = "600 11px system-ui, sans-serif";
  const space = ctx.canvas.clientWidth - box.right - 12;
  for (const one of shown) {
    const top = Math.max(one.y + 4, last + 13, box.top + 6);
    last = top;
    ctx.fillStyle = roadLook(one.name, look).colour;
    const share = percent(one.p);
    ctx.fillText(share, box.right + 8, top);
    const used = ctx.measureText(share).width + 6;
    ctx.fillStyle = look.faint;
    ctx.fillText(shortened(ctx, one.name, space - used), box.right + 8 + used, top);
  }
}

function shortened(ctx, text, space) {
  if (space < 18) return "";
  let kept = text;
  while (kept.length > 1 && ctx.measureText(`${kept}…`).width > space) kept = kept.slice(0, -1);
  return kept.length < text.length ? (kept.length > 1 ? `${kept}…` : "") : text;
}

function drawSeconds(ctx, box, x, span, now, height, look) {
  ctx.font = "10px system-ui, sans-serif";
  ctx.fillStyle = look.faint;
  ctx.textAlign = "center";
  for (let back = 0; back <= now - span[0]; back += 15) {
    const at = x(now - back);
    if (at > box.left + 12 && at < box.right + 2) ctx.fillText(back ? `−${back} s` : "now", at, height - 1);
  }
  ctx.textAlign = "left";
}

const strips = new WeakMap(); // series -> its strip as an image, drawn once

/** The whole drive: the least P(road) of each pixel column, the status below, and now.
 * span: when it begins and ends; growing: whether the series does. Gives the time of a pixel. */
export function drawDrive(canvas, series, now, look, span = [series.begin, series.end], growing = false) {
  const { ctx, width, height } = sharp(canvas);
  ctx.clearRect(0, 0, width, height);
  const [begin, end] = span;
  const scale = width / Math.max(end - begin, 1e-9);
  const bottom = height - STRIP - 2;
  const key = `${canvas.width} ${canvas.height} ${look.name}`;
  let strip = strips.get(series);
  if (strip?.key !== key || growing) {
    const image = strip?.image ?? document.createElement("canvas");
    [image.width, image.height] = [canvas.width, canvas.height];
    const brush = image.getContext("2d");
    brush.setTransform(canvas.width / width, 0, 0, canvas.height / height, 0, 0);
    drawColumns(brush, series, (t) => (t - begin) * scale, width, bottom, look);
    strip = { key, image };
    strips.set(series, strip);
  }
  ctx.drawImage(strip.image, 0, 0, width, height);
  const at = (now - begin) * scale;
  ctx.fillStyle = look.paper;
  ctx.globalAlpha = 0.55;
  ctx.fillRect(at, 0, width - at, bottom);
  ctx.globalAlpha = 1;
  ctx.fillStyle = look.ink;
  ctx.fillRect(at - 1, 0, 2, height);
  ctx.beginPath();
  ctx.arc(at, 4, 4, 0, 7);
  ctx.fill();
  return (px) => begin + Math.min(Math.max(px / width, 0), 1) * (end - begin);
}

function drawColumns(ctx, series, x, width, bottom, look) {
  drawMasks(ctx, series, 0, series.length, x, 0, bottom, look);
  const low = new Float32Array(Math.ceil(width) + 1).fill(2);
  const last = series.length ? Math.min(width, x(series.end)) : 0;
  for (let i = 0; i < series.length; i += 1) {
    const column = Math.max(0, Math.round(x(series.get("t", i))));
    low[column] = Math.min(low[column], series.get("p", i));
  }
  let p = 0;
  ctx.globalAlpha = 0.85;
  const first = series.length ? Math.max(0, Math.floor(x(series.begin))) : 0;
  for (let column = first; column < last; column += 1) {
    p = low[column] <= 1 ? low[column] : p;
    ctx.fillStyle = colourOf(p, look);
    ctx.fillRect(column, 1 + (1 - p) * (bottom - 1), 1.2, Math.max(1, p * (bottom - 1)));
  }
  ctx.globalAlpha = 1;
  drawStrip(ctx, series, 0, series.length, x, bottom + 2, look);
}
