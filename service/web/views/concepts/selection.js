/** The one selection that all views of the concepts share: a filtration time, and a concept. */

export class Selection {
  /** @param {import("../../parts/model.js").Model} model */
  constructor(model) {
    this.model = model;
    this.listeners = { change: [], settle: [] };
    this.picked = null; // the concept that was chosen, at whatever time
    this.#at(model.epsilonMax);
  }

  /** Calls a function whenever something changes, also while the time is dragged. */
  onChange(listener) {
    this.listeners.change.push(listener);
  }

  /** Calls a function when a change is done: the URL is written then. */
  onSettle(listener) {
    this.listeners.settle.push(listener);
  }

  /** Takes over what the URL says. */
  take(place) {
    const [time, concept] = [place.number("time"), place.number("concept")];
    const { tree, epsilonMax } = this.model;
    this.picked = concept !== null && Number.isInteger(concept) && tree.isConcept(concept) ? concept : null;
    this.#at(Math.min(1, Math.max(0, time ?? epsilonMax)));
    this.#tell("change");
  }

  /** Goes to a time. @param {boolean} done whether no more of the same are to come. */
  setTime(time, done = true) {
    this.#at(Math.min(1, Math.max(0, time)));
    this.#tell("change");
    if (done) this.#tell("settle");
  }

  /** Chooses a concept; null for none. */
  pick(concept) {
    this.picked = concept !== null && concept >= 0 ? concept : null;
    this.#tell("change");
    this.#tell("settle");
  }

  /** Says that names have changed. */
  renamed() {
    this.#tell("change");
  }

  /** The concept of this time that the chosen one is, is part of, or becomes; null for none. */
  get shown() {
    const found = this.picked === null ? -1 : this.model.tree.conceptFor(this.picked, this.time);
    return found < 0 ? null : found;
  }

  /** The time for the URL; null where it is the model's own. */
  timeText() {
    return this.time === this.model.epsilonMax ? null : String(Number(this.time.toFixed(4)));
  }

  #at(time) {
    this.time = time;
    const { tree } = this.model;
    this.concepts = tree.conceptsAt(time);
    this.assignment = tree.assignmentAt(time);
    this.held = this.concepts.reduce((sum, concept) => sum + tree.size[concept], 0);
  }

  #tell(kind) {
    for (const listener of this.listeners[kind]) listener();
  }
}
