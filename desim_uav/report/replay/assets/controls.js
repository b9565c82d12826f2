// Hands: buttons, keys, pointers. They move the player and the camera; nothing here draws.

import { describe } from "./details.js";
import { SPEEDS } from "./player.js";
import { fillRows } from "./panel.js";

const byId = (id) => document.getElementById(id);
const TURN = 0.09;
const MOVE = 60;

export function wire({ run, player, camera, scene, timeline, panel, redraw, setTheme, isDark }) {
  const kinds = () => {
    const chosen = byId("kinds").value;
    return chosen ? new Set(chosen.split(" ").map((kind) => run.kinds.indexOf(kind))) : null;
  };
  const shown = () => player.episode.index;
  const actions = {
    toggle: () => (player.playing ? player.pause() : player.play()),
    step: (direction) => {
      if (!player.stepEvent(direction, kinds())) {
        byId("live").textContent = direction > 0 ? "no such event after this" : "no such event before this";
      } else panel.announce();
    },
    by: (us) => {
      player.seek(player.state.tUs + us);
      if (!player.playing) panel.announce();
    },
    to: (us) => player.seek(us),
    episode: (index) => {
      if (index < 0 || index >= run.episodes.length) return;
      player.pause();
      player.open(index);
    },
    tilt: () => {
      camera.tilted = !camera.tilted;
      camera.reset();
      byId("tilt").setAttribute("aria-pressed", String(camera.tilted));
      settle();
    },
    theme: () => setTheme(isDark() ? "light" : "dark"),
    zoom: (factor, px, py) => {
      camera.zoomBy(factor, px, py);
      settle();
    },
    whole: () => {
      camera.reset();
      settle();
    },
    move: (dx, dy) => {
      if (camera.tilted) camera.turn(-dx * TURN, dy * TURN);
      else camera.pan(-dx * MOVE, dy * MOVE);
      settle();
    },
    help: () => (byId("keys").open ? byId("keys").close() : byId("keys").showModal()),
  };
  /** After the camera has moved: who touches the map scrolls the page only where nothing else moves. */
  function settle() {
    scene.canvas.style.touchAction = camera.tilted || camera.zoom > 1 ? "none" : "pan-y";
    redraw();
  }
  wireButtons(actions, player, panel, shown);
  wireKeys(actions, player, run, shown);
  wireMap(actions, player, camera, scene, settle, redraw);
  wireTimeline(player, timeline, panel, redraw);
  settle();
  return actions;
}

function wireButtons(actions, player, panel, shown) {
  const on = (id, event, action) => byId(id).addEventListener(event, action);
  on("play", "click", actions.toggle);
  on("back", "click", () => actions.step(-1));
  on("forth", "click", () => actions.step(1));
  on("earlier", "click", () => actions.episode(shown() - 1));
  on("later", "click", () => actions.episode(shown() + 1));
  on("episode", "change", () => actions.episode(byId("episode").selectedIndex));
  on("tilt", "click", actions.tilt);
  on("theme", "click", actions.theme);
  on("help", "click", actions.help);
  on("closer", "click", () => actions.zoom(1.5));
  on("wider", "click", () => actions.zoom(1 / 1.5));
  on("whole", "click", actions.whole);
  on("speed", "input", () => player.setSpeed(SPEEDS[Number(byId("speed").value)]));
  on("unchoose", "click", () => player.select(null));
  on("now", "click", () => panel.nowOf && player.select(panel.nowOf));
  on("what", "change", () => { byId("number").max = panel.limit(byId("what").value); });
  on("choose", "submit", (event) => {
    event.preventDefault();
    const what = byId("what").value;
    const index = Math.min(panel.limit(what), Math.max(0, Math.round(Number(byId("number").value) || 0)));
    byId("number").value = index;
    player.select({ what, index });
  });
}

function wireKeys(actions, player, run, shown) {
  const keys = {
    " ": actions.toggle,
    ",": () => actions.step(-1),
    ".": () => actions.step(1),
    "[": () => actions.episode(shown() - 1),
    "]": () => actions.episode(shown() + 1),
    ArrowLeft: (shift) => actions.by(shift ? -run.step_us : -5e6),
    ArrowRight: (shift) => actions.by(shift ? run.step_us : 5e6),
    Home: () => actions.to(0),
    End: () => actions.to(player.episode.durationUs),
    "+": () => actions.zoom(1.25),
    "=": () => actions.zoom(1.25),
    "-": () => actions.zoom(0.8),
    0: actions.whole,
    w: () => actions.move(0, 1),
    s: () => actions.move(0, -1),
    a: () => actions.move(-1, 0),
    d: () => actions.move(1, 0),
    v: actions.tilt,
    t: actions.theme,
    "?": actions.help,
    Escape: () => player.select(null),
  };
  SPEEDS.forEach((speed, k) => { keys[k + 1] = () => player.setSpeed(speed); });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !player.state) return;
    if (byId("keys").open && event.key !== "?") return;
    const { target } = event;
    if (target.matches("input:not([type=range]), select")) return;
    const presses = [" ", "Enter"].includes(event.key) && target.matches("button");
    const slides = event.key.startsWith("Arrow") || event.key === "Home" || event.key === "End";
    if (presses || (slides && target.matches("input"))) return;
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action(event.shiftKey);
  });
}

function wireMap(actions, player, camera, scene, settle, redraw) {
  const { canvas } = scene;
  const tip = byId("tip");
  let from = null;
  let moved = false;
  const where = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const point = (px, py) => {
    scene.hover = player.state ? scene.nearest(px, py) : null;
    scene.pointer = [px, py];
    canvas.style.cursor = scene.hover ? "pointer" : "";
    redraw();
  };
  canvas.addEventListener("pointerdown", (event) => {
    from = where(event);
    moved = false;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const [px, py] = where(event);
    if (!from) return point(px, py);
    const [dx, dy] = [px - from[0], py - from[1]];
    if (!moved && Math.hypot(dx, dy) < 4) return undefined;
    moved = true;
    from = [px, py];
    scene.hover = null;
    if (camera.tilted) camera.turn(-dx * 0.006, dy * 0.006);
    else camera.pan(dx, dy);
    return settle();
  });
  canvas.addEventListener("pointerup", (event) => {
    const [px, py] = where(event);
    if (from && !moved) player.select(scene.nearest(px, py, event.pointerType === "touch" ? 26 : 16));
    from = null;
  });
  canvas.addEventListener("pointercancel", () => { from = null; });
  canvas.addEventListener("pointerleave", () => {
    scene.hover = null;
    tip.hidden = true;
    redraw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    actions.zoom(Math.exp(-event.deltaY * 0.0015), ...where(event));
  }, { passive: false });
}

/** The words at the pointer. */
export function updateTip(player, scene) {
  const tip = byId("tip");
  const what = scene.hover;
  tip.hidden = !what || (player.selection?.what === what.what && player.selection.index === what.index);
  if (tip.hidden) return;
  const told = describe(player.state, what);
  if (!tip.firstChild) {
    const title = document.createElement("b");
    const rows = document.createElement("dl");
    rows.className = "rows";
    tip.append(title, rows);
  }
  tip.firstChild.textContent = `${told.title}, ${told.tag}`;
  fillRows(tip.lastChild, told.rows);
  const [px, py] = scene.pointer;
  const { clientWidth: width, clientHeight: height } = scene.canvas;
  const left = px + 16 + tip.offsetWidth > width ? px - 16 - tip.offsetWidth : px + 16;
  const top = Math.min(height - tip.offsetHeight - 4, Math.max(4, py + 12));
  tip.style.transform = `translate(${Math.max(4, left)}px, ${top}px)`;
}

function wireTimeline(player, timeline, panel, redraw) {
  const { canvas } = timeline;
  let held = false;
  let resume = false;
  const timeOf = (event) => timeline.timeAt(event.clientX - canvas.getBoundingClientRect().left);
  canvas.addEventListener("pointerdown", (event) => {
    if (!player.state) return;
    held = true;
    resume = player.playing;
    player.pause();
    canvas.setPointerCapture(event.pointerId);
    player.seek(timeOf(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!player.state) return;
    timeline.hoverUs = timeOf(event);
    if (held) player.seek(timeline.hoverUs);
    else redraw();
  });
  const release = () => {
    if (!held) return;
    held = false;
    if (resume) player.play();
    else panel.announce();
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("pointerleave", () => {
    timeline.hoverUs = null;
    redraw();
  });
}
