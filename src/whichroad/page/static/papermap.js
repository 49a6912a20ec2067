// A small map of its own for the report: roads on a canvas, to shift and to magnify.
//
// World units are web Mercator, the world 2^20 wide, about an origin near the drive.

const SIZE = 2 ** 20;
const WIDTH = [7, 6, 5, 4, 2.4]; // metres of a road by its rank, as drawn close by
const LEAST = [3.2, 2.6, 2, 1.4, 0.9]; // pixels, as drawn from afar

function mercator(lon, lat) {
  const phi = (lat * Math.PI) / 180;
  return [(lon / 360 + 0.5) * SIZE, (0.5 - Math.log(Math.tan(Math.PI / 4 + phi / 2)) / (2 * Math.PI)) * SIZE];
}

export class PaperMap {
  /** box: west, south, east, north; roads: [[rank, name, line], ...]. */
  constructor(canvas, box, roads, onMove) {
    this.canvas = canvas;
    this.onMove = onMove;
    this.onTap = () => {};
    const [west, south, east, north] = box;
    this.origin = mercator((west + east) / 2, (south + north) / 2);
    this.metre = SIZE / (40030174 * Math.cos((((south + north) / 2) * Math.PI) / 180));
    this.paths = WIDTH.map(() => new Path2D());
    this.names = new Map();
    for (const [rank, name, line] of roads) this.add(rank, name, line);
    const low = this.world(west, south);
    const high = this.world(east, north);
    this.extent = [high[0] - low[0], low[1] - high[1]];
    this.centre = [0, 0];
    this.scale = 1; // pixels per world unit
    this.listen();
  }

  world(lon, lat) {
    const [x, y] = mercator(lon, lat);
    return [x - this.origin[0], y - this.origin[1]];
  }

  /** Longitude and latitude of world units. */
  place(x, y) {
    const lon = ((x + this.origin[0]) / SIZE - 0.5) * 360;
    const up = (0.5 - (y + this.origin[1]) / SIZE) * 2 * Math.PI;
    return [lon, (2 * Math.atan(Math.exp(up)) - Math.PI / 2) * (180 / Math.PI)];
  }

  add(rank, name, line) {
    let last = null;
    line.forEach(([lon, lat], i) => {
      const at = this.world(lon, lat);
      if (i) this.paths[rank].lineTo(...at);
      else this.paths[rank].moveTo(...at);
      if (name && last) this.offer(name, rank, last, at);
      last = at;
    });
  }

  /** A name stands on the longest straight parts of its street. */
  offer(name, rank, a, b) {
    const length = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (!this.names.has(name)) this.names.set(name, []);
    const places = this.names.get(name);
    places.push({ rank, length, x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2, angle: Math.atan2(b[1] - a[1], b[0] - a[0]) });
    places.sort((p, q) => q.length - p.length);
    places.length = Math.min(places.length, 4);
  }

  size() {
    return [this.canvas.clientWidth, this.canvas.clientHeight];
  }

  /** Shows all of the drive. */
  fit() {
    const [width, height] = this.size();
    const filled = 0.84;
    const tools = 56; // pixels at the right that buttons hide
    this.scale = Math.min((filled * (width - tools)) / Math.max(this.extent[0], 60 * this.metre), (filled * height) / Math.max(this.extent[1], 60 * this.metre));
    this.centre = [tools / 2 / this.scale, 0];
  }

  lookAt(lon, lat) {
    this.centre = this.world(lon, lat);
  }

  /** Pixels per metre. */
  get magnification() {
    return this.scale * this.metre;
  }

  set magnification(value) {
    this.scale = Math.min(Math.max(value, 0.004), 60) / this.metre;
  }

  view() {
    const [width, height] = this.size();
    const [x, y] = [width / 2 / this.scale, height / 2 / this.scale];
    const [west, north] = this.place(this.centre[0] - x, this.centre[1] - y);
    const [east, south] = this.place(this.centre[0] + x, this.centre[1] + y);
    return {
      width, height, bounds: [west, south, east, north],
      project: (lon, lat) => {
        const [x, y] = this.world(lon, lat);
        return { x: width / 2 + (x - this.centre[0]) * this.scale, y: height / 2 + (y - this.centre[1]) * this.scale };
      },
    };
  }

  draw(ctx, look) {
    const [width, height] = this.size();
    const ratio = this.canvas.width / width;
    ctx.fillStyle = look.land;
    ctx.fillRect(0, 0, width, height);
    ctx.save();
    const s = this.scale;
    ctx.setTransform(ratio * s, 0, 0, ratio * s, ratio * (width / 2 - this.centre[0] * s), ratio * (height / 2 - this.centre[1] * s));
    ctx.lineCap = ctx.lineJoin = "round";
    const wide = (rank) => Math.max(WIDTH[rank] * this.metre, LEAST[rank] / s);
    const casing = (this.magnification > 0.25 ? 2 : 1.2) / s;
    for (const rank of [4, 3, 2, 1, 0]) {
      ctx.lineWidth = wide(rank) + casing;
      ctx.strokeStyle = rank < 2 ? look.majorCasing : look.casing;
      ctx.stroke(this.paths[rank]);
    }
    for (const rank of [4, 3, 2, 1, 0]) {
      ctx.lineWidth = wide(rank);
      ctx.strokeStyle = rank < 2 ? look.major : rank === 4 ? look.small : look.road;
      ctx.stroke(this.paths[rank]);
    }
    ctx.restore();
    if (this.magnification > 0.35) this.drawNames(ctx, look, width, height);
    this.drawScale(ctx, look, width, height);
  }

  drawNames(ctx, look, width, height) {
    ctx.font = "500 11.5px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.lineJoin = "round";
    const taken = [];
    const order = [...this.names].sort((a, b) => a[1][0].rank - b[1][0].rank);
    for (const [name, places] of order) {
      const long = ctx.measureText(name).width;
      for (const place of places) {
        const x = width / 2 + (place.x - this.centre[0]) * this.scale;
        const y = height / 2 + (place.y - this.centre[1]) * this.scale;
        if (x < 0 || y < 0 || x > width || y > height || place.length * this.scale < 0.8 * long) continue;
        if (taken.some(([a, b, r]) => Math.hypot(x - a, y - b) < 0.5 * (long + r))) continue;
        taken.push([x, y, long]);
        let angle = place.angle;
        if (Math.abs(angle) > Math.PI / 2) angle += Math.PI;
        ctx.save();
        ctx.translate(x, y);
        ctx.rotate(angle);
        ctx.lineWidth = 3;
        ctx.strokeStyle = look.halo;
        ctx.strokeText(name, 0, 0.5);
        ctx.fillStyle = look.text;
        ctx.fillText(name, 0, 0.5);
        ctx.restore();
      }
    }
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
  }

  drawScale(ctx, look, width, height) {
    const most = 110 / this.magnification;
    const ten = 10 ** Math.floor(Math.log10(most));
    const metres = [5, 2, 1].map((k) => k * ten).find((m) => m <= most) ?? ten;
    const long = metres * this.magnification;
    const [x, y] = [width - 16, height - (width < 380 ? 32 : 16)]; // above the credit
    ctx.strokeStyle = look.faint;
    ctx.lineWidth = 2;
    ctx.beginPath();
    ctx.moveTo(x - long, y - 5);
    ctx.lineTo(x - long, y);
    ctx.lineTo(x, y);
    ctx.lineTo(x, y - 5);
    ctx.stroke();
    ctx.font = "11px system-ui, sans-serif";
    ctx.fillStyle = look.text;
    ctx.textAlign = "center";
    ctx.fillText(metres >= 1000 ? `${metres / 1000} km` : `${metres} m`, x - long / 2, y - 8);
    ctx.textAlign = "left";
  }

  zoom(factor, x = null, y = null) {
    const [width, height] = this.size();
    const before = this.scale;
    this.magnification = this.magnification * factor;
    if (x !== null) {
      const shift = 1 / before - 1 / this.scale;
      this.centre = [this.centre[0] + (x - width / 2) * shift, this.centre[1] + (y - height / 2) * shift];
    }
    this.onMove(x !== null);
  }

  listen() {
    const pointers = new Map();
    const canvas = this.canvas;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-0.0016 * event.deltaY * (event.deltaMode ? 30 : 1)), event.offsetX, event.offsetY);
    }, { passive: false });
    let still = null; // where a finger went down, as long as it has not moved
    canvas.addEventListener("pointerdown", (event) => {
      still = [event.offsetX, event.offsetY];
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const now = [event.offsetX, event.offsetY];
      if (still && Math.hypot(now[0] - still[0], now[1] - still[1]) < 4) return;
      still = null;
      if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
        const was = Math.hypot(last[0] - other[0], last[1] - other[1]);
        const is = Math.hypot(now[0] - other[0], now[1] - other[1]);
        if (was > 5) this.zoom(is / was, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      }
      const share = pointers.size === 2 ? 0.5 : 1;
      this.centre = [this.centre[0] - (share * (now[0] - last[0])) / this.scale, this.centre[1] - (share * (now[1] - last[1])) / this.scale];
      pointers.set(event.pointerId, now);
      this.onMove(true);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => {
        pointers.delete(event.pointerId);
        if (still && end === "pointerup") this.onTap(...still);
        still = null;
      });
    }
  }
}
