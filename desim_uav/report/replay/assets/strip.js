// The strip below a user or a request: the parts of its task, from the request to its end.

import { span } from "./palette.js";
import { element, setText } from "./rows.js";
import { PARTS, spellsOf } from "./tasks.js";

const wordOf = (part) => part.replace(" part", "");

export class Strip {
  constructor(below) {
    this.strip = element("div", "strip");
    this.strip.setAttribute("role", "img");
    this.legend = element("div", "strip-legend");
    this.parts = PARTS.map((part) => this.legend.appendChild(element("span", `of-${wordOf(part)}`)));
    below.after(this.strip, this.legend);
    this.show(null);
  }

  /** Show a task (see taskOf of details.js), or nothing. */
  show(task, state) {
    this.strip.hidden = this.legend.hidden = !task;
    if (!task) return;
    const sums = [...task.parts].map(([part, us]) => `${part} ${span(us)}`);
    this.parts.forEach((node, k) => setText(node, sums[k]));
    this.strip.setAttribute("aria-label", `Request ${task.request}: ${sums.join(", ")}`);
    if (this.task !== task.request || this.episode !== state.episode) this.#draw(task, state.episode);
    const [from, until] = this.range;
    this.ahead.style.left = `${100 * Math.min(1, (state.tUs - from) / (until - from))}%`;
    this.ahead.hidden = state.tUs >= until;
  }

  #draw(task, episode) {
    [this.task, this.episode] = [task.request, episode];
    const spells = spellsOf(episode, task.user).filter(({ request }) => request === task.request);
    const from = task.askedUs;
    const until = spells.reduce((last, { untilUs }) => Math.max(last, untilUs), from + 1);
    this.range = [from, until];
    const share = (tUs) => `${(100 * (tUs - from)) / (until - from)}%`;
    this.strip.replaceChildren(...spells.map(({ part, fromUs, untilUs }) => {
      const piece = element("span", `of-${wordOf(part)} ${wordOf(part)}`);
      piece.style.left = share(fromUs);
      piece.style.width = share(from + untilUs - fromUs);
      return piece;
    }));
    if (task.deadlineUs >= 0 && task.deadlineUs < until) {
      const late = element("span", "late");
      late.style.left = share(task.deadlineUs);
      this.strip.append(late);
    }
    this.ahead = element("span", "ahead");
    this.strip.append(this.ahead);
  }
}
