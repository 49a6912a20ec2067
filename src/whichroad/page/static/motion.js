// The pose between two messages, so that the vehicle moves smoothly and not from message to message.

const LONGEST = 1000; // ms from one message to the next that are bridged
const FARTHEST = 100; // m; what is farther off was not driven
const STEP = 3; // s of the drive; more is a jump in time
const METRES = 111195; // of a degree

/** Has the numbers of the newest message at once; its poses are reached when the next one is due. */
export class Motion {
  constructor() {
    this.from = this.to = null;
    this.begun = this.long = 0;
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
  }

  take(frame, now) {
    const last = this.at(now);
    const [before, since] = [this.to, now - this.begun];
    this.to = frame;
    this.begun = now;
    this.from = before && this.joins(before, frame) ? last : null;
    this.long = Math.min(since, LONGEST);
  }

  joins(before, frame) {
    if (this.calm.matches || frame.play.paused || !before.pose || !frame.pose) return false;
    const ahead = frame.epoch_s - before.epoch_s;
    const north = METRES * (frame.pose.lat - before.pose.lat);
    const east = METRES * (frame.pose.lon - before.pose.lon) * Math.cos((frame.pose.lat * Math.PI) / 180);
    return ahead > 0 && ahead < STEP && Math.hypot(north, east) < FARTHEST;
  }

  /** Whether the vehicle is still on its way to the newest message. */
  moves(now) {
    return this.from !== null && now < this.begun + this.long;
  }

  /** The newest message with the poses of this moment. */
  at(now) {
    if (!this.moves(now)) return this.to;
    const share = Math.max(0, (now - this.begun) / this.long);
    const { from, to } = this;
    const place = ["matched_lat", "matched_lon"];
    const poses = new Map(from.hypotheses.map((one) => [one.edge_id, one]));
    return {
      ...to,
      pose: between(from.pose, to.pose, share),
      road: from.road.edge_id === to.road.edge_id ? { ...to.road, ...mixed(from.road, to.road, place, share) } : to.road,
      hypotheses: to.hypotheses.map((one) => between(poses.get(one.edge_id), one, share)),
    };
  }
}

function between(from, to, share) {
  if (!from || from.lat === null || to.lat === null) return to;
  const turn = ((to.bearing_deg - from.bearing_deg + 540) % 360) - 180;
  return { ...to, ...mixed(from, to, ["lat", "lon"], share), bearing_deg: from.bearing_deg + share * turn };
}

function mixed(from, to, names, share) {
  return Object.fromEntries(names.map((name) => [
    name, from[name] === null || to[name] === null ? to[name] : from[name] + share * (to[name] - from[name]),
  ]));
}
