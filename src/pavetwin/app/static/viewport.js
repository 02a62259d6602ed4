// Which part of the world a canvas shows, and the transforms between both. Pixels are those of the page.

const CLOSEST = 60, FARTHEST = 0.02;

export class Viewport {
  #root;
  /** `{ x, y, k }`: the place in the middle, in metres of the world, and pixels a metre; null before anything is shown. */
  view = null;

  /** @param root the element that the canvas fills */
  constructor(root) { this.#root = root; }

  get size() { return { width: this.#root.clientWidth || 1, height: this.#root.clientHeight || 1 }; }
  /** Pixels of the canvas for one of the page. */
  get ratio() { return devicePixelRatio || 1; }
  /** In metres. */
  get pixel() { return 1 / this.view.k; }

  /** Show an area. */
  show(west, south, east, north, margin) {
    const { width, height } = this.size;
    const k = Math.min(CLOSEST, Math.min(width / (east - west), height / (north - south)) / margin);
    this.view = { x: (west + east) / 2, y: (south + north) / 2, k };
  }

  /** Show a place, at least as close as `k`. */
  showPlace(x, y, k) { this.view = { x, y, k: Math.max(this.view?.k ?? k, k) }; }

  /** Move the middle to a place; returns whether it was elsewhere. */
  centre(x, y) {
    if (Math.hypot(x - this.view.x, y - this.view.y) <= 1e-3) return false;
    this.view = { ...this.view, x, y };
    return true;
  }

  /** Zoom around a pixel, which goes on showing the same place; the middle unless given. */
  zoom(factor, x, y) {
    const { width, height } = this.size, [left, top] = [x ?? width / 2, y ?? height / 2];
    const [mx, my] = this.toWorld(left, top), k = Math.min(CLOSEST, Math.max(FARTHEST, this.view.k * factor));
    this.view = { k, x: mx - (left - width / 2) / k, y: my + (top - height / 2) / k };
  }

  /** Move what is shown by pixels. */
  drag(right, down) { this.view = { ...this.view, x: this.view.x - right / this.view.k, y: this.view.y + down / this.view.k }; }

  /** Make a canvas as large as the element. */
  fill(canvas) {
    const { width, height } = this.size;
    canvas.width = Math.round(width * this.ratio);
    canvas.height = Math.round(height * this.ratio);
  }

  /** Draw in metres of the world, y up. */
  metres(pen) {
    const { width, height } = this.size, { x, y, k } = this.view, r = this.ratio;
    pen.setTransform(k * r, 0, 0, -k * r, (width / 2 - x * k) * r, (height / 2 + y * k) * r);
  }

  /** Draw in pixels. */
  pixels(pen) { pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0); }

  toScreen(x, y) {
    const { width, height } = this.size, { x: cx, y: cy, k } = this.view;
    return [width / 2 + (x - cx) * k, height / 2 - (y - cy) * k];
  }

  toWorld(left, top) {
    const { width, height } = this.size, { x, y, k } = this.view;
    return [x + (left - width / 2) / k, y - (top - height / 2) / k];
  }
}
