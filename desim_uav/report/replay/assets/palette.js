// Colours of drones and users, which are part of the page's data, shapes of services, and words.

const looks = { drones: ["#000000"], users: [] };

/** Take the palette of the page: colours of drones by number, word and colour of users by state. */
export function setPalette({ drones, users }) {
  Object.assign(looks, { drones, users });
}

export const droneColour = (d) => looks.drones[d % looks.drones.length];
export const userColour = (doing) => looks.users[doing].colour;
export const userWord = (doing) => looks.users[doing].word;

export const SHAPES = ["circle", "square", "triangle", "diamond", "cross", "star"];

export const FONT = "system-ui, -apple-system, 'Segoe UI', sans-serif";

/** Black or white, whichever is legible on a colour. */
export function inkOn(colour) {
  const [r, g, b] = [1, 3, 5].map((at) => {
    const c = parseInt(colour.slice(at, at + 2), 16) / 255;
    return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.22 ? "#111418" : "#FFFFFF";
}

/** The colours of the present theme, from the style sheet. */
export function readTheme() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  const theme = {};
  for (const name of ["paper", "map", "ink", "muted", "faint", "line", "grid", "accent",
    "danger", "street", "roof-low", "roof-high", "on-roof",
    "task-waiting", "task-sending", "task-computing", "task-own"]) theme[name] = of(name);
  return theme;
}

/** A colour between two, as #RRGGBB. */
export function between(low, high, share) {
  const part = (at) => {
    const [a, b] = [low, high].map((colour) => parseInt(colour.slice(at, at + 2), 16));
    return Math.round(a + (b - a) * share).toString(16).padStart(2, "0");
  };
  return `#${part(1)}${part(3)}${part(5)}`;
}

/** Trace the outline of a shape of radius r around (x, y). */
export function trace(ctx, shape, x, y, r) {
  if (shape === "square") ctx.rect(x - r * 0.88, y - r * 0.88, 1.76 * r, 1.76 * r);
  else if (shape === "circle") {
    ctx.moveTo(x + r, y);
    ctx.arc(x, y, r, 0, 2 * Math.PI);
  } else {
    POINTS[shape].forEach(([dx, dy], k) => {
      if (k === 0) ctx.moveTo(x + r * dx, y + r * dy);
      else ctx.lineTo(x + r * dx, y + r * dy);
    });
    ctx.closePath();
  }
}

const POINTS = {
  triangle: [[0, -1.2], [1.1, 0.8], [-1.1, 0.8]],
  diamond: [[0, -1.25], [1.25, 0], [0, 1.25], [-1.25, 0]],
  hexagon: Array.from({ length: 6 }, (_, k) => [1.1 * Math.cos((k * Math.PI) / 3), 1.1 * Math.sin((k * Math.PI) / 3)]),
  shield: [[-1, -1], [1, -1], [1, 0.3], [0, 1.25], [-1, 0.3]],
  cross: [[-0.4, -1.1], [0.4, -1.1], [0.4, -0.4], [1.1, -0.4], [1.1, 0.4], [0.4, 0.4], [0.4, 1.1],
    [-0.4, 1.1], [-0.4, 0.4], [-1.1, 0.4], [-1.1, -0.4], [-0.4, -0.4]],
  star: Array.from({ length: 10 }, (_, k) => {
    const [r, a] = [k % 2 ? 0.55 : 1.3, (k * Math.PI) / 5];
    return [r * Math.sin(a), -r * Math.cos(a)];
  }),
};

// ---- words

const MINUTE_US = 60e6;
const DAY_US = 86400e6;
const two = (number) => String(number).padStart(2, "0");

/** A time as h:mm:ss, 0:12:34, or with so many digits of a second, 0:12:34.567; from the second day
 *  on with the day before it. */
export function clock(us, digits = 0) {
  const unit = 10 ** (6 - digits);
  const cut = Math.floor(us / unit) * unit;
  const seconds = Math.floor((cut % MINUTE_US) / 1e6);
  const part = digits ? `.${String(Math.round((cut % 1e6) / unit)).padStart(digits, "0")}` : "";
  return `${hoursAndMinutes(cut)}:${two(seconds)}${part}`;
}

/** A time as h:mm if it is a whole minute, else as h:mm:ss. */
export const shortClock = (us) => (us % MINUTE_US === 0 ? hoursAndMinutes(us) : clock(us));

function hoursAndMinutes(us) {
  const day = Math.floor(us / DAY_US);
  const minutes = Math.floor((us % DAY_US) / MINUTE_US);
  return `${day ? `day ${day + 1}, ` : ""}${Math.floor(minutes / 60)}:${two(minutes % 60)}`;
}

/** A duration: 48 s, 12 min 5 s. */
export function span(us) {
  const s = us / 1e6;
  if (s < 60) return `${s < 10 && s % 1 ? s.toFixed(1) : Math.round(s)} s`;
  const whole = Math.round(s);
  const rest = whole % 60;
  return `${Math.floor(whole / 60)} min${rest ? ` ${rest} s` : ""}`;
}

export const kbps = (bps) => (bps >= 1e6 ? `${+(bps / 1e6).toFixed(2)} Mbit/s`
  : `${+(bps / 1e3).toFixed(1)} kbit/s`);

export const words = (name) => name.replaceAll("_", " ");

export const percent = (value, digits = 1) => (value === null || Number.isNaN(value)
  ? "–" : `${value.toFixed(digits)} %`);

/** QoE2 with its unit, or without it where the unit stands beside its name. */
export const inSteps = (value, unit = " steps") => (value === null ? "–" : value.toFixed(2) + unit);
