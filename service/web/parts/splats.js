/**
 * Draws points into an image: no graphics driver is needed, so that it looks the same in every browser and robot.
 *
 * Each point becomes a disc about as large as its distance to the next one, and the nearest wins; then the depths of
 * the image tell how it is lit, so that a cloud needs no normals.
 */
const FAR = Infinity;
const STRENGTH = 7;
const SPAN = 5; // neighbours on each side whose depths make a slope
const CLIFF = 0.04; // doublings of the distance beyond which a neighbour is part of something else
const LARGEST = 11; // pixels across a disc
const INSETS = Array.from({ length: LARGEST + 1 }, (_, size) =>
  Array.from({ length: size }, (_, row) => {
    const up = (row + 0.5) / size - 0.5;
    return size < 4 ? 0 : Math.round(size * (0.5 - Math.sqrt(Math.max(0, 0.29 - up * up))));
  }).map((inset) => Math.max(0, inset)),
); // pixels that a disc's rows are shorter than it is wide, on each side

/** An image of points, and of which point each pixel shows. */
export class Splats {
  /** Makes room for an image. */
  resize(width, height) {
    Object.assign(this, { width, height });
    this.image = new ImageData(width, height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.depth = new Float32Array(width * height); // logarithms
    this.shown = new Int32Array(width * height);
  }

  /**
   * Draws points.
   *
   * @param {Float32Array} points x, y, z of each.
   * @param {Uint32Array} colours of each, 0xAABBGGRR.
   * @param {number} count how many are drawn: the first ones.
   * @param {{rotation: number[], target: number[], distance: number, focal: number}} camera `rotation`: its axes right,
   *   down and forward, row by row; `target`: what it looks at, from a `distance`; `focal`: pixels.
   * @param {number} spacing distance of neighbouring points.
   */
  draw(points, colours, count, camera, spacing) {
    const { width, height, depth, pixels, shown } = this;
    depth.fill(FAR);
    pixels.fill(0);
    shown.fill(-1);
    const [a, b, c, d, e, f, g, h, i] = camera.rotation;
    const [tx, ty, tz] = camera.target;
    const nearest = camera.distance * 0.02;
    for (let n = 0; n < count; n += 1) {
      const x = points[3 * n] - tx;
      const y = points[3 * n + 1] - ty;
      const z = points[3 * n + 2] - tz;
      const away = g * x + h * y + i * z + camera.distance;
      if (!(away > nearest)) continue;
      const scale = camera.focal / away;
      const u = width / 2 + (a * x + b * y + c * z) * scale;
      const v = height / 2 + (d * x + e * y + f * z) * scale;
      const size = Math.min(LARGEST, Math.max(1, Math.round(spacing * scale * 1.8)));
      const left = Math.round(u - size / 2);
      const top = Math.round(v - size / 2);
      if (left + size <= 0 || top + size <= 0 || left >= width || top >= height) continue;
      const log = Math.log2(away);
      const colour = colours[n];
      for (let row = Math.max(0, top); row < Math.min(height, top + size); row += 1) {
        const inset = INSETS[size][row - top];
        const end = row * width + Math.min(width, left + size - inset);
        for (let at = row * width + Math.max(0, left + inset); at < end; at += 1) {
          if (log < depth[at]) {
            depth[at] = log;
            pixels[at] = colour;
            shown[at] = n;
          }
        }
      }
    }
  }

  /**
   * Shades the image as if a lamp shone from above the left shoulder: by the slopes of what it shows, from its depths.
   *
   * Slopes are means over some pixels, as depths of sensors are noisy. Pixels far behind a neighbour are darkened.
   *
   * @param {number} focal pixels.
   * @param {number} step pixels between the depths that are compared.
   */
  shade(focal, step) {
    const { width, height, depth, pixels } = this;
    const margin = Math.round(SPAN * step);
    for (let row = 0; row < height; row += 1) {
      for (let column = 0; column < width; column += 1) {
        const at = row * width + column;
        const own = depth[at];
        if (own === FAR) continue;
        const inside = row >= margin && row < height - margin && column >= margin && column < width - margin;
        if (!inside) continue;
        const right = this.#slope(at, own, step) * focal;
        const down = this.#slope(at, own, step * width) * focal;
        const facing = (0.8 - 0.34 * right - 0.5 * down) / Math.sqrt(1 + right * right + down * down);
        const light = (0.66 + 0.42 * Math.max(0, facing)) * this.#shadow(at, own, step);
        const colour = pixels[at];
        const red = Math.min(255, (colour & 0xff) * light);
        const green = Math.min(255, ((colour >>> 8) & 0xff) * light);
        const blue = Math.min(255, ((colour >>> 16) & 0xff) * light);
        pixels[at] = ((colour & 0xff000000) | (blue << 16) | (green << 8) | red) >>> 0;
      }
    }
  }

  /** How much farther the surface gets with each pixel of a direction, as a share of its distance. */
  #slope(at, own, step) {
    const { depth } = this;
    let rise = 0;
    let run = 0;
    for (let far = 1; far <= SPAN; far += 1) {
      const [before, after] = [depth[at - far * step], depth[at + far * step]];
      if (Math.abs(before - own) > CLIFF || Math.abs(after - own) > CLIFF) continue;
      rise += after - before;
      run += 2 * far;
    }
    return run ? (rise / run) * (Math.LN2 / (step >= this.width ? step / this.width : step)) : 0;
  }

  /** How dark a pixel is that lies behind its neighbours. */
  #shadow(at, own, step) {
    const { depth, width } = this;
    let behind = 0;
    for (const neighbour of [depth[at - step], depth[at + step], depth[at - step * width], depth[at + step * width]]) {
      if (neighbour !== FAR && own - neighbour > CLIFF / 2) behind += Math.min(own - neighbour, 0.2);
    }
    return Math.max(0.45, Math.exp(-STRENGTH * behind));
  }

  /** The point that is shown at a pixel or right beside it, -1 for none. */
  at(u, v, reach = 3) {
    let best = -1;
    let nearest = FAR;
    for (let row = Math.max(0, v - reach); row <= Math.min(this.height - 1, v + reach); row += 1) {
      for (let column = Math.max(0, u - reach); column <= Math.min(this.width - 1, u + reach); column += 1) {
        const away = (row - v) ** 2 + (column - u) ** 2;
        const found = this.shown[row * this.width + column];
        if (found >= 0 && away < nearest) [best, nearest] = [found, away];
      }
    }
    return best;
  }
}

/** The distance of neighbouring points of a surface: from the area that they cover, by the cells they fill. */
export function spacingOf(points, count, radius) {
  const cell = radius / 24;
  const filled = new Set();
  const step = Math.max(1, Math.floor(count / 20000));
  for (let n = 0; n < count; n += step) {
    const [x, y, z] = [0, 1, 2].map((axis) => Math.floor(points[3 * n + axis] / cell) + 500);
    filled.add(x + 1000 * (y + 1000 * z));
  }
  return Math.sqrt((filled.size * cell * cell) / Math.max(1, count));
}

/** The middle of points, and the radius about it that holds nearly all of them. */
export function boundsOf(points, count) {
  const middle = [0, 1, 2].map((axis) => {
    const values = [];
    const step = Math.max(1, Math.floor(count / 5000));
    for (let n = 0; n < count; n += step) values.push(points[3 * n + axis]);
    values.sort((one, other) => one - other);
    const at = (share) => values[Math.floor(share * (values.length - 1))] ?? 0;
    return (at(0.01) + at(0.99)) / 2;
  });
  const away = [];
  const step = Math.max(1, Math.floor(count / 5000));
  for (let n = 0; n < count; n += step) {
    away.push(Math.hypot(...middle.map((value, axis) => points[3 * n + axis] - value)));
  }
  away.sort((one, other) => one - other);
  return { middle, radius: Math.max(away[Math.floor(0.98 * (away.length - 1))] ?? 1, 1e-4) };
}
