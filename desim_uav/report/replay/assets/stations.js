// Charging stations on the map: their pads, and the drones that wait for one.

import { drawBattery, drawBody, shapeOf } from "./drones.js";

const BOLT = [[1.5, -7], [-5, 1.5], [-0.5, 1.5], [-1.5, 7], [5, -1.5], [0.5, -1.5]];

/** A station, its pads below it, and the drones that wait for one. */
export function drawStations(scene) {
  const { ctx, theme, run } = scene;
  scene.stations.forEach(({ px, py, dock }, s) => {
    if (scene.tiny) {
      ctx.fillStyle = theme.ink;
      ctx.fillRect(px - 4, py - 4, 8, 8);
      return;
    }
    drawStation(ctx, theme, px, py, scene.isChosen("station", s) ? 2.5 : 1.5);
    drawDock(scene, px, py + 29, dock, run.pads);
  });
}

export function drawStation(ctx, theme, px, py, width) {
  ctx.fillStyle = theme.paper;
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = width;
  ctx.beginPath();
  ctx.roundRect(px - 10, py - 10, 20, 20, 5);
  ctx.fill();
  ctx.stroke();
  ctx.fillStyle = theme.ink;
  ctx.beginPath();
  for (const [x, y] of BOLT) ctx.lineTo(px + x, py + y);
  ctx.fill();
}

function drawDock(scene, px, py, dock, pads) {
  const { ctx, theme } = scene;
  const slots = Math.min(pads, Math.max(3, dock.charging.length));
  const gap = 21;
  const charging = dock.charging.slice(0, slots);
  const waiting = dock.queue.slice(0, 5);
  const ready = dock.charged.slice(0, 3);
  const left = px - ((slots - 1) * gap) / 2;
  if (!charging.length && !waiting.length && !ready.length) return;
  for (let k = 0; k < slots; k += 1) {
    drawPad(ctx, theme, left + k * gap, py, 9.5);
    if (k < charging.length) drawDocked(scene, charging[k], left + k * gap, py, false);
  }
  let x = left + (slots - 1) * gap + gap + 4;
  waiting.forEach((d) => {
    drawDocked(scene, d, x, py, true);
    x += gap - 2;
  });
  if (waiting.length) {
    const more = dock.queue.length - waiting.length;
    scene.write(more ? `+${more} wait` : waiting.length > 1 ? "wait" : "waits", x - 6, py, "left", theme.ink);
  }
  x = left - gap - 4;
  ready.forEach((d) => {
    drawDocked(scene, d, x, py, false);
    scene.write("✓", x, py + 16, "center", theme.ink);
    x -= gap;
  });
}

/** A pad: a square with side 2 r. */
export function drawPad(ctx, theme, x, y, r) {
  ctx.strokeStyle = theme.ink;
  ctx.fillStyle = theme.paper;
  ctx.lineWidth = 1.25;
  ctx.beginPath();
  ctx.roundRect(x - r, y - r, 2 * r, 2 * r, 4);
  ctx.fill();
  ctx.stroke();
}

function drawDocked(scene, d, x, y, hollow) {
  const drone = scene.drones[d];
  drone.px = x;
  drone.py = y;
  drone.drawn = true;
  drawBattery(scene.ctx, scene.theme, scene.batteryOf(d), x, y, 9.5, 2);
  drawBody(scene.ctx, scene.theme, d, x, y, 7, hollow, true, shapeOf(scene.run, d));
}
