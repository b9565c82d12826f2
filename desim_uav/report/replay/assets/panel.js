// The text beside the map: clock, measures, drones and the chosen thing; two runs are side by side.

import { allUsers, describe, howMany, modeOf, taskOf, tell, usersOf } from "./details.js";
import { isCommon } from "./fork.js";
import { typeOf } from "./links.js";
import { clock, droneColour, inkOn, inSteps, percent, shortClock } from "./palette.js";
import { byId, element, fillRows, setText } from "./rows.js";
import { CRASHED, FLYING, RETURNING } from "./states.js";
import { Strip } from "./strip.js";

const LETTERS = ["A", "B"];
const MEASURES = [
  ["QoE1", "Share of the requested time that was served, mean over requests", (now) => percent(now.qoe1)],
  ["QoE2 steps", "Time a request was open and not served, in steps, mean over requests",
    (now) => inSteps(now.qoe2, "")],
  ["QoE3", "Time average of the share of users attached to a drone", (now) => percent(now.qoe3)],
  ["reward", "Sum over the steps, mean over the drones", (now) => now.reward.toFixed(2)],
  ["requests", "Requests so far", (now) => String(now.requests)],
  ["completed", "Requests completed so far", (now) => String(now.completed)],
  ["open", "Requests open now", (now) => String(now.open)],
  ["crashes", "Drones that have crashed so far", (now) => String(now.crashes)],
];

/** Of links with classes. */
const OF_LINKS = [
  ["handovers", "Users that passed from one drone to another without a break, so far", (now) => String(now.handovers)],
  ["outages", "Times at which a user with an open request lost its link, so far", (now) => String(now.outages)],
];

/** The name of a run: its label and policy, with a letter if there are two runs. */
export function nameOf(runs, k) {
  const { name, policy } = runs[k];
  const label = name ? `${name} (${policy})` : policy;
  return runs.length === 1 ? label : `${LETTERS[k]}: ${label}`;
}

export class Panel {
  constructor(runs, player) {
    this.runs = runs;
    [this.run] = runs;
    this.player = player;
    this.#fillHeader();
    this.#fillMeasures();
    this.#fillDrones();
    this.chosen = runs.map((_, k) => {
      const rows = element("dl", "rows");
      rows.id = k ? `chosen-rows-${k}` : "chosen-rows";
      if (runs.length > 1) byId("chosen").append(element("h3", "", nameOf(runs, k)));
      byId("chosen").append(rows);
      return rows;
    });
    this.strips = runs.map((_, k) => new Strip(this.chosen[k]));
  }

  #fillHeader() {
    const { run, runs } = this;
    const count = (number, word) => `${number} ${word}${number > 1 ? "s" : ""}`;
    const policies = runs.map((_, k) => nameOf(runs, k)).join(" and ");
    document.title = `${run.scenario}, ${policies}: replay`;
    setText(byId("title"), run.scenario);
    setText(byId("subtitle"), `${policies}, seed ${run.seed}; ${count(run.drones, "drone")}, ${count(run.users, "user")}`);
    for (const about of run.episodes) {
      const option = element("option", "", `episode ${about.episode}`);
      option.value = about.episode;
      byId("episode").append(option);
    }
    const groups = [
      ["every event", []],
      ["requests", ["request", "complete", "refuse", "close", "late"]],
      ...(run.senses.length ? [["updates", ["generate", "drop", "deliver", "lose"]]] : []),
      ...(run.computed.length ? [["tasks", ["stage", "move", "compute", "computed"]]] : []),
      ["services", ["serve", "stop"]],
      ["attachments", ["attach", "detach"]],
      ["crossings", ["enter", "exit"]],
      ["flights", ["decide", "depart", "arrive", "blocked"]],
      ["charging", ["land", "charge", "charged"]],
      ["crashes", ["deplete", "crash", "respawn"]],
      ...(run.separation_m ? [["distances", ["conflict", "clear"]]] : []),
    ];
    for (const [name, kinds] of groups) {
      const option = element("option", "", name);
      option.value = kinds.join(" ");
      byId("kinds").append(option);
    }
    for (const kind of run.kinds) {
      const option = element("option", "", `only ${kind}`);
      option.value = kind;
      byId("kinds").append(option);
    }
  }

  /** One run gives a grid of names with values, two runs a table with a column for each. */
  #fillMeasures() {
    const { runs } = this;
    const pair = runs.length > 1;
    byId("measures").classList.toggle("pair", pair);
    if (pair) {
      const head = element("div", "head");
      head.append(element("dt", "", "so far"), ...runs.map((_, k) => element("dd", "", LETTERS[k])));
      byId("measures").append(head);
    }
    const shown = runs.every((each) => each.graded) ? [...MEASURES, ...OF_LINKS] : MEASURES;
    this.measures = shown.map(([name, about, form]) => {
      const cell = element("div");
      const term = element("dt", "", name);
      term.title = about;
      const values = runs.map(() => element("dd"));
      cell.append(term, ...values);
      byId("measures").append(cell);
      if (!pair) [values[0].id] = name.toLowerCase().split(" ");
      return { form, values };
    });
    byId("one-seed").hidden = !pair;
  }

  #fillDrones() {
    const { runs } = this;
    this.drones = runs.map((run, k) => {
      if (runs.length > 1) byId("drones").append(element("li", "head", nameOf(runs, k)));
      return Array.from({ length: run.drones }, (_, d) => this.#droneRow(run, d));
    });
  }

  #droneRow(run, d) {
    const { player } = this;
    const button = element("button");
    button.type = "button";
    const chip = element("span", "chip", String(d));
    const [mode, users, left] = ["mode", "users", "left"].map((name) => element("span", name));
    const meter = element("span", "meter");
    const fill = element("span");
    meter.append(fill);
    button.append(chip, mode, users);
    if (typeOf(run, d).capacity_us !== null) button.append(meter, left);
    chip.style.backgroundColor = droneColour(d);
    chip.style.color = inkOn(droneColour(d));
    button.addEventListener("click", () => {
      const chosen = player.selection?.what === "drone" && player.selection.index === d;
      player.select(chosen ? null : { what: "drone", index: d });
    });
    const row = element("li");
    row.append(button);
    byId("drones").append(row);
    return { button, mode, users, fill, left };
  }

  /** Show the present state. */
  update() {
    const { player } = this;
    const { states, state, tUs } = player;
    const parts = clock(tUs, 3).split(".");
    setText(byId("clock"), parts[0]);
    setText(byId("fraction"), player.playing || parts[1] === "000" ? "" : `.${parts[1]}`);
    setText(byId("of"), `of ${shortClock(player.durationUs)}`);
    setText(byId("step"), `${this.#stepsNow()}, episode ${state.episode.about.episode}`);
    const now = states.map((each) => each.measures());
    for (const { form, values } of this.measures) {
      values.forEach((value, k) => setText(value, form(now[k])));
    }
    setText(byId("all-users"), states.map((each, k) => (
      `${states.length > 1 ? `${LETTERS[k]}: ` : ""}${allUsers(each)}`)).join("\n"));
    states.forEach((each, k) => {
      const caption = byId(`caption-${k}`);
      const over = each.episode.durationUs < tUs ? `, over at ${shortClock(each.episode.durationUs)}` : "";
      const same = k > 0 && isCommon(states, tUs) ? ", so far the same" : "";
      setText(caption.firstElementChild, nameOf(this.runs, k) + over + same);
      setText(caption.lastElementChild, `QoE1 ${percent(now[k].qoe1)}   QoE2 ${inSteps(now[k].qoe2)}   QoE3 ${percent(now[k].qoe3)}`);
      this.#updateDrones(each, this.drones[k]);
    });
    this.#updateChosen(states);
    this.#updateNow();
  }

  /** The present step; drones that are asked by event have other steps in each run. */
  #stepsNow() {
    const now = (state) => `${state.stepNow() + 1} of ${state.episode.step.count}`;
    const { states, state } = this.player;
    return this.run.by_event ? `decision epoch ${states.map(now).join(" and ")}` : `step ${now(state)}`;
  }

  #updateDrones(state, rows) {
    const { player } = this;
    const { run } = state;
    rows.forEach((row, d) => {
      const flies = state.mode[d] === FLYING || state.mode[d] === RETURNING;
      const place = run.three_d && flies ? `, ${state.episode.dronePlace(d, state.tUs, [0, 0, 0])[2].toFixed(0)} m` : "";
      const type = run.types.length > 1 ? `${typeOf(run, d).name}, ` : "";
      setText(row.mode, type + modeOf(state, d) + place);
      const tasks = state.queue[d] ? `; ${state.queue[d]} at its processor` : "";
      setText(row.users, state.mode[d] === CRASHED ? "" : usersOf(state, d) + tasks);
      const pressed = player.selection?.what === "drone" && player.selection.index === d;
      row.button.setAttribute("aria-pressed", String(pressed));
      const { capacity_us: capacity } = typeOf(run, d);
      if (capacity === null) return;
      const share = Math.max(0, Math.min(1, state.episode.batteryUs(d, state.tUs) / capacity));
      row.fill.style.width = `${(100 * share).toFixed(1)}%`;
      row.fill.className = share > 0.2 ? "" : "low";
      setText(row.left, percent(100 * share, 0));
    });
  }

  #updateChosen(states) {
    const { selection } = this.player;
    byId("chosen").hidden = !selection;
    if (!selection) return;
    states.forEach((state, k) => {
      if (!(selection.index < howMany(state, selection.what))) {
        fillRows(this.chosen[k], [["in this run", "there is none"]]);
        this.strips[k].show(null);
        return;
      }
      const told = describe(state, selection);
      if (k === 0) setText(byId("chosen-title"), told.title);
      if (k === 0) setText(byId("chosen-tag"), states.length > 1 ? "" : told.tag);
      fillRows(this.chosen[k], states.length > 1 ? [["now", told.tag], ...told.rows] : told.rows);
      this.strips[k].show(taskOf(state, selection), state);
    });
    byId("chosen-tag").hidden = states.length > 1;
  }

  /** The latest event. */
  #updateNow() {
    const { k, i } = this.player.told ?? this.#lastEvent();
    this.nowOf = null;
    if (i < 0) return setText(byId("now"), "");
    const told = tell(this.player.states[k], i);
    this.nowOf = told.of;
    const whose = this.runs.length > 1 ? `${LETTERS[k]}: ` : "";
    return setText(byId("now"), `${clock(told.tUs, 6)}  ${whose}${told.text}`);
  }

  #lastEvent() {
    let last = { k: 0, i: -1, tUs: -1 };
    this.player.states.forEach((state, k) => {
      const i = state.sums.next - 1;
      const tUs = i < 0 ? -1 : state.episode.event.tUs[i];
      if (tUs > last.tUs) last = { k, i, tUs };
    });
    return last;
  }

  /** The sentence about the present instant, for screen readers. */
  announce() {
    const { states, state, told, tUs } = this.player;
    const text = told ? `${clock(tUs, 1)}, ${tell(states[told.k], told.i).text}`
      : `${clock(tUs)} of episode ${state.episode.about.episode}`;
    setText(byId("live"), text);
  }

  /** The largest index of a kind that can be chosen. */
  limit(what) {
    return this.player.state ? howMany(this.player.state, what) - 1 : 0;
  }
}
