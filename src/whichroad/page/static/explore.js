// What the page tells of what is pointed at, links to moments, and files that are dropped.

import { numbersOfPlace, placesOf } from "./beside.js";
import { fetchJson, here } from "./feed.js";
import { linked } from "./links.js";
import { awayFrom, nearest, numbersOfFix, numbersOfMoment, numbersOfRoad } from "./numbers.js";

const ROAD = 12; // pixels from a road within which it is meant

/** What is clicked on the map: a fix, a place of the track, or a road. */
export function tellOfMap(world, numbers, { state, fixes, began, nameOf, overlay }) {
  world.map.on("click", async (event) => {
    numbers.hide();
    const { x, y } = event.point;
    const view = world.view(overlay.clientWidth, overlay.clientHeight);
    const fix = nearest(fixes(), (one) => view.project(one.lon, one.lat), x, y);
    if (fix) return void numbers.show(numbersOfFix(fix, began()), x, y);
    const place = nearest(placesOf(state.frame), (one) => view.project(one.lon, one.lat), x, y);
    if (place) return void numbers.show(numbersOfPlace(state.frame, place), x, y);
    const row = rowAt(state.series, view, x, y);
    if (row >= 0) return void numbers.show(numbersOfMoment(state.series, row, began(), nameOf), x, y);
    const { lat, lng } = event.lngLat;
    const road = await fetchJson(`roads/near?lat=${lat.toFixed(7)}&lon=${lng.toFixed(7)}`).catch(() => null);
    if (!road || awayFrom(road.line.map(([lon, north]) => view.project(lon, north)), x, y) > ROAD) return;
    numbers.show(numbersOfRoad(road, state.roads.find(([edge]) => edge === road.edge)?.[1]), x, y);
  });
  for (const moved of ["dragstart", "wheel"]) world.map.on(moved, () => numbers.hide());
}

/** The row of the track that is nearest to a place on the screen, or -1. */
function rowAt(series, view, x, y) {
  const [west, south, east, north] = view.bounds;
  const seen = [];
  for (let i = 0; i < series.length; i += 1) {
    const [lon, lat] = [series.get("lon", i), series.get("lat", i)];
    if (lon > west && lon < east && lat > south && lat < north) seen.push(i);
  }
  return nearest(seen, (i) => view.project(series.get("lon", i), series.get("lat", i)), x, y) ?? -1;
}

/** Goes where the address says, now and when it changes. seek(t), zoom(z). */
export function followLinks(seek, zoom) {
  const go = () => {
    const { t, z } = linked();
    if (z !== null) zoom(z);
    if (t !== null) seek(t);
  };
  go();
  addEventListener("hashchange", go);
}

/** Files that are dropped onto the page are sent to the server, which shows them. */
export function takeDrops(page, replays, toast) {
  const over = (on) => page.classList.toggle("dropping", on);
  addEventListener("dragover", (event) => {
    event.preventDefault();
    over(true);
  });
  addEventListener("dragleave", (event) => event.relatedTarget === null && over(false));
  addEventListener("drop", async (event) => {
    event.preventDefault();
    over(false);
    const [file] = event.dataTransfer.files;
    if (!file) return;
    if (!replays) return toast("files are shown by whichroad replay; this page is live");
    toast(`reading ${file.name}`);
    const answer = await fetch(here(`open?name=${encodeURIComponent(file.name)}`), { method: "POST", body: file }).catch(() => null);
    const said = answer ? await answer.json().catch(() => ({})) : {};
    toast(answer?.ok ? `${file.name} is shown` : said.error ?? "the file was not taken");
  });
}
