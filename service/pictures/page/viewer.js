"use strict";
// Draws points as small discs into a picture of its own, the nearest in front: no WebGL, which not every machine has.

const EDGE = 0.35; // how dark the rim of what lies before something else gets
const FAR = 0.4; // how dark what is far away gets
const DIM = 0.82; // how far points that are not highlighted go into the background

function unpack(text, Type) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Type(bytes.buffer);
}

function rgb(name) {
  return [1, 3, 5].map((at) => parseInt(name.slice(at, at + 2), 16));
}

class Viewer {
  constructor(canvas, cloud) {
    this.canvas = canvas;
    this.points = unpack(cloud.points, Int16Array); // about the middle, in steps
    this.segments = unpack(cloud.segments, Int16Array);
    this.count = this.segments.length;
    this.disc = cloud.spacing / cloud.step;
    let most = 1;
    for (const value of this.points) most = Math.max(most, Math.abs(value));
    this.size = most;
    this.only = null; // the segments that are highlighted
    this.home();
    this.listen();
    new ResizeObserver(() => this.ask()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.ask());
  }

  home() {
    [this.yaw, this.pitch, this.zoom] = [0.45, 0.3, 1];
    this.fit();
    this.ask();
  }

  fit() {
    // how far the cloud reaches to the side and down as it is seen at first, so that it fills the view
    this.reach = [1e-3, 1e-3];
    const turned = this.turned();
    for (let i = 0; i < this.count; i++) {
      const [right, down, far] = turned(i);
      this.reach[0] = Math.max(this.reach[0], Math.abs(right / far));
      this.reach[1] = Math.max(this.reach[1], Math.abs(down / far));
    }
  }

  turned() {
    // a point as a pinhole camera at four sizes' distance sees it: to the right, down, and far
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const points = this.points;
    return (i) => {
      const [x, y, z] = [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
      const ahead = z * cy - x * sy;
      return [x * cy + z * sy, y * cp - ahead * sp, 4 * this.size + ahead * cp + y * sp];
    };
  }

  colour(values, colours) {
    this.values = values;
    this.colours = colours.map(rgb);
    this.ask();
  }

  highlight(segments) {
    this.only = segments && new Set(segments);
    this.ask();
  }

  ask() {
    if (!this.asked) this.asked = requestAnimationFrame(() => ((this.asked = 0), this.draw()));
  }

  turn(right, down) {
    this.yaw += right;
    this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + down));
    this.ask();
  }

  near(factor) {
    this.zoom = Math.max(0.3, Math.min(12, this.zoom * factor));
    this.ask();
  }

  listen() {
    const held = new Map(); // fingers
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) return;
      const apart = () => {
        const [a, b] = [...held.values()];
        return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
      };
      const [x, y] = held.get(event.pointerId);
      const before = held.size > 1 ? apart() : 0;
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size > 1) this.near(apart() / before);
      else this.turn((event.clientX - x) / 150, (event.clientY - y) / 150);
    });
    for (const end of ["pointerup", "pointercancel"])
      this.canvas.addEventListener(end, (event) => held.delete(event.pointerId));
    this.canvas.addEventListener("dblclick", () => this.home());
    this.canvas.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey && document.activeElement !== this.canvas) return; // the page scrolls
        event.preventDefault();
        this.near(Math.exp(-event.deltaY / 500));
      },
      { passive: false },
    );
    const keys = {
      ArrowLeft: () => this.turn(-0.15, 0),
      ArrowRight: () => this.turn(0.15, 0),
      ArrowUp: () => this.turn(0, -0.15),
      ArrowDown: () => this.turn(0, 0.15),
      "+": () => this.near(1.2),
      "-": () => this.near(1 / 1.2),
      Home: () => this.home(),
    };
    this.canvas.addEventListener("keydown", (event) => {
      if (keys[event.key]) {
        event.preventDefault();
        keys[event.key]();
      }
    });
  }

  draw() {
    const density = Math.min(devicePixelRatio || 1, 2);
    const width = Math.round(this.canvas.clientWidth * density);
    const height = Math.round(this.canvas.clientHeight * density);
    if (!width || !height || !this.values) return;
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    const front = this.project(width, height);
    this.canvas.getContext("2d").putImageData(this.shade(front, width, height), 0, 0);
  }

  project(width, height) {
    const depth = new Float32Array(width * height).fill(Infinity);
    const owner = new Int32Array(width * height).fill(-1); // the point that each pixel shows
    const turned = this.turned();
    const focal = 0.47 * this.zoom * Math.min(width / this.reach[0], height / this.reach[1]);
    for (let i = 0; i < this.count; i++) {
      const [right, down, far] = turned(i);
      if (far < 0.5 * this.size) continue;
      const [u, v] = [width / 2 + (focal * right) / far, height / 2 + (focal * down) / far];
      const radius = Math.max(0.8, Math.min(30, (0.9 * focal * this.disc) / far));
      const [left, last] = [Math.max(0, Math.ceil(u - radius)), Math.min(width - 1, Math.floor(u + radius))];
      const [top, bottom] = [Math.max(0, Math.ceil(v - radius)), Math.min(height - 1, Math.floor(v + radius))];
      for (let row = top; row <= bottom; row++)
        for (let column = left; column <= last; column++) {
          if ((row - v) ** 2 + (column - u) ** 2 > radius * radius + 0.4) continue;
          const at = row * width + column;
          if (far < depth[at]) [depth[at], owner[at]] = [far, i];
        }
    }
    return { depth, owner };
  }

  shade({ depth, owner }, width, height) {
    // eye-dome lighting after Boucheny 2009: a pixel is darkened by how far it lies behind its neighbours
    const image = new ImageData(width, height);
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const ground = dark ? [26, 31, 38] : [255, 255, 255];
    const reach = Math.max(1, Math.round(width / 500));
    for (let row = 0; row < height; row++)
      for (let column = 0; column < width; column++) {
        const at = row * width + column;
        const point = owner[at];
        if (point < 0) continue;
        let behind = 0;
        for (const beside of [at - reach, at + reach, at - reach * width, at + reach * width])
          if (depth[beside] < Infinity) behind += Math.max(0, depth[at] - depth[beside] - 2 * this.disc);
        const far = (depth[at] / this.size - 3) / 2; // 0 to 1
        const light = Math.max(1 - EDGE, Math.exp((-5 * behind) / this.size)) * (1.08 - FAR * far);
        const colour = this.colours[this.values[point]];
        const dim = this.only && !this.only.has(this.segments[point]) ? DIM : 0;
        for (let part = 0; part < 3; part++)
          image.data[4 * at + part] = light * (colour[part] + dim * (ground[part] - colour[part]));
        image.data[4 * at + 3] = 255;
      }
    return image;
  }
}
