// The states of users and drones at an instant, by replaying the events of an episode.
//
// Events are ordered by instant, by phase, and within a phase those that release a user come before
// those that take one. Copies of the state at intervals make every instant quick to reach.

import {
  ATTACHED, CHARGED, CHARGING, CRASHED, FLYING, IDLE, QUEUED, RETURNING, SERVED, WAITING,
} from "./states.js";
import { isComputed } from "./tasks.js";

const COPIES = 200;
const SAMPLES = 720;
const ALL_PHASES = 99;

export class State {
  constructor(episode) {
    const { run } = episode;
    this.episode = episode;
    this.run = run;
    this.applyKind = run.kinds.map((kind) => this[`_${kind}`] ?? this.#leadsTo(run.leads_to[kind]));
    this.goto = run.actions.indexOf("goto_charging_station");
    this.charge = run.actions.indexOf("charge");
    this.arrays = {
      holder: new Int16Array(run.users).fill(-1),
      request: new Int32Array(run.users).fill(-1),
      served: new Uint8Array(run.users),
      computes: new Uint8Array(run.users),
      stage: new Int16Array(run.users), // of the open request
      moves: new Uint8Array(run.users), // whether its task is on the way between two processors
      site: new Int16Array(run.users).fill(-1), // the processor that has the user's task, or had it
      queue: new Int32Array(run.senders), // the tasks at each processor
      buffered: new Int32Array(run.senses.length), // the updates in each sensor's buffer
      freshUs: new Float64Array(run.senses.length), // when its freshest delivered update was taken
      carried: new Int32Array(run.senders), // the updates that drones take to the ground
      mode: new Uint8Array(run.drones),
      station: new Int16Array(run.drones).fill(-1),
      sinceUs: new Float64Array(run.drones),
      attachedTo: new Int32Array(run.senders),
      servedBy: new Int32Array(run.senders),
      usedBps: new Float64Array(run.senders),
      linkClass: new Uint8Array(run.graded ? run.users * run.senders : 0),
    };
    Object.assign(this, this.arrays);
    this.sums = {
      next: 0, // the first event that has not happened yet
      atUs: 0, // up to when the integrals reach
      attachedUs: 0, unservedUs: 0, qoe1: 0, // integrals over time
      rate: 0, attached: 0, open: 0, serving: 0, asked: 0, done: 0, crashes: 0,
      handovers: 0, outages: 0,
    };
    this.tUs = 0;
    this.#begin();
    this.chargingAtFirst = [...this.mode.keys()].filter((d) => this.mode[d] === CHARGING);
    this.#readThrough();
    this.seek(0);
  }

  // ---- moving in time

  /** Go to a time, in microseconds, after the events of `phase` at that instant. The default is all
   *  phases, and at the episode's end those before all users are released. */
  seek(tUs, phase = null) {
    const { event, durationUs } = this.episode;
    const t = Math.min(Math.max(Math.round(tUs), 0), durationUs);
    const last = phase ?? (t === durationUs ? this.run.record_phase - 1 : ALL_PHASES);
    this.#goTo(countUpTo(event, t, last));
    this.#integrateTo(t);
    this.tUs = t;
  }

  /** Call a function at some times, in their order, and come back to the present instant. */
  visit(times, look) {
    const [next, tUs] = [this.sums.next, this.tUs];
    for (const t of times) {
      this.seek(t);
      look(t);
    }
    this.#goTo(next);
    this.tUs = tUs;
    this.#integrateTo(tUs);
  }

  /** Go to the state right after event number i. */
  seekEvent(i) {
    this.#goTo(i + 1);
    this.tUs = this.episode.event.tUs[i];
    this.#integrateTo(this.tUs);
  }

  /** The number of the next event (direction 1) or that before the present one (-1) whose kind is
   *  among `kinds` (null: all), or -1 if there is none. `past`: the event that has just happened is
   *  the present one, and does not count as before it. */
  findEvent(direction, kinds, past) {
    const { event } = this.episode;
    let i = direction > 0 ? this.sums.next : this.sums.next - 1;
    if (past && i >= 0 && event.tUs[i] === this.tUs) i -= 1;
    while (i >= 0 && i < event.count) {
      if (kinds === null || kinds.has(event.kind[i])) return i;
      i += direction;
    }
    return -1;
  }

  #goTo(next) {
    const copy = this.#copyBefore(next);
    if (next < this.sums.next || copy.sums.next > this.sums.next) this.#restore(copy);
    while (this.sums.next < next) this.#apply(this.sums.next);
  }

  #apply(i) {
    const { event } = this.episode;
    this.#integrateTo(event.tUs[i]);
    this.applyKind[event.kind[i]].call(
      this, event.drone[i], event.user[i], event.request[i], event.station[i], event.tUs[i],
      event.linkClass[i], event.stage[i], event.update[i],
    );
    this.sums.next = i + 1;
  }

  /** Let time pass, forwards, or backwards if no event is between. Times are whole microseconds, so two
   *  of the three integrals are exact. */
  #integrateTo(tUs) {
    const { sums } = this;
    const spanUs = tUs - sums.atUs;
    sums.attachedUs += sums.attached * spanUs;
    sums.unservedUs += (sums.open - sums.serving) * spanUs;
    sums.qoe1 += sums.rate * spanUs;
    sums.atUs = tUs;
  }

  // ---- copies

  #begin() {
    const { episode, run } = this;
    for (let d = 0; d < run.drones; d += 1) {
      const k = episode.leg.first[d];
      const mode = episode.leg.mode[k];
      this.mode[d] = mode;
      this.sinceUs[d] = episode.leg.tUs[k];
      if (run.grounded.includes(mode)) {
        this.station[d] = nearestStation(run, episode.leg.xTo[k], episode.leg.yTo[k]);
      }
    }
  }

  /** Play once from beginning to end, for the copies, the curves of the measures, and the marks. */
  #readThrough() {
    const { event, durationUs } = this.episode;
    const every = Math.max(256, Math.ceil(event.count / COPIES));
    const course = {
      tUs: new Float64Array(SAMPLES + 1),
      qoe1: new Float64Array(SAMPLES + 1).fill(NaN),
      qoe2: new Float64Array(SAMPLES + 1).fill(NaN),
      qoe3: new Float64Array(SAMPLES + 1).fill(NaN),
      usedBps: new Float64Array(SAMPLES + 1),
      ageUs: new Float64Array(SAMPLES + 1),
    };
    const marked = new Set(["crash", "respawn", "charge", "charged", "land"]
      .map((kind) => this.run.kinds.indexOf(kind)));
    this.marks = [];
    this.copies = [];
    this.queues = Array.from({ length: this.run.senders }, () => ({ tUs: [0], values: [0] }));
    let i = 0;
    for (let s = 0; s <= SAMPLES; s += 1) {
      const t = (s * durationUs) / SAMPLES;
      const last = s === SAMPLES ? this.run.record_phase - 1 : ALL_PHASES;
      const end = countUpTo(event, t, last);
      for (; i < end; i += 1) {
        if (i % every === 0) this.copies.push(this.#copy());
        if (marked.has(event.kind[i])) this.marks.push(i);
        this.#apply(i);
      }
      this.#integrateTo(t);
      course.tUs[s] = t;
      if (this.run.senses.length) course.ageUs[s] = this.meanAgeUs(t);
      const { qoe1, qoe2, qoe3 } = this.measures();
      course.qoe1[s] = qoe1 ?? NaN;
      course.qoe2[s] = qoe2 ?? NaN;
      course.qoe3[s] = qoe3 ?? NaN;
      course.usedBps[s] = this.usedBps.reduce((sum, used) => sum + used, 0);
    }
    if (!this.copies.length) this.copies.push(this.#copy());
    for (const { tUs, values } of this.queues) {
      tUs.push(durationUs);
      values.push(values.at(-1));
    }
    this.course = { ...course, queues: this.queues };
    this.queues = null;
  }

  #copy() {
    const arrays = {};
    for (const name of Object.keys(this.arrays)) arrays[name] = this.arrays[name].slice();
    return { arrays, sums: { ...this.sums } };
  }

  #restore(copy) {
    for (const name of Object.keys(this.arrays)) this.arrays[name].set(copy.arrays[name]);
    Object.assign(this.sums, copy.sums);
  }

  #copyBefore(next) {
    let low = 0;
    let high = this.copies.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.copies[middle].sums.next <= next) low = middle;
      else high = middle - 1;
    }
    return this.copies[low];
  }

  // ---- the effects of events

  /** The effect of an event after which a drone is in a mode (undefined: in the same as before). */
  #leadsTo(mode) {
    if (mode === undefined) return () => {};
    return (d, u, r, s, tUs) => this.#become(d, mode, s, tUs);
  }

  _request(d, u, r) {
    this.request[u] = r;
    this.stage[u] = 0;
    this.sums.unservedUs += this.sums.atUs - this.episode.request.tUs[r]; // in a sensor's buffer
    this.sums.open += 1;
    this.sums.asked += 1;
  }

  _enter(d, u, r, s, tUs, c) { this._class(d, u, r, s, tUs, c); }

  _exit(d, u) { this._class(d, u, -1, -1, 0, 0); }

  _class(d, u, r, s, tUs, c) {
    if (this.linkClass.length) this.linkClass[u * this.run.senders + d] = c;
  }

  _attach(d, u) {
    this.holder[u] = d;
    this.attachedTo[d] += 1;
    this.sums.attached += 1;
  }

  _detach(d, u) {
    this.holder[u] = -1;
    this.attachedTo[d] -= 1;
    this.sums.attached -= 1;
  }

  _serve(d, u, r) {
    if (this.#computesFor(u) && this.site[u] < 0) this.#stand(u, this.stage[u], d);
    this.served[u] = 1;
    this.servedBy[d] += 1;
    if (this.#isOnLink(u)) this.usedBps[d] += this.episode.request.bandwidthBps[r];
    if (!this.computes[u]) this.#progress(r, 1);
  }

  _stop(d, u, r) {
    this.served[u] = 0;
    this.servedBy[d] -= 1;
    if (this.#isOnLink(u)) this.usedBps[d] -= this.episode.request.bandwidthBps[r];
    if (!this.computes[u]) this.#progress(r, -1);
  }

  /** A request begins a stage: its task arrives at the processor of d, leaves it, or is lost there. */
  _stage(d, u, r, s, tUs, c, stage) {
    const arrives = isComputed(this.run, this.episode, r, stage);
    this.#stand(u, stage, arrives ? d : stage < this.stage[u] ? -1 : this.site[u]);
  }

  /** A task leaves the processor where it waits, and is on its way to another one. */
  _move(d, u) { this.#stand(u, this.stage[u], -1, 1); }

  #stand(u, stage, site, moves = 0) {
    const before = this.site[u];
    if (this.isAtProcessor(u)) this.queue[before] -= 1;
    this.stage[u] = stage;
    this.site[u] = site;
    this.moves[u] = moves;
    if (this.isAtProcessor(u)) this.queue[site] += 1;
    for (const one of new Set([before, site])) this.#noteQueue(one);
  }

  /** While an episode is read through: append the length of a queue to its course, as steps. */
  #noteQueue(s) {
    if (s < 0 || !this.queues) return;
    const { tUs, values } = this.queues[s];
    if (values.at(-1) === this.queue[s]) return;
    tUs.push(this.sums.atUs, this.sums.atUs);
    values.push(values.at(-1), this.queue[s]);
  }

  #isOnLink(u) { return !this.moves[u] && !this.#computesFor(u); }

  #computesFor(u) {
    return !this.moves[u] && isComputed(this.run, this.episode, this.request[u], this.stage[u]);
  }

  /** A user computes a part of its task itself, beside what drones do for it. */
  _compute(d, u, r) {
    this.computes[u] = 1;
    if (!this.served[u]) this.#progress(r, 1);
  }

  _computed(d, u, r) {
    this.computes[u] = 0;
    if (!this.served[u]) this.#progress(r, -1);
  }

  /** A request begins to progress (by 1), or does so no longer (-1). */
  #progress(r, by) {
    this.sums.serving += by;
    this.sums.rate += by / this.episode.request.requiredUs[r];
    if (this.sums.serving === 0) this.sums.rate = 0; // no crumbs of rounding
  }

  _complete(d, u, r) {
    this.sums.done += 1;
    if (this.run.senses[u] >= 0) {
      this.buffered[u] -= 1;
      this.carried[d < 0 ? this.holder[u] : d] += 1;
    }
    this._close(d, u, r);
  }

  _generate(d, u) { this.buffered[u] += 1; }

  _drop(d, u, r) {
    this.buffered[u] -= 1;
    if (r >= 0) this._close(d, u, r);
  }

  _deliver(d, u, r, s, tUs, c, stage, update) {
    this.carried[d] -= 1;
    this.freshUs[u] = Math.max(this.freshUs[u], this.episode.takenUs[update]);
  }

  _lose(d) { this.carried[d] -= 1; }

  _refuse(d, u, r) { this._close(d, u, r); }

  _late(d, u, r) { this._close(d, u, r); }

  _close(d, u, r) {
    this.sums.open -= 1;
    if (this.request[u] !== r) return; // the next one, of the same instant, comes first in the log
    this.#stand(u, 0, -1);
    this.request[u] = -1;
  }

  _decide(d, u, r, s, tUs) {
    const action = this.episode.step.taken[this.episode.stepsEnded(tUs) * this.run.drones + d];
    if (action === this.charge) return; // it lands: the next row says so
    this.mode[d] = action === this.goto ? RETURNING : FLYING;
    this.station[d] = -1;
    this.sinceUs[d] = tUs;
  }

  _respawn(d, u, r, s, tUs) { this.#become(d, FLYING, -1, tUs); }

  _crash(d, u, r, s, tUs) {
    this.#become(d, CRASHED, -1, tUs);
    this.sums.crashes += 1;
  }

  _handover() { this.sums.handovers += 1; }

  _outage() { this.sums.outages += 1; }

  #become(d, mode, station, tUs) {
    this.mode[d] = mode;
    this.station[d] = station;
    this.sinceUs[d] = tUs;
  }

  // ---- queries

  /** The measures so far; null if there was no request. */
  measures() {
    const { sums, run, episode } = this;
    const steps = episode.stepsEnded(sums.atUs);
    return {
      qoe1: sums.asked ? (100 * sums.qoe1) / sums.asked : null,
      qoe2: sums.asked ? sums.unservedUs / run.step_us / sums.asked : null,
      qoe3: sums.atUs > 0 ? (100 * sums.attachedUs) / (sums.atUs * run.users) : null,
      reward: episode.rewardSoFar[steps],
      requests: sums.asked,
      completed: sums.done,
      open: sums.open,
      crashes: sums.crashes,
      ...(run.graded ? { handovers: sums.handovers, outages: sums.outages } : {}),
    };
  }

  /** Whether the task of a user stands at a processor, which computes it now or later. */
  isAtProcessor(u) {
    return this.site[u] >= 0 && this.request[u] >= 0 && this.#computesFor(u);
  }

  /** Whether the link of a user is in use: nothing is sent while a task is computed, or moves. */
  usesLink(u) { return this.served[u] && this.#isOnLink(u); }

  /** The state of a user: IDLE, ATTACHED, WAITING or SERVED. */
  userState(u) {
    if (this.request[u] >= 0) return this.served[u] ? SERVED : WAITING;
    return this.holder[u] >= 0 ? ATTACHED : IDLE;
  }

  /** The age of information of a user, in microseconds; null if it is no sensor. */
  ageUs(u) {
    return this.run.senses[u] >= 0 ? this.tUs - this.freshUs[u] : null;
  }

  /** The mean age of all sensors. */
  meanAgeUs(tUs = this.tUs) {
    const [sum, count] = this.freshUs.reduce(([total, n], fresh, u) => (
      this.run.senses[u] >= 0 ? [total + tUs - fresh, n + 1] : [total, n]), [0, 0]);
    return count ? sum / count : NaN;
  }

  /** The class of the link between a user and a drone or access point; 1 in the footprint of a disc. */
  classOf(u, s) {
    return this.linkClass.length ? this.linkClass[u * this.run.senders + s] : 1;
  }

  /** How many users are in each state. */
  counts() {
    const found = [0, 0, 0, 0];
    for (let u = 0; u < this.run.users; u += 1) found[this.userState(u)] += 1;
    return found;
  }

  /** The drones at a station: on its pads, waiting for one in order, and charged. */
  dock(s) {
    const here = [];
    for (let d = 0; d < this.run.drones; d += 1) if (this.station[d] === s) here.push(d);
    here.sort((a, b) => this.sinceUs[a] - this.sinceUs[b] || a - b);
    const of = (mode) => here.filter((d) => this.mode[d] === mode);
    return { charging: of(CHARGING), queue: of(QUEUED), charged: of(CHARGED) };
  }

  /** The present step: its number, counted from 0. */
  stepNow() {
    return Math.min(this.episode.step.count - 1, this.episode.stepsEnded(this.tUs));
  }
}

/** The number of events up to a time, after phase `last` of that instant. */
function countUpTo(event, tUs, last) {
  let low = 0;
  let high = event.count;
  while (low < high) {
    const middle = (low + high) >> 1;
    const t = event.tUs[middle];
    if (t < tUs || (t === tUs && event.phase[middle] <= last)) low = middle + 1;
    else high = middle;
  }
  return low;
}

export function nearestStation(run, x, y) {
  const { size_m: size, cells, stations } = run.map;
  let best = -1;
  let nearest = Infinity;
  stations.forEach(([ix, iy], s) => {
    const far = Math.hypot(((ix + 0.5) * size[0]) / cells[0] - x, ((iy + 0.5) * size[1]) / cells[1] - y);
    if (far < nearest) [best, nearest] = [s, far];
  });
  return best;
}
