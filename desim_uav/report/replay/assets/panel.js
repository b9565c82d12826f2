// The words beside the map: clock, measures, legends, drones, and what is chosen.

import { describe, howMany, modeOf, tell } from "./details.js";
import { clock, droneColour, inkOn, percent, words } from "./palette.js";
import { STATES, WAITING } from "./states.js";
import { drawUser, RADII } from "./users.js";

const byId = (id) => document.getElementById(id);

function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.textContent = text;
  return made;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export class Panel {
  constructor(run, player) {
    this.run = run;
    this.player = player;
    this.#fillHeader();
    this.#fillLegends();
    this.#fillDrones();
  }

  #fillHeader() {
    const { run } = this;
    document.title = `${run.scenario}, ${run.policy}: replay`;
    byId("title").textContent = run.scenario;
    byId("subtitle").textContent = `${run.policy}, seed ${run.seed}; `
      + `${run.drones} drone${run.drones > 1 ? "s" : ""}, ${run.users} user${run.users > 1 ? "s" : ""}`;
    for (const about of run.episodes) {
      const option = element("option", "", `episode ${about.episode}`);
      option.value = about.episode;
      byId("episode").append(option);
    }
    const groups = [
      ["every event", []],
      ["requests", ["request", "complete", "refuse", "close"]],
      ["services", ["serve", "stop"]],
      ["attachments", ["attach", "detach"]],
      ["crossings", ["enter", "exit"]],
      ["flights", ["decide", "depart", "arrive", "blocked"]],
      ["charging", ["land", "charge", "charged"]],
      ["crashes", ["deplete", "crash", "respawn"]],
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

  #fillLegends() {
    this.states = [3, 2, 1, 0].map((doing) => {
      const row = element("li");
      const sample = element("canvas");
      const count = element("b");
      row.append(sample, element("span", "", STATES[doing]), count);
      byId("states").append(row);
      return { doing, sample, count };
    });
    this.services = this.run.services.map((name, service) => {
      const row = element("li");
      const sample = element("canvas");
      row.append(sample, element("span", "", words(name)));
      row.title = name;
      byId("services").append(row);
      return { service, sample };
    });
  }

  /** The samples of the legends, in the colours of the theme. */
  setTheme(theme) {
    const paint = (canvas, r, doing, service, colour) => {
      const ratio = Math.min(3, window.devicePixelRatio || 1);
      canvas.width = canvas.height = 18 * ratio;
      const ctx = canvas.getContext("2d");
      ctx.scale(ratio, ratio);
      drawUser(ctx, 9, 9, r, doing, service, { ...theme, map: theme.paper }, colour);
    };
    for (const { doing, sample } of this.states) paint(sample, RADII[doing], doing, -1);
    for (const { service, sample } of this.services) paint(sample, 5.2, WAITING, service, theme.ink);
    this.drones.forEach(({ chip }, d) => {
      chip.style.backgroundColor = droneColour(d);
      chip.style.color = inkOn(droneColour(d));
    });
  }

  #fillDrones() {
    const { run, player } = this;
    this.drones = Array.from({ length: run.drones }, (_, d) => {
      const button = element("button");
      button.type = "button";
      const chip = element("span", "chip", String(d));
      const [mode, users, left] = ["mode", "users", "left"].map((name) => element("span", name));
      const meter = element("span", "meter");
      const fill = element("span");
      meter.append(fill);
      button.append(chip, mode, users);
      if (run.capacity_us !== null) button.append(meter, left);
      button.addEventListener("click", () => {
        const chosen = player.selection?.what === "drone" && player.selection.index === d;
        player.select(chosen ? null : { what: "drone", index: d });
      });
      const row = element("li");
      row.append(button);
      byId("drones").append(row);
      return { button, chip, mode, users, fill, left };
    });
  }

  /** Say what is so now. */
  update() {
    const { state } = this.player;
    const now = state.measures();
    const { durationUs } = state.episode;
    setText(byId("clock"), clock(state.tUs, this.player.playing ? 0 : 3));
    setText(byId("of"), `of ${clock(durationUs)}`);
    setText(byId("step"), `step ${state.stepNow() + 1} of ${state.episode.step.count}, episode ${state.episode.about.episode}`);
    setText(byId("qoe1"), percent(now.qoe1));
    setText(byId("qoe2"), now.qoe2 === null ? "–" : now.qoe2.toFixed(2));
    setText(byId("qoe3"), percent(now.qoe3));
    setText(byId("reward"), now.reward.toFixed(2));
    for (const name of ["requests", "completed", "open", "crashes"]) setText(byId(name), String(now[name]));
    const counts = state.counts();
    for (const { doing, count } of this.states) setText(count, String(counts[doing]));
    this.#updateDrones(state);
    this.#updateChosen(state);
    this.#updateNow(state);
  }

  #updateDrones(state) {
    const { run, player } = this;
    this.drones.forEach((row, d) => {
      setText(row.mode, modeOf(state, d));
      const users = state.attachedTo[d];
      setText(row.users, users ? `${state.servedBy[d]} of ${users} served` : "");
      const pressed = player.selection?.what === "drone" && player.selection.index === d;
      row.button.setAttribute("aria-pressed", String(pressed));
      if (run.capacity_us === null) return;
      const us = state.episode.batteryUs(d, state.tUs);
      const share = Math.max(0, Math.min(1, us / run.capacity_us));
      row.fill.style.width = `${(100 * share).toFixed(1)}%`;
      row.fill.className = share > 0.2 ? "" : "low";
      setText(row.left, clock(us));
    });
  }

  #updateChosen(state) {
    const { selection } = this.player;
    byId("chosen").hidden = !selection;
    if (!selection) return;
    const told = describe(state, selection);
    setText(byId("chosen-title"), told.title);
    setText(byId("chosen-tag"), told.tag);
    fillRows(byId("chosen-rows"), told.rows);
  }

  #updateNow(state) {
    const i = this.player.told >= 0 ? this.player.told : state.sums.next - 1;
    this.nowOf = null;
    if (i < 0) return setText(byId("now"), "");
    const told = tell(state, i);
    this.nowOf = told.of;
    return setText(byId("now"), `${clock(told.tUs, 6)}  ${told.text}`);
  }

  /** The sentence about the present moment, to be read out. */
  announce() {
    const { state, told } = this.player;
    const text = told >= 0 ? `${clock(state.tUs, 1)}, ${tell(state, told).text}`
      : `${clock(state.tUs)} of episode ${state.episode.about.episode}`;
    setText(byId("live"), text);
  }

  /** The largest number that can be chosen of a kind. */
  limit(what) {
    return this.player.state ? howMany(this.player.state, what) - 1 : 0;
  }
}

/** Rows of names and values; what is there already is used again. */
export function fillRows(list, rows) {
  while (list.children.length > 2 * rows.length) list.lastChild.remove();
  while (list.children.length < 2 * rows.length) list.append(element(list.children.length % 2 ? "dd" : "dt"));
  rows.forEach(([name, value], k) => {
    setText(list.children[2 * k], name);
    setText(list.children[2 * k + 1], value);
  });
}
