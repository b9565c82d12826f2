// Access points on the map: masts with their numbers.

import { drawTasks } from "./drones.js";

const at = [0, 0, 0];

export function drawPoints(scene) {
  const { ctx, camera, run, theme } = scene;
  run.points.forEach(({ at: [x, y] }, k) => {
    const { px, py } = scene.points[k];
    if (camera.tilted) {
      camera.project(x, y, 0, at);
      ctx.strokeStyle = theme.ink;
      ctx.lineWidth = 1.5;
      ctx.beginPath();
      ctx.moveTo(at[0], at[1]);
      ctx.lineTo(px, py);
      ctx.stroke();
    }
    drawMast(ctx, theme, px, py, scene.tiny ? 4 : 7);
    if (scene.tiny) return;
    scene.write(`access point ${k}`, px, py + 17, "center", theme.ink);
    drawTasks(scene, run.drones + k, px, py + 25);
  });
}

/** A triangle with waves on both sides of its top. */
export function drawMast(ctx, theme, x, y, r) {
  ctx.fillStyle = theme.ink;
  ctx.strokeStyle = theme.paper;
  ctx.lineWidth = 1;
  ctx.beginPath();
  ctx.moveTo(x, y - r);
  ctx.lineTo(x + 0.75 * r, y + r);
  ctx.lineTo(x - 0.75 * r, y + r);
  ctx.closePath();
  ctx.fill();
  ctx.stroke();
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = 1.25;
  for (const begin of [-0.6, Math.PI - 0.6]) {
    ctx.beginPath();
    ctx.arc(x, y - r, 0.9 * r, begin, begin + 1.2);
    ctx.stroke();
  }
}
