/** The best concepts of a stream's newest answer. They stay in their places, so that a link can be hit between two. */
import { h } from "../../parts/elements.js";
import { linkTo } from "../../place.js";

const LISTED = 5; // concepts
const PROTOTYPES = 5; // pictures of each

export class Ranked {
  constructor() {
    this.rows = Array.from({ length: LISTED }, () => new Row());
    this.element = h("ol", { class: "ranked" }, this.rows.map((row) => row.element));
  }

  /** @param {Object} answer of one object. @param {?import("../../parts/model.js").Model} model once it is known. */
  show(answer, model) {
    const own = answer.concepts.filter((concept) => concept.time === answer.time); // those of other times follow
    const responses = own.map((concept) => concept.response);
    const [closest, farthest] = [Math.min(...responses), Math.max(...responses)];
    const closeness = (response) => (farthest > closest ? (farthest - response) / (farthest - closest) : 1);
    this.rows.forEach((row, place) => row.show(own[place], closeness, answer, model));
  }
}

class Row {
  constructor() {
    this.name = h("a", { class: "rank-name" });
    this.fill = h("span", { class: "bar-fill" });
    this.number = h("span", { class: "number fine" });
    this.pictures = h("span", { class: "thumbnails" });
    this.element = h("li", { class: "rank" }, h("span", { class: "rank-title" }, this.name),
      h("span", { class: "bar-track" }, this.fill), this.number, this.pictures);
  }

  show(concept, closeness, answer, model) {
    this.element.classList.toggle("hidden", concept === undefined);
    if (!concept) return;
    const reference = `${answer.model}:${answer.version}`;
    this.name.textContent = concept.name ?? `Concept ${concept.id}`;
    this.name.href = linkTo("concepts", { model: reference, concept: concept.id });
    this.fill.style.width = `${Math.max(1, 100 * closeness(concept.response))}%`;
    this.number.textContent = concept.response.toFixed(1);
    if (!model || this.pictured === `${reference} ${concept.id}`) return;
    this.pictured = `${reference} ${concept.id}`;
    this.fill.style.background = model.tree.colour(concept.id);
    this.pictures.replaceChildren(...[...model.tree.objectsOf(concept.id)].slice(0, PROTOTYPES)
      .map((object) => model.thumbnails.show(object)));
  }
}
