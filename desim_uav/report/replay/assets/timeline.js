// The timeline of an episode under the map: the events of drones, and the measures so far.

import { forkUs } from "./fork.js";
import { typeOf } from "./links.js";
import { hasTasks, PARTS, partColour, spellsOf } from "./tasks.js";
import { clock, droneColour, FONT, inSteps, percent, shortClock, span } from "./palette.js";
import { roundDown } from "./scale.js";

const MARKS = 20;
const AXIS = 18;
const GAP = 7;
const RIGHT = 12;
const SLOW_PATHS = 20;
const SHORT_US = 10_000;
const ROOM_FOR_TWO = 30; // pixels of a lane: below this height only its greatest value is written
const FLAT = 90; // below this height there is no room for charts
const LETTERS = ["A", "B"];
const DASHES = [[], [5, 3]]; // of two runs

export class Timeline {
  constructor(runs, canvas) {
    this.runs = runs;
    this.canvas = canvas;
    this.ctx = canvas.getContext("2d");
    this.hoverUs = null;
    this.selected = -1;
    this.user = -1;
  }

  setTheme(theme) {
    this.theme = theme;
    this.stale = true;
  }

  setStates(player) {
    this.player = player;
    this.states = player.states;
    this.durationUs = player.durationUs;
    this.measured = this.runs.length > 1 ? lanesOfTwo(this.states) : lanesOf(this.runs[0], this.states[0]);
    this.#addTasks();
  }

  /** Highlight the lines of a chosen drone, and show the tasks of a chosen user. */
  select(chosen) {
    const [d, u] = ["drone", "user"].map((what) => (chosen?.what === what ? chosen.index : -1));
    if (d === this.selected && u === this.user) return;
    [this.selected, this.user] = [d, u];
    this.#addTasks();
  }

  #addTasks() {
    const shows = this.user >= 0 && this.states && hasTasks(this.runs[0]);
    this.lanes = [...(this.measured ?? []), ...(shows ? taskLanes(this.states, this.user) : [])];
    this.stale = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.ratio = Math.min(3, window.devicePixelRatio || 1);
    this.width = width;
    this.height = height;
    const alone = width < 520 ? 102 : 118;
    this.left = this.runs.length > 1 ? 130 : alone;
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
    this.stale = true;
  }

  /** The time at a place of the picture. */
  timeAt(px) {
    const share = (px - this.left) / (this.width - this.left - RIGHT);
    return Math.round(Math.min(1, Math.max(0, share)) * this.durationUs);
  }

  draw() {
    const { ctx, theme } = this;
    if (!this.states || !this.width) return;
    if (this.stale) this.#drawCharts();
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.drawImage(this.charts, 0, 0);
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const x = this.#x(this.player.tUs);
    ctx.fillStyle = theme.paper;
    ctx.globalAlpha = 0.55; // what is to come is pale
    ctx.fillRect(x, 0, this.width - x - RIGHT + 1, this.height - AXIS);
    ctx.globalAlpha = 1;
    this.#drawValues();
    if (this.hoverUs !== null) this.#drawHover();
    ctx.strokeStyle = ctx.fillStyle = theme.accent;
    ctx.lineWidth = 1.5;
    ctx.beginPath();
    ctx.moveTo(x, 4);
    ctx.lineTo(x, this.height - AXIS);
    ctx.stroke();
    ctx.beginPath();
    ctx.moveTo(x - 5, 0);
    ctx.lineTo(x + 5, 0);
    ctx.lineTo(x, 8);
    ctx.fill();
  }

  get flat() { return this.height < FLAT; }

  #x(tUs) {
    const share = tUs / this.durationUs;
    return this.left + share * (this.width - this.left - RIGHT);
  }

  #lane(k) {
    const shares = this.lanes.map((lane) => lane.share ?? 1);
    const sum = (list) => list.reduce((a, b) => a + b, 0);
    const unit = (this.height - MARKS - AXIS - GAP * this.lanes.length) / sum(shares);
    return { top: MARKS + sum(shares.slice(0, k)) * unit + k * GAP, height: shares[k] * unit };
  }

  #drawCharts() {
    this.charts ??= document.createElement("canvas");
    this.charts.width = this.canvas.width;
    this.charts.height = this.canvas.height;
    const ctx = this.charts.getContext("2d");
    const { theme } = this;
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ctx.fillStyle = theme.paper;
    ctx.fillRect(0, 0, this.width, this.height);
    ctx.font = `11px ${FONT}`;
    ctx.lineJoin = "round";
    if (this.flat) this.#drawTrack(ctx);
    else this.lanes.forEach((lane, k) => {
      const { top, height } = this.#lane(k);
      const bottom = top + height;
      ctx.strokeStyle = theme.grid;
      ctx.lineWidth = 1;
      ctx.beginPath();
      for (const y of [top, bottom]) {
        ctx.moveTo(this.left, Math.round(y) + 0.5);
        ctx.lineTo(this.width - RIGHT, Math.round(y) + 0.5);
      }
      ctx.stroke();
      if (lane.lines.length) this.#drawScale(ctx, lane, top, height);
      const toY = (value) => bottom - ((value - lane.low) / (lane.high - lane.low)) * height;
      for (const line of lane.lines) this.#drawLine(ctx, line, toY);
      for (const { part, fromUs, untilUs } of lane.spells ?? []) {
        const x = this.#x(fromUs);
        const own = part === PARTS.at(-1); // beside what is done elsewhere
        ctx.fillStyle = partColour(theme, part);
        ctx.fillRect(x, own ? top + 0.7 * height : top + 1, Math.max(1, this.#x(untilUs) - x), (own ? 0.3 : 0.65) * height - 1);
      }
    });
    this.#drawAxis(ctx);
    this.#drawMarks(ctx);
    this.#drawFork(ctx);
    this.stale = false;
  }

  /** The greatest round value of a lane, with a line, and 0. */
  #drawScale(ctx, lane, top, height) {
    const { theme } = this;
    const toY = (value) => top + height - ((value - lane.low) / (lane.high - lane.low)) * height;
    const most = roundDown(lane.high);
    const text = lane.scale ?? ((value) => String(+value.toPrecision(2)));
    ctx.font = `10px ${FONT}`;
    ctx.textAlign = "left";
    ctx.strokeStyle = theme.grid;
    ctx.fillStyle = theme.muted;
    for (const value of height > ROOM_FOR_TWO ? [0, most] : [most]) {
      const y = toY(value);
      ctx.lineWidth = 1;
      ctx.beginPath();
      ctx.moveTo(this.left, Math.round(y) + 0.5);
      ctx.lineTo(this.width - RIGHT, Math.round(y) + 0.5);
      ctx.stroke();
      ctx.textBaseline = y < top + 11 ? "top" : "alphabetic";
      ctx.fillText(text(value), this.left + 3, ctx.textBaseline === "top" ? y + 2 : y - 2);
    }
    ctx.font = `11px ${FONT}`;
  }

  /** Without charts: a slider. */
  #drawTrack(ctx) {
    ctx.strokeStyle = this.theme.line;
    ctx.lineWidth = 1;
    const y = this.height - AXIS - 0.5;
    ctx.beginPath();
    ctx.moveTo(this.left, y);
    ctx.lineTo(this.width - RIGHT, y);
    ctx.stroke();
  }

  #drawLine(ctx, line, toY) {
    const { theme } = this;
    const chosen = line.drone === undefined || this.selected < 0 || line.drone === this.selected;
    ctx.strokeStyle = line.colour ?? theme.ink;
    ctx.globalAlpha = chosen ? (line.faint ? 0.3 : 1) : 0.2;
    ctx.lineWidth = line.drone !== undefined && line.drone === this.selected ? 2.25 : 1.5;
    ctx.setLineDash(line.dash ?? []);
    ctx.beginPath();
    let pen = false;
    for (let i = 0; i < line.tUs.length; i += 1) {
      const value = line.values[i];
      if (Number.isNaN(value)) {
        pen = false;
        continue;
      }
      const [x, y] = [this.#x(line.tUs[i]), toY(value)];
      if (pen) ctx.lineTo(x, y);
      else ctx.moveTo(x, y);
      pen = true;
    }
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  #drawAxis(ctx) {
    const { theme, durationUs } = this;
    const bottom = this.height - AXIS;
    ctx.fillStyle = theme.muted;
    ctx.textBaseline = "top";
    ctx.textAlign = "center";
    const room = (this.width - this.left - RIGHT) / 52;
    const tick = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21600, 86400]
      .map((s) => s * 1e6).find((us) => durationUs / us <= room) ?? durationUs;
    const form = tick % 60e6 === 0 ? shortClock : clock;
    for (let t = 0; t <= durationUs; t += tick) {
      const half = ctx.measureText(form(t)).width / 2;
      ctx.fillText(form(t), Math.min(this.width - half, this.#x(t)), bottom + 4);
    }
  }

  /** Crashes as crosses, and charging as bars from the beginning to the end of the time on a pad. */
  #drawMarks(ctx) {
    this.states.forEach((state, k) => this.#drawMarksOf(ctx, state, k));
  }

  #drawMarksOf(ctx, state, k) {
    const { theme, runs } = this;
    const run = runs[k];
    const { event } = state.episode;
    const begun = new Map();
    const own = Math.min(run.drones, runs.length > 1 ? 3 : 6); // one below the other, as far as there is room
    const rows = own * runs.length;
    ctx.lineWidth = rows > 1 ? Math.max(1.75, 14 / rows - 1) : 4;
    ctx.lineCap = "butt";
    const bar = (d, from, to) => {
      const y = rows > 1 ? 5 + (k * own + (d % own) + 0.5) * (14 / rows) : 12;
      ctx.strokeStyle = droneColour(d);
      ctx.globalAlpha = 0.85;
      ctx.beginPath();
      ctx.moveTo(this.#x(from), y);
      ctx.lineTo(Math.max(this.#x(from) + 2, this.#x(to)), y);
      ctx.stroke();
      ctx.globalAlpha = 1;
    };
    for (const d of state.chargingAtFirst) begun.set(d, 0);
    for (const i of state.marks) {
      const [kind, d, t] = [run.kinds[event.kind[i]], event.drone[i], event.tUs[i]];
      if (kind === "charge") begun.set(d, t);
      if (kind === "charged") {
        bar(d, begun.get(d) ?? t, t);
        begun.delete(d);
      }
    }
    for (const [d, from] of begun) bar(d, from, state.episode.durationUs);
    for (const i of state.marks) {
      if (run.kinds[event.kind[i]] !== "crash") continue;
      const x = this.#x(event.tUs[i]);
      const [y, r] = runs.length > 1 ? [8.5 + 7 * k, 3.2] : [12, 4.5];
      ctx.strokeStyle = theme.danger;
      ctx.lineWidth = 2.25;
      ctx.beginPath();
      ctx.moveTo(x - r, y - r);
      ctx.lineTo(x + r, y + r);
      ctx.moveTo(x + r, y - r);
      ctx.lineTo(x - r, y + r);
      ctx.stroke();
      if (this.flat) continue;
      ctx.globalAlpha = 0.35;
      ctx.lineWidth = 1;
      ctx.beginPath();
      ctx.moveTo(x, MARKS);
      ctx.lineTo(x, this.height - AXIS);
      ctx.stroke();
      ctx.globalAlpha = 1;
    }
    ctx.lineCap = "round";
  }

  /** Where two branches of a run part: a dashed line. */
  #drawFork(ctx) {
    const parts = forkUs(this.states);
    if (parts === null || parts === Infinity) return;
    const x = this.#x(parts);
    ctx.strokeStyle = ctx.fillStyle = this.theme.muted;
    ctx.lineWidth = 1;
    ctx.setLineDash([4, 3]);
    ctx.beginPath();
    ctx.moveTo(x, this.flat ? 2 : MARKS);
    ctx.lineTo(x, this.height - AXIS);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.textAlign = "left";
    ctx.textBaseline = "top";
    if (!this.flat) ctx.fillText("fork", x + 3, MARKS + 2);
  }

  /** The names of the lanes and their present values. */
  #drawValues() {
    const { ctx, theme, states } = this;
    const now = states.map((state) => state.measures());
    const write = (text, y, colour, weight, x = 4) => {
      ctx.font = `${weight} 11px ${FONT}`;
      ctx.fillStyle = colour;
      ctx.textAlign = "left";
      ctx.textBaseline = "middle";
      ctx.fillText(text, x, y);
    };
    write("charging, × crash", 12, theme.muted, 400);
    if (this.flat) return;
    this.lanes.forEach((lane, k) => {
      const { top, height } = this.#lane(k);
      const rows = lane.labels(now, states[0], this.width < 520);
      const rowY = (j, count) => top + height / 2 + (j - (count - 1) / 2) * 14;
      const names = lane.names ?? [];
      names.forEach((name, j) => write(name, rowY(j, names.length), theme.ink, 500));
      rows.forEach((row, j) => {
        const y = rowY(j, rows.length);
        write(row.text, y, theme.ink, 500, names.length ? 46 : 4);
        if (!row.line) return;
        ctx.strokeStyle = row.line.colour ?? theme.ink;
        ctx.lineWidth = 1.5;
        ctx.setLineDash(row.line.dash ?? []);
        ctx.beginPath();
        ctx.moveTo(this.left - (this.width < 520 ? 20 : 24), y);
        ctx.lineTo(this.left - 6, y);
        ctx.stroke();
        ctx.setLineDash([]);
      });
    });
  }

  #drawHover() {
    const { ctx, theme } = this;
    const x = this.#x(this.hoverUs);
    ctx.strokeStyle = theme.muted;
    ctx.lineWidth = 1;
    ctx.setLineDash([2, 3]);
    ctx.beginPath();
    ctx.moveTo(x, 0);
    ctx.lineTo(x, this.height - AXIS);
    ctx.stroke();
    ctx.setLineDash([]);
    const text = clock(this.hoverUs, 1);
    ctx.font = `600 11px ${FONT}`;
    const half = ctx.measureText(text).width / 2 + 6;
    const middle = Math.min(this.width - half, Math.max(half, x));
    ctx.fillStyle = theme.ink;
    ctx.beginPath();
    ctx.roundRect(middle - half, this.height - AXIS + 1, 2 * half, 16, 4);
    ctx.fill();
    ctx.fillStyle = theme.paper;
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.fillText(text, middle, this.height - AXIS + 9.5);
  }
}

const inPercent = (value) => `${value} %`;

/** The measures of two runs on the same scale, the second one dashed. */
function lanesOfTwo(states) {
  const most = (lines, least) => lines.reduce((high, { values }) => (
    values.reduce((a, b) => (b > a ? b : a), high)), least);
  const lane = (names, linesOf, form, limits, share = 1) => {
    const lines = states.map((state, k) => ({ ...linesOf(state), dash: DASHES[k] }));
    const [low, high] = limits(lines);
    return {
      names, low, high, share, lines,
      labels: (now) => now.map((each, k) => ({
        text: `${LETTERS[k]} ${form(each)}`, line: lines[k],
      })),
    };
  };
  const course = (name) => ({ course: of }) => ({ tUs: of.tUs, values: of[name] });
  const full = () => [0, 100];
  return [
    lane(["QoE1"], course("qoe1"), (now) => percent(now.qoe1), full),
    lane(["QoE2", "steps"], course("qoe2"), (now) => inSteps(now.qoe2, ""),
      (lines) => [0, most(lines, 0.5) * 1.05]),
    lane(["QoE3"], course("qoe3"), (now) => percent(now.qoe3), full),
    lane(["reward"], (state) => rewardSteps(state.run, state.episode), (now) => now.reward.toFixed(2),
      (lines) => [Math.min(0, ...lines.flatMap(({ values }) => values)), most(lines, 0.1)]),
  ];
}

function lanesOf(run, state) {
  const { course, episode } = state;
  const most = (values, least) => values.reduce((a, b) => (b > a ? b : a), least);
  const steps = rewardSteps(run, episode);
  const [qoe1, qoe3] = [
    { tUs: course.tUs, values: course.qoe1 },
    { tUs: course.tUs, values: course.qoe3, dash: [5, 3] },
  ];
  const lanes = [
    {
      low: 0, high: 100, share: 1.6, lines: [qoe1, qoe3], scale: inPercent,
      labels: ([now]) => [
        { text: `QoE1 ${percent(now.qoe1)}`, line: qoe1 },
        { text: `QoE3 ${percent(now.qoe3)}`, line: qoe3 },
      ],
    },
    {
      low: 0, high: most(course.qoe2, 0.5) * 1.05, lines: [{ tUs: course.tUs, values: course.qoe2 }],
      labels: ([now]) => [{ text: `QoE2 ${inSteps(now.qoe2)}` }],
    },
    {
      low: Math.min(0, ...steps.values), high: most(steps.values, 0.1), lines: [steps],
      labels: ([now]) => [{ text: `reward ${now.reward.toFixed(2)}` }],
    },
    {
      low: 0, high: bandwidthLimit(run, course), scale: (bps) => `${+(bps / 1e6).toPrecision(2)}`, lines: [{ tUs: course.tUs, values: course.usedBps }],
      labels: (_, at, narrow) => {
        const used = at.usedBps.reduce((sum, b) => sum + b, 0) / 1e6;
        return narrow ? [{ text: `${used.toFixed(2)} Mbit/s` }]
          : [{ text: `bandwidth ${used.toFixed(2)}` }, { text: bandwidthUnit(run) }];
      },
    },
  ];
  if (hasTasks(run)) lanes.push(queueLane(run, course));
  if (run.senses.length) lanes.push(ageLane(course));
  if (episode.battery) lanes.push(batteryLane(run, episode));
  if (run.types.some((type) => type.hover_w !== null)) lanes.push(powerLane(run, episode));
  return lanes;
}

/** The bandwidth of all drones, or null if it is unlimited. */
function bandwidthOfAll(run) {
  if (run.types.some((type) => type.bandwidth_hz === null)) return null;
  return run.type_of.reduce((sum, number) => sum + run.types[number].bandwidth_hz, 0);
}

const bandwidthLimit = (run, course) => (bandwidthOfAll(run)
  ?? course.usedBps.reduce((a, b) => Math.max(a, b), 1));

const bandwidthUnit = (run) => (bandwidthOfAll(run) === null ? "Mbit/s"
  : `of ${+(bandwidthOfAll(run) / 1e6).toFixed(2)} Mbit/s`);

function rewardSteps(run, episode) {
  const tUs = [0];
  const values = [0];
  for (let k = 1; k <= episode.step.count; k += 1) {
    tUs.push(episode.step.tUs[k - 1], episode.step.tUs[k - 1]);
    values.push(episode.rewardSoFar[k - 1], episode.rewardSoFar[k]);
  }
  return { tUs, values };
}

/** The number of tasks at each processor. */
function queueLane(run, course) {
  const lines = course.queues.map((queue, s) => ({
    ...queue, drone: s, colour: s < run.drones ? droneColour(s) : undefined, faint: run.drones > SLOW_PATHS,
  })).filter(({ values }) => values.length > 2);
  const most = lines.flatMap(({ values }) => values).reduce((a, b) => Math.max(a, b), 1);
  return {
    low: 0, high: 1.05 * most, lines,
    labels: (_, at) => [{ text: `queues ${at.queue.reduce((sum, of) => sum + of, 0)}, most ${most}` }],
  };
}

/** The mean age of all sensors. */
function ageLane(course) {
  return {
    low: 0, high: 1.05 * course.ageUs.reduce((a, b) => Math.max(a, b), 1), scale: span,
    lines: [{ tUs: course.tUs, values: course.ageUs }],
    labels: (_, at) => [{ text: `age ${span(at.meanAgeUs())}` }],
  };
}

/** The tasks of a user, by what is done for them; one lane for each run. */
function taskLanes(states, u) {
  return states.map(({ episode }, k) => ({
    low: 0, high: 1, share: 0.7, lines: [], spells: spellsOf(episode, u),
    labels: () => [{ text: `${states.length > 1 ? `${LETTERS[k]} ` : ""}user ${u}'s tasks` }],
  }));
}

/** The power of drones whose batteries have energy, by what they hold. */
function powerLane(run, episode) {
  const { battery } = episode;
  const lines = [];
  for (let d = 0; d < run.drones; d += 1) {
    const { hover_w: hoverW } = typeOf(run, d);
    if (hoverW === null) continue;
    const [tUs, values] = [[], []];
    for (let k = battery.first[d]; k + 1 < battery.first[d + 1]; k += 1) {
      const spanUs = battery.tUs[k + 1] - battery.tUs[k];
      if (spanUs < SHORT_US) continue; // a jump, or too short to divide by
      const power = (hoverW * Math.max(0, battery.us[k] - battery.us[k + 1])) / spanUs;
      tUs.push(battery.tUs[k], battery.tUs[k + 1]);
      values.push(power, power);
    }
    lines.push({ drone: d, colour: droneColour(d), faint: run.drones > SLOW_PATHS, tUs, values });
  }
  const most = lines.flatMap(({ values }) => values).reduce((a, b) => Math.max(a, b), 1);
  return {
    low: 0, high: 1.05 * most, lines,
    scale: (watts) => `${watts} W`, labels: () => [{ text: "power" }],
  };
}

function batteryLane(run, episode) {
  const { battery } = episode;
  const lines = [];
  for (let d = 0; d < run.drones; d += 1) {
    const [from, to] = [battery.first[d], battery.first[d + 1]];
    const { capacity_us: capacity } = typeOf(run, d);
    if (capacity === null) continue;
    lines.push({
      drone: d, colour: droneColour(d), faint: run.drones > SLOW_PATHS,
      tUs: battery.tUs.subarray(from, to),
      values: battery.us.subarray(from, to).map((us) => (100 * us) / capacity),
    });
  }
  return {
    low: 0, high: 100, lines, scale: inPercent,
    labels: () => [{ text: "battery" }],
  };
}
