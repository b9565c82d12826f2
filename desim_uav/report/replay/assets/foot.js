// The foot of a map, under which no map is drawn: the scale bar, the wind, the key of the heat map,
// and whose data the map has.

import { heatPart } from "./heat.js";
import { FONT } from "./palette.js";
import { scalePart, windPart } from "./scale.js";

const EDGE = 14;
const GAP = 20;
const ROW = 34;
const TAIL = 10; // below the last row

/** The parts of the foot with their places, in rows, and the height that they take. */
function footOf(scene) {
  const { ctx, camera } = scene;
  ctx.font = `500 11px ${FONT}`;
  const parts = [scalePart(scene), windPart(scene), heatPart(scene), sourcePart(scene)].filter(Boolean);
  const end = camera.width - Math.max(EDGE, scene.covered);
  let [left, row] = [EDGE, 0];
  for (const part of parts) {
    if (left > EDGE && left + part.width > end) [left, row] = [EDGE, row + 1];
    Object.assign(part, { left, row });
    left += part.width + GAP;
  }
  return { parts, height: (row + 1) * ROW };
}

/** Leave as much room below the map as its foot takes. */
export function makeRoom(scene) {
  scene.foot = footOf(scene);
  if (scene.foot.height === scene.camera.below) return;
  scene.camera.standOn(scene.foot.height);
  scene.foot = footOf(scene); // the scale is another
}

/** Draw the foot over whatever of the map would be there. */
export function drawFoot(scene) {
  const { ctx, camera, theme, foot } = scene;
  const top = camera.height - foot.height;
  ctx.fillStyle = theme.paper;
  ctx.fillRect(0, top, camera.width, foot.height);
  for (const { left, row, draw } of foot.parts) {
    ctx.font = `500 11px ${FONT}`;
    ctx.fillStyle = ctx.strokeStyle = theme.ink;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    draw(ctx, left, top + (row + 1) * ROW - TAIL);
    ctx.globalAlpha = 1;
  }
}

/** Whose data the map has. */
function sourcePart({ ctx, theme, run }) {
  const text = run.map.attribution;
  if (!text) return null;
  return {
    width: ctx.measureText(text).width,
    draw: (to, left, y) => {
      to.fillStyle = theme.muted;
      to.fillText(text, left, y);
    },
  };
}
