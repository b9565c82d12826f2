// Drones on the map: their positions, paths, batteries and crashes.

import { clock, droneColour, FONT, inkOn, trace } from "./palette.js";
import { CRASHED, FLYING, RETURNING } from "./states.js";
import { drawQueue, tasksAt } from "./tasks.js";

const at = [0, 0, 0];
const place = [0, 0, 0];

/** The paths of drones in this episode; if there are many drones, only that of the chosen one. */
export function drawPaths(scene) {
  const { ctx } = scene;
  scene.drones.forEach((drone, d) => {
    const chosen = scene.isChosen("drone", d);
    if (scene.small && !chosen) return;
    ctx.strokeStyle = droneColour(d);
    ctx.globalAlpha = chosen ? 0.95 : 0.6;
    ctx.lineWidth = chosen ? 2.5 : 1.75;
    ctx.beginPath();
    tracePath(scene, d);
    ctx.stroke();
  });
  ctx.globalAlpha = 1;
}

function tracePath(scene, d) {
  const { ctx, camera, state } = scene;
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
  const { x, y, z } = scene.drones[d];
  to(x, y, z);
}

export function drawDrones(scene) {
  const { state, camera } = scene;
  const order = scene.drones.map((_, d) => d).filter((d) => state.mode[d] !== CRASHED && !isDocked(scene, d));
  if (camera.tilted) {
    const depth = (d) => camera.depth(scene.drones[d].x, scene.drones[d].y, scene.drones[d].z);
    order.sort((a, b) => depth(b) - depth(a));
    order.forEach((d) => drawPole(scene, d));
  }
  const near = tooNear(scene);
  const beside = new Map();
  for (const d of order) {
    const drone = scene.drones[d];
    const key = `${Math.round(drone.px / 6)},${Math.round(drone.py / 6)}`;
    const others = beside.get(key) ?? 0;
    beside.set(key, others + 1);
    drone.px += scene.tiny ? 0 : others * (scene.small ? 17 : 26); // those that share a place stand side by side
    drawDrone(scene, d);
    if (near.has(d)) drawRing(scene.ctx, scene.theme, drone.px, drone.py, scene.small ? 12 : 18);
  }
}

/** The drones in the air that are nearer to another one than the scenario's least distance. */
function tooNear({ run, state, drones }) {
  const near = new Set();
  if (!run.separation_m) return near;
  const flying = [...drones.keys()].filter((d) => state.mode[d] === FLYING || state.mode[d] === RETURNING);
  flying.forEach((one, k) => {
    for (const other of flying.slice(k + 1)) {
      const [a, b] = [drones[one], drones[other]];
      if (Math.hypot(a.x - b.x, a.y - b.y, a.z - b.z) < run.separation_m) near.add(one).add(other);
    }
  });
  return near;
}

/** A ring around a drone that is too near to another one. */
export function drawRing(ctx, theme, x, y, r) {
  ctx.strokeStyle = theme.danger;
  ctx.lineWidth = 2;
  ctx.setLineDash([4, 3]);
  ctx.beginPath();
  ctx.arc(x, y, r, 0, 2 * Math.PI);
  ctx.stroke();
  ctx.setLineDash([]);
}

function isDocked(scene, d) {
  const docked = scene.drones[d].docked && scene.drones[d].drawn;
  scene.drones[d].drawn = false;
  return docked;
}

function drawPole(scene, d) {
  const { ctx, camera } = scene;
  const drone = scene.drones[d];
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

function drawDrone(scene, d) {
  const { ctx, theme, state } = scene;
  const { px, py } = scene.drones[d];
  const shape = shapeOf(scene.run, d);
  if (scene.tiny) return drawBody(ctx, theme, d, px, py, 4.5, state.mode[d] === RETURNING, false, shape);
  const r = scene.small ? 6.5 : 9;
  if (!scene.small) drawFrame(ctx, theme, px, py, 11, 4);
  drawBattery(ctx, theme, scene.batteryOf(d), px, py, r + 3, scene.small ? 1.5 : 3);
  drawBody(ctx, theme, d, px, py, r, state.mode[d] === RETURNING, true, shape);
  drawTasks(scene, d, px, py + (scene.small ? 12 : 18));
  if (!scene.small && state.mode[d] === RETURNING) {
    scene.write("returning", px, py - 25, "center", theme.ink);
  }
  return undefined;
}

/** The queue at the processor of a drone or access point, below it. */
export function drawTasks(scene, s, x, y) {
  if (!scene.state.queue[s]) return;
  const more = drawQueue(scene.ctx, scene.theme, s, scene.run.drones, x, y, tasksAt(scene.state, s));
  if (more) scene.write(more.text, more.x, more.y, "left", scene.theme.ink);
}

/** The arms and rotors around a drone's body. */
export function drawFrame(ctx, theme, x, y, arm, rotor) {
  ctx.lineWidth = 2;
  ctx.strokeStyle = theme.ink;
  drawCross(ctx, x, y, arm);
  ctx.fillStyle = theme.paper;
  ctx.lineWidth = 1.25;
  for (const [sx, sy] of [[-1, -1], [1, -1], [1, 1], [-1, 1]]) {
    ctx.beginPath();
    ctx.arc(x + sx * arm, y + sy * arm, rotor, 0, 2 * Math.PI);
    ctx.fill();
    ctx.stroke();
  }
}

const SHAPES = ["circle", "square", "hexagon", "shield", "diamond", "triangle"];

/** The shape of a drone, by its type. */
export const shapeOf = (run, d) => shapeOfType(run.type_of[d]);
export const shapeOfType = (number) => SHAPES[number % SHAPES.length];

export function drawBody(ctx, theme, d, x, y, r, hollow, numbered = true, shape = "circle") {
  const colour = droneColour(d);
  ctx.fillStyle = hollow ? theme.paper : colour;
  ctx.strokeStyle = hollow ? colour : theme.paper;
  ctx.lineWidth = hollow ? 2 : 1;
  ctx.beginPath();
  trace(ctx, shape, x, y, r);
  ctx.fill();
  ctx.stroke();
  if (!numbered) return;
  ctx.fillStyle = hollow ? theme.ink : inkOn(colour);
  ctx.font = `600 ${Math.round(r * (d > 99 ? 0.9 : 1.25))}px ${FONT}`;
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(d, x, y + 0.5);
}

/** A ring that shows the charge of the battery as a share of a circle. */
export function drawBattery(ctx, theme, share, x, y, r, width) {
  if (share === null) return;
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

export function drawCrashes(scene) {
  const { ctx, state, theme, camera } = scene;
  const { episode } = state;
  const { event } = episode;
  const crash = scene.run.kinds.indexOf("crash");
  const fallen = state.marks.filter((i) => event.kind[i] === crash && i < state.sums.next);
  scene.fallen = [];
  for (const i of fallen) {
    const d = event.drone[i];
    episode.dronePlace(d, event.tUs[i], place);
    camera.project(place[0], place[1], 0, at);
    const [x, y] = at;
    const r = scene.tiny ? 4 : 7;
    const lies = state.mode[d] === CRASHED && state.sinceUs[d] === event.tUs[i];
    for (const [width, colour] of [[6, theme.map], [2.75, theme.danger]]) {
      ctx.strokeStyle = colour;
      ctx.globalAlpha = lies ? 1 : 0.55; // another has taken its place since
      ctx.lineWidth = scene.tiny ? width / 1.6 : width;
      drawCross(ctx, x, y, r);
    }
    ctx.globalAlpha = 1;
    if (lies && !scene.tiny) scene.fallen.push({ text: `${d} crashed at ${clock(event.tUs[i])}`, x, y: y + 17 });
  }
}

/** The names of crashed drones, above everything else, one below the other. */
export function nameFallen(scene) {
  const rows = new Map();
  for (const { text, x, y } of scene.fallen) {
    const key = `${Math.round(x / 40)},${Math.round(y / 10)}`;
    const before = rows.get(key) ?? 0;
    rows.set(key, before + 1);
    scene.write(text, x, y + 13 * before, "center", scene.theme.danger, 600);
  }
}

export function drawCross(ctx, x, y, r) {
  ctx.beginPath();
  ctx.moveTo(x - r, y - r);
  ctx.lineTo(x + r, y + r);
  ctx.moveTo(x + r, y - r);
  ctx.lineTo(x - r, y + r);
  ctx.stroke();
}
