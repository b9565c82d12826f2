// The city in perspective: the ground, and buildings as boxes, the farther ones first. Boxes are
// translucent, so that no user is hidden.

import { between } from "./palette.js";
import { roof } from "./view2d.js";

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

export function drawBuildings(ctx, run, camera, theme) {
  const { size_m: [width, depth], cells: [nx, ny], cell_height_m: heights } = run.map;
  const [dx, dy] = [width / nx, depth / ny];
  if (run.map.city) {
    drawPrisms(ctx, run.map.city, camera, theme);
    return;
  }
  const boxes = [];
  for (let ix = 0; ix < nx; ix += 1) {
    for (let iy = 0; iy < ny; iy += 1) {
      const height = heights[ix][iy];
      if (height > 0) {
        boxes.push([camera.depth((ix + 0.5) * dx, (iy + 0.5) * dy, 0), ix * dx, iy * dy, height]);
      }
    }
  }
  boxes.sort((a, b) => b[0] - a[0]);
  ctx.globalAlpha = 0.82;
  ctx.lineWidth = 1;
  for (const [, x, y, height] of boxes) drawBox(ctx, camera, theme, [x, y, dx, dy, height]);
  ctx.globalAlpha = 1;
}

/** The buildings of a city, those behind first, with the walls that look to the viewer. */
function drawPrisms(ctx, { pieces_m: pieces, roofs_m: heights }, camera, theme) {
  const order = pieces.map((corners, k) => [camera.depth(...middle(corners), 0), corners, heights[k]]);
  order.sort((a, b) => b[0] - a[0]);
  ctx.lineWidth = 0.5;
  for (const [, corners, height] of order) {
    const top = roof(theme, 0.25 + (0.75 * height) / camera.tallest);
    corners.forEach(([x0, y0], k) => {
      const [x1, y1] = corners[(k + 1) % corners.length];
      const facing = (x1 - x0) * camera.cosYaw + (y1 - y0) * camera.sinYaw;
      if (facing <= 0) return;
      ctx.beginPath();
      for (const [px, py, z] of [[x0, y0, 0], [x1, y1, 0], [x1, y1, height], [x0, y0, height]]) {
        camera.project(px, py, z, at);
        ctx.lineTo(at[0], at[1]);
      }
      ctx.closePath();
      ctx.fillStyle = between(top, "#101418", 0.18 + 0.14 * (1 - facing / Math.hypot(x1 - x0, y1 - y0)));
      ctx.fill();
    });
    polygon(ctx, camera, corners, height);
    ctx.fillStyle = ctx.strokeStyle = top;
    ctx.fill();
    ctx.stroke();
  }
}

function middle(corners) {
  const sum = corners.reduce(([x, y], [px, py]) => [x + px, y + py], [0, 0]);
  return sum.map((value) => value / corners.length);
}

function drawBox(ctx, camera, theme, [x, y, dx, dy, height]) {
  const top = roof(theme, 0.25 + (0.75 * height) / camera.tallest);
  ctx.strokeStyle = theme.map;
  const sides = [ // those that look to the viewer
    camera.cosYaw > 0 ? [[x, y], [x + dx, y]] : [[x, y + dy], [x + dx, y + dy]],
    camera.sinYaw > 0 ? [[x, y], [x, y + dy]] : [[x + dx, y], [x + dx, y + dy]],
  ];
  sides.forEach(([[x0, y0], [x1, y1]], k) => {
    ctx.beginPath();
    for (const [px, py, z] of [[x0, y0, 0], [x1, y1, 0], [x1, y1, height], [x0, y0, height]]) {
      camera.project(px, py, z, at);
      ctx.lineTo(at[0], at[1]);
    }
    ctx.closePath();
    ctx.fillStyle = between(top, "#101418", k ? 0.32 : 0.18);
    ctx.fill();
    ctx.stroke();
  });
  polygon(ctx, camera, [[x, y], [x + dx, y], [x + dx, y + dy], [x, y + dy]], height);
  ctx.fillStyle = top;
  ctx.fill();
  ctx.stroke();
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
