// What is shown: an episode, a moment of it, and what is chosen. Everything else looks at this.

import { readBlock } from "./decode.js";
import { Episode } from "./episode.js";
import { State } from "./state.js";

export const SPEEDS = [1, 2, 5, 10, 30, 60, 120, 300, 600];
const KEPT = 3;

export class Player extends EventTarget {
  constructor(run) {
    super();
    this.run = run;
    this.speed = 60;
    this.playing = false;
    this.selection = null;
    this.told = -1; // the event that was stepped to
    this.states = new Map();
  }

  /** Show an episode, by its place in the page, at a time. */
  async open(index, tUs = 0, phase = null) {
    this.wanted = index;
    const state = await this.#stateOf(index);
    if (this.wanted !== index) return;
    if (state !== this.state) {
      this.state = state;
      if (this.selection && !exists(state, this.selection)) this.selection = null;
      this.#say("episode");
    }
    this.seek(tUs, phase);
  }

  async #stateOf(index) {
    let state = this.states.get(index);
    if (!state) {
      this.#say("loading");
      state = new State(new Episode(this.run, index, await readBlock(`episode-${index}`)));
    }
    this.states.delete(index);
    this.states.set(index, state); // the last ones are kept
    if (this.states.size > KEPT) this.states.delete(this.states.keys().next().value);
    return state;
  }

  get episode() { return this.state.episode; }

  seek(tUs, phase = null) {
    this.state.seek(tUs, phase);
    this.told = -1;
    this.#say("moment");
  }

  seekEvent(i) {
    this.state.seekEvent(i);
    this.told = i;
    this.#say("moment");
  }

  /** Go to the next event of these kinds, or to the one before; is there one? */
  stepEvent(direction, kinds = null) {
    this.pause();
    const i = this.state.findEvent(direction, kinds);
    if (i < 0) return false;
    this.seekEvent(i);
    return true;
  }

  play() {
    if (this.playing || !this.state) return;
    if (this.state.tUs >= this.episode.durationUs) this.seek(0);
    this.playing = true;
    this.#say("playing");
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.#say("playing");
  }

  /** Let so much real time go by. */
  advance(ms) {
    this.seek(this.state.tUs + ms * 1000 * this.speed);
    if (this.state.tUs >= this.episode.durationUs) this.pause();
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

function exists(state, { what, index }) {
  const { run, episode } = state;
  const count = {
    user: run.users, drone: run.drones, station: run.map.stations.length,
    request: episode.request.count,
  }[what];
  return Number.isInteger(index) && index >= 0 && index < count;
}
