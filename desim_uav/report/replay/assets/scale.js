// The scale bar of a map, and its wind.

const LONGEST_PX = 160;
const LONGEST_SHARE = 0.3; // of the picture's width

/** The longest of 1, 2 and 5 times a power of ten that is not above a number. */
export function roundDown(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find((digit) => digit * power <= value) * power;
}

/** The pixels that the bar never exceeds, so that its neighbours stay in place while one zooms. */
const longestOf = (camera) => Math.min(LONGEST_PX, LONGEST_SHARE * camera.width);

/** The length of the bar in metres, in pixels, and in words. */
export function scaleOf(camera) {
  const metres = roundDown(longestOf(camera) / camera.pixelsPerMetre);
  const text = metres >= 1000 ? `${metres / 1000} km` : `${+metres.toPrecision(1)} m`;
  return { metres, pixels: metres * camera.pixelsPerMetre, text };
}

const ARROW_PX = 26;

/** An arrow that shows where the wind blows to, and its speed, or null if there is none. */
export function windPart({ ctx, camera, run }) {
  const [east, north] = run.wind_mps;
  const mps = Math.hypot(east, north);
  if (!mps) return null;
  const text = `wind ${Number(mps.toFixed(1))} m/s`;
  const ahead = camera.tilted ? turned(camera, east, north) : [east, -north];
  const length = Math.hypot(...ahead);
  const [dx, dy] = ahead.map((part) => (0.5 * ARROW_PX * part) / length);
  const draw = (to, left, base) => {
    const [x, y] = [left + ARROW_PX / 2, base - 4];
    to.lineWidth = 2;
    to.beginPath();
    to.moveTo(x - dx, y - dy);
    to.lineTo(x + dx, y + dy);
    for (const side of [1, -1]) {
      to.moveTo(x + 0.3 * dx - 0.45 * side * dy, y + 0.3 * dy + 0.45 * side * dx);
      to.lineTo(x + dx, y + dy);
    }
    to.stroke();
    to.fillText(text, left + ARROW_PX + 6, base);
  };
  return { width: ARROW_PX + 6 + ctx.measureText(text).width, draw };
}

/** A direction on the ground in the picture of a tilted map. */
function turned(camera, east, north) {
  const right = east * camera.cosYaw - north * camera.sinYaw;
  const back = east * camera.sinYaw + north * camera.cosYaw;
  return [right, -back * camera.sinPitch];
}

/** The bar with its length. In perspective it is valid in the middle of the picture. */
export function scalePart({ ctx, camera }) {
  const { pixels, text } = scaleOf(camera);
  const notes = [text];
  if (camera.tilted) notes.push("in the middle");
  if (camera.tilted && camera.lift > 1.05) notes.push(`heights × ${camera.lift.toFixed(1)}`);
  const words = notes.join(", ");
  const draw = (to, left, y) => {
    to.lineWidth = 1.5;
    to.lineCap = "butt";
    to.beginPath();
    for (const [dx, dy] of [[0, -2], [0, 2], [pixels, 2], [pixels, -2]]) to.lineTo(left + dx, y + dy);
    to.stroke();
    to.lineCap = "round";
    to.fillText(words, left, y - 6);
  };
  return { width: Math.max(longestOf(camera), ctx.measureText(words).width), draw };
}
