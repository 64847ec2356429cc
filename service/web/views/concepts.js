/**
 * Concepts: what a model learned, in four linked views with one selection: barcode, merge tree, map, and list.
 *
 * All that depends on the filtration time follows from the annexation graph, which is loaded once: nothing is asked of
 * the service while the time is dragged. The URL holds model, time and concept.
 */
import { h } from "../parts/elements.js";
import { loadModel } from "../parts/model.js";
import { modelChooser } from "../parts/model_chooser.js";
import { failure, loading } from "../parts/states.js";
import { Barcode } from "./concepts/barcode.js";
import { ConceptMap } from "./concepts/map.js";
import { Detail } from "./concepts/detail.js";
import { List } from "./concepts/list.js";
import { Selection } from "./concepts/selection.js";
import { TimeControl } from "./concepts/time_control.js";
import { Tree } from "./concepts/tree.js";

/** @param {HTMLElement} root @param {import("../place.js").Place} place */
export function show(root, place) {
  const view = new Concepts(root, place);
  view.begin();
  return { changed: () => view.followPlace(), leave: () => view.leave() };
}

class Concepts {
  constructor(root, place) {
    this.root = root;
    this.place = place;
    this.body = h("div", {});
    this.parts = [];
    this.selection = null;
  }

  async begin() {
    const asked = this.place.get("model");
    this.asked = asked; // what the URL says
    this.wanted = undefined;
    this.close();
    const chooser = h("div", {});
    this.root.replaceChildren(h("h1", { class: "unseen" }, "Concepts"), chooser, this.body);
    this.body.replaceChildren(loading("Loading the model …"));
    try {
      const made = await modelChooser(asked, (chosen) => {
        this.place.set({ model: chosen, time: null, concept: null }, { push: true });
        this.asked = chosen;
        this.load(chosen);
      });
      if (this.left || this.asked !== asked) return; // meanwhile, another one was asked for
      chooser.replaceChildren(made.element);
      await this.load(made.reference);
    } catch (error) {
      if (this.asked === asked) this.body.replaceChildren(failure(error, { again: () => this.begin() }));
    }
  }

  /** Shows a model. */
  async load(reference) {
    this.close();
    this.wanted = reference;
    this.body.replaceChildren(loading("Loading the model …"));
    try {
      const model = await loadModel(reference);
      if (this.wanted === reference) this.#fill(model); // otherwise another one was chosen meanwhile
    } catch (error) {
      if (this.wanted !== reference) return;
      this.body.replaceChildren(failure(error, { again: () => this.load(reference) }));
    }
  }

  /** The user went back or forward. */
  followPlace() {
    if (this.place.get("model") !== this.asked) this.begin();
    else this.selection?.take(this.place);
  }

  leave() {
    this.left = true;
    this.wanted = undefined;
    this.close();
  }

  close() {
    for (const part of this.parts) part.close?.();
    this.parts = [];
    this.selection = null;
  }

  #fill(model) {
    const selection = new Selection(model);
    this.selection = selection;
    const time = new TimeControl(selection);
    const [barcode, tree, map] = [new Barcode(selection), new Tree(selection), new ConceptMap(selection)];
    const [list, detail] = [new List(selection), new Detail(selection)];
    this.parts = [time, barcode, tree, map, list, detail];
    this.body.replaceChildren(
      time.element,
      h(
        "div",
        { class: "concepts" },
        h("div", { class: "column" }, barcode.element, tree.element),
        h("div", { class: "column" }, map.element, list.element),
        detail.element,
      ),
    );
    selection.onChange(() => this.parts.forEach((part) => part.update()));
    selection.onSettle(() => {
      this.asked = model.reference;
      this.place.set({ model: model.reference, time: selection.timeText(), concept: selection.picked });
    });
    selection.take(this.place);
  }
}
