/** Try: a cloud or a scene in, the concepts that it resembles out, and why. */
import * as api from "../api.js";
import { h } from "../parts/elements.js";
import { faultOf } from "../parts/files.js";
import { loadModel } from "../parts/model.js";
import { modelChooser } from "../parts/model_chooser.js";
import { readPoints } from "../parts/ply.js";
import { empty, failure, loading } from "../parts/states.js";
import { answerPanel } from "./try/answer.js";
import { CloudPanel } from "./try/cloud_panel.js";
import { describe, Input } from "./try/input.js";
import { objectsPanel } from "./try/objects.js";

const FRESH =
  "Drop a file anywhere on this page, pick one, or start with a sample: simulated objects that the built-in " +
  "model has never seen.";

/** @param {HTMLElement} root @param {import("../place.js").Place} place */
export function show(root, place) {
  const trial = new Trial(root, place);
  trial.begin();
  return { changed: () => trial.followPlace(), leave: () => trial.leave() };
}

class Trial {
  constructor(root, place) {
    this.root = root;
    this.place = place;
    this.cloudPanel = new CloudPanel(place, (object) => this.#showObject(object));
    this.answer = h("section", { class: "try-answer", "aria-label": "Answer" });
    this.input = new Input(place, { onCloud: (cloud) => this.ask(cloud), onSample: () => this.askAboutSample() });
    this.asking = null;
  }

  /** Fills the view, and asks about the sample that the URL names. */
  async begin() {
    const chooser = h("div", { class: "choosers" });
    const first = h("div", { class: "try-first" }, this.input.element, this.cloudPanel.element);
    this.root.replaceChildren(
      h("h1", { class: "unseen" }, "Try a cloud"),
      chooser,
      h("div", { class: "try" }, first, this.answer),
    );
    this.endDropping?.();
    this.endDropping = this.input.takeDrops(this.root.ownerDocument.body);
    this.#rest();
    try {
      const { element, reference } = await modelChooser(this.place.get("model"), (chosen) => this.#chooseModel(chosen));
      this.reference = reference;
      chooser.replaceChildren(element, this.#timeChooser());
      await this.input.begin();
    } catch (error) {
      this.answer.replaceChildren(failure(error, { again: () => this.begin() }));
      return;
    }
    if (!this.left) this.followPlace();
  }

  leave() {
    this.left = true;
    this.asking?.abort();
    this.endDropping?.();
    this.cloudPanel.close();
  }

  /** Asks about the sample that the URL names, unless that was asked already. */
  followPlace() {
    if (this.place.get("sample") && this.place.get("sample") !== this.cloud?.name) this.askAboutSample();
    else this.cloudPanel.recolour();
  }

  /** Asks about the sample that the URL names. */
  async askAboutSample() {
    const { signal } = this.#askAnew();
    try {
      const sample = await this.input.sample(this.place.get("sample"), signal);
      if (sample) this.ask(sample);
    } catch (error) {
      if (!signal.aborted) this.#fail(error, () => this.askAboutSample());
    }
  }

  /** Gives up what was asked before. @returns {AbortController} of what is asked now. */
  #askAnew() {
    this.asking?.abort();
    this.asking = new AbortController();
    return this.asking;
  }

  /**
   * Shows a cloud's points and asks which concepts it resembles; what was asked before is given up.
   *
   * @param {import("./try/input.js").Cloud} cloud
   */
  async ask(cloud) {
    const asking = this.#askAnew();
    this.cloud = cloud;
    this.cloudPanel.begin(cloud);
    this.answer.replaceChildren(loading(`Asking about ${cloud.name} …`));
    const fault = (await faultOf(cloud.data)) ?? (cloud.mask && (await faultOf(cloud.mask)));
    if (asking.signal.aborted) return;
    if (fault) {
      this.cloudPanel.fail();
      this.#fail(fault);
      return;
    }
    const seeing = this.#points(cloud, asking.signal).catch((error) => error);
    try {
      const [answer, model] = await Promise.all([this.#respond(cloud, asking.signal), loadModel(this.reference)]);
      if (this.asking !== asking) return;
      this.#showAnswer(answer, model, cloud);
      const points = await seeing;
      if (this.asking !== asking) return;
      if (points instanceof Error) this.cloudPanel.fail(failure(points, { again: () => this.ask(cloud) }));
      else this.cloudPanel.explain(answer, model, cloud.scene);
    } catch (error) {
      if (error.name !== "AbortError" && this.asking === asking) this.#fail(error);
      await seeing;
    }
  }

  async #points(cloud, signal) {
    try {
      const response = await api.request("v1/points", {
        method: "POST",
        body: describe(cloud),
        query: cloud.reading,
        signal,
      });
      const points = readPoints(await response.arrayBuffer());
      this.cloudPanel.show(points);
      return points;
    } catch (error) {
      if (error.name !== "AbortError") this.cloudPanel.fail();
      throw error;
    }
  }

  #respond(cloud, signal) {
    const query = {
      ...cloud.reading,
      model: this.reference,
      time: this.place.number("time"),
      scene: cloud.scene || null,
      detail: "concepts,segments,explanation",
    };
    return api.get("v1/responses", { method: "POST", body: describe(cloud), query, signal });
  }

  #showAnswer(answer, model, cloud) {
    const ways = { highlight: (segments) => this.cloudPanel.highlight(segments) };
    this.shown = { answer, model, ways };
    if (!cloud.scene) this.answer.replaceChildren(answerPanel(answer, model, ways));
    else this.#showObject(answer.objects.find((one) => one.answer)?.number ?? null);
  }

  /** Of a scene: shows the answer of one of its objects. */
  #showObject(number) {
    const { answer, model, ways } = this.shown;
    const object = answer.objects[number];
    const list = objectsPanel(answer, model, number, (chosen) => this.#showObject(chosen));
    const own = object?.answer ? answerPanel(object.answer, model, ways) : object && failure(refusalOf(object.error));
    this.answer.replaceChildren(...[list, own].filter(Boolean));
    this.cloudPanel.chooseObject(number);
  }

  #timeChooser() {
    const field = h("input", {
      id: "answer-time",
      type: "number",
      min: 0,
      max: 1,
      step: "any",
      placeholder: "the model's",
      value: this.place.get("time"),
      title: "0: specific, 1: generic; without one, the concepts of the model's own time come first, then others",
      change: () => {
        this.place.set({ time: field.value });
        if (this.cloud) this.ask(this.cloud);
      },
    });
    return h("label", { class: "chooser" }, "Filtration time ", field);
  }

  #chooseModel(reference) {
    this.reference = reference;
    this.place.set({ model: reference });
    if (this.cloud) this.ask(this.cloud);
  }

  #fail(error, again = () => this.ask(this.cloud)) {
    this.answer.replaceChildren(failure(error, { again }));
  }

  #rest() {
    this.answer.replaceChildren(h("div", { class: "panel" }, empty(FRESH)));
  }
}

function refusalOf({ type, detail }) {
  return new api.Problem({ status: 422, title: "This object could not be answered", detail, type });
}
