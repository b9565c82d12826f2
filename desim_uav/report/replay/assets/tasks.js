// Tasks: where they stand at processors, and what has been done for the task of a user, and when.

import { droneColour } from "./palette.js";

/** The parts of the time of a task, in the order of its stages, and the user's own part. */
export const PARTS = ["waiting", "sending", "computing", "own part"];

export const hasTasks = (run) => run.computed.length > 0;

/** Whether a processor computes in a stage of the service of request r. */
export function isComputed(run, episode, r, stage) {
  return hasTasks(run) && run.computed[episode.request.service[r]][stage] === 1;
}

/** The tasks at the processor of a drone or access point: those that are computed, and the others. */
export function tasksAt(state, s) {
  const found = { computing: [], waiting: [] };
  for (let u = 0; u < state.run.users; u += 1) {
    if (state.site[u] === s && state.isAtProcessor(u)) found[state.served[u] ? "computing" : "waiting"].push(u);
  }
  return found;
}

/** The spells of all tasks of user u, {request, part, fromUs, untilUs}, of which `part` is one of PARTS. */
export function spellsOf(episode, u) {
  episode.spells ??= new Map();
  if (!episode.spells.has(u)) episode.spells.set(u, readSpells(episode, u));
  return episode.spells.get(u);
}

function readSpells(episode, u) {
  const { run, event } = episode;
  const spells = [];
  let [request, stage, moves, doing, own, sinceUs] = [-1, 0, false, null, false, 0];
  const add = (part, untilUs) => {
    if (untilUs > sinceUs && request >= 0) spells.push({ request, part, fromUs: sinceUs, untilUs });
  };
  for (const i of episode.eventsOfUser(u)) {
    const kind = run.kinds[event.kind[i]];
    if (!CHANGES.has(kind) || event.request[i] < 0) continue;
    const tUs = event.tUs[i];
    add(doing ?? (own ? null : "waiting"), tUs);
    if (own) add("own part", tUs);
    sinceUs = tUs;
    if (kind === "request") [request, stage, moves] = [event.request[i], 0, false];
    else if (kind === "serve") doing = !moves && isComputed(run, episode, request, stage) ? "computing" : "sending";
    else if (kind === "stop") doing = null;
    else if (kind === "stage") [stage, moves] = [event.stage[i], false];
    else if (kind === "move") moves = true;
    else if (kind === "compute" || kind === "computed") own = kind === "compute";
    else [request, doing, own] = [-1, null, false];
  }
  return joined(spells.filter(({ part }) => part !== null));
}

const CHANGES = new Set(["request", "serve", "stop", "stage", "move", "compute", "computed", "complete",
  "refuse", "close", "late", "drop"]);

/** The spells, of which those that follow each other in the same part are one. */
function joined(spells) {
  const last = new Map();
  return spells.filter((spell) => {
    const before = last.get(spell.part);
    if (before?.request === spell.request && before.untilUs === spell.fromUs) {
      before.untilUs = spell.untilUs;
      return false;
    }
    last.set(spell.part, spell);
    return true;
  });
}

/** The microseconds of each part of request r up to a time. */
export function partsSoFar(episode, r, tUs) {
  const sums = new Map(PARTS.map((part) => [part, 0]));
  for (const { request, part, fromUs, untilUs } of spellsOf(episode, episode.request.user[r])) {
    if (request === r && fromUs < tUs) sums.set(part, sums.get(part) + Math.min(untilUs, tUs) - fromUs);
  }
  return sums;
}

/** The part of a colour for each part of a task, from the style sheet's theme. */
export const partColour = (theme, part) => theme[`task-${part.replace(" part", "")}`];

/** A queue: a square for each task at a processor, full if it is computed; many as a number. */
export function drawQueue(ctx, theme, s, drones, x, y, { computing, waiting }) {
  const count = computing.length + waiting.length;
  const colour = s < drones ? droneColour(s) : theme.ink;
  const shown = Math.min(count, MOST_SQUARES);
  const left = x - (shown * SQUARE) / 2;
  ctx.lineWidth = 1.25;
  for (let k = 0; k < shown; k += 1) {
    ctx.fillStyle = k < computing.length ? colour : theme.paper;
    ctx.strokeStyle = colour;
    ctx.beginPath();
    ctx.rect(left + k * SQUARE + 0.5, y + 0.5, SQUARE - 2, SQUARE - 2);
    ctx.fill();
    ctx.stroke();
  }
  return count > shown ? { text: `+${count - shown}`, x: left + shown * SQUARE + 2, y: y + SQUARE / 2 } : null;
}

export const SQUARE = 7;
const MOST_SQUARES = 8;
