// The legend: a sample and a name of everything that is drawn on the map.

import { buildingsOf, roof } from "./city.js";
import { drawBattery, drawBody, drawCross, drawFrame, drawRing, shapeOfType } from "./drones.js";
import { droneColour, userWord, words } from "./palette.js";
import { drawMast } from "./points.js";
import { byId, element, setText } from "./rows.js";
import { ATTACHED, IDLE, SERVED, WAITING } from "./states.js";
import { drawPad, drawStation } from "./stations.js";
import { drawQueue, hasTasks, SQUARE } from "./tasks.js";
import { drawUser, RADII } from "./users.js";
import { zoneWords } from "./zones.js";

const [WIDTH, HEIGHT] = [26, 20];
const [X, Y] = [WIDTH / 2, HEIGHT / 2];

export class Legend {
  constructor(runs) {
    [this.run] = runs;
    this.samples = [];
    this.counts = new Map();
    this.#fill(runs.length);
  }

  #fill(runs) {
    const users = this.#part("Users");
    for (const doing of [SERVED, WAITING, ATTACHED, IDLE]) {
      const row = this.#row(users, userWord(doing), (ctx, theme) => {
        drawUser(ctx, X, Y, RADII[doing] * 1.1, doing, -1, { ...theme, map: theme.paper });
      });
      const count = element("b");
      row.append(count);
      if (runs === 1) this.counts.set(doing, count);
    }
    const services = this.#part("Requests, by service");
    this.run.services.forEach((name, service) => {
      this.#row(services, words(name), (ctx, theme) => {
        drawUser(ctx, X, Y, 5.2, WAITING, service, { ...theme, map: theme.paper }, theme.ink);
      });
    });
    this.#fillDrones(this.#part("Drones, each in its colour"));
    this.#fillGround(this.#part("Ground"));
  }

  #fillDrones(list) {
    const { run } = this;
    const battery = run.types.every((type) => type.capacity_us === null) ? "" : ", with its battery";
    run.types.forEach(({ name }, number) => {
      const text = run.types.length > 1 ? `${name}, serving` : `serving${battery}`;
      this.#row(list, text, (ctx, theme) => {
        drawFrame(ctx, theme, X, Y, 6, 2.6);
        if (battery) drawBattery(ctx, theme, 0.7, X, Y, 7, 2);
        drawBody(ctx, theme, 0, X, Y, 5, false, false, shapeOfType(number));
      });
    });
    if (battery) {
      this.#row(list, "returning, without service", (ctx, theme) => {
        drawBattery(ctx, theme, 0.15, X, Y, 7, 2);
        drawBody(ctx, theme, 0, X, Y, 5, true, false);
      });
      this.#row(list, "crashed", (ctx, theme) => {
        ctx.strokeStyle = theme.danger;
        ctx.lineWidth = 2.75;
        drawCross(ctx, X, Y, 5.5);
      });
    }
    const footprint = run.types.some((type) => type.rings) ? "classes of links, at the mean loss"
      : `footprint, ${[...new Set(run.types.map((type) => `${type.footprint_m} m`))].join(" or ")}`;
    this.#row(list, footprint, (ctx) => {
      ctx.fillStyle = ctx.strokeStyle = droneColour(0);
      ctx.beginPath();
      ctx.arc(X, Y, 8, 0, 2 * Math.PI);
      ctx.globalAlpha = 0.12;
      ctx.fill();
      ctx.globalAlpha = 0.75;
      ctx.stroke();
    });
    if (run.separation_m) {
      this.#row(list, `nearer than ${run.separation_m} m to another drone`, (ctx, theme) => {
        drawRing(ctx, theme, X, Y, 8);
        drawBody(ctx, theme, 0, X, Y, 5, false, false);
      });
    }
    if (hasTasks(run)) {
      this.#row(list, "tasks at its processor; hollow: waiting", (ctx, theme) => {
        const tasks = { computing: [0], waiting: [1, 2] };
        drawQueue(ctx, theme, 0, run.drones, X, Y - SQUARE / 2, tasks);
      });
    }
    this.#row(list, "path so far", (ctx) => {
      strokeLine(ctx, droneColour(0), 2, [[2, 15], [10, 15], [10, 6], [24, 6]]);
    });
    if (run.three_d) {
      this.#row(list, "the point on the ground below it (3D)", (ctx) => {
        strokeLine(ctx, droneColour(0), 1.25, [[X, 2], [X, 15]]);
        ctx.fillStyle = droneColour(0);
        ctx.beginPath();
        ctx.ellipse(X, 15, 5, 3, 0, 0, 2 * Math.PI);
        ctx.fill();
      });
    }
    this.#row(list, run.graded ? "serves this user; wide: a good link" : "serves this user", (ctx, theme) => {
      strokeLine(ctx, droneColour(0), 1.1, [[3, 4], [19, 14]]);
      drawUser(ctx, 20, 14, 4, SERVED, -1, { ...theme, map: theme.paper });
    });
  }

  #fillGround(list) {
    const { run } = this;
    const heights = buildingsOf(run).map(({ height }) => height);
    if (run.map.stations.length) {
      this.#row(list, "charging station", (ctx, theme) => {
        ctx.translate(X, Y);
        ctx.scale(0.8, 0.8);
        drawStation(ctx, theme, 0, 0, 1.5);
      });
      this.#row(list, "its pad, with a charging drone", (ctx, theme) => {
        drawPad(ctx, theme, X, Y, 8);
        drawBody(ctx, theme, 0, X, Y, 5, false, false);
      });
    }
    if (run.points.length) {
      this.#row(list, "access point", (ctx, theme) => drawMast(ctx, theme, X, Y + 2, 6));
    }
    if (heights.length) {
      const [low, high] = [Math.min, Math.max].map((of) => Math.round(heights.reduce((a, b) => of(a, b))));
      this.#row(list, low === high ? `building, ${low} m` : `buildings, ${low} to ${high} m`, (ctx, theme) => {
        [0, 0.33, 0.67, 1].forEach((share, k) => {
          ctx.fillStyle = roof(theme, low / high + share * (1 - low / high));
          ctx.fillRect(1 + 6 * k, 4, 6, 12);
        });
      });
    }
    const [east, north] = run.wind_mps;
    if (east || north) {
      const mps = Math.hypot(east, north);
      this.#row(list, `wind, ${Number(mps.toFixed(2))} m/s`, (ctx, theme) => {
        strokeArrow(ctx, theme.ink, (8 * east) / mps, (-8 * north) / mps);
      });
    }
    if (run.map.zones.length) {
      const [zone, other] = run.map.zones;
      this.#row(list, other ? "no flight" : zoneWords(zone.altitude_m), (ctx, theme) => {
        ctx.strokeStyle = theme.danger;
        ctx.setLineDash([4, 3]);
        ctx.strokeRect(3, 4, 20, 12);
      });
    }
    if (run.map.clusters.length) {
      this.#row(list, "cluster of homes", (ctx, theme) => {
        ctx.strokeStyle = theme.muted;
        ctx.setLineDash([2, 3]);
        ctx.beginPath();
        ctx.arc(X, Y, 8, 0, 2 * Math.PI);
        ctx.stroke();
      });
    }
    this.#row(list, "chosen, or at the pointer", (ctx, theme) => {
      ctx.strokeStyle = theme.accent;
      ctx.lineWidth = 2;
      ctx.beginPath();
      ctx.arc(X, Y, 8, 0, 2 * Math.PI);
      ctx.stroke();
    });
    this.#row(list, "walk of the chosen user, past and future", (ctx, theme) => {
      strokeLine(ctx, theme.ink, 1.25, [[1, 14], [8, 6], [14, 11]]);
      ctx.setLineDash([1, 4]);
      strokeLine(ctx, theme.ink, 1.25, [[14, 11], [25, 5]]);
    });
  }

  #part(title) {
    const list = element("ul", "legend");
    byId("legend-parts").append(element("h3", "", title), list);
    return list;
  }

  #row(list, text, paint) {
    const row = element("li");
    const sample = element("canvas");
    row.append(sample, element("span", "", text));
    list.append(row);
    this.samples.push({ sample, paint });
    return row;
  }

  /** Paint the samples in the colours of the theme. */
  setTheme(theme) {
    const ratio = Math.min(3, window.devicePixelRatio || 1);
    for (const { sample, paint } of this.samples) {
      [sample.width, sample.height] = [WIDTH * ratio, HEIGHT * ratio];
      const ctx = sample.getContext("2d");
      ctx.scale(ratio, ratio);
      ctx.lineJoin = ctx.lineCap = "round";
      ctx.lineWidth = 1.25;
      paint(ctx, theme);
    }
  }

  /** How many users are in each state now. */
  update(state) {
    const counts = state.counts();
    for (const [doing, count] of this.counts) setText(count, String(counts[doing]));
  }
}

/** An arrow through the middle of a sample, from (-dx, -dy) to (dx, dy). */
function strokeArrow(ctx, colour, dx, dy) {
  const barb = (side) => [X + 0.3 * dx - 0.45 * side * dy, Y + 0.3 * dy + 0.45 * side * dx];
  strokeLine(ctx, colour, 1.5, [[X - dx, Y - dy], [X + dx, Y + dy]]);
  strokeLine(ctx, colour, 1.5, [barb(1), [X + dx, Y + dy], barb(-1)]);
}

function strokeLine(ctx, colour, width, points) {
  ctx.strokeStyle = colour;
  ctx.lineWidth = width;
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
  ctx.stroke();
}
