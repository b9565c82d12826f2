// The tooltip at the pointer: beside its subject, never on it, and inside the window.

import { describe } from "./details.js";
import { fillRows } from "./rows.js";

const GAP = 8;
const EDGE = 6;
const REACH = { user: 13, drone: 24, station: 24 };
const BELOW = { user: 13, drone: 24, station: 44 }; // a station's pads are below it

export function updateTip(tip, player, scene) {
  const what = scene?.hover ?? null;
  const chosen = player.selection;
  tip.hidden = !what || (chosen?.what === what.what && chosen.index === what.index);
  if (tip.hidden) return;
  const told = describe(scene.state, what);
  if (!tip.firstChild) {
    const title = document.createElement("b");
    const rows = document.createElement("dl");
    rows.className = "rows";
    tip.append(title, rows);
  }
  tip.firstChild.textContent = `${told.title}, ${told.tag}`;
  fillRows(tip.lastChild, told.rows);
  const [left, top] = beside(boxAround(scene, what), tip.offsetWidth, tip.offsetHeight);
  tip.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
}

/** The box of the thing at the pointer, in pixels of the window. */
function boxAround(scene, what) {
  const { px, py } = scene.whereIs(what);
  const canvas = scene.canvas.getBoundingClientRect();
  const [x, y, reach] = [canvas.left + px, canvas.top + py, REACH[what.what]];
  return { left: x - reach, right: x + reach, top: y - reach, bottom: y + BELOW[what.what] };
}

/** The first place beside a box that has room in the window: right, left, below, above. */
export function beside(box, width, height) {
  const { innerWidth, innerHeight } = window;
  const within = (at, size, room) => Math.max(EDGE, Math.min(room - size - EDGE, at));
  const across = within((box.left + box.right - width) / 2, width, innerWidth);
  const down = within(box.top, height, innerHeight);
  const places = [
    [box.right + GAP, down], [box.left - GAP - width, down],
    [across, box.bottom + GAP], [across, box.top - GAP - height],
  ];
  const fits = ([left, top]) => left >= EDGE && top >= EDGE
    && left + width <= innerWidth - EDGE && top + height <= innerHeight - EDGE;
  const [left, top] = places.find(fits) ?? places[2];
  return [within(left, width, innerWidth), within(top, height, innerHeight)];
}
