/** One robot's newest cloud from all sides, coloured by segment, and what it was answered. */
import { CloudView } from "../../parts/cloud_view.js";
import { colourOf, toPixel } from "../../parts/colours.js";
import { h } from "../../parts/elements.js";
import { loadModel } from "../../parts/model.js";
import { Ranked } from "./ranked.js";

export class Detail {
  constructor() {
    this.cloud = new CloudView({ label: "The newest cloud, coloured by segment" });
    this.drawn = h("p", { class: "fine number" });
    this.title = h("h2");
    this.ranked = new Ranked();
    this.said = h("div");
    this.facts = h("p", { class: "fine number" });
    this.key = null; // whose cloud is drawn
    this.model = { reference: null, loaded: null }; // that answered last; null while it is loaded, or cannot be
    this.element = h("div", { class: "live-detail" },
      h("div", { class: "panel live-cloud" }, this.cloud.element, this.drawn),
      h("div", { class: "panel live-answer" }, this.title, this.ranked.element, this.said, this.facts));
  }

  close() {
    this.cloud.close();
  }

  /** Another robot is looked at. @param {?string} key of one that has published nothing yet. */
  clear(key = null) {
    this.key = null;
    this.cloud.setPoints(new Float32Array());
    this.cloud.setMarks([]);
    this.drawn.textContent = "No cloud to draw yet.";
    this.title.textContent = key ?? "";
    this.ranked.element.classList.add("hidden");
    this.said.replaceChildren(...(key === null ? [] : [h("p", {}, "Nothing has come on this key yet.")]));
    this.facts.textContent = "";
  }

  /** @param {Object} told an event of /v1/streams/events. */
  show(told) {
    const { key, answer, problem } = told;
    if (told.cloud) this.#draw(told);
    else if (key !== this.key) this.clear();
    this.title.textContent = key;
    const lone = answer !== null && !answer.objects;
    this.ranked.element.classList.toggle("hidden", !lone);
    if (lone) this.ranked.show(answer, this.#modelOf(`${answer.model}:${answer.version}`));
    this.said.replaceChildren(...(problem ? problemOf(problem) : lone ? measured(answer) : sceneOf(answer)));
    this.facts.textContent = factsOf(told);
  }

  #draw({ key, cloud, answer }) {
    const points = new Float32Array(octets(cloud.xyz).buffer);
    const parts = new Int16Array(octets(cloud.parts).buffer);
    this.cloud.setPoints(points, { follow: key === this.key });
    this.key = key;
    const colours = new Map();
    for (const part of new Set(parts)) colours.set(part, toPixel(colourOf(part)));
    this.cloud.setColours(Uint32Array.from(parts, (part) => colours.get(part)));
    this.cloud.setMarks((answer?.objects ?? []).map((object) => ({
      position: object.sensor_position_m,
      element: h("span", { class: "mark" }, object.number),
    })));
    this.drawn.textContent = cloud.points < cloud.measured
      ? `${cloud.points.toLocaleString("en")} of ${cloud.measured.toLocaleString("en")} points`
      : `${cloud.points.toLocaleString("en")} points`;
  }

  /** What is known of a model beside its answers: pictures and colours. It is loaded once, and not waited for. */
  #modelOf(reference) {
    if (this.model.reference !== reference) {
      const model = { reference, loaded: null };
      this.model = model;
      loadModel(reference).then((loaded) => { model.loaded = loaded; }, () => {});
    }
    return this.model.loaded;
  }
}

function octets(base64) {
  const text = atob(base64);
  const found = new Uint8Array(text.length);
  for (let place = 0; place < text.length; place += 1) found[place] = text.charCodeAt(place);
  return found;
}

function measured(answer) {
  return [h("p", { class: "number" }, `Novelty ${Math.round(100 * answer.novelty)} %, ${answer.segments} segments, `
    + `${(100 * answer.extent_m).toFixed(1)} cm across`),
  ...answer.warnings.map((warning) => h("p", { class: "warning" }, warning))];
}

function sceneOf(answer) {
  const rows = answer.objects.map((object) => {
    const swatch = h("span", { class: "swatch" });
    swatch.style.background = colourOf(object.number);
    return h("tr", {}, h("td", {}, swatch, ` ${object.number}`), h("td", {}, nameOf(object)),
      h("td", { class: "number" }, object.answer ? `${Math.round(100 * object.answer.novelty)} %` : "–"),
      h("td", { class: "number" }, `${object.distance_m.toFixed(2)} m`));
  });
  const heads = ["Object", "Best concept", "Novelty", "Away"].map((head) => h("th", { scope: "col" }, head));
  return [h("p", {}, `${answer.objects.length} ${answer.objects.length === 1 ? "object" : "objects"} on a plane`),
    ...answer.warnings.map((warning) => h("p", { class: "warning" }, warning)),
    h("div", { class: "wide" }, h("table", {}, h("thead", {}, h("tr", {}, heads)), h("tbody", {}, rows)))];
}

function nameOf({ answer, error }) {
  const best = answer?.concepts[0];
  return best ? best.name ?? `Concept ${best.id}` : error?.detail ?? "not answered";
}

function problemOf(problem) {
  return [h("div", { class: "state state-error" }, h("p", { class: "title" }, problem.title),
    h("p", {}, problem.detail))];
}

function factsOf({ answer, problem, latency_s: latency }) {
  const { source } = answer ?? problem;
  const took = answer && Object.values(answer.timings_ms).reduce((total, each) => total + each, 0);
  return [answer && `${answer.model}:${answer.version}`, took && `answered in ${took.toFixed(0)} ms`,
    latency !== null && `${Math.round(1000 * latency)} ms after it was published`,
    source.sequence !== null && `cloud ${source.sequence}`,
    source.frame_id && `frame ${source.frame_id}`].filter(Boolean).join(" · ");
}
