/** What is asked about: a file that was dropped or picked, or a sample; and how it is to be read. */
import * as api from "../../api.js";
import { counted, h } from "../../parts/elements.js";

/**
 * @typedef {Object} Cloud
 * @property {string} name of the file.
 * @property {Blob} data
 * @property {Blob|null} mask of a depth image.
 * @property {boolean} scene whether it is a whole scene.
 * @property {Object} reading parameters of the request that say how it is read: unit, viewpoint, intrinsics ...
 */

const UNITS = ["m", "dm", "cm", "mm", "um", "in", "ft"];
const FORMATS = "PCD, PLY, XYZ and other text, NPY, NPZ, JSON, ROS 2 PointCloud2 (CDR), depth images (PNG, NPY)";

/** The form of a request that brings a cloud: the name tells the format where the content does not. */
export function describe(cloud) {
  const form = new FormData();
  // Browsers guess media types by the endings; some of these endings are those of other things.
  form.append("cloud", new Blob([cloud.data], { type: "application/octet-stream" }), cloud.name);
  if (cloud.mask) form.append("mask", new Blob([cloud.mask], { type: "application/octet-stream" }), "mask");
  return form;
}

export class Input {
  /**
   * @param {import("../../place.js").Place} place
   * @param {{onCloud: function(Cloud): void, onSample: function(): void}} told `onCloud`: what is to be asked about;
   *   `onSample`: that the URL names a sample to be asked about.
   */
  constructor(place, { onCloud, onSample }) {
    this.place = place;
    this.onCloud = onCloud;
    this.onSample = onSample;
    this.samples = [];
    this.current = null; // what was asked about last
    this.note = h("p", { class: "fine", role: "status" });
    this.buttons = h("div", { class: "samples", role: "group", "aria-label": "Samples" });
    this.element = this.#fill();
  }

  /** Offers the samples. */
  async begin() {
    const { element, buttons } = this;
    if (this.samples.length) return;
    this.samples = await api.get("page/samples/index.json");
    buttons.replaceChildren(...this.samples.map((sample) => this.#button(sample)));
    buttons.prepend(h("span", { class: "fine" }, "Samples"));
    element.querySelector(".drop").after(buttons);
  }

  /** The sample of a file's name, null where there is none. @returns {Promise<Cloud|null>} */
  async sample(file, signal) {
    const sample = this.samples.find((one) => one.file === file);
    for (const button of this.buttons.querySelectorAll("button"))
      button.setAttribute("aria-pressed", String(button.dataset.file === file));
    if (!sample) return null;
    this.note.textContent = "";
    const data = await (await api.request(`page/samples/${sample.file}`, { signal })).blob();
    this.element.querySelector(`[value=${sample.scene ? "scene" : "object"}]`).checked = true;
    this.current = { name: sample.file, data, mask: null, scene: sample.scene, reading: {} };
    return this.current;
  }

  /** Takes files that are dropped anywhere on an element; returns a function that ends this. */
  takeDrops(element) {
    let depth = 0;
    const listeners = {
      dragenter: () => element.classList.toggle("dropping", (depth += 1) > 0),
      dragleave: () => element.classList.toggle("dropping", (depth -= 1) > 0),
      dragover: (event) => event.preventDefault(),
      drop: (event) => {
        event.preventDefault();
        depth = 0;
        element.classList.remove("dropping");
        const { files } = event.dataTransfer;
        if (files.length) this.#take(files[0], files.length);
      },
    };
    for (const [name, listener] of Object.entries(listeners)) element.addEventListener(name, listener);
    return () => {
      for (const [name, listener] of Object.entries(listeners)) element.removeEventListener(name, listener);
    };
  }

  #fill() {
    this.file = h("input", {
      type: "file",
      class: "unseen",
      id: "file",
      change: () => this.file.files[0] && this.#take(this.file.files[0]),
    });
    this.kind = h(
      "fieldset",
      { class: "choice", change: () => this.current && this.#tell(this.current) },
      h("legend", { class: "unseen" }, "What the file shows"),
      [
        ["object", "One object"],
        ["scene", "A whole scene"],
      ].map(([value, text]) =>
        h("label", {}, h("input", { type: "radio", name: "kind", value, checked: value === "object" }), ` ${text}`),
      ),
    );
    return h(
      "section",
      { class: "panel try-input", "aria-label": "Cloud" },
      h(
        "div",
        { class: "drop" },
        h("label", { for: "file", class: "button" }, "Pick a file"),
        this.file,
        h("span", {}, " or drop one"),
        this.kind,
      ),
      this.note,
      this.#options(),
    );
  }

  #options() {
    const field = (name, label, more) =>
      h("div", {}, h("label", { for: `read-${name}` }, label), h("input", { id: `read-${name}`, name, ...more }));
    this.reading = h(
      "form",
      {
        class: "reading",
        submit: (event) => {
          event.preventDefault();
          if (this.current) this.#tell(this.current);
        },
      },
      h(
        "div",
        {},
        h("label", { for: "read-unit" }, "Unit"),
        h(
          "select",
          { id: "read-unit", name: "unit" },
          h("option", { value: "" }, "the file's own, or metres"),
          UNITS.map((unit) => h("option", {}, unit)),
        ),
      ),
      field("viewpoint", "Viewpoint of the sensor", { placeholder: "x,y,z or x,y,z,qw,qx,qy,qz" }),
      field("intrinsics", "Camera of a depth image", { placeholder: "fx,fy,cx,cy" }),
      field("depth_scale", "Metres of a depth of 1", { type: "number", step: "any", min: "0", placeholder: "0.001" }),
      field("mask", "Mask of a depth image", { type: "file" }),
      h("button", { type: "submit" }, "Ask again"),
    );
    return h(
      "details",
      {},
      h("summary", {}, "Formats, unit, viewpoint, depth camera"),
      h("p", { class: "fine" }, `Taken: ${FORMATS}.`),
      this.reading,
    );
  }

  #button(sample) {
    const choose = () => {
      this.place.set({ sample: sample.file }, { push: true });
      this.onSample();
    };
    const title = `${counted(sample.points)} points`;
    return h(
      "button",
      { type: "button", "data-file": sample.file, "aria-pressed": "false", title, click: choose },
      sample.title,
    );
  }

  /** Asks about a file. @param {number} of how many that were dropped. */
  #take(file, of = 1) {
    this.note.textContent = of > 1 ? `Of the ${of} files, only ${file.name} is asked about: drop one at a time.` : "";
    this.place.set({ sample: null });
    this.sample(null);
    this.#tell({ name: file.name, data: file });
    this.file.value = ""; // the same file may be picked again, altered
  }

  /** Asks about a file, read as the form says. */
  #tell({ name, data }) {
    const given = new FormData(this.reading);
    const reading = Object.fromEntries(
      ["unit", "viewpoint", "intrinsics", "depth_scale"].map((one) => [one, given.get(one).trim()]),
    );
    const mask = given.get("mask");
    const scene = this.kind.querySelector("[value=scene]").checked;
    this.current = { name, data, mask: mask.size ? mask : null, scene, reading };
    this.onCloud(this.current);
  }
}
