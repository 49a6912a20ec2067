// The stream of messages, taken up again when it breaks, and what is asked of the server.

const VEHICLE = new URLSearchParams(location.search).get("vehicle");

/** The vehicle of this page, where its address names one, added to what is asked for. */
export function ofVehicle(path) {
  if (VEHICLE === null) return path;
  return `${path}${path.includes("?") ? "&" : "?"}vehicle=${encodeURIComponent(VEHICLE)}`;
}

/** A whole address of this server; braces, as addresses of tiles have them, stay as they are. */
export function here(path) {
  return new URL(path, location.href).href.replaceAll("%7B", "{").replaceAll("%7D", "}");
}

export class Feed {
  constructor(onMessage, onState) {
    this.onMessage = onMessage;
    this.onState = onState;
    this.wait = 500;
    this.open();
  }

  open() {
    this.onState("connecting");
    this.socket = new WebSocket(here(ofVehicle("ws")).replace(/^http/, "ws"));
    this.socket.onopen = () => {
      this.wait = 500;
      this.onState("open");
    };
    this.socket.onmessage = (event) => this.onMessage(JSON.parse(event.data));
    this.socket.onclose = () => {
      this.onState("closed");
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(2 * this.wait, 8000);
    };
  }
}

/** Asks the server to do something; returns the reason where it does not. */
export async function control(action, value = null) {
  const answer = await fetch(here(ofVehicle("control")), {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(value === null && action !== "speed" ? { action } : { action, value }),
  });
  if (answer.ok) return null;
  const refusal = await answer.json().catch(() => ({}));
  return refusal.error ?? `the service refused (${answer.status})`;
}

export async function fetchJson(path) {
  const answer = await fetch(here(path));
  return answer.ok ? answer.json() : null;
}

const KEPT = 300;

/** Edges of the map by their ids, asked for once. */
export class Edges extends Map {
  constructor(onCome) {
    super();
    this.onCome = onCome;
    this.asked = new Set();
  }

  need(ids) {
    const missing = ids.filter((id) => id >= 0 && !this.has(id) && !this.asked.has(id)).slice(0, 40);
    if (!missing.length) return;
    for (const id of missing) this.asked.add(id);
    fetchJson(`roads/edges?ids=${missing.join(",")}`)
      .then((edges) => {
        for (const edge of edges ?? []) this.set(edge.edge, edge);
        while (this.size > KEPT) this.delete(this.keys().next().value);
        this.onCome();
      })
      .catch(() => {})
      .finally(() => missing.forEach((id) => this.asked.delete(id)));
  }
}
