/** Turns, moves and zooms a camera about a target: with mouse, fingers, or keys. */

const TURN = 0.008; // radians a pixel
const STEP = 12; // pixels that an arrow key stands for
const MOVED = 0.3; // radii by which what is followed may move or grow before the camera does

export class Orbit {
  /**
   * @param {HTMLElement} element that is dragged, and takes the keys when it has the focus.
   * @param {function(boolean): void} onMove called after each change; whether more of the same are to come.
   */
  constructor(element, onMove) {
    this.onMove = onMove;
    this.pointers = new Map();
    this.look([0, 0, 0], 1);
    element.addEventListener("pointerdown", (event) => this.#down(element, event));
    element.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel"]) element.addEventListener(name, (event) => this.#up(event));
    element.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    element.addEventListener("keydown", (event) => this.#key(event));
    element.addEventListener("dblclick", () => this.reset());
  }

  /** Looks at a target as the sensor did, from so far that a sphere of a radius about it fits in. */
  look(target, radius) {
    this.home = { target: [...target], distance: radius * 3 };
    this.reset();
  }

  /** Looks at what has moved or changed from the side and as near as before; not at all as long as it is in place. */
  follow(target, radius) {
    const { home } = this;
    const moved = Math.hypot(...target.map((value, axis) => value - home.target[axis]));
    const grown = (radius * 3.2) / home.distance;
    if (moved < MOVED * radius && grown > 1 - MOVED && grown < 1 + MOVED) return;
    this.home = { target: [...target], distance: radius * 3.2 };
    this.target = this.target.map((value, axis) => value - home.target[axis] + target[axis]);
    this.distance *= grown;
    this.onMove(false);
  }

  /** The view that `look` gave, a little from the side and from above: the third dimension shows. */
  reset() {
    this.target = [...this.home.target];
    this.distance = this.home.distance;
    this.azimuth = 0.24;
    this.elevation = 0.2;
    this.onMove(false);
  }

  /** The camera's axes right, down and forward, row by row: nine numbers. */
  get rotation() {
    const [sa, ca, se, ce] = [
      Math.sin(this.azimuth),
      Math.cos(this.azimuth),
      Math.sin(this.elevation),
      Math.cos(this.elevation),
    ];
    // At 0 and 0 it is the sensor's own: x right, y down, z forward.
    return [ca, 0, -sa, -se * sa, ce, -se * ca, ce * sa, se, ce * ca];
  }

  #turn(right, down) {
    this.azimuth -= right * TURN;
    this.elevation = Math.min(1.55, Math.max(-1.55, this.elevation + down * TURN));
  }

  #shift(right, down, scale) {
    const axes = this.rotation;
    for (let axis = 0; axis < 3; axis += 1) {
      this.target[axis] -= (right * axes[axis] + down * axes[3 + axis]) * scale;
    }
  }

  #zoom(factor) {
    this.distance = Math.min(this.home.distance * 8, Math.max(this.home.distance * 0.08, this.distance * factor));
  }

  #down(element, event) {
    element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  #move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [right, down] = [now[0] - before[0], now[1] - before[1]];
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)[1];
      const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
      this.#zoom(Math.max(1, apart(before)) / Math.max(1, apart(now)));
      this.#shift(right / 2, down / 2, this.distance / 500);
    } else if (event.buttons === 2 || event.shiftKey) this.#shift(right, down, this.distance / 500);
    else this.#turn(right, down);
    this.pointers.set(event.pointerId, now);
    this.onMove(true);
  }

  #up(event) {
    if (this.pointers.delete(event.pointerId)) this.onMove(false);
  }

  #wheel(event) {
    if (document.activeElement !== event.currentTarget && !event.ctrlKey) return; // the page scrolls past it
    event.preventDefault();
    this.#zoom(Math.exp(event.deltaY * 0.0012));
    this.onMove(true);
    clearTimeout(this.still);
    this.still = setTimeout(() => this.onMove(false), 150);
  }

  #key(event) {
    const arrows = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
    if (arrows[event.key] && event.shiftKey) this.#shift(...arrows[event.key], this.distance / 500);
    else if (arrows[event.key]) this.#turn(...arrows[event.key]);
    else if (event.key === "+" || event.key === "=") this.#zoom(0.9);
    else if (event.key === "-") this.#zoom(1.1);
    else if (event.key === "Home") this.reset();
    else return;
    event.preventDefault();
    this.onMove(false);
  }
}
