// From metres to pixels: a flat map seen from above, or the city in perspective.

import { buildingsOf } from "./city.js";

const MARGIN = 14;

export class Camera {
  constructor(run) {
    const [width, depth] = run.map.size_m;
    this.size = { width, depth };
    this.tallest = buildingsOf(run).reduce((most, { height }) => Math.max(most, height), 1);
    this.tilted = false;
    this.following = false; // then it may look beyond the edge of the map
    this.width = this.height = 1;
    this.left = this.right = this.below = 0; // pixels that something else takes there
    this.reset();
  }

  reset() {
    this.zoom = 1;
    this.following = false;
    this.x = this.size.width / 2; // in the middle of the picture
    this.y = this.size.depth / 2;
    this.z = 0;
    this.yaw = -0.5;
    this.pitch = 0.72;
    this.update();
  }

  resize(width, height, left = 0, right = 0) {
    this.width = width;
    this.height = height;
    this.left = left;
    this.right = right;
    this.update();
  }

  /** Leave some pixels below the map. */
  standOn(below) {
    this.below = below;
    this.update();
  }

  /** The middle of the picture, in pixels. */
  get middle() { return [this.left + this.free / 2, this.high / 2]; }

  get free() { return Math.max(1, this.width - this.left - this.right); }

  get high() { return Math.max(1, this.height - this.below); }

  /** Keep a point in the middle of the picture. */
  follow(x, y, z) {
    Object.assign(this, { following: true, x, y, z: this.tilted ? z : 0 });
    this.update();
  }

  /** The present view, to return to later. */
  get view() {
    const { zoom, x, y, z, yaw, pitch } = this;
    return { zoom, x, y, z, yaw, pitch };
  }

  set view(view) {
    Object.assign(this, view, { following: false });
    this.update();
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(1.5, Math.max(0.2, this.pitch + pitch));
    this.update();
  }

  /** Move the picture by some pixels. */
  pan(dx, dy) {
    if (this.tilted) return;
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
    this.update();
  }

  /** Zoom by a factor; the point of the map under (px, py) stays there. */
  zoomBy(factor, px = this.middle[0], py = this.middle[1]) {
    const [fromX, fromY] = [this.mapX(px), this.mapY(py)];
    this.zoom = Math.min(24, Math.max(this.tilted ? 0.5 : 1, this.zoom * factor));
    this.update();
    if (!this.tilted && !this.following) {
      this.x += fromX - this.mapX(px);
      this.y += fromY - this.mapY(py);
      this.update();
    }
  }

  update() {
    const { width, depth } = this.size;
    const { free, high } = this;
    const fit = Math.min((free - 2 * MARGIN) / width, (high - 2 * MARGIN) / depth);
    this.scale = Math.max(1e-6, fit) * this.zoom;
    const halfX = free / this.scale / 2;
    const halfY = high / this.scale / 2;
    const room = MARGIN / this.scale;
    if (!this.tilted && !this.following) {
      this.x = clampMiddle(this.x, halfX - room, width);
      this.y = clampMiddle(this.y, halfY - room, depth);
    }

    const across = Math.hypot(width, depth);
    this.lift = Math.min(10, Math.max(1, (0.13 * across) / this.tallest)); // heights are drawn taller
    this.far = 2.1 * across;
    this.sinYaw = Math.sin(this.yaw);
    this.cosYaw = Math.cos(this.yaw);
    this.sinPitch = Math.sin(this.pitch);
    this.cosPitch = Math.cos(this.pitch);
    const extentX = Math.abs(width * this.cosYaw) + Math.abs(depth * this.sinYaw);
    const extentY = Math.abs(width * this.sinYaw) + Math.abs(depth * this.cosYaw);
    const heightSeen = extentY * this.sinPitch + this.tallest * this.lift * this.cosPitch;
    this.near = 1.05 * this.zoom
      * Math.min(free / (extentX * 1.22), high / (heightSeen * 1.12));
    [this.middleX, this.middleY] = this.middle;
    this.stamp = [this.tilted, this.width, this.height, this.left, this.right, this.below, this.zoom, this.x, this.y, this.z,
      this.yaw, this.pitch].join();
  }

  /** Write a point's place in the picture into `out`: px, py, and the pixels per metre there. */
  project(x, y, z, out) {
    if (!this.tilted) {
      out[0] = this.middleX + (x - this.x) * this.scale;
      out[1] = this.middleY - (y - this.y) * this.scale;
      out[2] = this.scale;
      return out;
    }
    const dx = x - this.x;
    const dy = y - this.y;
    const right = dx * this.cosYaw - dy * this.sinYaw;
    const back = dx * this.sinYaw + dy * this.cosYaw;
    const up = (z - this.z) * this.lift;
    const depth = Math.max(this.far / 20, this.far + back * this.cosPitch - up * this.sinPitch);
    const scale = (this.near * this.far) / depth;
    out[0] = this.middleX + scale * right;
    out[1] = this.middleY - scale * (back * this.sinPitch + up * this.cosPitch);
    out[2] = scale;
    return out;
  }

  /** The distance of a point, by which the farther things are drawn first. */
  depth(x, y, z) {
    const dx = x - this.size.width / 2;
    const dy = y - this.size.depth / 2;
    const back = dx * this.sinYaw + dy * this.cosYaw;
    return back * this.cosPitch - z * this.lift * this.sinPitch;
  }

  /** The pixels per metre in the middle of the picture. */
  get pixelsPerMetre() { return this.tilted ? this.near : this.scale; }

  mapX(px) { return this.x + (px - this.middleX) / this.scale; }

  mapY(py) { return this.y - (py - this.middleY) / this.scale; }
}

function clampMiddle(middle, half, size) {
  return 2 * half >= size ? size / 2 : Math.min(size - half, Math.max(half, middle));
}
