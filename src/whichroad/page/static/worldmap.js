// The map below: MapLibre GL, roads as vector tiles from this server, names as drawn images.

/* global maplibregl */

const RANKS = [0, 1, 2, 3, 4];
const WIDTHS = { 6: [1.2, 0.8, 0.5, 0.3, 0.2], 11: [2.6, 2, 1.3, 0.7, 0.4], 14: [8, 6.5, 5, 3.4, 1.8], 18: [34, 30, 25, 20, 11] };
const IMAGES = 1500; // names kept as images

function byZoom(more) {
  const stops = Object.entries(WIDTHS).flatMap(([zoom, widths]) => [
    Number(zoom),
    ["match", ["get", "rank"], ...RANKS.flatMap((r) => [r, widths[r] + more(Number(zoom))]), 1],
  ]);
  return ["interpolate", ["exponential", 1.6], ["zoom"], ...stops];
}

function byRank(major, plain, small) {
  return ["match", ["get", "rank"], 0, major, 1, major, 4, small, plain];
}

function styleOf(about, look, here) {
  const style = {
    version: 8,
    sources: {
      roads: {
        type: "vector", tiles: [here(about.tiles)], bounds: about.bounds,
        maxzoom: about.maxzoom, attribution: about.attribution,
      },
    },
    layers: [{ id: "land", type: "background", paint: { "background-color": look.land } }],
  };
  if (about.tiles_url) {
    style.sources.user = { type: "raster", tiles: [about.tiles_url], tileSize: 256, attribution: about.tiles_by };
    style.layers.push({ id: "user", type: "raster", source: "user", paint: rasterPaint(look) });
  }
  const line = { source: "roads", "source-layer": "road", type: "line" };
  const layout = { "line-cap": "round", "line-join": "round", "line-sort-key": ["-", 0, ["get", "rank"]] };
  style.layers.push(
    { ...line, id: "casing", layout, paint: { "line-width": byZoom((zoom) => (zoom < 11 ? 0.4 : 2)) } },
    { ...line, id: "road", layout, paint: { "line-width": byZoom(() => 0) } },
    {
      id: "oneway", type: "symbol", source: "roads", "source-layer": "road", minzoom: 15.5,
      filter: ["has", "oneway"],
      layout: {
        "symbol-placement": "line", "symbol-spacing": 110, "icon-image": `${look.name}|arrow`,
        "icon-rotation-alignment": "map", "icon-padding": 1, "icon-keep-upright": false,
      },
    },
    {
      id: "name", type: "symbol", source: "roads", "source-layer": "name", minzoom: 13.4,
      layout: {
        "symbol-placement": "line", "symbol-spacing": 320, "icon-rotation-alignment": "map",
        "icon-keep-upright": true, "icon-padding": 6, "symbol-sort-key": ["get", "rank"],
        "icon-image": ["concat", `${look.name}|`, ["get", "name"]],
      },
    },
  );
  for (const layer of style.layers) Object.assign((layer.paint ??= {}), coloursOf(layer.id, look));
  return style;
}

function rasterPaint(look) {
  return look.name === "dark"
    ? { "raster-brightness-max": 0.45, "raster-saturation": -0.6, "raster-opacity": 0.8 }
    : { "raster-brightness-max": 1, "raster-saturation": -0.4, "raster-opacity": 0.7 };
}

function coloursOf(id, look) {
  if (id === "land") return { "background-color": look.land };
  if (id === "casing") return { "line-color": byRank(look.majorCasing, look.casing, look.casing) };
  if (id === "road") {
    const plain = byRank(look.major, look.road, look.small);
    return { "line-color": ["case", ["has", "tunnel"], look.tunnel, plain] };
  }
  return id === "user" ? rasterPaint(look) : {};
}

export class WorldMap {
  /** about: the server's description of the map; here: turns an address of ours into a whole one. */
  constructor(container, about, look, here) {
    this.about = about;
    this.names = [];
    const [west, south, east, north] = about.view ?? about.bounds;
    this.map = new maplibregl.Map({
      container,
      style: styleOf(about, look, here),
      bounds: [[west, south], [east, north]],
      fitBoundsOptions: { padding: 40 },
      attributionControl: about.attribution || about.tiles_by ? { compact: !about.tiles_by } : false,
      maxZoom: 20.5, fadeDuration: 0, dragRotate: true, pitchWithRotate: false, maxPitch: 0,
      keyboard: false, localIdeographFontFamily: false, maxTileCacheSize: 120,
    });
    this.map.addControl(new maplibregl.ScaleControl({ maxWidth: 110 }), "bottom-right");
    this.map.on("styleimagemissing", (event) => this.draw(event.id));
    this.look = look;
  }

  /** Draws the image of a name, or the arrow of a one-way street. */
  draw(id) {
    const [theme, text] = [id.slice(0, id.indexOf("|")), id.slice(id.indexOf("|") + 1)];
    if (this.map.hasImage(id) || theme !== this.look.name) return;
    const image = text === "arrow" ? arrowImage(this.look) : nameImage(text, this.look);
    this.map.addImage(id, image, { pixelRatio: 2 });
    this.names.push(id);
    if (this.names.length > IMAGES) {
      for (const old of this.names.splice(0, IMAGES / 2)) this.map.removeImage(old);
    }
  }

  recolour(look) {
    this.look = look;
    for (const layer of this.map.getStyle().layers) {
      for (const [name, value] of Object.entries(coloursOf(layer.id, look))) {
        this.map.setPaintProperty(layer.id, name, value);
      }
    }
    this.map.setLayoutProperty("oneway", "icon-image", `${look.name}|arrow`);
    this.map.setLayoutProperty("name", "icon-image", ["concat", `${look.name}|`, ["get", "name"]]);
  }

  /** The view that a scene is drawn in. */
  view(width, height) {
    const box = this.map.getBounds();
    return {
      width, height, project: (lon, lat) => this.map.project([lon, lat]),
      bounds: [box.getWest(), box.getSouth(), box.getEast(), box.getNorth()],
    };
  }
}

function blank(width, height) {
  const canvas = document.createElement("canvas");
  canvas.width = Math.ceil(2 * width);
  canvas.height = Math.ceil(2 * height);
  const ctx = canvas.getContext("2d", { willReadFrequently: true });
  ctx.scale(2, 2);
  return ctx;
}

function nameImage(text, look) {
  const font = "500 11.5px system-ui, sans-serif";
  const measure = blank(1, 1);
  measure.font = font;
  const width = measure.measureText(text).width + 8;
  const ctx = blank(width, 18);
  ctx.font = font;
  ctx.textBaseline = "middle";
  ctx.lineJoin = "round";
  ctx.lineWidth = 3;
  ctx.strokeStyle = look.halo;
  ctx.strokeText(text, 4, 9.5);
  ctx.fillStyle = look.text;
  ctx.fillText(text, 4, 9.5);
  return ctx.getImageData(0, 0, ctx.canvas.width, ctx.canvas.height);
}

function arrowImage(look) {
  const ctx = blank(14, 8);
  ctx.strokeStyle = look.arrow;
  ctx.lineWidth = 1.4;
  ctx.lineCap = ctx.lineJoin = "round";
  ctx.beginPath();
  ctx.moveTo(1, 4);
  ctx.lineTo(12, 4);
  ctx.moveTo(9, 1.5);
  ctx.lineTo(12, 4);
  ctx.lineTo(9, 6.5);
  ctx.stroke();
  return ctx.getImageData(0, 0, ctx.canvas.width, ctx.canvas.height);
}
