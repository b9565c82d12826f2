// Zones in which no drone may fly: prisms with a dashed edge, on the ground and at their altitudes.

import { polygon } from "./view3d.js";

const at = [0, 0, 0];
const DASHES = [6, 4];
const ROOM_PX = 60;

export function drawZones(ctx, run, camera, theme) {
  ctx.strokeStyle = ctx.fillStyle = theme.danger;
  ctx.lineWidth = 1.25;
  for (const zone of run.map.zones) {
    const [low, high] = heightsOf(zone, camera);
    polygon(ctx, camera, zone.polygon_m, low);
    ctx.globalAlpha = 0.08;
    ctx.fill();
    ctx.globalAlpha = 0.7;
    ctx.setLineDash(DASHES);
    ctx.stroke();
    if (camera.tilted) drawWalls(ctx, camera, zone.polygon_m, low, high);
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
    if (!camera.tilted) drawName(ctx, camera, zone);
  }
}

/** What a zone forbids: from which altitude to which, in metres. */
export function zoneWords([low, high]) {
  if (high >= 10000) return low > 0 ? `no flight above ${low} m` : "no flight";
  return low > 0 ? `no flight, ${low} to ${high} m` : `no flight below ${high} m`;
}

/** In the picture a zone reaches a little above the tallest building, if not less. */
function heightsOf({ altitude_m: [low, high] }, camera) {
  const top = 1.5 * Math.max(camera.tallest, 40);
  return [Math.min(low, top), Math.min(high, top)];
}

function drawWalls(ctx, camera, corners, low, high) {
  polygon(ctx, camera, corners, high);
  ctx.stroke();
  ctx.beginPath();
  for (const [x, y] of corners) {
    camera.project(x, y, low, at);
    ctx.moveTo(at[0], at[1]);
    camera.project(x, y, high, at);
    ctx.lineTo(at[0], at[1]);
  }
  ctx.stroke();
}

function drawName(ctx, camera, { polygon_m: corners, altitude_m: altitude }) {
  const xs = corners.map(([x]) => x);
  const ys = corners.map(([, y]) => y);
  const [left, top] = camera.project(Math.min(...xs), Math.max(...ys), 0, at);
  if ((Math.max(...xs) - Math.min(...xs)) * camera.scale < ROOM_PX) return;
  ctx.font = "11px system-ui, sans-serif";
  ctx.textBaseline = "top";
  ctx.textAlign = "left";
  ctx.fillText(zoneWords(altitude), left + 4, top + 4);
}
