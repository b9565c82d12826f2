// The episode, the instant and the chosen thing, for one run or for two in step.
// All views read them.

import { readBlock } from "./decode.js";
import { Episode } from "./episode.js";
import { State } from "./state.js";

export const SPEEDS = [1, 2, 5, 10, 30, 60, 120, 300, 600];
const KEPT = 3;

export class Player extends EventTarget {
  constructor(runs) {
    super();
    this.runs = runs;
    [this.run] = runs;
    this.speed = 60;
    this.playing = false;
    this.selection = null;
    this.told = null; // the event that was stepped to: {k, i}, number i of run k
    this.tUs = 0;
    this.kept = new Map();
    this.states = []; // of each run, once there are any
  }

  /** Show an episode, by its index in the page, at a time. */
  async open(index, tUs = 0, phase = null) {
    this.wanted = index;
    const states = await this.#statesOf(index);
    if (this.wanted !== index) return;
    if (states !== this.states) {
      this.states = states;
      if (this.selection && !exists(this.state, this.selection)) this.selection = null;
      this.#say("episode");
    }
    this.seek(tUs, phase);
  }

  async #statesOf(index) {
    let states = this.kept.get(index);
    if (!states) {
      this.#say("loading");
      states = await Promise.all(this.runs.map(async (run, k) => (
        new State(new Episode(run, index, await readBlock(`episode-${k}-${index}`))))));
    }
    this.kept.delete(index);
    this.kept.set(index, states); // the last ones are kept
    if (this.kept.size > KEPT) this.kept.delete(this.kept.keys().next().value);
    return states;
  }

  /** The state of the first run. */
  get state() { return this.states[0]; }

  get episode() { return this.state.episode; }

  /** The duration of the episode; with two runs, that of the longer one. */
  get durationUs() { return Math.max(...this.states.map((state) => state.episode.durationUs)); }

  seek(tUs, phase = null) {
    this.tUs = Math.min(Math.max(Math.round(tUs), 0), this.durationUs);
    for (const state of this.states) state.seek(this.tUs, phase);
    this.told = null;
    this.#say("moment");
  }

  /** Go to right after event number i of run k. Of that instant, the other runs have had the phases
   *  before the event's; a run that stands before it, that phase too. */
  seekEvent(k, i) {
    const { event } = this.states[k].episode;
    this.tUs = event.tUs[i];
    this.states.forEach((state, other) => {
      if (other === k) state.seekEvent(i);
      else state.seek(this.tUs, other < k ? event.phase[i] : event.phase[i] - 1);
    });
    this.told = { k, i };
    this.#say("moment");
  }

  /** Go to the next event of these kinds, or to the one before; is there one? */
  stepEvent(direction, kinds = null) {
    this.pause();
    let best = null;
    this.states.forEach((state, k) => {
      const past = direction < 0 && (this.told === null || this.told.k === k);
      const i = state.findEvent(direction, kinds, past);
      if (i < 0) return;
      const { event } = state.episode;
      const found = { k, i, order: [event.tUs[i], event.phase[i], k] };
      if (best === null || direction * compare(found.order, best.order) < 0) best = found;
    });
    if (best === null) return false;
    this.seekEvent(best.k, best.i);
    return true;
  }

  play() {
    if (this.playing || !this.state) return;
    if (this.tUs >= this.durationUs) this.seek(0);
    this.playing = true;
    this.#say("playing");
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.#say("playing");
  }

  /** Advance by an amount of real time. */
  advance(ms) {
    this.seek(this.tUs + ms * 1000 * this.speed);
    if (this.tUs >= this.durationUs) this.pause();
  }

  setSpeed(speed) {
    this.speed = speed;
    this.#say("speed");
  }

  select(selection) {
    if (selection && !exists(this.state, selection)) return;
    this.selection = selection;
    this.#say("selection");
  }

  #say(what) { this.dispatchEvent(new Event(what)); }
}

function compare(one, other) {
  const k = one.findIndex((value, place) => value !== other[place]);
  return k < 0 ? 0 : one[k] - other[k];
}

function exists(state, { what, index }) {
  const { run, episode } = state;
  const count = {
    user: run.users, drone: run.drones, station: run.map.stations.length,
    request: episode.request.count,
  }[what];
  return Number.isInteger(index) && index >= 0 && index < count;
}
