// The page: its data, the player, and the views. `window.replay` is for scripts and tests:
//
//   await replay.ready                      the first episode is drawn
//   replay.episodes                         the numbers of the episodes of this page
//   await replay.seek(episode, t_s, phase)  show a time, after the events of `phase` (all) then
//   replay.state(k)                         the state of run k (0): drones, users, stations, measures
//   replay.runs                             the policies of the runs of this page
//   replay.stepEvent(1 or -1, [kinds])      to the next event of these kinds (all), or the one before;
//                                           returns {kind, t_s, text}, or null if there is none
//   replay.play(), replay.pause(), replay.setSpeed(times)
//   replay.select({what: "user" | "drone" | "station" | "request", index} or null)
//   replay.where({what, index}, k)          its place on the map of run k (0), in pixels of the window
//   replay.scale(k)                         the length of that map's scale bar, in metres and pixels
//   replay.foot(k)                          what stands below that map: its top, and each part's place
//   replay.draw()                           draw once, now
//   replay.heat(k)                          the heat map of run k that is shown (key h), or null
//   replay.picture()                        what is shown now, as the address (data:) of a PNG
// When they return, the change is drawn and announced.

import { Camera } from "./camera.js";
import { wire } from "./controls.js";
import { canInflate, readJson } from "./decode.js";
import { tell } from "./details.js";
import { US } from "./episode.js";
import { Layout } from "./layout.js";
import { Legend } from "./legend.js";
import { clock, readTheme, setPalette, userWord } from "./palette.js";
import { Panel } from "./panel.js";
import { png, save } from "./picture.js";
import { Player, SPEEDS } from "./player.js";
import { byId, element } from "./rows.js";
import { scaleOf } from "./scale.js";
import { Scene } from "./scene.js";
import { tasksAt } from "./tasks.js";
import { Timeline } from "./timeline.js";
import { updateTip } from "./tip.js";

const KINDS_OF_CHOICE = ["user", "drone", "station", "request"];
const WORDS_EVERY_MS = 120;
const ADDRESS_AFTER_MS = 250;

function start() {
  if (!canInflate()) {
    byId("message").textContent = "This browser cannot unpack the data of this page "
      + "(DecompressionStream is missing). Chrome and Edge 103, Firefox 113, Safari 16.4 and later can.";
    return;
  }
  const { runs, palette } = readJson("runs");
  const [run] = runs;
  setPalette(palette);
  const player = new Player(runs);
  const scenes = runs.map((each, k) => new Scene(each, mapOf(k, runs.length), new Camera(each)));
  const timeline = new Timeline(runs, byId("timeline"));
  const panel = new Panel(runs, player);
  const legend = new Legend(runs);
  let stale = true;
  let saidAt = 0;
  const redraw = () => { stale = true; };
  for (const scene of scenes) scene.again = redraw;

  // ---- colours
  const darkByNature = window.matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (document.documentElement.dataset.theme ?? (darkByNature.matches ? "dark" : "light")) === "dark";
  const setTheme = (name) => {
    if (name) document.documentElement.dataset.theme = name;
    byId("theme").setAttribute("aria-pressed", String(isDark()));
    const theme = readTheme();
    for (const part of [...scenes, timeline, legend]) part.setTheme(theme);
    redraw();
  };
  darkByNature.addEventListener("change", () => setTheme(null));
  setTheme(null);

  // ---- drawing
  const draw = () => {
    if (!player.state) return;
    scenes.forEach((scene, k) => scene.draw(player.states[k]));
    timeline.draw();
  };
  const say = (now) => {
    if (player.playing && now - saidAt < WORDS_EVERY_MS) return;
    saidAt = now;
    panel.update();
    legend.update(player.state);
    updateTip(byId("tip"), player, scenes.find((scene) => scene.pointed));
    const { tUs, durationUs } = player;
    const slider = byId("timeline");
    slider.setAttribute("aria-valuemax", String(durationUs / US));
    slider.setAttribute("aria-valuenow", String(tUs / US));
    slider.setAttribute("aria-valuetext", `${clock(tUs, 1)} of ${clock(durationUs)}`);
  };
  let before = null;
  const frame = (now) => {
    if (player.playing && before !== null) player.advance(Math.min(100, now - before));
    before = now;
    if (stale && player.state) {
      stale = false;
      draw();
      say(now);
    }
    requestAnimationFrame(frame);
  };
  const resize = () => {
    scenes.forEach((scene, k) => scene.resize(...layout.taken(k)));
    timeline.resize();
    redraw();
  };
  const layout = new Layout(runs.length, resize);
  const observer = new ResizeObserver(resize);
  for (const { canvas } of [...scenes, timeline]) observer.observe(canvas);

  // ---- changes
  const address = addressOf(player);
  player.addEventListener("moment", () => {
    redraw();
    if (!player.playing) address.write();
  });
  player.addEventListener("selection", () => {
    const { selection } = player;
    scenes.forEach((scene, k) => {
      const { request } = player.states[k].episode;
      const user = selection?.what === "request" ? request.user[selection.index] : undefined;
      scene.selection = user === undefined ? selection : { what: "user", index: user };
      if (scene.selection?.what === "request") scene.selection = null; // asked in the other run only
      scene.reveal(scene.selection);
    });
    timeline.select(scenes[0].selection);
    redraw();
    if (!player.playing) address.write();
  });
  player.addEventListener("loading", () => {
    byId("message").textContent = "Reading …";
    byId("message").hidden = false;
  });
  player.addEventListener("episode", () => {
    byId("message").hidden = true;
    byId("episode").selectedIndex = player.episode.index;
    byId("earlier").disabled = player.episode.index === 0;
    byId("later").disabled = player.episode.index === run.episodes.length - 1;
    timeline.setStates(player);
    byId("number").max = panel.limit(byId("what").value);
    scenes.forEach((scene, k) => {
      scene.canvas.setAttribute("aria-label", `Map of episode ${player.episode.about.episode}, ${runs[k].policy}: `
        + `${run.drones} drones, ${run.users} users, ${run.map.stations.length} stations`);
      if (!player.selection) scene.selection = null;
      if (scene.heat) scene.setHeat(scene.heat.name, player.states[k]);
    });
  });
  player.addEventListener("playing", () => {
    byId("play").setAttribute("aria-pressed", String(player.playing));
    byId("play").setAttribute("aria-label", player.playing ? "Pause" : "Play");
    saidAt = 0;
    redraw();
    if (!player.playing) {
      address.write();
      panel.announce();
    }
  });
  player.addEventListener("speed", () => {
    const nearest = SPEEDS.findLastIndex((speed) => speed <= player.speed);
    byId("speed").value = String(Math.max(0, nearest));
    byId("speed").setAttribute("aria-valuetext", `${player.speed} times`);
    byId("speed-now").textContent = `${player.speed} ×`;
  });
  const picture = () => {
    draw();
    return png(runs, player, scenes, timeline);
  };
  const keep = () => {
    draw();
    save(runs, player, scenes, timeline);
  };
  wire({ runs, player, scenes, timeline, panel, layout, redraw, setTheme, isDark, keep });
  player.setSpeed(60);

  const show = () => {
    if (!player.state) return;
    stale = false;
    saidAt = 0;
    draw();
    say(performance.now());
  };
  const ready = address.read().then(() => {
    window.addEventListener("hashchange", () => address.read());
    resize();
    show();
    requestAnimationFrame(frame);
  }).catch((error) => {
    byId("message").textContent = `This page cannot be read: ${error.message}`;
    byId("message").hidden = false;
    throw error;
  });
  window.replay = scripted(runs, player, scenes, ready, draw, show, picture);
}

/** The canvas of run k, under a caption if there are two. */
function mapOf(k, count) {
  const pane = element("div", "map");
  const canvas = element("canvas");
  Object.assign(canvas, { id: k ? `map-${k}` : "map", tabIndex: 0, role: "img", ariaLabel: "Map" });
  const caption = element("p", "caption");
  Object.assign(caption, { id: `caption-${k}`, hidden: count === 1 });
  caption.append(element("b"), element("span"));
  pane.append(caption, canvas);
  byId("maps").append(pane);
  byId("stage").classList.toggle("pair", count > 1);
  return canvas;
}

/** The part of the address behind #: the instant, and the chosen thing. */
function addressOf(player) {
  const { run } = player;
  let timer = 0;
  const write = () => { // later, and once: browsers allow only so many changes
    clearTimeout(timer);
    timer = setTimeout(() => {
      if (player.playing || location.protocol === "about:") return; // a notebook's frame has none
      const parts = [`episode=${player.episode.about.episode}`, `t=${player.tUs / US}`];
      if (player.selection) parts.push(`${player.selection.what}=${player.selection.index}`);
      history.replaceState(null, "", `#${parts.join("&")}`);
    }, ADDRESS_AFTER_MS);
  };
  const read = async () => {
    const asked = new URLSearchParams(location.hash.slice(1));
    const whole = (name) => (/^-?\d+$/.test(asked.get(name) ?? "") ? Number(asked.get(name)) : null);
    const place = run.episodes.findIndex((about) => about.episode === whole("episode"));
    const t = Number(asked.get("t") ?? 0);
    player.pause();
    await player.open(Math.max(0, place), Number.isFinite(t) ? t * US : 0);
    const what = KINDS_OF_CHOICE.find((name) => whole(name) !== null);
    if (what) player.select({ what, index: whole(what) });
  };
  return { read, write };
}

function scripted(runs, player, scenes, ready, draw, show, picture) {
  const [run] = runs;
  const numbers = run.episodes.map((about) => about.episode);
  const moment = ({ k, i }) => {
    const { kind, tUs, text } = tell(player.states[k], i);
    return { kind, t_s: tUs / US, text, run: k };
  };
  return Object.freeze({
    ready,
    episodes: numbers,
    runs: runs.map(({ policy }) => policy),
    seek: async (episode, tS, phase = null) => {
      await ready;
      const index = numbers.indexOf(episode);
      if (index < 0) throw new RangeError(`there is no episode ${episode}`);
      await player.open(index, tS * US, phase);
      show();
    },
    stepEvent: (direction, kinds = null) => {
      const wanted = kinds && new Set(kinds.map((kind) => run.kinds.indexOf(kind)));
      const found = player.stepEvent(direction, wanted);
      show();
      return found ? moment(player.told) : null;
    },
    play: () => player.play(),
    pause: () => player.pause(),
    setSpeed: (times) => player.setSpeed(times),
    select: (selection) => {
      player.select(selection);
      show();
    },
    where: (what, k = 0) => {
      const { px, py } = scenes[k].whereIs(what);
      const { left, top } = scenes[k].canvas.getBoundingClientRect();
      return { x: left + px, y: top + py };
    },
    scale: (k = 0) => {
      const { metres, pixels } = scaleOf(scenes[k].camera);
      return { metres, pixels };
    },
    foot: (k = 0) => {
      const { canvas, camera, foot } = scenes[k];
      const { left: x, bottom } = canvas.getBoundingClientRect();
      const parts = foot.parts.map(({ left, row, width }) => ({ left: x + left, right: x + left + width, row }));
      return { top: bottom - camera.below, parts };
    },
    draw,
    heat: (k = 0) => scenes[k].heat,
    picture,
    state: (k = 0) => told(runs[k], player, player.states[k]),
  });
}

/** The whole state as plain values. */
function told(run, player, state) {
  const { episode } = state;
  const [x, y] = [new Float64Array(run.users), new Float64Array(run.users)];
  episode.userPlaces(state.tUs, x, y);
  const { qoe1, qoe2, qoe3, ...counts } = state.measures();
  return {
    episode: episode.about.episode,
    t_s: state.tUs / US,
    playing: player.playing,
    speed: player.speed,
    selection: player.selection,
    events: state.sums.next,
    drones: Array.from({ length: run.drones }, (_, d) => {
      const [xM, yM, zM] = episode.dronePlace(d, state.tUs, [0, 0, 0]);
      const batteryUs = episode.batteryUs(d, state.tUs);
      return {
        x_m: xM, y_m: yM, z_m: zM,
        mode: run.modes[state.mode[d]],
        battery_s: batteryUs === null ? null : batteryUs / US,
        attached_users: state.attachedTo[d],
        served_requests: state.servedBy[d],
        bandwidth_kbps: state.usedBps[d] / 1000,
        processor: tasksAt(state, d),
        carried: state.carried[d],
      };
    }),
    users: Array.from({ length: run.users }, (_, u) => ({
      x_m: x[u], y_m: y[u], z_m: episode.walk.z[u],
      state: userWord(state.userState(u)),
      service: state.request[u] < 0 ? null : run.services[episode.request.service[state.request[u]]],
      request: state.request[u] < 0 ? null : state.request[u],
      holder: state.holder[u] < 0 ? null : state.holder[u],
      age_s: state.ageUs(u) === null ? null : state.ageUs(u) / US,
      buffered: state.buffered[u] ?? null,
      link_class: state.holder[u] < 0 ? null : state.classOf(u, state.holder[u]),
    })),
    stations: run.map.stations.map((_, s) => state.dock(s)),
    measures: {
      qoe1_percent: qoe1, qoe2_iterations: qoe2, qoe3_percent: qoe3, ...counts,
    },
  };
}

start();
