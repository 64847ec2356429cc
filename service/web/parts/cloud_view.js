/** A cloud to look at from all sides: points with colours, some of them highlighted, and marks that name places. */
import { onLightChange } from "./colours.js";
import { h } from "./elements.js";
import { Orbit } from "./orbit.js";
import { boundsOf, spacingOf, Splats } from "./splats.js";

const MOVING = 40000; // points that are drawn while the camera moves
const MOST_PIXELS = 1_000_000;
const PALE = 0.22; // what is left of the colour of points that are not highlighted

export class CloudView {
  /**
   * @param {{label: string, onHover: function(number): void, onPick: function(number): void}} told `label`: what the
   *   picture shows, in words; `onHover`, `onPick`: told the number of the point below the pointer, -1 for none.
   */
  constructor({ label = "Point cloud", onHover, onPick } = {}) {
    this.canvas = h("canvas", {
      class: "cloud-canvas",
      tabindex: "0",
      role: "img",
      "aria-label": `${label}. Arrow keys turn it, plus and minus zoom, Home resets.`,
    });
    this.marks = h("div", { class: "cloud-marks" });
    this.element = h("div", { class: "cloud" }, this.canvas, this.marks);
    this.splats = new Splats();
    this.count = 0;
    this.orbit = new Orbit(this.canvas, (moving) => this.#redraw(moving));
    this.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    this.#listen(onHover, onPick);
    this.resizing = new ResizeObserver(() => this.#resize());
    this.resizing.observe(this.element);
    this.endLight = onLightChange(() => this.#redraw(false));
  }

  /** Ends its listening; the element may be removed then. */
  close() {
    this.resizing.disconnect();
    this.endLight();
    cancelAnimationFrame(this.frame);
  }

  /**
   * Shows other points.
   *
   * @param {Float32Array} points x, y, z of each, metres, in the sensor's frame.
   * @param {{keep?: boolean, follow?: boolean}} how `keep`: the camera stays where it is, as for a cloud that moves;
   *   `follow`: it goes with the cloud, and looks from the same side.
   */
  setPoints(points, { keep = false, follow = false } = {}) {
    this.points = points;
    this.count = points.length / 3;
    this.colours = new Uint32Array(this.count).fill(0xffa0948b);
    this.lit = null;
    const { middle, radius } = boundsOf(points, this.count);
    this.spacing = spacingOf(points, this.count, radius);
    if (follow) this.orbit.follow(middle, radius);
    else if (!keep) this.orbit.look(middle, radius);
    this.#redraw(false);
  }

  /** Colours the points: 0xAABBGGRR of each, as `toPixel` of colours.js makes them. */
  setColours(colours) {
    this.colours = colours;
    this.#redraw(false);
  }

  /** Highlights points: all others turn pale. @param {Uint8Array|null} lit not 0 for those; null for all alike. */
  setHighlight(lit) {
    this.lit = lit;
    this.#redraw(false);
  }

  /** Names places in it. @param {{position: number[], element: HTMLElement}[]} marks in the points' frame. */
  setMarks(marks) {
    this.placed = marks;
    this.marks.replaceChildren(...marks.map((mark) => mark.element));
    this.#redraw(false);
  }

  #listen(onHover, onPick) {
    const found = (event) => {
      const box = this.canvas.getBoundingClientRect();
      const scale = this.canvas.width / box.width;
      return this.splats.width
        ? this.splats.at(Math.round((event.clientX - box.left) * scale), Math.round((event.clientY - box.top) * scale))
        : -1;
    };
    let pressed = null;
    this.canvas.addEventListener("pointerdown", (event) => (pressed = [event.clientX, event.clientY]));
    this.canvas.addEventListener("pointermove", (event) => !event.buttons && onHover?.(found(event)));
    this.canvas.addEventListener("pointerleave", () => onHover?.(-1));
    this.canvas.addEventListener("click", (event) => {
      const moved = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4;
      if (!moved) onPick?.(found(event));
    });
  }

  #resize() {
    const { width, height } = this.element.getBoundingClientRect();
    if (!width || !height) return;
    const scale = Math.min(devicePixelRatio || 1, 2, Math.sqrt(MOST_PIXELS / (width * height)));
    this.canvas.width = Math.max(1, Math.round(width * scale));
    this.canvas.height = Math.max(1, Math.round(height * scale));
    this.splats.resize(this.canvas.width, this.canvas.height);
    this.#redraw(false);
  }

  #redraw(moving) {
    this.moving = moving;
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.#draw();
    });
  }

  #draw() {
    if (!this.points || !this.splats.width) return;
    const { width, height } = this.canvas;
    const count = this.moving ? Math.min(this.count, MOVING) : this.count;
    const spacing = this.spacing * Math.sqrt(this.count / Math.max(1, count));
    const { rotation, target, distance } = this.orbit;
    const camera = { rotation, target, distance, focal: 1.35 * Math.min(width, height) };
    this.splats.draw(this.points, this.lit ? this.#paled() : this.colours, count, camera, spacing);
    this.splats.shade(camera.focal, this.canvas.width > this.element.clientWidth * 1.4 ? 2 : 1);
    this.canvas.getContext("2d").putImageData(this.splats.image, 0, 0);
    this.#place(camera);
  }

  #paled() {
    const paled = new Uint32Array(this.count);
    const alpha = (PALE * 255) << 24;
    for (let n = 0; n < this.count; n += 1) {
      paled[n] = this.lit[n] ? this.colours[n] : ((this.colours[n] & 0xffffff) | alpha) >>> 0;
    }
    return paled;
  }

  #place({ rotation, target, distance, focal }) {
    const scale = this.element.clientWidth / this.canvas.width;
    for (const { position, element } of this.placed ?? []) {
      const own = position.map((value, axis) => value - target[axis]);
      const [right, down, away] = [0, 3, 6].map((row) =>
        own.reduce((sum, value, axis) => sum + value * rotation[row + axis], 0),
      );
      const zoom = focal / Math.max(1e-6, away + distance);
      element.style.left = `${(this.canvas.width / 2 + right * zoom) * scale}px`;
      element.style.top = `${(this.canvas.height / 2 + down * zoom) * scale}px`;
      element.hidden = away + distance <= 0;
    }
  }
}
