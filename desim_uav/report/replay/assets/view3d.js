// The ground in perspective.

import { drawStreets } from "./city.js";

const at = [0, 0, 0];

export function drawTiltedGround(ctx, run, camera, theme) {
  const { size_m: [width, depth], cells: [nx, ny] } = run.map;
  polygon(ctx, camera, [[0, 0], [width, 0], [width, depth], [0, depth]], 0);
  ctx.fillStyle = theme.map;
  ctx.fill();
  ctx.strokeStyle = theme.grid;
  ctx.lineWidth = 1;
  if (nx * ny <= 10000) {
    ctx.beginPath();
    for (let ix = 1; ix < nx; ix += 1) line(ctx, camera, (ix * width) / nx, 0, (ix * width) / nx, depth);
    for (let iy = 1; iy < ny; iy += 1) line(ctx, camera, 0, (iy * depth) / ny, width, (iy * depth) / ny);
    ctx.stroke();
  }
  drawStreets(ctx, run, camera, theme);
  polygon(ctx, camera, [[0, 0], [width, 0], [width, depth], [0, depth]], 0);
  ctx.strokeStyle = theme.line;
  ctx.stroke();
  ctx.strokeStyle = theme.muted;
  ctx.globalAlpha = 0.6;
  ctx.setLineDash([2, 4]);
  for (const { x_m: x, y_m: y, radius_m: radius } of run.map.clusters) {
    circle(ctx, camera, x, y, radius);
    ctx.stroke();
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

export function polygon(ctx, camera, corners, z) {
  ctx.beginPath();
  for (const [x, y] of corners) {
    camera.project(x, y, z, at);
    ctx.lineTo(at[0], at[1]);
  }
  ctx.closePath();
}

/** A circle on the ground. */
export function circle(ctx, camera, x, y, radius) {
  ctx.beginPath();
  for (let k = 0; k < 64; k += 1) {
    const a = (k * Math.PI) / 32;
    camera.project(x + radius * Math.cos(a), y + radius * Math.sin(a), 0, at);
    ctx.lineTo(at[0], at[1]);
  }
  ctx.closePath();
}

function line(ctx, camera, x0, y0, x1, y1) {
  camera.project(x0, y0, 0, at);
  ctx.moveTo(at[0], at[1]);
  camera.project(x1, y1, 0, at);
  ctx.lineTo(at[0], at[1]);
}
