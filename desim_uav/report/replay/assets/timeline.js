// The course of an episode under the map: what happened to drones, and the measures so far.

import { clock, droneColour, percent } from "./palette.js";

const FONT = "system-ui, -apple-system, 'Segoe UI', sans-serif";
const MARKS = 20;
const AXIS = 18;
const GAP = 7;
const RIGHT = 12;
const SLOW_PATHS = 20;

export class Timeline {
  constructor(run, canvas) {
    this.run = run;
    this.canvas = canvas;
    this.ctx = canvas.getContext("2d");
    this.hoverUs = null;
    this.selected = -1;
  }

  setTheme(theme) {
    this.theme = theme;
    this.stale = true;
  }

  setState(state) {
    this.state = state;
    this.lanes = lanesOf(this.run, state);
    this.stale = true;
  }

  /** The drone whose battery stands out; -1: none. */
  select(d) {
    if (d === this.selected) return;
    this.selected = d;
    this.stale = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.ratio = Math.min(3, window.devicePixelRatio || 1);
    this.width = width;
    this.height = height;
    this.left = width < 520 ? 102 : 118;
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
    this.stale = true;
  }

  /** The time under a place of the picture. */
  timeAt(px) {
    const share = (px - this.left) / (this.width - this.left - RIGHT);
    return Math.round(Math.min(1, Math.max(0, share)) * this.state.episode.durationUs);
  }

  draw() {
    const { ctx, state, theme } = this;
    if (!state || !this.width) return;
    if (this.stale) this.#drawCharts();
    ctx.setTransform(1, 0, 0, 1, 0, 0);
    ctx.drawImage(this.charts, 0, 0);
    ctx.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const x = this.#x(state.tUs);
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

  #x(tUs) {
    const share = tUs / this.state.episode.durationUs;
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
    this.lanes.forEach((lane, k) => {
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
      const toY = (value) => bottom - ((value - lane.low) / (lane.high - lane.low)) * height;
      for (const line of lane.lines) this.#drawLine(ctx, line, toY);
    });
    this.#drawAxis(ctx);
    this.#drawMarks(ctx);
    this.stale = false;
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
    const { theme } = this;
    const { durationUs } = this.state.episode;
    const bottom = this.height - AXIS;
    ctx.fillStyle = theme.muted;
    ctx.textBaseline = "top";
    ctx.textAlign = "center";
    const room = (this.width - this.left - RIGHT) / 52;
    const tick = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21600, 86400]
      .map((s) => s * 1e6).find((us) => durationUs / us <= room) ?? durationUs;
    for (let t = 0; t <= durationUs; t += tick) {
      const half = ctx.measureText(clock(t)).width / 2;
      ctx.fillText(clock(t), Math.min(this.width - half, this.#x(t)), bottom + 4);
    }
  }

  /** Crashes as crosses, charges as bars from the first moment on a pad to the last. */
  #drawMarks(ctx) {
    const { theme, state, run } = this;
    const { event } = state.episode;
    const begun = new Map();
    const rows = Math.min(run.drones, 6); // one below the other, as far as there is room
    ctx.lineWidth = rows > 1 ? Math.max(1.75, 14 / rows - 1) : 4;
    ctx.lineCap = "butt";
    const bar = (d, from, to) => {
      const y = rows > 1 ? 5 + ((d % rows) + 0.5) * (14 / rows) : 12;
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
      ctx.strokeStyle = theme.danger;
      ctx.lineWidth = 2.25;
      ctx.beginPath();
      ctx.moveTo(x - 4.5, 7.5);
      ctx.lineTo(x + 4.5, 16.5);
      ctx.moveTo(x + 4.5, 7.5);
      ctx.lineTo(x - 4.5, 16.5);
      ctx.stroke();
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

  /** The names of the lanes, and what they come to now. */
  #drawValues() {
    const { ctx, theme, state } = this;
    const now = state.measures();
    const write = (text, y, colour, weight) => {
      ctx.font = `${weight} 11px ${FONT}`;
      ctx.fillStyle = colour;
      ctx.textAlign = "left";
      ctx.textBaseline = "middle";
      ctx.fillText(text, 4, y);
    };
    write("on pads, × crash", 12, theme.muted, 400);
    this.lanes.forEach((lane, k) => {
      const { top, height } = this.#lane(k);
      const rows = lane.labels(now, state, this.width < 520);
      rows.forEach((row, j) => {
        write(row.text, top + height / 2 + (j - (rows.length - 1) / 2) * 14, theme.ink, 500);
        if (!row.line) return;
        ctx.strokeStyle = row.line.colour ?? theme.ink;
        const y = top + height / 2 + (j - (rows.length - 1) / 2) * 14;
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
      low: 0, high: 100, share: 1.6, lines: [qoe1, qoe3],
      labels: (now) => [
        { text: `QoE1 ${percent(now.qoe1)}`, line: qoe1 },
        { text: `QoE3 ${percent(now.qoe3)}`, line: qoe3 },
      ],
    },
    {
      low: 0, high: most(course.qoe2, 0.5) * 1.05, lines: [{ tUs: course.tUs, values: course.qoe2 }],
      labels: (now, _, narrow) => [
        { text: `QoE2 ${now.qoe2 === null ? "–" : now.qoe2.toFixed(2)}${narrow ? "" : " steps"}` },
      ],
    },
    {
      low: Math.min(0, ...steps.values), high: most(steps.values, 0.1), lines: [steps],
      labels: (now) => [{ text: `reward ${now.reward.toFixed(2)}` }],
    },
    {
      low: 0, high: bandwidthLimit(run, course), lines: [{ tUs: course.tUs, values: course.usedBps }],
      labels: (_, at, narrow) => {
        const used = at.usedBps.reduce((sum, b) => sum + b, 0) / 1e6;
        return narrow ? [{ text: `${used.toFixed(2)} Mbit/s` }]
          : [{ text: `bandwidth ${used.toFixed(2)}` }, { text: bandwidthUnit(run) }];
      },
    },
  ];
  if (episode.battery) lanes.push(batteryLane(run, episode));
  return lanes;
}

const bandwidthLimit = (run, course) => (run.bandwidth_bps === null
  ? course.usedBps.reduce((a, b) => Math.max(a, b), 1) : run.bandwidth_bps * run.drones);

const bandwidthUnit = (run) => (run.bandwidth_bps === null ? "Mbit/s"
  : `of ${+((run.bandwidth_bps * run.drones) / 1e6).toFixed(2)} Mbit/s`);

function rewardSteps(run, episode) {
  const tUs = [0];
  const values = [0];
  for (let k = 1; k <= episode.step.count; k += 1) {
    tUs.push(k * run.step_us, k * run.step_us);
    values.push(episode.rewardSoFar[k - 1], episode.rewardSoFar[k]);
  }
  return { tUs, values };
}

function batteryLane(run, episode) {
  const { battery } = episode;
  const lines = [];
  for (let d = 0; d < run.drones; d += 1) {
    const [from, to] = [battery.first[d], battery.first[d + 1]];
    lines.push({
      drone: d, colour: droneColour(d), faint: run.drones > SLOW_PATHS,
      tUs: battery.tUs.subarray(from, to),
      values: battery.us.subarray(from, to).map((us) => (100 * us) / run.capacity_us),
    });
  }
  return {
    low: 0, high: 100, lines,
    labels: () => [{ text: "battery %" }],
  };
}
