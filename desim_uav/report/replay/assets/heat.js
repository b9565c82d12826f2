// A heat map: the share of time in which each place was covered, or the users who waited there.

import { ringsAt } from "./links.js";
import { polygon } from "./view3d.js";
import { FLYING, WAITING } from "./states.js";

const SAMPLES = 240; // instants of an episode
const BINS = 64; // along the longer side of the map
const MOST_OPAQUE = 0.75;
const KEY_PX = 90;

export const HEATS = [null, "covered", "waiting"];
const at = [0, 0, 0];
const place = [0, 0, 0];

/** The heat map of the whole episode of a state: bins by rows from the south, and what the most is. */
export function heatOf(state, name) {
  const { run, episode } = state;
  const { size_m: [width, depth] } = run.map;
  const side = Math.max(width, depth) / BINS;
  const [nx, ny] = [Math.ceil(width / side), Math.ceil(depth / side)];
  const values = new Float64Array(nx * ny);
  const heat = { name, nx, ny, side, values, most: 1 };
  const times = Array.from({ length: SAMPLES }, (_, k) => ((k + 0.5) * episode.durationUs) / SAMPLES);
  const look = name === "covered" ? coverage(run, heat) : waiters(run, heat);
  state.visit(times, (tUs) => look(state, tUs));
  for (let k = 0; k < values.length; k += 1) values[k] /= SAMPLES;
  if (name === "waiting") heat.most = values.reduce((a, b) => Math.max(a, b), 0);
  return heat;
}

function coverage(run, { nx, ny, side, values }) {
  const seen = new Int32Array(values.length).fill(-1);
  let round = 0;
  const disc = (x, y, radius) => {
    const from = Math.max(0, Math.floor((y - radius) / side));
    const to = Math.min(ny - 1, Math.floor((y + radius) / side));
    for (let j = from; j <= to; j += 1) {
      const half2 = radius ** 2 - ((j + 0.5) * side - y) ** 2;
      if (half2 < 0) continue;
      const first = Math.max(0, Math.ceil((x - Math.sqrt(half2)) / side - 0.5));
      const last = Math.min(nx - 1, Math.floor((x + Math.sqrt(half2)) / side - 0.5));
      for (let i = first; i <= last; i += 1) {
        if (seen[j * nx + i] === round) continue;
        seen[j * nx + i] = round;
        values[j * nx + i] += 1;
      }
    }
  };
  return (state, tUs) => {
    round += 1;
    run.points.forEach(({ at: [x, y], rings_m: [radius] }) => disc(x, y, radius));
    for (let d = 0; d < run.drones; d += 1) {
      if (state.mode[d] !== FLYING) continue;
      state.episode.dronePlace(d, tUs, place);
      disc(place[0], place[1], ringsAt(run, d, place[2])[0]);
    }
  };
}

function waiters(run, { nx, ny, side, values }) {
  const [x, y] = [new Float64Array(run.users), new Float64Array(run.users)];
  return (state, tUs) => {
    state.episode.userPlaces(tUs, x, y);
    for (let u = 0; u < run.users; u += 1) {
      if (state.userState(u) !== WAITING) continue;
      const i = Math.min(nx - 1, Math.max(0, Math.floor(x[u] / side)));
      const j = Math.min(ny - 1, Math.max(0, Math.floor(y[u] / side)));
      values[j * nx + i] += 1;
    }
  };
}

const colourOf = (theme, name) => (name === "covered" ? theme.accent : theme.danger);

/** Colour the ground. */
export function drawHeat(ctx, heat, camera, theme) {
  const { name, nx, ny, side, values, most } = heat;
  ctx.fillStyle = colourOf(theme, name);
  for (let j = 0; j < ny; j += 1) {
    for (let i = 0; i < nx; i += 1) {
      const share = most > 0 ? values[j * nx + i] / most : 0;
      if (share === 0) continue;
      ctx.globalAlpha = MOST_OPAQUE * share;
      const [x, y] = [i * side, j * side];
      if (camera.tilted) {
        polygon(ctx, camera, [[x, y], [x + side, y], [x + side, y + side], [x, y + side]], 0);
        ctx.fill();
      } else {
        const [px, py, scale] = camera.project(x, y + side, 0, at);
        const [left, top] = [Math.floor(px), Math.floor(py)];
        ctx.fillRect(left, top, Math.floor(px + side * scale) - left, Math.floor(py + side * scale) - top);
      }
    }
  }
  ctx.globalAlpha = 1;
}

/** What the colours mean. */
export function heatWords({ name, most, side }) {
  if (name === "covered") return "covered, 0 to 100 % of the time";
  return `waiting in ${Math.round(side)} x ${Math.round(side)} m, 0 to ${+most.toPrecision(2)} users`;
}

/** The key of the colours, or null without a heat map. */
export function heatPart({ ctx, theme, heat }) {
  if (!heat) return null;
  const words = heatWords(heat);
  const draw = (to, left, y) => {
    to.fillText(words, left, y - 6);
    to.fillStyle = colourOf(theme, heat.name);
    for (let k = 0; k < KEY_PX; k += 1) {
      to.globalAlpha = (MOST_OPAQUE * k) / KEY_PX;
      to.fillRect(left + k, y - 2, 1, 8);
    }
  };
  return { width: Math.max(KEY_PX, ctx.measureText(words).width), draw };
}
