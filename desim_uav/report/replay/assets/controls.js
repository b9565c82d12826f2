// Buttons, keys and pointers, which control the player and the camera; nothing here draws.

import { HEATS } from "./heat.js";
import { SPEEDS } from "./player.js";
import { byId } from "./rows.js";

const TURN = 0.09;
const MOVE = 60;
const NEAR = { flat: 2, tilted: 1.6 }; // zoom when a drone is followed

export function wire({ runs, player, scenes, timeline, panel, layout, redraw, setTheme, isDark, keep }) {
  const [run] = runs;
  const cameras = scenes.map((scene) => scene.camera);
  const [camera] = cameras;
  let before = null; // what was seen before a drone was followed
  const kinds = () => {
    const chosen = byId("kinds").value;
    return chosen ? new Set(chosen.split(" ").map((kind) => run.kinds.indexOf(kind))) : null;
  };
  const shown = () => player.episode.index;
  const followed = () => scenes[0].followed;
  const showFollowed = () => {
    const d = followed();
    byId("follow").setAttribute("aria-pressed", String(d >= 0));
    byId("following").hidden = d < 0;
    byId("following").textContent = d < 0 ? "" : `following drone ${d}`;
    settle();
  };
  /** Keep drone d in the middle of each map; -1 ends this. */
  const follow = (d) => {
    if (d >= 0 && followed() < 0) {
      before = cameras.map((each) => each.view);
      for (const each of cameras) each.zoom = Math.max(each.zoom, each.tilted ? NEAR.tilted : NEAR.flat);
    }
    for (const scene of scenes) scene.followed = d;
    if (d < 0 && before) cameras.forEach((each, k) => { each.view = before[k]; });
    if (d < 0) before = null;
    showFollowed();
  };
  /** Stop following, and keep the view. */
  const letGo = () => {
    if (followed() < 0) return;
    for (const scene of scenes) scene.followed = -1;
    for (const each of cameras) each.following = false;
    before = null;
    showFollowed();
  };
  const actions = {
    toggle: () => (player.playing ? player.pause() : player.play()),
    step: (direction) => {
      if (!player.stepEvent(direction, kinds())) {
        byId("live").textContent = direction > 0 ? "no such event after this" : "no such event before this";
      } else panel.announce();
    },
    by: (us) => {
      player.seek(player.tUs + us);
      if (!player.playing) panel.announce();
    },
    to: (us) => player.seek(us),
    episode: (index) => {
      if (index < 0 || index >= run.episodes.length) return;
      player.pause();
      player.open(index);
    },
    tilt: () => {
      const d = followed();
      letGo();
      for (const each of cameras) {
        each.tilted = !each.tilted;
        each.reset();
      }
      byId("tilt").setAttribute("aria-pressed", String(camera.tilted));
      if (d >= 0) follow(d);
      settle();
    },
    keep,
    theme: () => setTheme(isDark() ? "light" : "dark"),
    zoom: (factor, px, py) => {
      for (const each of cameras) each.zoomBy(factor, px, py);
      settle();
    },
    whole: () => {
      letGo();
      for (const each of cameras) each.reset();
      settle();
    },
    move: (dx, dy) => {
      if (camera.tilted) actions.turn(-dx * TURN, dy * TURN);
      else actions.pan(-dx * MOVE, dy * MOVE);
    },
    turn: (yaw, pitch) => {
      for (const each of cameras) each.turn(yaw, pitch);
      settle();
    },
    pan: (dx, dy) => {
      letGo();
      for (const each of cameras) each.pan(dx, dy);
      settle();
    },
    follow: () => {
      const { selection } = player;
      const wanted = selection?.what === "drone" ? selection.index : 0;
      follow(followed() < 0 ? wanted : -1);
    },
    heat: () => {
      const now = scenes[0].heat?.name ?? null;
      const next = HEATS[(HEATS.indexOf(now) + 1) % HEATS.length];
      scenes.forEach((scene, k) => scene.setHeat(next, player.states[k]));
      byId("heat").setAttribute("aria-pressed", String(next !== null));
      redraw();
    },
    open: (name) => layout.toggle(name),
    help: () => (byId("keys").open ? byId("keys").close() : byId("keys").showModal()),
  };
  /** After the camera has moved: touching the map scrolls the page only if the map cannot move. */
  function settle() {
    const touch = camera.tilted || camera.zoom > 1 ? "none" : "pan-y";
    for (const scene of scenes) scene.canvas.style.touchAction = touch;
    redraw();
  }
  player.addEventListener("selection", () => { // who is chosen is who is followed
    if (followed() >= 0 && player.selection?.what === "drone") follow(player.selection.index);
  });
  wireButtons(actions, player, panel, shown);
  wireKeys(actions, player, run, shown);
  for (const scene of scenes) wireMap(actions, player, scene, scenes, redraw);
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
  on("keep", "click", actions.keep);
  on("theme", "click", actions.theme);
  on("help", "click", actions.help);
  on("closer", "click", () => actions.zoom(1.5));
  on("wider", "click", () => actions.zoom(1 / 1.5));
  on("whole", "click", actions.whole);
  on("follow", "click", actions.follow);
  on("heat", "click", actions.heat);
  for (const name of ["charts", "panel", "legend"]) on(`${name}-toggle`, "click", () => actions.open(name));
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
    End: () => actions.to(player.durationUs),
    "+": () => actions.zoom(1.25),
    "=": () => actions.zoom(1.25),
    "-": () => actions.zoom(0.8),
    0: actions.whole,
    w: () => actions.move(0, 1),
    s: () => actions.move(0, -1),
    a: () => actions.move(-1, 0),
    d: () => actions.move(1, 0),
    v: actions.tilt,
    f: actions.follow,
    h: actions.heat,
    c: () => actions.open("charts"),
    p: () => actions.open("panel"),
    l: () => actions.open("legend"),
    t: actions.theme,
    e: actions.keep,
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

function wireMap(actions, player, scene, scenes, redraw) {
  const { canvas, camera } = scene;
  let from = null;
  let moved = false;
  const where = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  /** Highlight the same thing on both maps; the tooltip is beside the one under the pointer. */
  const point = (what) => {
    for (const each of scenes) Object.assign(each, { hover: what, pointed: each === scene });
    canvas.style.cursor = what ? "pointer" : "";
    redraw();
  };
  canvas.addEventListener("pointerdown", (event) => {
    from = where(event);
    moved = false;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const [px, py] = where(event);
    if (!from) return point(player.state ? scene.nearest(px, py) : null);
    const [dx, dy] = [px - from[0], py - from[1]];
    if (!moved && Math.hypot(dx, dy) < 4) return undefined;
    moved = true;
    from = [px, py];
    point(null);
    return camera.tilted ? actions.turn(-dx * 0.006, dy * 0.006) : actions.pan(dx, dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    const [px, py] = where(event);
    if (from && !moved) player.select(scene.nearest(px, py, event.pointerType === "touch" ? 26 : 16));
    from = null;
  });
  canvas.addEventListener("pointercancel", () => { from = null; });
  canvas.addEventListener("pointerleave", () => point(null));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    actions.zoom(Math.exp(-event.deltaY * 0.0015), ...where(event));
  }, { passive: false });
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
