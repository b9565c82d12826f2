// The scale bar of a map.

import { FONT } from "./palette.js";

const LONGEST_PX = 160;
const LONGEST_SHARE = 0.3; // of the picture's width

/** The longest of 1, 2 and 5 times a power of ten that is not above a number. */
export function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find((digit) => digit * power <= value) * power;
}

/** The length of the bar in metres, in pixels, and in words. */
export function scaleOf(camera) {
  const metres = roundDown(Math.min(LONGEST_PX, LONGEST_SHARE * camera.width) / camera.pixelsPerMetre);
  const text = metres >= 1000 ? `${metres / 1000} km` : `${+metres.toPrecision(1)} m`;
  return { metres, pixels: metres * camera.pixelsPerMetre, text };
}

const ARROW_PX = 26;

/** An arrow that shows where the wind blows to, above the map's lower edge, with its speed. */
export function drawWind(scene) {
  const { ctx, camera, run, theme } = scene;
  const [east, north] = run.wind_mps;
  const mps = Math.hypot(east, north);
  if (!mps) return;
  const text = `wind ${Number(mps.toFixed(1))} m/s`;
  const [x, y] = [camera.width - camera.right - 44, camera.height - 44];
  const ahead = camera.tilted ? turned(camera, east, north) : [east, -north];
  const length = Math.hypot(...ahead);
  const [dx, dy] = ahead.map((part) => (0.5 * ARROW_PX * part) / length);
  ctx.globalAlpha = 0.85;
  ctx.fillStyle = theme.paper;
  ctx.beginPath();
  ctx.roundRect(x - 38, y - 20, 76, 56, 6);
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = 2;
  ctx.beginPath();
  ctx.moveTo(x - dx, y - dy);
  ctx.lineTo(x + dx, y + dy);
  for (const side of [1, -1]) {
    ctx.moveTo(x + 0.3 * dx - 0.45 * side * dy, y + 0.3 * dy + 0.45 * side * dx);
    ctx.lineTo(x + dx, y + dy);
  }
  ctx.stroke();
  ctx.font = `500 11px ${FONT}`;
  ctx.fillStyle = theme.ink;
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.fillText(text, x, y + 25);
}

/** A direction on the ground in the picture of a tilted map. */
function turned(camera, east, north) {
  const right = east * camera.cosYaw - north * camera.sinYaw;
  const back = east * camera.sinYaw + north * camera.cosYaw;
  return [right, -back * camera.sinPitch];
}

/** Draw the bar in the lower left corner. In perspective it is valid in the middle of the picture. */
export function drawScale(scene) {
  const { ctx, camera, theme } = scene;
  const { pixels, text } = scaleOf(camera);
  const [left, y] = [14, camera.height - 14]; // under the legend, if that is open
  const notes = [text];
  if (camera.tilted) notes.push("in the middle");
  if (camera.tilted && camera.lift > 1.05) notes.push(`heights × ${camera.lift.toFixed(1)}`);
  const words = notes.join(", ");
  ctx.font = `500 11px ${FONT}`;
  const width = Math.max(pixels, ctx.measureText(words).width);
  ctx.globalAlpha = 0.85;
  ctx.fillStyle = theme.paper;
  ctx.beginPath();
  ctx.roundRect(left - 8, y - 24, width + 16, 32, 6);
  ctx.fill();
  ctx.globalAlpha = 1;
  ctx.strokeStyle = ctx.fillStyle = theme.ink;
  ctx.lineWidth = 1.5;
  ctx.lineCap = "butt";
  ctx.beginPath();
  for (const [dx, dy] of [[0, -4], [0, 0], [pixels, 0], [pixels, -4]]) ctx.lineTo(left + dx, y + dy);
  ctx.stroke();
  ctx.lineCap = "round";
  ctx.textAlign = "left";
  ctx.textBaseline = "alphabetic";
  ctx.fillText(words, left, y - 8);
}
