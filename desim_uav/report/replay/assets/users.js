// Users on the map, by state and service, with the walk of the chosen one and links to their drones.

import { Crowd, stampOf } from "./crowd.js";
import { quality } from "./links.js";
import { droneColour, SHAPES, trace, userColour } from "./palette.js";
import { IDLE, SERVED, WAITING } from "./states.js";

const at = [0, 0, 0];
export const MANY_USERS = 1500;
export const RADII = [3, 4, 5.2, 5.2]; // by state
const RADII_FAR = [1, 1.6, 1.5, 2.3];

/** The stamps of users: a small picture for each state and service. */
export function drawUsers(scene) {
  const { ctx, run, state } = scene;
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
  if (run.users > MANY_USERS) drawCrowd(scene, order, groups);
  else {
    for (const key of order) {
      const sprite = userSprite(scene, key & 3, (key >> 2) - 1);
      const half = sprite.width / 2;
      for (const u of groups.get(key)) {
        ctx.drawImage(
          sprite,
          Math.round(scene.px[u] * scene.ratio - half),
          Math.round(scene.py[u] * scene.ratio - half),
        );
      }
    }
  }
  ctx.setTransform(scene.ratio, 0, 0, scene.ratio, 0, 0);
}

function drawCrowd(scene, order, groups) {
  const { width, height } = scene.canvas;
  if (!width || !height) return;
  if (scene.crowd?.width !== width || scene.crowd.height !== height) scene.crowd = new Crowd(width, height);
  scene.crowd.clear();
  for (const key of order) {
    const sprite = userSprite(scene, key & 3, (key >> 2) - 1);
    sprite.stamp ??= stampOf(sprite);
    for (const u of groups.get(key)) {
      scene.crowd.put(sprite.stamp, scene.px[u] * scene.ratio, scene.py[u] * scene.ratio);
    }
  }
  scene.crowd.show(scene.ctx);
}

function userSprite(scene, doing, service) {
  const key = doing * 100 + service;
  let sprite = scene.sprites.get(key);
  if (sprite) return sprite;
  const r = (scene.far ? RADII_FAR : RADII)[doing];
  const side = Math.ceil((2 * r * 1.3 + 4) * scene.ratio);
  sprite = document.createElement("canvas");
  sprite.width = sprite.height = side + (side % 2);
  const ctx = sprite.getContext("2d");
  ctx.scale(scene.ratio, scene.ratio);
  const middle = sprite.width / scene.ratio / 2;
  if (scene.far) drawDot(ctx, middle, middle, r, doing, service);
  else drawUser(ctx, middle, middle, r, doing, service, scene.theme);
  scene.sprites.set(key, sprite);
  return sprite;
}

const WIDTHS = 4; // of lines, from the worst class of a link to the best one

/** Lines from drones and access points to the users they serve; the better the link, the wider. */
export function drawLinks(scene) {
  const { ctx, run, state, theme } = scene;
  const paths = new Map();
  for (let u = 0; u < run.users; u += 1) {
    if (!state.usesLink(u)) continue;
    const s = state.holder[u];
    if (s < 0) continue;
    const wide = Math.max(1, Math.ceil(WIDTHS * quality(run, s, state.classOf(u, s))));
    const key = s * (WIDTHS + 1) + wide;
    if (!paths.has(key)) paths.set(key, new Path2D());
    const path = paths.get(key);
    const from = s < run.drones ? scene.drones[s] : scene.points[s - run.drones];
    path.moveTo(from.px, from.py);
    path.lineTo(scene.px[u], scene.py[u]);
  }
  for (const [key, path] of paths) {
    const s = Math.floor(key / (WIDTHS + 1));
    const chosen = scene.isChosen("drone", s);
    const width = run.graded ? 0.35 + (0.9 * (key % (WIDTHS + 1))) / WIDTHS : 1;
    ctx.strokeStyle = s < run.drones ? droneColour(s) : theme.ink;
    ctx.globalAlpha = chosen ? 0.95 : scene.small ? 0.25 : 0.55;
    ctx.lineWidth = width * (chosen ? 1.75 : scene.small ? 0.6 : 1.1) * (run.graded ? 1.6 : 1);
    ctx.stroke(path);
  }
  ctx.globalAlpha = 1;
}

/** The walk of the chosen user: solid up to now, dotted after that. */
export function drawWalk(scene) {
  const u = scene.selection?.what === "user" ? scene.selection.index : -1;
  if (u < 0) return;
  const { ctx, camera, state, theme } = scene;
  const { walk } = state.episode;
  ctx.strokeStyle = theme.ink;
  for (const past of [true, false]) {
    ctx.beginPath();
    const here = [scene.px[u], scene.py[u]];
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

/** A user among thousands; served users are larger. */
function drawDot(ctx, x, y, r, doing, service) {
  ctx.beginPath();
  trace(ctx, service < 0 ? "circle" : SHAPES[service % SHAPES.length], x, y, r);
  ctx.fillStyle = userColour(doing);
  ctx.fill();
}

/** A user, by its state and, if it has a request, with the shape of its service. */
export function drawUser(ctx, x, y, r, doing, service, theme, ink = null) {
  const shape = service < 0 ? "circle" : SHAPES[service % SHAPES.length];
  const colour = ink ?? userColour(doing);
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
