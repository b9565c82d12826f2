// A city: streets on the ground, and buildings with their footprints, flat or in perspective.
// In perspective a building is translucent, so that no user is hidden; the farther ones come first.

import { between } from "./palette.js";

const at = [0, 0, 0];
const LEAST_PX = 2; // narrower buildings are drawn without edges
const STREET_M = 8;

const SHADES = 48;
const known = new Map();

/** A colour between two, of a few, which are made once. */
function blend(low, high, share) {
  const step = Math.round(SHADES * share);
  const key = `${low}${high}${step}`;
  let colour = known.get(key);
  if (!colour) known.set(key, colour = between(low, high, step / SHADES));
  return colour;
}

/** The shade of a building, stronger for taller ones. */
export const roof = (theme, share) => blend(theme["roof-low"], theme["roof-high"], share);

export function drawStreets(ctx, run, camera, theme) {
  if (!run.map.streets.length) return;
  ctx.strokeStyle = theme.street;
  ctx.lineCap = ctx.lineJoin = "round";
  ctx.lineWidth = Math.min(12, Math.max(1, STREET_M * camera.pixelsPerMetre));
  ctx.beginPath();
  for (const points of run.map.streets) {
    points.forEach(([x, y], k) => {
      camera.project(x, y, 0, at);
      if (k) ctx.lineTo(at[0], at[1]);
      else ctx.moveTo(at[0], at[1]);
    });
  }
  ctx.stroke();
}

/** The footprints seen from above, in shades by height. */
export function drawFootprints(ctx, run, camera, theme) {
  const shades = new Map();
  for (const { polygon_m: corners, height_m: height } of run.map.buildings) {
    const colour = roof(theme, height / camera.tallest);
    if (!shades.has(colour)) shades.set(colour, new Path2D());
    outline(shades.get(colour), camera, corners, 0);
  }
  ctx.lineWidth = 0.75;
  ctx.strokeStyle = theme.map;
  for (const [colour, path] of shades) {
    ctx.fillStyle = colour;
    ctx.fill(path);
    if (camera.scale > 0.2 && !run.map.buildings.some(({ inner }) => inner)) ctx.stroke(path);
  }
}

/** All buildings of the map: footprints with a height, and cells. */
export function buildingsOf(run) {
  const { size_m: [width, depth], cells: [nx, ny], cell_height_m: heights } = run.map;
  const [dx, dy] = [width / nx, depth / ny];
  const cells = [];
  heights.forEach((column, ix) => column.forEach((height, iy) => {
    const [x, y] = [ix * dx, iy * dy];
    if (height > 0) cells.push({ corners: [[x, y], [x + dx, y], [x + dx, y + dy], [x, y + dy]], height });
  }));
  const own = run.map.buildings.map(({ polygon_m: corners, height_m: height, inner }) => ({ corners, height, inner }));
  return (own.length ? own : cells).map((one) => ({ ...one, middle: middleOf(one.corners) }));
}

function middleOf(corners) {
  const sum = (k) => corners.reduce((total, corner) => total + corner[k], 0) / corners.length;
  return [sum(0), sum(1)];
}

/** The buildings in perspective; roughly: without edges, all walls of one in the same shade.
 *  Corners of a footprint are counterclockwise. */
export function drawBuildings(ctx, buildings, camera, theme, roughly = false) {
  const seen = buildings.map((one) => [camera.depth(...one.middle, 0), one]).sort((a, b) => b[0] - a[0]);
  ctx.globalAlpha = 0.82;
  ctx.lineWidth = 1;
  ctx.strokeStyle = theme.map;
  for (const [, { corners, height, inner }] of seen) {
    const top = roof(theme, 0.25 + (0.75 * height) / camera.tallest);
    const low = corners.map(([x, y]) => camera.project(x, y, 0, [0, 0, 0]));
    const high = corners.map(([x, y]) => camera.project(x, y, height, [0, 0, 0]));
    const edged = !roughly && Math.abs(low[0][0] - low[Math.floor(low.length / 2)][0]) >= LEAST_PX;
    const shade = (light) => blend(top, "#101418", 0.32 - 0.14 * light);
    if (roughly) {
      ctx.fillStyle = shade(0.5);
      ctx.beginPath();
    }
    corners.forEach(([x, y], k) => {
      const next = (k + 1) % corners.length;
      if (low[next][0] <= low[k][0] || inner?.includes(k)) return; // it looks away, or another piece is there
      const wall = [low[k], low[next], high[next], high[k]];
      if (roughly) return wall.forEach(([px, py], n) => (n ? ctx.lineTo(px, py) : ctx.moveTo(px, py)));
      const [ex, ey] = [corners[next][0] - x, corners[next][1] - y];
      ctx.fillStyle = shade(Math.abs(ex * camera.cosYaw - ey * camera.sinYaw) / Math.hypot(ex, ey));
      return fill(ctx, wall, edged);
    });
    if (roughly) ctx.fill();
    ctx.fillStyle = top;
    fill(ctx, high, edged && !inner);
  }
  ctx.globalAlpha = 1;
}

function fill(ctx, points, edged) {
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
  ctx.closePath();
  ctx.fill();
  if (edged) ctx.stroke();
}

function outline(path, camera, corners, z) {
  corners.forEach(([x, y], k) => {
    camera.project(x, y, z, at);
    if (k) path.lineTo(at[0], at[1]);
    else path.moveTo(at[0], at[1]);
  });
  path.closePath();
}
