/** The concepts of a time: sizes, names, purity where labels exist, some prototypes. */
import { counted, h } from "../../parts/elements.js";
import { keepingFocus } from "../../parts/focus.js";
import { purityOf, titleOf } from "../../parts/model.js";
import { empty } from "../../parts/states.js";
import { swatch } from "../try/painting.js";

const FIRST = 60; // concepts that are listed at first
const MORE = 200; // with each further step
const PROTOTYPES = 4; // pictures of each
const PAUSE = 100; // milliseconds

export class List {
  /** @param {import("./selection.js").Selection} selection */
  constructor(selection) {
    this.selection = selection;
    this.most = FIRST;
    this.body = h("div", { class: "concept-list" });
    this.element = h(
      "section",
      { class: "panel", "aria-label": "List of concepts" },
      h("h2", {}, "Concepts"),
      this.body,
    );
  }

  /** Builds the rows anew, a few times a second while the time is dragged: each brings pictures with it. */
  update() {
    this.waiting ??= setTimeout(
      () => {
        this.waiting = null;
        this.#fill();
      },
      this.body.childElementCount ? PAUSE : 0,
    );
  }

  close() {
    clearTimeout(this.waiting);
  }

  #fill() {
    const { concepts, shown, model } = this.selection;
    if (!concepts.length) {
      this.body.replaceChildren(empty("At this time no two objects are one concept yet: move towards generic."));
      return;
    }
    const listed = concepts.slice(0, this.most);
    if (shown !== null && !listed.includes(shown)) listed.push(shown);
    const rest = concepts.length - listed.length;
    const more = h(
      "button",
      {
        type: "button",
        class: "quiet",
        click: () => {
          this.most += MORE;
          this.#fill();
        },
      },
      `Show ${Math.min(rest, MORE)} more`,
    );
    const rows = listed.map((concept) => this.#row(concept, shown, model));
    keepingFocus(this.body, () => this.body.replaceChildren(...rows, ...(rest > 0 ? [more] : [])));
  }

  #row(concept, shown, model) {
    const purity = purityOf(model, concept);
    return h(
      "button",
      {
        type: "button",
        class: "concept-row",
        "data-concept": concept,
        "aria-pressed": String(concept === shown),
        click: () => this.selection.pick(concept === shown ? null : concept),
      },
      swatch(model.tree.colour(concept)),
      h(
        "span",
        { class: "concept-title" },
        titleOf(model, concept),
        purity && h("span", { class: "fine block" }, `${purity.category}, ${Math.round(100 * purity.share)} % pure`),
      ),
      h("span", { class: "number" }, counted(model.tree.size[concept])),
      h(
        "span",
        { class: "thumbnails" },
        [...model.tree.objectsOf(concept).slice(0, PROTOTYPES)].map((object) =>
          model.thumbnails.show(object, model.objects[object].key),
        ),
      ),
    );
  }
}
