/** Pictures of training objects, fetched side by side: many with one request. */
import * as api from "../api.js";
import { h } from "./elements.js";

const EDGE = 48; // pixels
const AT_ONCE = 128; // objects that one request asks for

export class Thumbnails {
  constructor(name, version) {
    this.path = `v1/models/${name}/versions/${version}/objects.png`;
    this.pictures = new Map(); // promises of canvases, by number
    this.waiting = new Map();
  }

  /**
   * An element that shows a training object, as soon as its picture is there.
   *
   * @param {number} number of the object.
   * @param {string} label what it is, for those who do not see it, and as a tooltip.
   */
  show(number, label = `Training object ${number}`) {
    const canvas = h("canvas", {
      class: "thumbnail",
      width: EDGE,
      height: EDGE,
      role: "img",
      "aria-label": label,
      title: label,
    });
    this.picture(number).then(
      (picture) => canvas.getContext("2d").drawImage(picture, 0, 0),
      () => canvas.classList.add("missing"),
    );
    return canvas;
  }

  /** A training object's picture. @returns {Promise<HTMLCanvasElement>} */
  picture(number) {
    if (!this.pictures.has(number)) {
      this.pictures.set(number, new Promise((found, failed) => this.waiting.set(number, { found, failed })));
      if (this.waiting.size === 1) setTimeout(() => this.#fetch());
    }
    return this.pictures.get(number);
  }

  async #fetch() {
    const wanted = [...this.waiting];
    this.waiting = new Map();
    for (let first = 0; first < wanted.length; first += AT_ONCE)
      await this.#fetchSome(wanted.slice(first, first + AT_ONCE));
  }

  async #fetchSome(wanted) {
    try {
      const numbers = wanted.map(([number]) => `number=${number}`).join("&");
      const answer = await api.request(`${this.path}?${numbers}`);
      const sheet = await createImageBitmap(await answer.blob());
      wanted.forEach(([, { found }], place) => found(cut(sheet, place)));
    } catch (error) {
      for (const [number, { failed }] of wanted) {
        this.pictures.delete(number); // it is asked for again when it is to be seen again
        failed(error);
      }
    }
  }
}

/** One object of a sheet, its ground transparent. */
function cut(sheet, place) {
  const canvas = h("canvas", { width: EDGE, height: EDGE });
  const context = canvas.getContext("2d");
  context.drawImage(sheet, -place * EDGE, 0);
  const image = context.getImageData(0, 0, EDGE, EDGE);
  for (let at = 0; at < image.data.length; at += 4) if (image.data[at] === 0) image.data[at + 3] = 0;
  context.putImageData(image, 0, 0);
  return canvas;
}
