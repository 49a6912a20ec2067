// Columns of estimates, oldest first, in a ring: memory does not grow with time.

const ALTERNATIVES = 6;
const COLUMNS = ["t", "lat", "lon", "p", "off", "status", "masked", "major"];

export class Series {
  constructor(capacity) {
    this.capacity = capacity;
    this.columns = Object.fromEntries(COLUMNS.map((c) => [c, new Float64Array(capacity)]));
    this.edges = new Int32Array(capacity * ALTERNATIVES);
    this.shares = new Float32Array(capacity * ALTERNATIVES);
    this.clear();
  }

  clear() {
    this.length = 0;
    this.head = 0; // where the oldest row is
    this.routes = {}; // [[lat, lon], ...] along the roads to a row far from the one before
  }

  /** row: {t, lat, lon, p, off, status, masked, major}; roads: [[edge, p], ...], -1 is off road. */
  push(row, roads) {
    let at = (this.head + this.length) % this.capacity;
    if (this.length === this.capacity) this.head = (this.head + 1) % this.capacity;
    else this.length += 1;
    for (const name of COLUMNS) this.columns[name][at] = row[name] ?? NaN;
    at *= ALTERNATIVES;
    for (let k = 0; k < ALTERNATIVES; k += 1) {
      this.edges[at + k] = k < roads.length ? roads[k][0] : -2;
      this.shares[at + k] = k < roads.length ? roads[k][1] : 0;
    }
  }

  /** Moves the times of all rows so that the last is not after t: the sensors' clock was set back. */
  endBefore(t) {
    const ahead = this.end - t;
    if (ahead > 0) this.columns.t = this.columns.t.map((time) => time - ahead);
  }

  get(name, i) {
    return this.columns[name][(this.head + i) % this.capacity];
  }

  /** Places along the roads between row i - 1 and row i, where they are known. */
  routeTo(i) {
    return this.routes[i];
  }

  /** Calls back with (edge, p) of row i, most probable first. */
  eachRoad(i, visit) {
    const at = ((this.head + i) % this.capacity) * ALTERNATIVES;
    for (let k = 0; k < ALTERNATIVES && this.edges[at + k] > -2; k += 1) {
      visit(this.edges[at + k], this.shares[at + k]);
    }
  }

  /** [west, south, east, north] of all rows; null where none has a place. */
  box() {
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let i = 0; i < this.length; i += 1) {
      const [lon, lat] = [this.get("lon", i), this.get("lat", i)];
      if (Number.isNaN(lat)) continue;
      box[0] = Math.min(box[0], lon);
      box[1] = Math.min(box[1], lat);
      box[2] = Math.max(box[2], lon);
      box[3] = Math.max(box[3], lat);
    }
    return box[0] <= box[2] ? box : null;
  }

  /** First row that is not before t. */
  find(t) {
    let low = 0;
    let high = this.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.get("t", middle) < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  get begin() {
    return this.length ? this.get("t", 0) : 0;
  }

  get end() {
    return this.length ? this.get("t", this.length - 1) : 0;
  }
}

/** The roads of a message's hypotheses, each once, most probable first. */
export function roadsOf(hypotheses) {
  const sums = new Map();
  for (const one of hypotheses) {
    const edge = one.edge_id ?? -1;
    sums.set(edge, (sums.get(edge) ?? 0) + one.p);
  }
  return [...sums].sort((a, b) => b[1] - a[1]);
}

/** A list that drops its oldest. */
export class Recent {
  constructor(capacity) {
    this.capacity = capacity;
    this.items = [];
  }

  push(item) {
    this.items.push(item);
    if (this.items.length > 2 * this.capacity) this.items.splice(0, this.items.length - this.capacity);
  }

  clear() {
    this.items = [];
  }

  get last() {
    return this.items[this.items.length - 1];
  }
}

/** A recorded drive's columns as a series, times counted from `begin`. */
export function fromTimeline(line, begin) {
  const series = new Series(Math.max(line.t.length, 1));
  series.routes = line.ways;
  line.t.forEach((t, i) => {
    series.push(
      {
        t: begin + t, lat: line.lat[i], lon: line.lon[i], p: line.p[i], off: line.off[i],
        status: line.status[i], masked: line.masked[i],
      },
      line.roads[i],
    );
  });
  return series;
}

/** Its fixes as messages have them. */
export function fixesOf(line, begin) {
  return line.fixes.map(([t, lat, lon, major, minor, axis, masked]) => ({
    epoch_s: begin + t, lat, lon, masked: masked === 1, believed: null,
    ellipse: major === null ? null : { major_m: major, minor_m: minor, bearing_deg: axis },
  }));
}

/** The last of them at a time. */
export function fixesAt(fixes, t, most = 60) {
  let low = 0;
  let high = fixes.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (fixes[middle].epoch_s <= t + 1e-6) low = middle + 1;
    else high = middle;
  }
  return fixes.slice(Math.max(0, low - most), low);
}

/** The track by wheels alone up to row k. */
export function reckoningAt(line, k) {
  const track = [];
  const last = line.reckoning[k];
  for (let i = k; last && i >= 0 && line.reckoning[i]?.[3] === last[3]; i -= 1) {
    track.push([line.reckoning[i][1], line.reckoning[i][0], line.reckoning[i][2]]);
  }
  return track.reverse();
}
