// From metres to pixels: a flat map seen from above, or the city in perspective.

const MARGIN = 14;

export class Camera {
  constructor(run) {
    const [width, depth] = run.map.size_m;
    this.size = { width, depth };
    this.tallest = Math.max(1, ...run.map.cell_height_m.map((column) => Math.max(...column)));
    this.tilted = false;
    this.width = this.height = 1;
    this.reset();
  }

  reset() {
    this.zoom = 1;
    this.x = this.size.width / 2; // in the middle of the picture
    this.y = this.size.depth / 2;
    this.yaw = -0.5;
    this.pitch = 0.72;
    this.update();
  }

  resize(width, height) {
    this.width = width;
    this.height = height;
    this.update();
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(1.5, Math.max(0.2, this.pitch + pitch));
    this.update();
  }

  /** Move the picture by so many pixels. */
  pan(dx, dy) {
    if (this.tilted) return;
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
    this.update();
  }

  /** Zoom by a factor; the point of the map under (px, py) stays there. */
  zoomBy(factor, px = this.width / 2, py = this.height / 2) {
    const [fromX, fromY] = [this.mapX(px), this.mapY(py)];
    this.zoom = Math.min(24, Math.max(this.tilted ? 0.5 : 1, this.zoom * factor));
    this.update();
    if (!this.tilted) {
      this.x += fromX - this.mapX(px);
      this.y += fromY - this.mapY(py);
      this.update();
    }
  }

  update() {
    const { width, depth } = this.size;
    const fit = Math.min((this.width - 2 * MARGIN) / width, (this.height - 2 * MARGIN) / depth);
    this.scale = Math.max(1e-6, fit) * this.zoom;
    const halfX = this.width / this.scale / 2;
    const halfY = this.height / this.scale / 2;
    const room = MARGIN / this.scale;
    this.x = clampMiddle(this.x, halfX - room, width);
    this.y = clampMiddle(this.y, halfY - room, depth);

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
      * Math.min(this.width / (extentX * 1.14), this.height / (heightSeen * 1.12));
    this.stamp = [this.tilted, this.width, this.height, this.zoom, this.x, this.y,
      this.yaw, this.pitch].join();
  }

  /** Where a point is in the picture: px, py, and the pixels a metre has there, into `out`. */
  project(x, y, z, out) {
    if (!this.tilted) {
      out[0] = this.width / 2 + (x - this.x) * this.scale;
      out[1] = this.height / 2 - (y - this.y) * this.scale;
      out[2] = this.scale;
      return out;
    }
    const dx = x - this.size.width / 2;
    const dy = y - this.size.depth / 2;
    const right = dx * this.cosYaw - dy * this.sinYaw;
    const back = dx * this.sinYaw + dy * this.cosYaw;
    const up = z * this.lift;
    const depth = this.far + back * this.cosPitch - up * this.sinPitch;
    const scale = (this.near * this.far) / depth;
    out[0] = this.width / 2 + scale * right;
    out[1] = this.height * 0.495 - scale * (back * this.sinPitch + up * this.cosPitch);
    out[2] = scale;
    return out;
  }

  /** How far away a point is, to draw what is behind first. */
  depth(x, y, z) {
    const dx = x - this.size.width / 2;
    const dy = y - this.size.depth / 2;
    const back = dx * this.sinYaw + dy * this.cosYaw;
    return back * this.cosPitch - z * this.lift * this.sinPitch;
  }

  mapX(px) { return this.x + (px - this.width / 2) / this.scale; }

  mapY(py) { return this.y - (py - this.height / 2) / this.scale; }
}

function clampMiddle(middle, half, size) {
  return 2 * half >= size ? size / 2 : Math.min(size - half, Math.max(half, middle));
}
