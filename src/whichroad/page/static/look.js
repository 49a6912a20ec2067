// Colours and words that the page and the report share.

// Blue is probable and red is not, as in every picture of this project.
const SCALE = {
  light: ["#c51b1b", "#ee7d2f", "#e3b22c", "#4a9bc9", "#0b4f9e"],
  dark: ["#ff6a5c", "#ff9a4a", "#f4cd58", "#62b9e6", "#4b96ff"],
};

export const LOOK = {
  light: {
    name: "light",
    land: "#f3f1ec", road: "#ffffff", casing: "#cfcac0", major: "#fff3d6", majorCasing: "#dcbf86",
    small: "#fbfaf8", tunnel: "#e2ded6", text: "#4b4740", halo: "#ffffff", arrow: "#a59f93",
    ink: "#16181b", paper: "#ffffff", faint: "#5c636f", grid: "rgba(22,24,27,0.10)",
    fix: "#d9730d", masked: "#8a8f98", reckoning: "#8e44ad", outside: "rgba(22,24,27,0.05)",
    hatch: "rgba(90,98,130,0.16)", ellipse: "#b9d4ea", place: "#0e6b5c",
  },
  dark: {
    name: "dark",
    land: "#12151a", road: "#566172", casing: "#0c0e12", major: "#7d7050", majorCasing: "#0c0e12",
    small: "#434c59", tunnel: "#2f3641", text: "#b4bcc8", halo: "#12151a", arrow: "#6c7685",
    ink: "#eef1f5", paper: "#1b2028", faint: "#a5afbc", grid: "rgba(238,241,245,0.12)",
    fix: "#ffa94d", masked: "#8d97a5", reckoning: "#c792ea", outside: "rgba(238,241,245,0.05)",
    hatch: "rgba(160,172,210,0.18)", ellipse: "#2f4a68", place: "#5fd6bd",
  },
};

// One colour for each road: told apart by the colour-blind, and in grey by lightness and dashes.
const ROAD = {
  light: ["#1f3d7a", "#c2571a", "#00806f", "#a8327e", "#6b6b00", "#2e86c1", "#7a4b2a", "#5b3fa0"],
  dark: ["#8fb4ff", "#ff9a5c", "#3fd0b6", "#f08ac4", "#d8d04a", "#62c4f0", "#d2a27c", "#bba4ff"],
};
const DASHES = [[], [9, 3], [4, 3], [12, 3, 3, 3], [2, 3], [16, 4], [6, 2, 2, 2], [1, 4]];
const KEPT = 512; // roads whose colours are known
const roadPlaces = new Map(); // of a road's name in the list of colours, the last used at the end

/** A road keeps its place; a new one takes that which was used longest ago. */
function placeOf(key) {
  let place = roadPlaces.get(key);
  if (place === undefined) {
    const lastUsed = DASHES.map(() => -1);
    let rank = 0;
    for (const its of roadPlaces.values()) lastUsed[its] = rank++;
    place = lastUsed.indexOf(Math.min(...lastUsed));
    if (roadPlaces.size >= KEPT) roadPlaces.delete(roadPlaces.keys().next().value);
  }
  roadPlaces.delete(key);
  roadPlaces.set(key, place);
  return place;
}

/** Colour and dashes of a road, the same in map, list and chart. key: its name, or its edge. */
export function roadLook(key, look) {
  if (key === "off the roads") return { colour: look.faint, dash: [3, 4] };
  const place = placeOf(key);
  return { colour: ROAD[look.name][place], dash: DASHES[place] };
}

// In the order of the service's own codes.
export const STATUS = {
  on_road: { word: "on road", light: "#0b4f9e", dark: "#4b96ff" },
  ambiguous: { word: "ambiguous", light: "#d99a06", dark: "#f4cd58" },
  off_road: { word: "off the roads", light: "#8255ab", dark: "#b48ade" },
  outage: { word: "no GNSS", light: "#6a78a6", dark: "#93a2d4" },
  stopped: { word: "stopped", light: "#5f9dbf", dark: "#7fb8d6" },
  lost: { word: "lost", light: "#c51b1b", dark: "#ff6a5c" },
};
export const STATUSES = Object.keys(STATUS);

// Rules that a route breaks, as named in tables of paths; several are joined by commas.
const BROKEN = {
  against_one_way: "against a one-way street", turn_banned: "banned turn", no_access: "closed road",
  u_turn: "U-turn", gap: "route broken off",
};

/** Word and colours of a place to check: a status or broken rules. */
export function lookOf(kind) {
  const word = kind.split(",").map((rule) => BROKEN[rule] ?? rule).join(", ");
  return STATUS[kind] ?? { word, light: "#b0307a", dark: "#f08ac4" };
}

export const CHI_95 = Math.sqrt(5.991); // a 2-D Gaussian holds 95 % within so many sigma

function channels(hex) {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
}

const tables = {};
/** Colour of a probability. */
export function colourOf(p, look) {
  const table = (tables[look.name] ??= Array.from({ length: 101 }, (_, i) => mixed(i / 100, look)));
  return table[Math.round(100 * Math.min(Math.max(p, 0), 1))];
}

function mixed(p, look) {
  const stops = SCALE[look.name];
  const at = Math.min(p * (stops.length - 1), stops.length - 1 - 1e-9);
  const low = channels(stops[Math.floor(at)]);
  const high = channels(stops[Math.floor(at) + 1]);
  const part = at - Math.floor(at);
  return `rgb(${low.map((c, i) => Math.round(c + part * (high[i] - c))).join(",")})`;
}

export function percent(p) {
  if (p === null || p === undefined) return "–";
  if (p > 0.9995) return "100 %";
  if (p > 0 && p < 0.001) return "< 0.1 %";
  return `${(100 * p).toFixed(p > 0.99 || p < 0.1 ? 1 : 0)} %`;
}

export function clock(seconds) {
  const s = Math.max(0, Math.floor(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const hours = Math.floor(s / 3600);
  return (hours ? `${hours}:${two(Math.floor(s / 60) % 60)}` : `${Math.floor(s / 60)}`) + `:${two(s % 60)}`;
}

/** What to call an edge. */
export function titleOf(edge, name, highway) {
  if (edge === null || edge < 0) return "off the roads";
  return name || (highway ? `unnamed ${highway.replaceAll("_", " ")}` : `edge ${edge}`);
}

/** The theme that is wished: the switch's, else the system's. */
export function themeWished() {
  let kept = null;
  try {
    kept = localStorage.getItem("whichroad-theme");
  } catch {
    // storage is refused: the system decides
  }
  return kept ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
}

export function keepTheme(name) {
  try {
    localStorage.setItem("whichroad-theme", name);
  } catch {
    // not kept, then
  }
}
