// The map at a moment: ground, stations and their queues, users, links, drones, crashes.

import { Crowd, stampOf } from "./crowd.js";
import {
  clock, droneColour, inkOn, SHAPES, STATE_COLOURS, trace,
} from "./palette.js";
import {
  CRASHED, FLYING, IDLE, RETURNING, SERVED, WAITING,
} from "./state.js";
import { drawFlatGround } from "./view2d.js";
import { circle, drawBuildings, drawTiltedGround } from "./view3d.js";

const at = [0, 0, 0];
const place = [0, 0, 0];
const FONT = "system-ui, -apple-system, 'Segoe UI', sans-serif";
const MANY_USERS = 1500;
const MANY_DRONES = 20;
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
    this.sprites = new Map();
    this.selection = null;
    this.hover = null;
    this.ratio = 1;
  }

  setTheme(theme) {
    this.theme = theme;
    this.sprites.clear();
    this.backdropOf = null;
  }

  /** Fit the canvas to its box. */
  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.ratio = Math.min(3, window.devicePixelRatio || 1);
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
    this.camera.resize(width, height);
    this.sprites.clear();
    this.backdropOf = null;
  }

  draw(state) {
    const { ctx, camera } = this;
    this.state = state;
    this.#locate();
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    this.#drawBackdrop();
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.lineJoin = ctx.lineCap = "round";
    this.#drawFootprints();
    this.#drawPaths();
    this.#drawWalk();
    this.#drawUsers();
    if (camera.tilted) drawBuildings(ctx, this.run, camera, this.theme);
    this.#drawLinks();
    this.#drawStations();
    this.#drawCrashes();
    this.#drawDrones();
    this.#nameFallen();
    this.#drawRing();
    if (camera.tilted && camera.lift > 1.05) this.#write(
      `heights × ${camera.lift.toFixed(1)}`, 12, camera.height - 12, "left", this.theme.muted,
    );
  }

  /** Move the map so that what is chosen can be seen. */
  reveal(what) {
    const { camera, state } = this;
    if (!what || !state || camera.tilted) return;
    this.#locate();
    const { px, py } = this.whereIs(what);
    if (px > 0 && py > 0 && px < camera.width && py < camera.height) return;
    camera.pan(camera.width / 2 - px, camera.height / 2 - py);
  }

  /** The drone, user or station next to a point of the picture; null where there is none. */
  nearest(px, py, reach = 16) {
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

  // ---- where everything is

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

  #drawBackdrop() {
    const { camera, theme, run } = this;
    const key = `${camera.stamp} ${this.ratio}`;
    if (this.backdropOf !== key) {
      this.backdrop ??= document.createElement("canvas");
      this.backdrop.width = this.canvas.width;
      this.backdrop.height = this.canvas.height;
      const ctx = this.backdrop.getContext("2d");
      ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      ctx.fillStyle = theme.paper;
      ctx.fillRect(0, 0, camera.width, camera.height);
      (camera.tilted ? drawTiltedGround : drawFlatGround)(ctx, run, camera, theme);
      this.backdropOf = key;
    }
    if (this.backdrop.width && this.backdrop.height) this.ctx.drawImage(this.backdrop, 0, 0);
  }

  #drawFootprints() {
    const { ctx, camera, run, state } = this;
    this.drones.forEach((drone, d) => {
      if (state.mode[d] !== FLYING) return;
      if (camera.tilted) circle(ctx, camera, drone.x, drone.y, run.footprint_m);
      else {
        ctx.beginPath();
        ctx.arc(drone.px, drone.py, run.footprint_m * camera.scale, 0, 2 * Math.PI);
      }
      ctx.fillStyle = ctx.strokeStyle = droneColour(d);
      ctx.globalAlpha = this.small ? 0.035 : 0.09;
      ctx.fill();
      ctx.globalAlpha = this.small ? 0.25 : 0.6;
      ctx.lineWidth = this.small ? 0.75 : 1.25;
      ctx.stroke();
    });
    ctx.globalAlpha = 1;
  }

  /** Where drones have been in this episode. Of many, that of the chosen one. */
  #drawPaths() {
    const { ctx } = this;
    this.drones.forEach((drone, d) => {
      const chosen = this.#isChosen("drone", d);
      if (this.small && !chosen) return;
      ctx.strokeStyle = droneColour(d);
      ctx.globalAlpha = chosen ? 0.95 : 0.6;
      ctx.lineWidth = chosen ? 2.5 : 1.75;
      ctx.beginPath();
      this.#tracePath(d);
      ctx.stroke();
    });
    ctx.globalAlpha = 1;
  }

  #tracePath(d) {
    const { ctx, camera, state } = this;
    const { leg } = state.episode;
    const now = state.episode.legAt(d, state.tUs);
    let pen = false;
    const to = (x, y, z) => {
      camera.project(x, y, z, at);
      if (pen) ctx.lineTo(at[0], at[1]);
      else ctx.moveTo(at[0], at[1]);
      pen = true;
    };
    for (let k = leg.first[d]; k <= now; k += 1) {
      if (leg.durationUs[k] === 0) pen = false; // put there, not flown
      if (leg.tUs[k] < 0 && leg.durationUs[k] > 0) {
        state.episode.dronePlace(d, 0, place);
        to(...place);
      } else to(leg.xFrom[k], leg.yFrom[k], leg.mode[k] === CRASHED ? 0 : leg.zFrom[k]);
      if (k < now && leg.durationUs[k] > 0) {
        const cutUs = leg.tUs[k + 1];
        if (leg.tUs[k] + leg.durationUs[k] <= cutUs) to(leg.xTo[k], leg.yTo[k], leg.zTo[k]);
        else { // it crashed on the way
          const share = state.episode.shareOfLeg(k, cutUs);
          to(...["x", "y", "z"].map((axis) => leg[`${axis}From`][k]
            + share * (leg[`${axis}To`][k] - leg[`${axis}From`][k])));
        }
      }
    }
    const { x, y, z } = this.drones[d];
    to(x, y, z);
  }

  /** The walk of the chosen user: what it has walked, and, dotted, what it will. */
  #drawWalk() {
    const u = this.selection?.what === "user" ? this.selection.index : -1;
    if (u < 0) return;
    const { ctx, camera, state, theme } = this;
    const { walk } = state.episode;
    ctx.strokeStyle = theme.ink;
    for (const past of [true, false]) {
      ctx.beginPath();
      const here = [this.px[u], this.py[u]];
      if (!past) ctx.moveTo(...here);
      for (let k = walk.first[u]; k < walk.first[u + 1]; k += 1) {
        if ((walk.tUs[k] <= state.tUs) !== past) continue;
        camera.project(walk.x[k], walk.y[k], camera.tilted ? walk.z[u] : 0, at);
        ctx.lineTo(at[0], at[1]);
      }
      if (past) ctx.lineTo(...here);
      ctx.setLineDash(past ? [] : [1, 5]);
      ctx.lineWidth = 1.25;
      ctx.globalAlpha = past ? 0.7 : 0.9;
      ctx.stroke();
    }
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  /** Users are stamped: a small picture for each state and service. */
  #drawUsers() {
    const { ctx, run, state } = this;
    const { request } = state.episode;
    const groups = new Map();
    for (let u = 0; u < run.users; u += 1) {
      const doing = state.userState(u);
      const asked = state.request[u];
      const service = asked >= 0 ? request.service[asked] : -1;
      const key = (service + 1) * 4 + doing;
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(u);
    }
    const order = [...groups.keys()].sort((a, b) => (a & 3) - (b & 3));
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    if (run.users > MANY_USERS) this.#drawCrowd(order, groups);
    else {
      for (const key of order) {
        const sprite = this.#userSprite(key & 3, (key >> 2) - 1);
        const half = sprite.width / 2;
        for (const u of groups.get(key)) {
          ctx.drawImage(
            sprite,
            Math.round(this.px[u] * this.ratio - half),
            Math.round(this.py[u] * this.ratio - half),
          );
        }
      }
    }
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
  }

  #drawCrowd(order, groups) {
    const { width, height } = this.canvas;
    if (!width || !height) return;
    if (this.crowd?.width !== width || this.crowd.height !== height) this.crowd = new Crowd(width, height);
    this.crowd.clear();
    for (const key of order) {
      const sprite = this.#userSprite(key & 3, (key >> 2) - 1);
      sprite.stamp ??= stampOf(sprite);
      for (const u of groups.get(key)) {
        this.crowd.put(sprite.stamp, this.px[u] * this.ratio, this.py[u] * this.ratio);
      }
    }
    this.crowd.show(this.ctx);
  }

  #userSprite(doing, service) {
    const key = doing * 100 + service;
    let sprite = this.sprites.get(key);
    if (sprite) return sprite;
    const r = (this.far ? RADII_FAR : RADII)[doing];
    const side = Math.ceil((2 * r * 1.3 + 4) * this.ratio);
    sprite = document.createElement("canvas");
    sprite.width = sprite.height = side + (side % 2);
    const ctx = sprite.getContext("2d");
    ctx.scale(this.ratio, this.ratio);
    const middle = sprite.width / this.ratio / 2;
    if (this.far) drawDot(ctx, middle, middle, r, doing, service, this.theme);
    else drawUser(ctx, middle, middle, r, doing, service, this.theme);
    this.sprites.set(key, sprite);
    return sprite;
  }

  /** From a drone to the users it serves. */
  #drawLinks() {
    const { ctx, run, state } = this;
    const paths = new Map();
    for (let u = 0; u < run.users; u += 1) {
      if (!state.served[u]) continue;
      const d = state.holder[u];
      if (d < 0) continue;
      if (!paths.has(d)) paths.set(d, new Path2D());
      const path = paths.get(d);
      path.moveTo(this.drones[d].px, this.drones[d].py);
      path.lineTo(this.px[u], this.py[u]);
    }
    for (const [d, path] of paths) {
      const chosen = this.#isChosen("drone", d);
      ctx.strokeStyle = droneColour(d);
      ctx.globalAlpha = chosen ? 0.95 : this.small ? 0.25 : 0.55;
      ctx.lineWidth = chosen ? 1.75 : this.small ? 0.6 : 1.1;
      ctx.stroke(path);
    }
    ctx.globalAlpha = 1;
  }

  /** A station, its pads below it, and those that wait for one. */
  #drawStations() {
    const { ctx, theme, run } = this;
    this.stations.forEach(({ px, py, dock }, s) => {
      ctx.fillStyle = theme.paper;
      ctx.strokeStyle = theme.ink;
      if (this.tiny) {
        ctx.fillStyle = theme.ink;
        ctx.fillRect(px - 4, py - 4, 8, 8);
        return;
      }
      ctx.lineWidth = this.#isChosen("station", s) ? 2.5 : 1.5;
      ctx.beginPath();
      ctx.roundRect(px - 10, py - 10, 20, 20, 5);
      ctx.fill();
      ctx.stroke();
      ctx.fillStyle = theme.ink;
      ctx.beginPath();
      for (const [x, y] of BOLT) ctx.lineTo(px + x, py + y);
      ctx.fill();
      this.#drawDock(px, py + 29, dock, run.pads);
    });
  }

  #drawDock(px, py, dock, pads) {
    const { ctx, theme } = this;
    const slots = Math.min(pads, Math.max(3, dock.charging.length));
    const gap = 21;
    const charging = dock.charging.slice(0, slots);
    const waiting = dock.queue.slice(0, 5);
    const ready = dock.charged.slice(0, 3);
    const left = px - ((slots - 1) * gap) / 2;
    if (!charging.length && !waiting.length && !ready.length) return;
    for (let k = 0; k < slots; k += 1) {
      ctx.strokeStyle = theme.ink;
      ctx.fillStyle = theme.paper;
      ctx.lineWidth = 1.25;
      ctx.beginPath();
      ctx.roundRect(left + k * gap - 9.5, py - 9.5, 19, 19, 4);
      ctx.fill();
      ctx.stroke();
      if (k < charging.length) this.#drawDocked(charging[k], left + k * gap, py, false);
    }
    let x = left + (slots - 1) * gap + gap + 4;
    waiting.forEach((d) => {
      this.#drawDocked(d, x, py, true);
      x += gap - 2;
    });
    if (waiting.length) {
      const more = dock.queue.length - waiting.length;
      this.#write(more ? `+${more} wait` : waiting.length > 1 ? "wait" : "waits", x - 6, py, "left", theme.ink);
    }
    x = left - gap - 4;
    ready.forEach((d) => {
      this.#drawDocked(d, x, py, false);
      this.#write("✓", x, py + 16, "center", theme.ink);
      x -= gap;
    });
  }

  #drawDocked(d, x, y, hollow) {
    const drone = this.drones[d];
    drone.px = x;
    drone.py = y;
    drone.drawn = true;
    this.#drawBattery(d, x, y, 9.5, 2);
    this.#drawBody(d, x, y, 7, hollow);
  }

  #drawCrashes() {
    const { ctx, state, theme, camera } = this;
    const { episode } = state;
    const { event } = episode;
    const crash = this.run.kinds.indexOf("crash");
    const fallen = state.marks.filter((i) => event.kind[i] === crash && i < state.sums.next);
    this.fallen = [];
    for (const i of fallen) {
      const d = event.drone[i];
      episode.dronePlace(d, event.tUs[i], place);
      camera.project(place[0], place[1], 0, at);
      const [x, y] = at;
      const r = this.tiny ? 4 : 7;
      const lies = state.mode[d] === CRASHED && state.sinceUs[d] === event.tUs[i];
      for (const [width, colour] of [[6, theme.map], [2.75, theme.danger]]) {
        ctx.strokeStyle = colour;
        ctx.globalAlpha = lies ? 1 : 0.55; // another has taken its place since
        ctx.lineWidth = this.tiny ? width / 1.6 : width;
        ctx.beginPath();
        ctx.moveTo(x - r, y - r);
        ctx.lineTo(x + r, y + r);
        ctx.moveTo(x + r, y - r);
        ctx.lineTo(x - r, y + r);
        ctx.stroke();
      }
      ctx.globalAlpha = 1;
      if (lies && !this.tiny) this.fallen.push({ text: `${d} crashed ${clock(event.tUs[i])}`, x, y: y + 17 });
    }
  }

  /** The names of what lies crashed, above all else, one below the other. */
  #nameFallen() {
    const rows = new Map();
    for (const { text, x, y } of this.fallen) {
      const key = `${Math.round(x / 40)},${Math.round(y / 10)}`;
      const before = rows.get(key) ?? 0;
      rows.set(key, before + 1);
      this.#write(text, x, y + 13 * before, "center", this.theme.danger, 600);
    }
  }

  #drawDrones() {
    const { state, camera } = this;
    const order = this.drones.map((_, d) => d).filter((d) => state.mode[d] !== CRASHED && !this.#isDocked(d));
    if (camera.tilted) {
      const depth = (d) => camera.depth(this.drones[d].x, this.drones[d].y, this.drones[d].z);
      order.sort((a, b) => depth(b) - depth(a));
      order.forEach((d) => this.#drawPole(d));
    }
    const beside = new Map();
    for (const d of order) {
      const drone = this.drones[d];
      const key = `${Math.round(drone.px / 6)},${Math.round(drone.py / 6)}`;
      const others = beside.get(key) ?? 0;
      beside.set(key, others + 1);
      drone.px += this.tiny ? 0 : others * (this.small ? 17 : 26); // those that share a place stand side by side
      this.#drawDrone(d);
    }
  }

  #isDocked(d) {
    const docked = this.drones[d].docked && this.drones[d].drawn;
    this.drones[d].drawn = false;
    return docked;
  }

  #drawPole(d) {
    const { ctx, camera } = this;
    const drone = this.drones[d];
    camera.project(drone.x, drone.y, 0, at);
    ctx.strokeStyle = ctx.fillStyle = droneColour(d);
    ctx.lineWidth = 1.25;
    ctx.beginPath();
    ctx.moveTo(at[0], at[1]);
    ctx.lineTo(drone.px, drone.py);
    ctx.stroke();
    ctx.beginPath();
    ctx.ellipse(at[0], at[1], 5, 5 * camera.sinPitch, 0, 0, 2 * Math.PI);
    ctx.fill();
  }

  #drawDrone(d) {
    const { ctx, theme, state } = this;
    const { px, py } = this.drones[d];
    if (this.tiny) return this.#drawBody(d, px, py, 4.5, state.mode[d] === RETURNING, false);
    const r = this.small ? 6.5 : 9;
    if (!this.small) {
      const arm = 11;
      ctx.lineWidth = 2;
      ctx.strokeStyle = theme.ink;
      ctx.beginPath();
      ctx.moveTo(px - arm, py - arm);
      ctx.lineTo(px + arm, py + arm);
      ctx.moveTo(px + arm, py - arm);
      ctx.lineTo(px - arm, py + arm);
      ctx.stroke();
      ctx.fillStyle = theme.paper;
      ctx.lineWidth = 1.25;
      for (const [sx, sy] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
        ctx.beginPath();
        ctx.arc(px + sx * arm, py + sy * arm, 4, 0, 2 * Math.PI);
        ctx.fill();
        ctx.stroke();
      }
    }
    this.#drawBattery(d, px, py, r + 3, this.small ? 1.5 : 3);
    this.#drawBody(d, px, py, r, state.mode[d] === RETURNING);
    if (!this.small && state.mode[d] === RETURNING) {
      this.#write("returning", px, py - 25, "center", theme.ink);
    }
    return undefined;
  }

  #drawBody(d, x, y, r, hollow, numbered = true) {
    const { ctx, theme } = this;
    const colour = droneColour(d);
    ctx.fillStyle = hollow ? theme.paper : colour;
    ctx.strokeStyle = hollow ? colour : theme.paper;
    ctx.lineWidth = hollow ? 2 : 1;
    ctx.beginPath();
    ctx.arc(x, y, r, 0, 2 * Math.PI);
    ctx.fill();
    ctx.stroke();
    if (!numbered) return;
    ctx.fillStyle = hollow ? theme.ink : inkOn(colour);
    ctx.font = `600 ${Math.round(r * (d > 99 ? 0.9 : 1.25))}px ${FONT}`;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.fillText(d, x, y + 0.5);
  }

  /** A ring of as much of a circle as the battery is full. */
  #drawBattery(d, x, y, r, width) {
    const { ctx, theme, state, run } = this;
    if (run.capacity_us === null) return;
    const share = Math.max(0, Math.min(1, state.episode.batteryUs(d, state.tUs) / run.capacity_us));
    ctx.lineWidth = width;
    ctx.strokeStyle = theme.faint;
    ctx.beginPath();
    ctx.arc(x, y, r, 0, 2 * Math.PI);
    ctx.stroke();
    ctx.strokeStyle = share > 0.2 ? theme.ink : theme.danger;
    ctx.beginPath();
    ctx.arc(x, y, r, -Math.PI / 2, -Math.PI / 2 + share * 2 * Math.PI);
    ctx.stroke();
  }

  /** Around what is chosen, and, thinner, around what the pointer is at. */
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

  /** Where something is in the picture. */
  whereIs({ what, index }) {
    if (what === "drone") return this.drones[index];
    if (what === "station") return this.stations[index];
    return { px: this.px[index], py: this.py[index] };
  }

  #isChosen(what, index) {
    return this.selection?.what === what && this.selection.index === index;
  }

  #write(text, x, y, align, colour, weight = 400) {
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

export const RADII = [3, 4, 5.2, 5.2]; // by state
const RADII_FAR = [1, 1.6, 1.5, 2.3];
const BOLT = [[1.5, -7], [-5, 1.5], [-0.5, 1.5], [-1.5, 7], [5, -1.5], [0.5, -1.5]];

/** A user of thousands: what is served is larger. */
function drawDot(ctx, x, y, r, doing, service, theme) {
  ctx.beginPath();
  trace(ctx, service < 0 ? "circle" : SHAPES[service % SHAPES.length], x, y, r);
  ctx.fillStyle = STATE_COLOURS[doing] || theme.idle;
  ctx.fill();
}

/** A user: by its state, and where it has a request by the shape of its service. */
export function drawUser(ctx, x, y, r, doing, service, theme, ink = null) {
  const shape = service < 0 ? "circle" : SHAPES[service % SHAPES.length];
  const colour = ink ?? (STATE_COLOURS[doing] || theme.idle);
  ctx.beginPath();
  trace(ctx, shape, x, y, r);
  ctx.lineJoin = "round";
  ctx.lineWidth = 2.5;
  ctx.strokeStyle = theme.map;
  ctx.stroke();
  ctx.fillStyle = doing === IDLE ? theme.map : colour;
  ctx.fill();
  ctx.lineWidth = doing === WAITING ? 2 : 1.25;
  ctx.strokeStyle = colour;
  if (doing === WAITING) ctx.fillStyle = theme.map;
  if (doing === WAITING) ctx.fill(); // hollow: it has nothing yet
  if (doing !== SERVED) ctx.stroke();
}
