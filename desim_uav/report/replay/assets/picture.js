// What is shown as one picture: a line that says what it is, the maps, and the course of the episode.

import { clock, FONT } from "./palette.js";
import { element } from "./rows.js";

const HEAD = 28;

/** A canvas with the maps side by side and the timeline below them, as wide as the maps. */
function pictureOf(scenes, timeline, words) {
  const maps = scenes.map(({ canvas }) => canvas);
  const ratio = timeline.ratio;
  const width = maps.reduce((sum, map) => sum + map.width, 0);
  const mapHeight = Math.max(...maps.map((map) => map.height));
  const below = Math.round((timeline.canvas.height * width) / timeline.canvas.width);
  const canvas = element("canvas");
  Object.assign(canvas, { width, height: Math.round(HEAD * ratio) + mapHeight + below });
  const ctx = canvas.getContext("2d");
  ctx.fillStyle = timeline.theme.paper;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.fillStyle = timeline.theme.ink;
  ctx.font = `600 ${Math.round(12 * ratio)}px ${FONT}`;
  ctx.textBaseline = "middle";
  ctx.fillText(words, 8 * ratio, (HEAD / 2) * ratio, width - 16 * ratio);
  let x = 0;
  for (const map of maps) {
    ctx.drawImage(map, x, Math.round(HEAD * ratio));
    x += map.width;
  }
  ctx.drawImage(timeline.canvas, 0, canvas.height - below, width, below);
  return canvas;
}

/** What is shown now, as the address of a PNG. */
export function png(runs, player, scenes, timeline) {
  const policies = runs.map(({ name, policy }) => name || policy).join(" and ");
  const { about } = player.episode;
  const words = `${runs[0].scenario}, ${policies}, seed ${runs[0].seed}, episode ${about.episode}, ${clock(player.tUs)}`;
  return pictureOf(scenes, timeline, words).toDataURL("image/png");
}

/** Save what is shown now as a PNG, with a name that says what it is. */
export function save(runs, player, scenes, timeline) {
  const link = element("a");
  const seconds = Math.floor(player.tUs / 1e6);
  const name = `${runs[0].scenario}-${player.episode.about.episode}-${seconds}s`;
  link.download = `${name.replace(/[^\w.=-]+/g, "-")}.png`;
  link.href = png(runs, player, scenes, timeline);
  link.click();
}
