// The map at an instant: ground, stations and their queues, users, links, drones and crashes.

import { buildingsOf, drawBuildings } from "./city.js";
import { drawCrashes, drawDrones, drawPaths, nameFallen } from "./drones.js";
import { drawFoot, makeRoom } from "./foot.js";
import { drawHeat, heatOf } from "./heat.js";
import { ringsAt, typeOf } from "./links.js";
import { droneColour, FONT } from "./palette.js";
import { drawPoints } from "./points.js";
import { FLYING, RETURNING } from "./states.js";
import { drawStations } from "./stations.js";
import { drawLinks, drawUsers, drawWalk, MANY_USERS } from "./users.js";
import { drawFlatGround } from "./view2d.js";
import { circle, drawTiltedGround } from "./view3d.js";
import { drawZones } from "./zones.js";

const at = [0, 0, 0];
const place = [0, 0, 0];
const MANY_DRONES = 20;
const MANY_BUILDINGS = 1000;
const REST_MS = 150;
const CLOSE_PX = 22; // of a cell: from there on each drone and pad of many has room

export class Scene {
  constructor(run, canvas, camera) {
    this.run = run;
    this.canvas = canvas;
    this.ctx = canvas.getContext("2d");
    this.camera = camera;
    this.x = new Float64Array(run.users);
    this.y = new Float64Array(run.users);
    this.px = new Float32Array(run.users);
    this.py = new Float32Array(run.users);
    this.drones = Array.from({ length: run.drones }, () => ({ x: 0, y: 0, z: 0, px: 0, py: 0 }));
    this.stations = run.map.stations.map(() => ({ px: 0, py: 0 }));
    this.points = run.points.map(() => ({ px: 0, py: 0 }));
    this.sprites = new Map();
    this.selection = null;
    this.hover = null;
    this.followed = -1; // the drone that stays in the middle
    this.ratio = 1;
    this.covered = 0; // pixels at the right of the foot
    this.buildings = buildingsOf(run);
    this.heat = null;
  }

  setTheme(theme) {
    this.theme = theme;
    this.sprites.clear();
    this.layers = {};
  }

  /** Show a heat map of the episode: "covered", "waiting", or null for none. */
  setHeat(name, state) {
    this.heat = name && state ? heatOf(state, name) : null;
    this.layers = {};
  }

  /** Fit the canvas to its box, some pixels of which are covered: at the left and right of the map, and
   * at the right of its foot. */
  resize(left = 0, right = 0, covered = right) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.ratio = Math.min(3, window.devicePixelRatio || 1);
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
    this.covered = covered;
    this.camera.resize(width, height, left, right);
    this.sprites.clear();
    this.layers = {};
  }

  draw(state) {
    const { ctx, camera } = this;
    this.state = state;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    makeRoom(this);
    if (this.followed >= 0) camera.follow(...state.episode.dronePlace(this.followed, state.tUs, place));
    this.#locate();
    this.#drawLayer("ground", (layer) => this.#drawGround(layer));
    ctx.lineJoin = ctx.lineCap = "round";
    this.#drawFootprints();
    drawPaths(this);
    drawWalk(this);
    drawUsers(this);
    if (camera.tilted && this.buildings.length) {
      this.#drawLayer("city", (layer) => drawBuildings(layer, this.buildings, camera, this.theme, this.#moves()));
    }
    drawLinks(this);
    drawStations(this);
    drawPoints(this);
    drawCrashes(this);
    drawDrones(this);
    nameFallen(this);
    this.#drawRing();
    drawFoot(this);
  }

  /** Move the map so that the chosen thing is visible. */
  reveal(what) {
    const { camera, state } = this;
    if (!what || !state || camera.tilted || this.followed >= 0) return;
    this.#locate();
    const { px, py } = this.whereIs(what);
    if (px > camera.left && py > 0 && px < camera.width && py < camera.height - camera.below) return;
    camera.pan(camera.middleX - px, camera.middleY - py);
  }

  /** The drone, user or station next to a point of the picture, or null if there is none. */
  nearest(px, py, reach = 16) {
    if (py > this.camera.height - this.camera.below) return null;
    let best = null;
    let nearest = reach * reach;
    const consider = (what, index, x, y, ease) => {
      const far = (x - px) ** 2 + (y - py) ** 2 - ease;
      if (far < nearest) [best, nearest] = [{ what, index }, far];
    };
    for (let u = 0; u < this.run.users; u += 1) consider("user", u, this.px[u], this.py[u], 0);
    this.stations.forEach((s, index) => consider("station", index, s.px, s.py, 40));
    this.drones.forEach((d, index) => consider("drone", index, d.px, d.py, 90));
    return best;
  }

  // ---- positions

  #locate() {
    const { state, camera, run } = this;
    const { episode } = state;
    episode.userPlaces(state.tUs, this.x, this.y);
    for (let u = 0; u < run.users; u += 1) {
      camera.project(this.x[u], this.y[u], camera.tilted ? episode.walk.z[u] : 0, at);
      this.px[u] = at[0];
      this.py[u] = at[1];
    }
    const { size_m: size, cells } = run.map;
    run.map.stations.forEach(([ix, iy], s) => {
      camera.project(((ix + 0.5) * size[0]) / cells[0], ((iy + 0.5) * size[1]) / cells[1], 0, at);
      Object.assign(this.stations[s], { px: at[0], py: at[1], dock: state.dock(s) });
    });
    run.points.forEach((point, k) => {
      camera.project(point.at[0], point.at[1], camera.tilted ? point.at[2] : 0, at);
      [this.points[k].px, this.points[k].py] = at;
    });
    this.drones.forEach((drone, d) => {
      episode.dronePlace(d, state.tUs, place);
      [drone.x, drone.y, drone.z] = place;
      camera.project(...place, at);
      [drone.px, drone.py] = at;
      drone.docked = state.station[d] >= 0 && state.mode[d] !== FLYING && state.mode[d] !== RETURNING;
    });
    this.small = run.drones > MANY_DRONES;
    const cellPx = (size[0] / cells[0]) * (camera.tilted ? camera.near : camera.scale);
    this.tiny = this.small && cellPx < CLOSE_PX;
    const far = run.users > MANY_USERS && cellPx < CLOSE_PX;
    if (far !== this.far) this.sprites.clear();
    this.far = far;
  }

  // ---- layers

  /** Whether the view of a large city moves; when it rests, the city is drawn again in full. */
  #moves() {
    const moves = this.buildings.length > MANY_BUILDINGS && this.seenFrom !== this.camera.stamp;
    this.seenFrom = this.camera.stamp;
    clearTimeout(this.resting);
    if (moves) {
      this.resting = setTimeout(() => {
        this.layers.city = null;
        this.again?.();
      }, REST_MS);
    }
    return moves;
  }

  /** Draw what changes with the view only; it is kept until the view changes. */
  #drawLayer(name, paint) {
    const { camera, canvas } = this;
    const key = `${camera.stamp} ${this.ratio}`;
    if (!canvas.width || !canvas.height) return;
    const layer = this.layers[name] ?? { canvas: document.createElement("canvas") };
    this.layers[name] = layer;
    if (layer.key !== key) {
      layer.canvas.width = canvas.width; // this clears it
      layer.canvas.height = canvas.height;
      const ctx = layer.canvas.getContext("2d");
      ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      ctx.lineJoin = ctx.lineCap = "round";
      paint(ctx);
      layer.key = key;
    }
    this.ctx.setTransform(1, 0, 0, 1, 0, 0);
    this.ctx.drawImage(layer.canvas, 0, 0);
    this.ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
  }

  #drawGround(ctx) {
    const { camera, theme, run } = this;
    ctx.fillStyle = theme.paper;
    ctx.fillRect(0, 0, camera.width, camera.height);
    ctx.lineCap = "butt";
    (camera.tilted ? drawTiltedGround : drawFlatGround)(ctx, run, camera, theme);
    if (this.heat) drawHeat(ctx, this.heat, camera, theme);
    drawZones(ctx, run, camera, theme);
  }

  #drawFootprints() {
    const { run, state, theme } = this;
    run.points.forEach(({ at: [x, y], rings_m: radii }) => this.#drawRings(x, y, radii, theme.muted));
    this.drones.forEach((drone, d) => {
      if (state.mode[d] !== FLYING) return;
      this.#drawRings(drone.x, drone.y, ringsAt(run, d, drone.z), droneColour(d));
    });
    this.ctx.globalAlpha = 1;
  }

  /** The rings in which links have each class, the widest with its edge; a disc is one ring. */
  #drawRings(x, y, radii, colour) {
    const { ctx, camera } = this;
    const dark = this.small ? 0.035 : radii.length > 1 ? 0.22 : 0.09;
    const each = 1 - (1 - dark) ** (1 / radii.length);
    ctx.fillStyle = ctx.strokeStyle = colour;
    radii.forEach((radius, k) => {
      if (radius <= 0) return;
      if (camera.tilted) circle(ctx, camera, x, y, radius);
      else {
        camera.project(x, y, 0, at);
        ctx.beginPath();
        ctx.arc(at[0], at[1], radius * camera.scale, 0, 2 * Math.PI);
      }
      ctx.globalAlpha = each;
      ctx.fill();
      if (k > 0) return;
      ctx.globalAlpha = this.small ? 0.3 : 0.8;
      ctx.lineWidth = this.small ? 0.75 : 1.25;
      ctx.stroke();
    });
  }

  /** Rings around the chosen thing and, thinner, around the one at the pointer. */
  #drawRing() {
    const { ctx, theme } = this;
    for (const [what, width] of [[this.hover, 1.25], [this.selection, 2]]) {
      const where = what && this.whereIs(what);
      if (!where) continue;
      ctx.strokeStyle = theme.accent;
      ctx.lineWidth = width;
      ctx.beginPath();
      ctx.arc(where.px, where.py, what.what === "user" ? 11 : 21, 0, 2 * Math.PI);
      ctx.stroke();
    }
  }

  /** The charge of a drone's battery, 0 … 1, or null if it is unlimited. */
  batteryOf(d) {
    const { run, state } = this;
    const { capacity_us: capacity } = typeOf(run, d);
    if (capacity === null) return null;
    return Math.max(0, Math.min(1, state.episode.batteryUs(d, state.tUs) / capacity));
  }

  /** The place of something in the picture. */
  whereIs({ what, index }) {
    if (what === "drone") return this.drones[index];
    if (what === "station") return this.stations[index];
    return { px: this.px[index], py: this.py[index] };
  }

  isChosen(what, index) {
    return this.selection?.what === what && this.selection.index === index;
  }

  write(text, x, y, align, colour, weight = 400) {
    const { ctx, theme } = this;
    ctx.font = `${weight} 11px ${FONT}`;
    ctx.textAlign = align;
    ctx.textBaseline = "middle";
    ctx.strokeStyle = theme.map;
    ctx.lineWidth = 3.5;
    ctx.strokeText(text, x, y);
    ctx.fillStyle = colour;
    ctx.fillText(text, x, y);
  }
}
