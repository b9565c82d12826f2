// The details of a user, a drone, a station, a request or an event, as rows of [name, value].

import { covering, requestSoFar } from "./history.js";
import { linkWords, senderName, typeOf } from "./links.js";
import { clock, kbps, percent, span, userWord, words } from "./palette.js";
import { hasTasks, partsSoFar, tasksAt } from "./tasks.js";
import { CHARGING, CRASHED, FLYING, QUEUED, RETURNING, SERVED, WAITING } from "./states.js";

const place = [0, 0, 0];

export function describe(state, { what, index }) {
  return { user: ofUser, drone: ofDrone, station: ofStation, request: ofRequest }[what](state, index);
}

/** The number of things of a kind; the index of a chosen one is below it. */
export function howMany(state, what) {
  const { run, episode } = state;
  return {
    user: run.users, drone: run.drones, station: run.map.stations.length,
    request: episode.request.count,
  }[what];
}

const metres = (x, y) => `${x.toFixed(1)}, ${y.toFixed(1)} m`;
const drones = (list) => (list.length ? list.join(", ") : "none");
const senders = (run, list) => drones(list.map((s) => (s < run.drones ? s : senderName(run, s))));

function ofUser(state, u) {
  const { episode } = state;
  const doing = state.userState(u);
  const [x, y] = [new Float64Array(1), new Float64Array(1)];
  whereUser(episode, u, state.tUs, x, y);
  const { groups, group_of: groupOf } = state.run;
  const rows = groups.length ? [["group", groups[groupOf[u]]]] : [];
  rows.push(["place", metres(x[0], y[0])]);
  if (episode.walk.z[u] > 0) rows.push(["height", `${episode.walk.z[u].toFixed(1)} m`]);
  const holder = state.holder[u];
  rows.push(["attached to", holder >= 0 ? senderName(state.run, holder) : "no drone"]);
  const link = holder >= 0 ? linkWords(state.run, holder, state.classOf(u, holder)) : null;
  if (link) rows.push(["link", link]);
  rows.push(["in the footprints of", senders(state.run, covering(state, u))]);
  const own = [...episode.requestsOfUser(u)];
  const asked = own.filter((r) => episode.request.tUs[r] <= state.tUs);
  const open = state.request[u];
  if (open >= 0) rows.push(...requestRows(state.run, requestSoFar(state, open)));
  else {
    const next = own.find((r) => episode.request.tUs[r] > state.tUs);
    rows.push(["open request", "none"]);
    if (next !== undefined) rows.push(["asks again", `at ${clock(episode.request.tUs[next], 1)}`]);
  }
  rows.push(["requests so far", String(asked.length)]);
  const ageUs = state.ageUs(u);
  if (ageUs !== null) rows.push(["updates in its buffer", String(state.buffered[u])], ["age", span(ageUs)]);
  return { title: `User ${u}`, tag: userWord(doing), rows };
}

export function whereUser(episode, u, tUs, x, y) {
  const { walk } = episode;
  let k = walk.first[u];
  const last = walk.first[u + 1] - 1;
  while (k < last && walk.tUs[k + 1] <= tUs) k += 1;
  const length = k < last ? walk.tUs[k + 1] - walk.tUs[k] : 0;
  const share = length > 0 ? Math.max(0, (tUs - walk.tUs[k]) / length) : 0;
  const next = share > 0 ? k + 1 : k;
  x[0] = walk.x[k] + share * (walk.x[next] - walk.x[k]);
  y[0] = walk.y[k] + share * (walk.y[next] - walk.y[k]);
}

function requestRows(run, told) {
  const volume = told.mbit > 0;
  const share = percent((100 * told.servedUs) / told.requiredUs, 0);
  const rows = [
    ["request", `${told.request}, ${words(told.service)}`],
    ["asked", `${clock(told.askedUs, 1)}, for ${volume ? `${+told.mbit.toFixed(3)} Mbit` : span(told.requiredUs)}`],
    [volume ? "mean rate" : "bandwidth", kbps(told.bandwidthBps)],
    ["served so far", `${span(told.servedUs)} (${volume ? "about " : ""}${share})`],
    ["first served", told.firstUs === null ? "not yet" : clock(told.firstUs, 1)],
    ["served by", senders(run, told.drones)],
  ];
  if (told.deadlineUs >= 0) rows.push(["deadline", clock(told.deadlineUs, 1)]);
  if (told.endUs !== null) rows.push(["ended", `${clock(told.endUs, 1)}, ${told.outcome}`]);
  return rows;
}

function ofRequest(state, r) {
  const told = requestSoFar(state, r);
  const tag = !told.asked ? "not yet asked" : told.endUs !== null ? told.outcome
    : told.by >= 0 ? "served" : "waiting";
  return { title: `Request ${r}`, tag, rows: [["user", String(told.user)], ...requestRows(state.run, told)] };
}

function ofDrone(state, d) {
  const { run, episode } = state;
  episode.dronePlace(d, state.tUs, place);
  const own = typeOf(run, d);
  const rows = run.types.length > 1 ? [["type", own.name]] : [];
  rows.push(["place", metres(place[0], place[1])]);
  if (run.three_d) rows.push(["altitude", `${place[2].toFixed(0)} m`]);
  const batteryUs = episode.batteryUs(d, state.tUs);
  if (batteryUs !== null) {
    const share = batteryUs / own.capacity_us;
    const left = own.capacity_wh === null ? span(batteryUs) : `${(share * own.capacity_wh).toFixed(1)} Wh`;
    rows.push(["battery", `${percent(100 * share, 0)}, ${left}`]);
  }
  rows.push(...energyRows(state, d));
  rows.push(["action", action(state, d)], ...destination(state, d));
  if (run.by_event) rows.push(...asked(state, d));
  rows.push([run.graded ? "mean data rate" : "bandwidth in use", shareOf(state.usedBps[d], own.bandwidth_hz)]);
  rows.push(["attached users", usersOf(state, d)]);
  const served = [];
  for (let u = 0; u < run.users && served.length < 13; u += 1) {
    if (state.usesLink(u) && state.holder[u] === d) served.push(u);
  }
  if (served.length) rows.push([hasTasks(run) ? "link to users" : "serves users", some(served)]);
  rows.push(...processorRows(state, d));
  if (state.carried[d]) rows.push(["carries updates", String(state.carried[d])]);
  return { title: `Drone ${d}`, tag: modeOf(state, d), rows };
}

const some = (users) => users.slice(0, 12).join(", ") + (users.length > 12 ? " …" : "");

/** The tasks at a processor: which users' are computed, and which wait. */
function processorRows(state, d) {
  const { processor } = typeOf(state.run, d);
  if (!processor || !hasTasks(state.run)) return [];
  const { computing, waiting } = tasksAt(state, d);
  const cores = `${processor.cores} core${processor.cores > 1 ? "s" : ""}, ${processor.ghz} GHz`;
  const rows = [["processor", cores], ["computes for users", some(computing) || "none"]];
  return [...rows, ["tasks waiting", some(waiting) || "none"]];
}

/** What has been done so far for the task that is shown of something, or null: its parts and times. */
export function taskOf(state, { what, index }) {
  if (!hasTasks(state.run) || (what !== "user" && what !== "request")) return null;
  const { request } = state.episode;
  const asked = what === "request" ? [index] : [...state.episode.requestsOfUser(index)];
  const r = asked.filter((one) => request.tUs[one] <= state.tUs).at(-1);
  if (r === undefined) return null;
  return { request: r, parts: partsSoFar(state.episode, r, state.tUs), ...requestSoFar(state, r) };
}

/** The power that a drone takes now, and the energy of the leg that it flies. */
function energyRows(state, d) {
  const { episode } = state;
  if (typeOf(state.run, d).hover_w === null) return [];
  if (state.mode[d] !== FLYING && state.mode[d] !== RETURNING) return [["power", "0 W"]];
  const rows = [["power", `${episode.powerW(d, state.tUs).toFixed(1)} W`]];
  const k = episode.legAt(d, state.tUs);
  const [beginsUs, endsUs] = [episode.leg.tUs[k], episode.leg.tUs[k] + episode.leg.durationUs[k]];
  if (beginsUs < 0 || endsUs <= state.tUs || endsUs > episode.durationUs) return rows;
  const held = [beginsUs, state.tUs, endsUs].map((tUs) => episode.batteryUs(d, tUs));
  const [soFar, whole] = [held[0] - held[1], held[0] - held[2]].map((us) => joules(state.run, d, us));
  return [...rows, ["energy of this leg", `${soFar.toFixed(0)} of ${whole.toFixed(0)} J`]];
}

/** The energy of so many microseconds of hovering. */
const joules = (run, d, us) => (us / 1e6) * typeOf(run, d).hover_w;

/** When a drone was asked last, how often so far, and when it is asked next. */
function asked(state, d) {
  const { episode } = state;
  const all = episode.decisionsOf(d);
  const count = all.filter((i) => i < state.sums.next).length;
  const at = (k) => clock(episode.event.tUs[all[k]], 1);
  const rows = [["asked", count ? `${at(count - 1)}, ${count} of ${all.length} times` : "not yet"]];
  return count < all.length ? [...rows, ["asked next", at(count)]] : rows;
}

/** The states of the users attached to a drone: 3 served, 1 waiting, 5 not asking. */
export function usersOf(state, d) {
  let waiting = 0;
  for (let u = 0; u < state.run.users; u += 1) {
    if (state.holder[u] === d && state.userState(u) === WAITING) waiting += 1;
  }
  const served = state.servedBy[d];
  return inWords(served, waiting, state.attachedTo[d] - served - waiting) || "no users";
}

/** The states of all users. */
export function allUsers(state) {
  const counts = state.counts();
  return inWords(counts[SERVED], counts[WAITING], state.run.users - counts[SERVED] - counts[WAITING]);
}

function inWords(served, waiting, rest) {
  const parts = [[served, "served"], [waiting, "waiting"], [rest, "not asking"]];
  return parts.filter(([count]) => count > 0).map(([count, word]) => `${count} ${word}`).join(", ");
}

/** A bandwidth and its limit, with the unit once if both have the same. */
function shareOf(bps, limitBps) {
  if (limitBps === null) return kbps(bps);
  const [used, unit] = kbps(bps).split(" ");
  return kbps(limitBps).endsWith(unit) || bps === 0 ? `${used} of ${kbps(limitBps)}`
    : `${used} ${unit} of ${kbps(limitBps)}`;
}

export function modeOf(state, d) {
  return words(state.run.modes[state.mode[d]]);
}

/** The present command of a serving drone, and the action that it took. */
function commandOf({ run, episode, sinceUs }, d) {
  const k = Math.min(episode.step.count - 1, episode.stepsEnded(sinceUs[d])) * run.drones + d;
  return [run.actions[episode.step.told[k]], run.actions[episode.step.taken[k]]];
}

/** Where a drone is about to arrive that follows a command of free flight. */
function destination(state, d) {
  const { run, episode } = state;
  const { leg } = episode;
  const k = episode.legAt(d, state.tUs);
  if (state.mode[d] !== FLYING || leg.tUs[k] + leg.durationUs[k] <= state.tUs) return [];
  if (commandOf(state, d)[1] !== "fly") return [];
  const height = run.three_d ? ` at ${leg.zTo[k].toFixed(0)} m` : "";
  return [["flies to", metres(leg.xTo[k], leg.yTo[k]) + height]];
}

/** The activity of a drone, and the time that is left of it. */
function action(state, d) {
  const { run, episode } = state;
  const mode = state.mode[d];
  const since = span(state.tUs - state.sinceUs[d]);
  if (mode === CRASHED) return `lies crashed for ${since}`;
  if (mode === QUEUED) return `waits for a pad for ${since}`;
  if (mode === CHARGING) return `charges for ${since}`;
  if (mode !== FLYING && mode !== RETURNING) return `is ${modeOf(state, d)} for ${since}`;
  const leg = episode.legAt(d, state.tUs);
  const leftUs = episode.leg.tUs[leg] + episode.leg.durationUs[leg] - state.tUs;
  if (mode === RETURNING) {
    return leftUs > 0 ? `returns; ${span(leftUs)} left of this hop` : "returns to a station";
  }
  const [told, taken] = commandOf(state, d);
  const unlike = told && told !== taken ? ` (command: ${words(told)})` : "";
  if (mode === FLYING && leftUs > 0) return `${words(taken)}${unlike}, ${span(leftUs)} left`;
  const moved = episode.leg.durationUs[leg] > 0
    && episode.leg.tUs[leg] >= state.sinceUs[d];
  if (taken !== "hover" && !moved) return `hovers: ${words(taken)} is blocked`;
  return moved ? `hovers after ${words(taken)}${unlike}` : `hovers${unlike}`;
}

function ofStation(state, s) {
  const { run } = state;
  const [ix, iy] = run.map.stations[s];
  const dock = state.dock(s);
  const { size_m: size, cells } = run.map;
  return {
    title: `Station ${s}`,
    tag: `${dock.charging.length} of ${run.pads} pad${run.pads > 1 ? "s" : ""} taken`,
    rows: [
      ["place", metres(((ix + 0.5) * size[0]) / cells[0], ((iy + 0.5) * size[1]) / cells[1])],
      ["on a pad", drones(dock.charging)],
      ["wait for a pad", drones(dock.queue)],
      ["charged", drones(dock.charged)],
    ],
  };
}

const TOLD = {
  request: (e) => `user ${e.user} asks: request ${e.request}`,
  serve: (e) => `${e.sender} serves user ${e.user}, request ${e.request}`,
  stop: (e) => `${e.sender} stops serving user ${e.user}`,
  complete: (e) => `request ${e.request} of user ${e.user} is completed`,
  stage: (e) => `request ${e.request} of user ${e.user} begins its next stage`,
  move: (e) => `the task of user ${e.user}, request ${e.request}, moves to ${e.sender}`,
  refuse: (e) => `request ${e.request} of user ${e.user} is refused`,
  close: (e) => `request ${e.request} of user ${e.user} is closed`,
  late: (e) => `request ${e.request} of user ${e.user} is late, and dropped`,
  compute: (e) => `user ${e.user} begins to compute for request ${e.request}`,
  generate: (e) => `user ${e.user} takes an update`,
  drop: (e) => `the buffer of user ${e.user} drops an update`,
  deliver: (e) => `an update of user ${e.user} is delivered by ${e.sender}`,
  lose: (e) => `an update of user ${e.user} is lost with ${e.sender}`,
  computed: (e) => `user ${e.user} ends computing for request ${e.request}`,
  enter: (e) => `user ${e.user} enters the footprint of ${e.sender}${e.link}`,
  exit: (e) => `user ${e.user} leaves the footprint of ${e.sender}`,
  attach: (e) => `user ${e.user} attaches to ${e.sender}`,
  detach: (e) => `user ${e.user} detaches from ${e.sender}`,
  class: (e) => `the link of user ${e.user} to ${e.sender} changes${e.link}`,
  handover: (e) => `user ${e.user} is handed over to ${e.sender}`,
  ping_pong: (e) => `user ${e.user} is handed back to ${e.sender}`,
  outage: (e) => `user ${e.user}, who has request ${e.request}, has no link`,
  outage_end: (e) => `the outage of user ${e.user} ends`,
  decide: (e) => `drone ${e.drone} gets the command: ${e.action}`,
  depart: (e) => `drone ${e.drone} departs`,
  blocked: (e) => `drone ${e.drone} is blocked`,
  arrive: (e) => `drone ${e.drone} arrives`,
  land: (e) => `drone ${e.drone} lands at station ${e.station}`,
  charge: (e) => `drone ${e.drone} charges at station ${e.station}`,
  charged: (e) => `drone ${e.drone} is charged`,
  deplete: (e) => `the battery of drone ${e.drone} is empty`,
  crash: (e) => `drone ${e.drone} crashes`,
  conflict: (e) => `drones ${e.drone} and ${e.other} come too near to each other`,
  clear: (e) => `drones ${e.drone} and ${e.other} are no longer too near`,
  respawn: (e) => `drone ${e.drone} is replaced at station ${e.station}`,
};

const ANY = (e, kind) => `drone ${e.drone}: ${words(kind)}`;

/** An event as a sentence, and the user or drone it concerns. */
export function tell(state, i) {
  const { run, episode } = state;
  const { event } = episode;
  const kind = run.kinds[event.kind[i]];
  const e = {
    drone: event.drone[i], user: event.user[i], request: event.request[i], station: event.station[i],
    other: event.other[i],
  };
  e.sender = senderName(run, e.drone);
  const link = linkWords(run, e.drone, event.linkClass[i]);
  e.link = link ? `, ${link}` : "";
  if (kind === "decide") {
    const step = episode.stepsEnded(event.tUs[i]);
    e.action = words(run.actions[episode.step.taken[step * run.drones + e.drone]] ?? "");
  }
  return {
    kind, tUs: event.tUs[i], text: (TOLD[kind] ?? ANY)(e, kind),
    of: e.user >= 0 ? { what: "user", index: e.user } : { what: "drone", index: e.drone },
  };
}
