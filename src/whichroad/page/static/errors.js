// The truth beside a drive: its track on the map, and the error against the ellipse over time.

import { sharp } from "./chart.js";

/** truth: columns lat, lon, error, bound (the 95 % ellipse towards the truth, m), one row each. */
export function drawTruth(ctx, view, truth, row, pose, look) {
  ctx.strokeStyle = look.ink;
  ctx.lineWidth = 1.4;
  ctx.setLineDash([2, 3]);
  ctx.beginPath();
  let open = false;
  truth.lat.forEach((lat, i) => {
    const at = lat === null ? null : view.project(truth.lon[i], lat);
    if (at && open) ctx.lineTo(at.x, at.y);
    else if (at) ctx.moveTo(at.x, at.y);
    open = at !== null;
  });
  ctx.stroke();
  ctx.setLineDash([]);
  if (row < 0 || truth.lat[row] === null) return;
  const at = view.project(truth.lon[row], truth.lat[row]);
  ctx.lineWidth = 2;
  ctx.beginPath();
  if (pose) {
    const here = view.project(pose.lon, pose.lat);
    ctx.moveTo(here.x, here.y);
    ctx.lineTo(at.x, at.y);
  }
  ctx.moveTo(at.x - 7, at.y);
  ctx.lineTo(at.x + 7, at.y);
  ctx.moveTo(at.x, at.y - 7);
  ctx.lineTo(at.x, at.y + 7);
  ctx.stroke();
}

/** Error (line) against the ellipse (area) over the whole drive, on the time of the strip. */
export function drawErrors(canvas, times, truth, now, look) {
  const { ctx, width, height } = sharp(canvas);
  ctx.clearRect(0, 0, width, height);
  const [begin, end] = [times[0], times[times.length - 1]];
  const most = Math.max(1, ...truth.error, ...truth.bound);
  const x = (t) => ((t - begin) / Math.max(end - begin, 1e-9)) * width;
  const y = (metres) => height - 1 - (metres / most) * (height - 12);
  ctx.beginPath();
  ctx.moveTo(0, height);
  times.forEach((t, i) => ctx.lineTo(x(t), y(truth.bound[i] ?? 0)));
  ctx.lineTo(width, height);
  ctx.fillStyle = look.ellipse;
  ctx.fill();
  ctx.beginPath();
  let open = false;
  times.forEach((t, i) => {
    const error = truth.error[i];
    if (error !== null && open) ctx.lineTo(x(t), y(error));
    else if (error !== null) ctx.moveTo(x(t), y(error));
    open = error !== null;
  });
  ctx.strokeStyle = look.ink;
  ctx.lineWidth = 1.3;
  ctx.lineJoin = "round";
  ctx.stroke();
  ctx.fillStyle = look.ink;
  ctx.fillRect(x(now) - 1, 0, 2, height);
  ctx.font = "10px system-ui, sans-serif";
  ctx.fillStyle = look.faint;
  ctx.fillText(`error against 95 % ellipse, to ${most.toFixed(0)} m; inside ${(100 * truth.inside).toFixed(1)} %`, 4, 9);
}
