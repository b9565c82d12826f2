// The ground of the flat map: cells, buildings by height, clusters.

import { drawFootprints, drawStreets, roof } from "./city.js";

const at = [0, 0, 0];

export function drawFlatGround(ctx, run, camera, theme) {
  const { size_m: [width, depth], cells: [nx, ny], cell_height_m: heights } = run.map;
  const [left, bottom] = camera.project(0, 0, 0, at);
  const [right, top] = camera.project(width, depth, 0, at);
  ctx.fillStyle = theme.map;
  ctx.fillRect(left, top, right - left, bottom - top);
  const [dx, dy] = [(right - left) / nx, (bottom - top) / ny];
  const named = Math.min(dx, dy) > 40;
  ctx.font = "11px system-ui, sans-serif";
  ctx.textBaseline = "top";
  ctx.textAlign = "left";
  const cells = run.map.buildings.length ? 0 : nx; // buildings with footprints are drawn instead
  for (let ix = 0; ix < cells; ix += 1) {
    for (let iy = 0; iy < ny; iy += 1) {
      const height = heights[ix][iy];
      if (height <= 0) continue;
      const [x, y] = [left + ix * dx, bottom - (iy + 1) * dy];
      ctx.fillStyle = roof(theme, height / camera.tallest);
      ctx.fillRect(x, y, dx + 0.5, dy + 0.5);
      if (!named) continue;
      ctx.fillStyle = theme["on-roof"];
      ctx.fillText(`${Math.round(height)} m`, x + 4, y + 4);
    }
  }
  drawStreets(ctx, run, camera, theme);
  drawFootprints(ctx, run, camera, theme);
  if (Math.min(dx, dy) > 4) drawGrid(ctx, [left, top, right, bottom], [nx, ny], theme);
  ctx.strokeStyle = theme.line;
  ctx.lineWidth = 1;
  ctx.strokeRect(left, top, right - left, bottom - top);
  ctx.strokeStyle = theme.muted;
  ctx.globalAlpha = 0.6;
  ctx.setLineDash([2, 4]);
  for (const { x_m: x, y_m: y, radius_m: radius } of run.map.clusters) {
    const [px, py, scale] = camera.project(x, y, 0, at);
    ctx.beginPath();
    ctx.arc(px, py, radius * scale, 0, 2 * Math.PI);
    ctx.stroke();
  }
  ctx.setLineDash([]);
  ctx.globalAlpha = 1;
}

function drawGrid(ctx, [left, top, right, bottom], [nx, ny], theme) {
  ctx.strokeStyle = theme.grid;
  ctx.lineWidth = 1;
  ctx.beginPath();
  for (let ix = 1; ix < nx; ix += 1) {
    const x = Math.round(left + ((right - left) * ix) / nx) + 0.5;
    ctx.moveTo(x, top);
    ctx.lineTo(x, bottom);
  }
  for (let iy = 1; iy < ny; iy += 1) {
    const y = Math.round(top + ((bottom - top) * iy) / ny) + 0.5;
    ctx.moveTo(left, y);
    ctx.lineTo(right, y);
  }
  ctx.stroke();
}
