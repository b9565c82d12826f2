// Which parts of the page are open: charts, panel and legend. The map takes the remaining space.

import { byId } from "./rows.js";

const TALL = 1000;
const WIDE = 960;

export class Layout {
  constructor(runs, changed) {
    const wide = window.innerWidth >= WIDE;
    this.changed = changed;
    this.runs = runs;
    this.open = {
      charts: window.innerHeight >= TALL || !wide,
      panel: true,
      legend: wide && runs === 1,
    };
    this.#apply();
  }

  toggle(name) {
    this.open[name] = !this.open[name];
    this.#apply();
    this.changed();
  }

  /** The pixels that the legend and the buttons cover: at the left and right of map k, and of its foot. */
  taken(k) {
    if (window.innerWidth < WIDE) return [0, 0, 0];
    const buttons = byId("zoom").offsetWidth + 12;
    const box = byId(this.open.legend ? "legend" : "legend-toggle");
    const covers = k === 0 && (this.open.legend || this.runs === 1);
    const left = covers ? box.offsetLeft + box.offsetWidth : 0;
    return this.runs === 1 ? [left, buttons, buttons] : [left, 0, k === this.runs - 1 ? buttons : 0];
  }

  #apply() {
    const { charts, panel, legend } = this.open;
    document.body.classList.toggle("no-charts", !charts);
    document.body.classList.toggle("no-panel", !panel);
    for (const name of ["charts", "panel", "legend"]) {
      byId(`${name}-toggle`).setAttribute("aria-pressed", String(this.open[name]));
    }
    byId("legend").hidden = !legend;
    (panel ? byId("moment") : byId("transport")).append(byId("now"));
  }
}
