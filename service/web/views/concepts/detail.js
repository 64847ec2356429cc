/** The chosen concept: its name, which can be given here, its place in the filtration, and its prototypes. */
import * as api from "../../api.js";
import { counted, h } from "../../parts/elements.js";
import { purityOf, renew, titleOf } from "../../parts/model.js";
import { empty, failure } from "../../parts/states.js";
import { swatch } from "../try/painting.js";

const FIRST = 48; // prototypes that are shown at first
const MORE = 200; // with each further step

export class Detail {
  /** @param {import("./selection.js").Selection} selection */
  constructor(selection) {
    this.selection = selection;
    this.element = h("section", { class: "panel detail", "aria-label": "Chosen concept" });
  }

  /** Fills it anew when another concept is shown, or its name changed; what is being typed stays otherwise. */
  update() {
    const { shown, picked, model } = this.selection;
    const state = `${shown} ${picked} ${model.names.get(shown)}`;
    if (state === this.state) return;
    this.state = state;
    if (shown === null) {
      this.element.replaceChildren(
        h("h2", {}, "Chosen concept"),
        empty("Choose a concept in any of the views, to see its prototypes and to name it."),
      );
      return;
    }
    this.element.replaceChildren(
      ...[this.#head(shown, picked, model), this.#naming(shown, model), this.#prototypes(shown, model)].flat(),
    );
  }

  #head(concept, picked, model) {
    const { tree } = model;
    const parent = tree.parent[concept];
    const until = parent < 0 ? "stays to the end" : `is taken in at ${tree.time[parent].toFixed(3)}`;
    const since = `exists from ${tree.time[concept].toFixed(3)}`;
    const purity = purityOf(model, concept);
    const part = this.#isEarly(picked) ? "still in parts: the largest is this one" : "part of this one";
    const related = picked !== concept && `${titleOf(model, picked)} is ${part} now.`;
    return h(
      "div",
      {},
      h("div", { class: "best" }, swatch(tree.colour(concept)), h("h2", {}, titleOf(model, concept))),
      h(
        "p",
        { class: "fine" },
        `Id ${concept}; ${counted(tree.size[concept])} training objects; ${since} and ${until}.`,
      ),
      purity &&
        h(
          "p",
          {},
          `Of ${purity.labelled} labelled objects ${Math.round(100 * purity.share)} % are ${purity.category}.`,
        ),
      related && h("p", { class: "warning" }, related),
    );
  }

  #isEarly(concept) {
    return this.selection.model.tree.time[concept] > this.selection.time;
  }

  #naming(concept, model) {
    const field = h("input", {
      id: "concept-name",
      maxlength: 100,
      value: model.names.get(concept) ?? "",
      autocomplete: "off",
    });
    const trouble = h("div", {});
    const change = async (options) => {
      trouble.replaceChildren();
      try {
        await api.request(`v1/models/${model.reference}/concepts/${concept}/name`, options);
        await renew(model);
        this.selection.renamed();
      } catch (error) {
        trouble.replaceChildren(failure(error));
      }
    };
    const name = (event) => {
      event.preventDefault();
      if (field.value.trim()) change({ method: "PUT", json: { name: field.value } });
    };
    return h(
      "form",
      { class: "naming", submit: name },
      h("label", { for: "concept-name" }, "Name"),
      field,
      h("button", { type: "submit", class: "main" }, "Save"),
      model.names.has(concept) &&
        h("button", { type: "button", click: () => change({ method: "DELETE" }) }, "Take away"),
      trouble,
    );
  }

  #prototypes(concept, model) {
    const objects = [...model.tree.objectsOf(concept)];
    const tiles = h(
      "div",
      { class: "prototypes" },
      objects.slice(0, FIRST).map((object) => this.#tile(object, model)),
    );
    const rest = objects.slice(FIRST);
    const more = h(
      "button",
      {
        type: "button",
        class: "quiet",
        click: () => {
          tiles.append(...rest.splice(0, MORE).map((object) => this.#tile(object, model)));
          more.textContent = `Show ${Math.min(rest.length, MORE)} more`;
          more.hidden = !rest.length;
        },
      },
      `Show ${Math.min(rest.length, MORE)} more`,
    );
    return h("div", {}, h("h3", {}, "Prototypes"), tiles, rest.length > 0 && more);
  }

  #tile(object, model) {
    const category = model.categories[object];
    return h(
      "figure",
      {},
      model.thumbnails.show(object, model.objects[object].key),
      h("figcaption", {}, category ?? object),
    );
  }
}
